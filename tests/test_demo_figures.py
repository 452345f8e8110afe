"""The figures that the demo's clip and models come from move as the motion capture does, and their
keypoints are where the picture shows them. Needs what the scripts need."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("skimage", reason="needs the extra train")
moderngl = pytest.importorskip("moderngl", reason="needs the extra train")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))

from dance2pose.mocap.bvh import read_bvh  # noqa: E402
from dance2pose.mocap.motion import forward_kinematics  # noqa: E402
from figure_renderer.body import Body, build_body  # noqa: E402
from figure_renderer.renderer import Camera  # noqa: E402
from figure_renderer.rig import BONES, read_performance, turn_between  # noqa: E402
from figure_renderer.samples import SampleMaker  # noqa: E402
from figure_renderer.solids import Shape  # noqa: E402

# Bone of the figure: the nodes at its ends in the two rigs.
_ENDS = {
    "left_upper_arm": (("LeftArm", "LeftForeArm"), ("lShldr", "lForeArm")),
    "right_forearm": (("RightForeArm", "RightHand"), ("rForeArm", "rHand")),
    "left_thigh": (("LeftUpLeg", "LeftLeg"), ("lThigh", "lShin")),
    "right_shin": (("RightLeg", "RightFoot"), ("rShin", "rFoot")),
}
_NEXT = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shin", "shin": "foot"}


@pytest.fixture(scope="module")
def opengl() -> None:
    """Skip where no OpenGL can be had, software or not."""
    try:
        moderngl.create_context(standalone=True, backend="egl", require=330).release()
    except Exception as error:
        pytest.skip(f"no OpenGL 3.3 here: {error}")


@pytest.fixture(scope="module")
def body() -> Body:
    return build_body(Shape(stature=1.7), cell_m=0.03)


@pytest.mark.shared
@pytest.mark.parametrize(("take", "rig"), [("02_01", 0), ("94_indian_13", 1)])
def test_limbs_point_where_the_motion_capture_points(
    shared: Path, body: Body, take: str, rig: int
) -> None:
    path = shared / "mocap" / "train" / f"{take}.bvh"
    motion, played = read_bvh(path), read_performance(path)
    nodes, _ = forward_kinematics(motion)
    nodes = nodes[1:] if rig == 0 else nodes  # the rest pose in front
    assert len(played) == len(nodes)
    for k in range(0, len(nodes), len(nodes) // 7):
        joints = body.posed_joints(played.rotation[k], played.pelvis[k])
        for bone, ends in _ENDS.items():
            start, end = (motion.names.index(name) for name in ends[rig])
            side, kind = bone.split("_", 1)
            child = BONES.index(f"{side}_{_NEXT[kind]}")
            figure = joints[child] - joints[BONES.index(bone)]
            truth = nodes[k, end] - nodes[k, start]
            cosine = figure @ truth / np.linalg.norm(figure) / np.linalg.norm(truth)
            assert cosine > 0.9999, (bone, k)


def test_turning_one_direction_into_another() -> None:
    rng = np.random.default_rng(5)
    for a, b in rng.normal(size=(20, 2, 3)):
        turn = turn_between(a, b)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-9)
        np.testing.assert_allclose(turn @ a / np.linalg.norm(a), b / np.linalg.norm(b), atol=1e-9)


def test_the_body_has_two_equal_sides_and_its_stature(body: Body) -> None:
    top, bottom = body.vertices[:, 1].max(), body.vertices[:, 1].min()
    assert top - bottom == pytest.approx(1.7, abs=0.03)
    mirrored = body.keypoints[[0, 2, 1]] * [-1, 1, 1]
    np.testing.assert_allclose(mirrored, body.keypoints[:3], atol=1e-9)
    assert body.keypoints[5, 0] > 0 > body.keypoints[6, 0]  # its left is at +x


def test_the_camera_looks_where_it_is_told() -> None:
    camera = Camera.looking_at(
        np.array([1.0, 2.0, 5.0]), np.array([0.0, 1.0, 0.0]), 900.0, (640, 800)
    )
    np.testing.assert_allclose(camera.project(np.array([0.0, 1.0, 0.0])), [319.5, 399.5])
    above, right = camera.project(np.array([[0.0, 1.2, 0.0], [0.2, 1.0, 0.0]]))
    assert above[1] < 399.5
    assert right[0] > 319.5


@pytest.mark.shared
def test_keypoints_lie_on_the_figure_they_belong_to(shared: Path, opengl: None) -> None:
    path = shared / "mocap" / "train" / "05_01.bvh"
    maker = SampleMaker([read_performance(path, every=20)], cell_m=0.02)
    for _, sample in zip(range(5), maker.samples(11), strict=False):
        x, y = np.round(sample.keypoints[5:17]).astype(int).T  # joints lie within the limbs
        assert (sample.mask[y, x] > 0).mean() > 0.8
        assert 0.01 < (sample.mask > 0).mean() < 0.6


@pytest.mark.shared
def test_the_same_seed_gives_the_same_sample(shared: Path, opengl: None) -> None:
    path = shared / "mocap" / "train" / "02_01.bvh"
    maker = SampleMaker([read_performance(path, every=20)], cell_m=0.03)
    one, two, other = (next(maker.samples(seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.picture, two.picture)
    np.testing.assert_array_equal(one.keypoints, two.keypoints)
    assert not np.array_equal(one.keypoints, other.keypoints)
