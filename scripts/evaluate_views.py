"""Compare poses lifted from single views with a reference triangulated from all of them.

    python scripts/evaluate_views.py calibration.qca.xml cam01.mp4 cam02.mp4 cam03.mp4 cam04.mp4 \
        --detector D.onnx --pose P.onnx -o report.md

Several calibrated, synchronised videos of one person. 2D keypoints of every view are triangulated
into a reference (direct linear transformation, then views that disagree are left out); every view
is then lifted alone, by the paper's lifter and by the default one, and the error of each after
Procrustes alignment (no reflection) is reported. The reference is itself made of the detections:
what all views get wrong alike does not show.

A camera belongs to the video whose file name ends in its serial. Calibration: Qualisys (.qca.xml),
intrinsics in 1/64 px, positions in mm.
"""

from __future__ import annotations

import argparse
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dance2pose import exchange, skeleton, smoothing
from dance2pose.detection import load_detector
from dance2pose.keypoints import KeypointEstimator, load_pose_model
from dance2pose.lifting.lift import lift
from dance2pose.poses import FloatArray, Track2D, Track3D
from dance2pose.progress import for_terminal
from dance2pose.tracking.tracker import Tracker
from dance2pose.video import open_video

_FRACTIONS = 64.0  # of a pixel, in which Qualisys writes intrinsics
_AGREE_PX = (
    25.0  # at the size of the sensor: how far a view may lie from the reference's projection
)
_FEWEST_VIEWS = 3


@dataclass(frozen=True)
class View:
    """camera_from_world (3, 4) mm and intrinsics (3, 3) for pictures `height` px high."""

    serial: str
    camera_from_world: FloatArray
    intrinsics: FloatArray
    height: float

    def project(self, xyz: FloatArray) -> FloatArray:
        """Sensor px (..., 2) of world points (..., 3); lens distortion (here < 3 px) left out."""
        matrix = self.camera_from_world
        image = (xyz @ matrix[:, :3].T + matrix[:, 3]) @ self.intrinsics.T
        return np.asarray(image[..., :2] / image[..., 2:])

    def fov_deg(self, image_size: tuple[int, int]) -> float:
        """Field of view across the longer side of pictures of the whole height of the sensor."""
        longer = max(image_size) * self.height / image_size[1]
        return float(2 * np.degrees(np.arctan(longer / 2 / self.intrinsics[0, 0])))


def read_calibration(path: Path) -> list[View]:
    views = []
    for camera in ElementTree.parse(path).getroot().iter("camera"):
        transform, lens = camera.find("transform"), camera.find("intrinsic")
        field = camera.find("fov_video")
        if transform is None or lens is None or field is None:
            sys.exit(f"{path}: camera {camera.get('serial')} has no transform, intrinsic or fov")
        t = {key: float(value) for key, value in transform.items()}
        k = {key: float(value) / _FRACTIONS for key, value in lens.items()}
        world_from_camera = np.array([[t[f"r{i}{j}"] for i in (1, 2, 3)] for j in (1, 2, 3)])
        # Qualisys cameras look along -z with y up; ours look along z with y down.
        rotation = np.diag([1.0, -1.0, -1.0]) @ world_from_camera.T
        position = np.array([t["x"], t["y"], t["z"]])
        intrinsics = np.array(
            [
                [k["focalLengthU"], 0, k["centerPointU"]],
                [0, k["focalLengthV"], k["centerPointV"]],
                [0, 0, 1],
            ]
        )
        height = float(field.get("bottom", "nan")) - float(field.get("top", "nan")) + 1
        matrix = np.concatenate([rotation, -(rotation @ position)[:, None]], axis=1)
        views.append(View(str(camera.get("serial")), matrix, intrinsics, height))
    return views


def track_of(video: Path, detector: Path, pose: Path) -> Track2D:
    """The keypoints of the most prominent person."""
    find, estimate = load_detector(detector), load_pose_model(pose)
    if not isinstance(estimate, KeypointEstimator):
        sys.exit(f"{pose}: expected a model that estimates keypoints inside boxes")
    tracker = None
    with open_video(video) as frames:
        for frame in for_terminal(quiet=False).track(
            frames, video.name, total=frames.expected_frames, unit="frame"
        ):
            if tracker is None:
                height, width = frame.image.shape[:2]
                tracker = Tracker(estimate.skeleton, (width, height))
            boxes = find.detect(frame.image)
            poses = estimate.estimate(frame.image, boxes)
            tracker.update(frame.index, frame.time_s, boxes, poses, cut=False, image=frame.image)
    tracks = tracker.finish("largest") if tracker else []
    if not tracks:
        sys.exit(f"{video}: no person was found")
    return max(tracks, key=len)


def triangulate(views: list[View], xy: FloatArray, weights: FloatArray) -> FloatArray:
    """World points (N, 3) mm from sensor px (V, N, 2); weights (V, N). NaN with too few views."""
    weights = np.where(np.isfinite(xy).all(axis=-1), weights, 0.0)
    for _ in range(3):
        xyz = _intersect(views, np.nan_to_num(xy), weights)
        off = np.stack(
            [np.linalg.norm(v.project(xyz) - p, axis=-1) for v, p in zip(views, xy, strict=True)]
        )
        off = np.where(weights > 0, off, -1.0)
        worst = off == off.max(axis=0)
        weights = np.where(worst & (off > _AGREE_PX), 0.0, weights)
    agree = (weights > 0) & (off < _AGREE_PX)
    return np.where((agree.sum(axis=0) >= _FEWEST_VIEWS)[:, None], xyz, np.nan)


