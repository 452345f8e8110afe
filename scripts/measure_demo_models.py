"""Measure the bundled demo models: on their clip, on rendered figures, and on a real video.

    python scripts/measure_demo_models.py [--models FOLDER]
        [--pool FOLDER --mocap FOLDER] [--video FILE --detector ONNX --pose ONNX]

--pool: a pool of figures rendered from takes that are not trained on, with bodies, clothes and
places of their own; made there from the BVH takes in --mocap if it is not. --video: a real video,
compared with what the named real models find in it, which stands in for the truth.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np

from dance2pose import demo
from dance2pose.detection import load_detector
from dance2pose.exchange import read_track
from dance2pose.keypoints import KeypointEstimator, load_pose_model
from dance2pose.options import OutputOptions
from dance2pose.poses import Boxes, Track2D
from dance2pose.reconstruction import reconstruct
from demo_training.backgrounds import backgrounds
from figure_renderer.pool import open_pool, start_pool

FIGURES, SEED = 400, 77
SURE = 0.3  # keypoints of the reference models below this confidence are not compared


def on_clip(models: Path) -> None:
    truth = demo.read_truth()
    track = _tracks(demo.asset(demo.CLIP), models / demo.DETECTOR, models / demo.POSE)[0]
    near = _near(track.xy, truth.keypoints[track.frame])
    seen = ~np.isnan(track.xy[:, :17]).all(axis=(1, 2))
    frames = len(truth.time_s)
    print(f"clip: a pose in {seen.sum() / frames:.1%} of {frames} frames")
    print(f"clip: PCK@0.2 body {near[:, :17].sum() / (17 * frames):.3f}, "
          f"feet {near[:, 17:].sum() / (6 * frames):.3f}")  # fmt: skip


def on_pool(folder: Path, models: Path) -> None:
    """Rendered figures, half of them over procedural pictures; the model gets true boxes, and
    the detector the same pictures whole."""
    pool, rng = open_pool(folder), np.random.default_rng(7)
    pictures = backgrounds(7, 40, pool.pictures.shape[1])
    detector = load_detector(models / demo.DETECTOR)
    estimator = load_pose_model(models / demo.POSE)
    assert isinstance(estimator, KeypointEstimator)
    near, found, overlap = [], 0, []
    rows = pool.ready()
    for row in rows:
        picture, mask = pool.pictures[row][..., :3], pool.pictures[row][..., 3]
        if pool.state[row] == 1:
            behind = pictures[rng.integers(len(pictures))]
            picture = np.where(mask[..., None] > 127, picture, behind)
        image = np.ascontiguousarray(picture[..., ::-1])
        x, y, w, h = cv2.boundingRect((mask > 127).astype(np.uint8))
        box = np.array([[x, y, x + w, y + h]], float)
        keypoints = pool.keypoints[row]
        estimated = estimator.estimate(image, Boxes(box, np.ones(1)))
        near.append(_near(estimated.xy, keypoints[None])[0])
        boxes = detector.detect(image)
        best = max((_iou(b, box[0]) for b in boxes.xyxy), default=0.0)
        overlap.append(best)
        found += best >= 0.5
    hits = np.array(near)
    print(f"rendered: {len(rows)} figures never trained on; PCK@0.2 body "
          f"{hits[:, :17].mean():.3f}, feet {hits[:, 17:].mean():.3f}; detector recall at IoU 0.5 "
          f"{found / len(rows):.3f}, mean IoU {np.mean(overlap):.2f}")  # fmt: skip


def on_video(video: Path, models: Path, detector: Path, pose: Path) -> None:
    """Against what real models find, whoever dances: of several tracks in a frame the most
    prominent counts."""
    reference = _poses(video, detector, pose)
    found = _poses(video, models / demo.DETECTOR, models / demo.POSE)
    near, sure = np.zeros((len(reference), 17), bool), np.zeros((len(reference), 17), bool)
    for k, (frame, (xy, confidence)) in enumerate(sorted(reference.items())):
        sure[k] = confidence >= SURE
        if frame in found:
            near[k] = _near(found[frame][0][None], xy[None])[0] & sure[k]
    posed = len(found.keys() & reference.keys()) / len(reference)
    each = near.sum(0) / np.maximum(sure.sum(0), 1)
    print(f"{video.name}: a pose in {posed:.1%} of the {len(reference)} frames where the real "
          f"models have one; PCK@0.2 {near.sum() / sure.sum():.3f} of the keypoints that they are "
          f"sure of; by keypoint {np.round(each, 2).tolist()}")  # fmt: skip


def _poses(video: Path, detector: Path, pose: Path) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Frame index to keypoints (17, 2) and confidence (17,) of the most prominent dancer."""
    poses: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    for track in _tracks(video, detector, pose):
        for k, frame in enumerate(track.frame):
            if not np.isnan(track.xy[k]).all():
                poses.setdefault(int(frame), (track.xy[k, :17], track.confidence[k, :17]))
    return poses


def _near(xy: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """(T, J) whether each keypoint lies within 0.2 torso lengths; NaN does not."""
    joints = truth.shape[1]
    return (
        np.linalg.norm(xy[:, :joints] - truth, axis=-1)
        <= demo.NEAR_TORSO * demo.torso_length(truth)[:, None]
    )


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    inner = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    both = float(np.clip(inner, 0, None).prod())
    return both / float((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod() - both)


def _tracks(video: Path, detector: Path, pose: Path) -> list[Track2D]:
    """The tracks of the whole chain, the most prominent dancer first; COCO keypoints."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out.rrd"
        no_picture = OutputOptions(picture="none")
        files = reconstruct(video, out, outputs=no_picture, detector=detector, pose=pose).files
        return [read_track(path) for path in files if path.name.endswith(".track.npz")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--models", type=Path, default=demo.asset(demo.CLIP).parent)
    parser.add_argument("--pool", type=Path)
    parser.add_argument("--mocap", type=Path)
    parser.add_argument("--video", type=Path)
    parser.add_argument("--detector", type=Path)
    parser.add_argument("--pose", type=Path)
    arguments = parser.parse_args()
    on_clip(arguments.models)
    if arguments.pool:
        if not (arguments.pool / "state.npy").exists():
            for renderer in start_pool(
                arguments.pool, arguments.mocap, FIGURES, seed=SEED, workers=1, test=True
            ):
                renderer.wait()
        on_pool(arguments.pool, arguments.models)
    if arguments.video:
        on_video(arguments.video, arguments.models, arguments.detector, arguments.pose)


if __name__ == "__main__":
    main()
