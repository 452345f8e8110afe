"""Keypoint skeletons of the body, in their publishers' order and names."""

from __future__ import annotations

from dance2pose.skeleton_tables.model import Skeleton

Edges = tuple[tuple[str, str], ...]

LIMBS: Edges = (
    ("left_shoulder", "right_shoulder"),
    ("left_shoulder", "left_elbow"),
    ("left_elbow", "left_wrist"),
    ("right_shoulder", "right_elbow"),
    ("right_elbow", "right_wrist"),
    ("left_hip", "right_hip"),
    ("left_hip", "left_knee"),
    ("left_knee", "left_ankle"),
    ("right_hip", "right_knee"),
    ("right_knee", "right_ankle"),
)
TRUNK_SIDES: Edges = (("left_shoulder", "left_hip"), ("right_shoulder", "right_hip"))
FACE: Edges = (
    ("nose", "left_eye"),
    ("nose", "right_eye"),
    ("left_eye", "left_ear"),
    ("right_eye", "right_ear"),
)
FEET: Edges = (
    ("left_ankle", "left_big_toe"),
    ("left_ankle", "left_small_toe"),
    ("left_ankle", "left_heel"),
    ("right_ankle", "right_big_toe"),
    ("right_ankle", "right_small_toe"),
    ("right_ankle", "right_heel"),
)
COCO17 = (
    "nose left_eye right_eye left_ear right_ear left_shoulder right_shoulder left_elbow "
    "right_elbow left_wrist right_wrist left_hip right_hip left_knee right_knee left_ankle "
    "right_ankle"
)
COCO_FEET = "left_big_toe left_small_toe left_heel right_big_toe right_small_toe right_heel"
HALPE26 = (
    COCO17 + " head neck hip left_big_toe right_big_toe left_small_toe right_small_toe "
    "left_heel right_heel"
)


def keypoints(name: str, joints: str, edges: Edges) -> Skeleton:
    """A keypoint skeleton from its joints, separated by spaces."""
    return Skeleton(name, tuple(joints.split()), edges)


BODIES = (
    keypoints("coco17", COCO17, FACE + TRUNK_SIDES + LIMBS),
    # COCO-17 and the six foot keypoints, as the first 23 of COCO-WholeBody.
    keypoints("coco23", f"{COCO17} {COCO_FEET}", FACE + TRUNK_SIDES + LIMBS + FEET),
    # OpenPose's COCO model (`--model_pose COCO`).
    keypoints(
        "coco18",
        "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist "
        "right_hip right_knee right_ankle left_hip left_knee left_ankle right_eye left_eye "
        "right_ear left_ear",
        (*FACE, ("nose", "neck"), *TRUNK_SIDES, *LIMBS),
    ),
    keypoints("halpe26", HALPE26, (*FACE, ("head", "neck"), ("neck", "hip"), *LIMBS, *FEET)),
    # OpenPose's BODY_25, its default.
    keypoints(
        "body25",
        "nose neck right_shoulder right_elbow right_wrist left_shoulder left_elbow left_wrist "
        "mid_hip right_hip right_knee right_ankle left_hip left_knee left_ankle right_eye "
        "left_eye right_ear left_ear left_big_toe left_small_toe left_heel right_big_toe "
        "right_small_toe right_heel",
        (*FACE, ("nose", "neck"), ("neck", "mid_hip"), *LIMBS, *FEET),
    ),
    # OpenPose's BODY_25B (openpose_train), another order.
    keypoints(
        "body25b",
        COCO17 + " upper_neck head_top left_big_toe left_small_toe left_heel right_big_toe "
        "right_small_toe right_heel",
        (*FACE, ("head_top", "upper_neck"), *TRUNK_SIDES, *LIMBS, *FEET),
    ),
    keypoints(
        "mpii16",
        "right_ankle right_knee right_hip left_hip left_knee left_ankle pelvis thorax "
        "upper_neck head_top right_wrist right_elbow right_shoulder left_shoulder left_elbow "
        "left_wrist",
        (("head_top", "upper_neck"), ("upper_neck", "thorax"), ("thorax", "pelvis"), *LIMBS),
    ),
    keypoints(
        "h36m17",
        "root right_hip right_knee right_foot left_hip left_knee left_foot spine thorax "
        "neck_base head left_shoulder left_elbow left_wrist right_shoulder right_elbow "
        "right_wrist",
        (
            ("root", "spine"),
            ("spine", "thorax"),
            ("thorax", "neck_base"),
            ("neck_base", "head"),
            *LIMBS[:7],
            ("left_knee", "left_foot"),
            LIMBS[8],
            ("right_knee", "right_foot"),
        ),
    ),
    # MediaPipe Pose.
    keypoints(
        "blazepose33",
        "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye "
        "right_eye_outer left_ear right_ear mouth_left mouth_right left_shoulder "
        "right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky "
        "right_pinky left_index right_index left_thumb right_thumb left_hip right_hip "
        "left_knee right_knee left_ankle right_ankle left_heel right_heel "
        "left_foot_index right_foot_index",
        (
            *FACE,
            ("mouth_left", "mouth_right"),
            *TRUNK_SIDES,
            *LIMBS,
            ("left_wrist", "left_index"),
            ("left_wrist", "left_thumb"),
            ("left_wrist", "left_pinky"),
            ("right_wrist", "right_index"),
            ("right_wrist", "right_thumb"),
            ("right_wrist", "right_pinky"),
            ("left_ankle", "left_heel"),
            ("left_heel", "left_foot_index"),
            ("right_ankle", "right_heel"),
            ("right_heel", "right_foot_index"),
        ),
    ),
)