def _intersect(views: list[View], xy: FloatArray, weights: FloatArray) -> FloatArray:
    rows = []
    for view, points, weight in zip(views, xy, weights, strict=True):
        matrix = view.intrinsics @ view.camera_from_world
        for axis in range(2):
            row = points[:, axis, None] * matrix[2] - matrix[axis]
            rows.append(weight[:, None] * row / np.linalg.norm(matrix[2, :3]) / 1000)
    _, _, vt = np.linalg.svd(np.stack(rows, axis=1))
    point = vt[:, -1]
    return np.asarray(point[:, :3] / point[:, 3:])


def aligned_error(xyz: FloatArray, reference: FloatArray) -> FloatArray:
    """Errors (T, J) mm after the best similarity without reflection; NaN where either is."""
    out = np.full(xyz.shape[:2], np.nan)
    for t in range(len(xyz)):
        known = np.isfinite(xyz[t]).all(axis=1) & np.isfinite(reference[t]).all(axis=1)
        if known.sum() < 10:
            continue
        x, y = xyz[t, known], reference[t, known]
        x, y = x - x.mean(axis=0), y - y.mean(axis=0)
        u, s, vt = np.linalg.svd(x.T @ y)
        sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        fitted = x @ (u * sign) @ vt * ((s * sign).sum() / np.square(x).sum())
        out[t, known] = np.linalg.norm(fitted - y, axis=1)
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("calibration", type=Path)
    parser.add_argument("videos", nargs="+", type=Path)
    parser.add_argument("--detector", type=Path, required=True)
    parser.add_argument("--pose", type=Path, required=True)
    parser.add_argument("--tracks", type=Path, help="folder in which keypoints are kept")
    parser.add_argument("-o", "--output", type=Path, required=True, help="report, Markdown")
    options = parser.parse_args()
    views = {view.serial: view for view in read_calibration(options.calibration)}
    tracks = {}
    for video in options.videos:
        serial = next((s for s in views if video.stem.endswith(s)), None)
        if serial is None:
            parser.error(f"{video}: its name ends in none of the cameras {sorted(views)}")
        kept = options.tracks / f"{serial}.npz" if options.tracks else None
        if kept and kept.exists():
            tracks[serial] = exchange.read_track(kept)
            continue
        tracks[serial] = track_of(video, options.detector, options.pose)
        if kept:
            exchange.write_track(kept, tracks[serial])
    options.output.write_text(report(views, tracks), encoding="utf-8")
    print(options.output.read_text(encoding="utf-8"))


def report(views: dict[str, View], tracks: dict[str, Track2D]) -> str:
    reference, frames = reference_of(views, tracks)
    lines = [
        f"Reference: {len(frames)} frames, {np.isfinite(reference).all(axis=2).mean():.0%} of "
        f"joints triangulated from at least {_FEWEST_VIEWS} views.",
        "",
        "PA-MPJPE in mm of each view alone (no reflection):",
        "",
        "| view | paper | paper, MMA | default | its field of view known | weak-perspective |",
        "|---|---|---|---|---|---|",
    ]
    for serial, track in tracks.items():
        paper = lift(track, lifter="paper")
        found = (
            paper,
            smoothing.smooth_track(paper, model="mma", window=5),
            lift(track),
            lift(track, fov_deg=views[serial].fov_deg(track.image_size)),
            lift(track, camera="weak-perspective"),
        )
        errors = [aligned_error(on_frames(poses, frames), reference) for poses in found]
        lines.append(" | ".join([f"| {serial}", *(f"{np.nanmean(e):.1f}" for e in errors)]) + " |")
    return "\n".join(lines) + "\n"


def reference_of(
    views: dict[str, View], tracks: dict[str, Track2D]
) -> tuple[FloatArray, FloatArray]:
    """body17 joints (T, J, 3) mm and the frames (T,) that all views have."""
    frames = np.unique(np.concatenate([track.frame for track in tracks.values()]))
    xy, weights = [], []
    for serial, track in tracks.items():
        points, confidence = skeleton.convert(
            track.xy.astype(float), track.confidence, source=track.skeleton, target="body17"
        )
        rows = np.searchsorted(frames, track.frame)
        placed = np.full((len(frames), *points.shape[1:]), np.nan)
        sure = np.zeros(placed.shape[:2])
        placed[rows] = points * (views[serial].height / track.image_size[1])
        sure[rows] = confidence
        xy.append(placed.reshape(-1, 2))
        weights.append(sure.ravel())
    used = [views[serial] for serial in tracks]
    xyz = triangulate(used, np.stack(xy), np.stack(weights))
    return xyz.reshape(len(frames), -1, 3), frames


def on_frames(poses: Track3D, frames: FloatArray) -> FloatArray:
    """xyz (T, J, 3) of the frames asked for, NaN where the track has none."""
    out = np.full((len(frames), *poses.xyz.shape[1:]), np.nan)
    rows = np.searchsorted(frames, poses.frame)
    out[rows] = poses.xyz
    return out


if __name__ == "__main__":
    main()
