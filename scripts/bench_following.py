"""How poses change when the detector looks at every N-th frame only.

    python scripts/bench_following.py VIDEO ... --detector D.onnx --pose P.onnx [--every 5 10 15]

Compares with the detector on every frame: both are joined into tracks as in a run (seen at least
three times), and every pose of a track, not interpolated, must be there again. Distances are of
keypoints surer than 0.3. As a measure of what such a distance means, the last line says how far
the keypoints move when the detector's boxes are shifted by 0.2 % and by 1 % of their height.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dance2pose.options import Settings, SpeedOptions
from dance2pose.people import PoseModels, find_people, load_models
from dance2pose.poses import Boxes, Track2D
from dance2pose.profiling import Profile
from dance2pose.tracking.tracker import Tracker
from dance2pose.video import open_video

CONFIDENT = 0.3
# Poses whose keypoints lie nearer than this part of the body's extent (median) are one person's.
SAME_PERSON = 0.25


@dataclass(frozen=True)
class Comparison:
    """distances_px of keypoints; poses: of the detector on every frame, of which `missed` are not
    there; more: poses that are there only without it; looks: calls of the detector."""

    distances_px: npt.NDArray[np.float64]
    poses: int
    missed: int
    more: int
    looks: int
    frames: int

    @property
    def mean_px(self) -> float:
        return float(self.distances_px.mean())

    def __str__(self) -> str:
        low, high = np.quantile(self.distances_px, [0.5, 0.95])
        return (
            f"{self.mean_px:.2f} px apart on average (median {low:.2f}, 95 % below {high:.2f}); "
            f"{self.missed} of {self.poses} poses missed, {self.more} more found; "
            f"{self.looks} looks of the detector in {self.frames} frames"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("videos", type=Path, nargs="+")
    parser.add_argument("--detector", type=Path, required=True)
    parser.add_argument("--pose", type=Path, required=True)
    parser.add_argument("--every", type=int, nargs="+", default=[SpeedOptions.detect_every])
    parser.add_argument("--seconds", type=float)
    options = parser.parse_args()
    for video in options.videos:
        for every in options.every:
            result = compare(
                video, options.detector, options.pose, detect_every=every, end_s=options.seconds
            )
            print(f"{video.name}, every {every}: {result}", flush=True)
        moved = sensitivity(video, options.detector, options.pose, end_s=options.seconds)
        print(f"  boxes shifted by 0.2 % / 1 %: {moved[0]:.2f} / {moved[1]:.2f} px", flush=True)


def compare(
    video: Path, detector: Path, pose: Path, *, detect_every: int, end_s: float | None = None
) -> Comparison:
    models = load_models(Settings(detector=detector, pose=pose))
    usual, frames, _ = poses_by_frame(video, models, 1, end_s)
    found, _, looks = poses_by_frame(video, models, detect_every, end_s)
    distances: list[float] = []
    poses = missed = matched = 0
    for frame, people in usual.items():
        for xy, confidence in people:
            poses += 1
            apart = nearest(xy, [other for other, _ in found.get(frame, [])])
            if apart is None:
                missed += 1
            else:
                matched += 1
                distances += apart[(confidence > CONFIDENT) & np.isfinite(apart)].tolist()
    more = sum(map(len, found.values())) - matched
    return Comparison(np.array(distances), poses, missed, more, looks, frames)


Person = tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]


def poses_by_frame(
    video: Path, models: PoseModels, detect_every: int, end_s: float | None
) -> tuple[dict[int, list[Person]], int, int]:
    """Keypoints (J, 2) and confidence (J,) of everybody who has a track, the number of frames and
    of looks."""
    with open_video(video, end_s=end_s) as reader, Profile() as profile:
        tracker = Tracker(models.skeleton, reader.info.size)
        for people in find_people(reader, models, SpeedOptions(detect_every=detect_every)):
            tracker.update(
                people.frame.index,
                people.frame.time_s,
                people.boxes,
                people.poses,
                cut=people.cut,
                image=people.frame.image,
            )
        frames = reader.frames_read
    out: dict[int, list[Person]] = {}
    tracks: list[Track2D] = tracker.finish("all")
    for track in tracks:
        for i in np.flatnonzero(np.isfinite(track.box[:, 0])):
            out.setdefault(int(track.frame[i]), []).append(
                (track.xy[i].astype(np.float64), track.confidence[i].astype(np.float64))
            )
    return out, frames, profile.calls["detector"]


def nearest(
    xy: npt.NDArray[np.float64], others: list[npt.NDArray[np.float64]]
) -> npt.NDArray[np.float64] | None:
    """Distances (J,) to the same person's pose among the others, None where it is not there."""
    if not others:
        return None
    apart = np.linalg.norm(np.array(others) - xy, axis=2)
    medians = np.array([np.nanmedian(a) if np.isfinite(a).any() else np.inf for a in apart])
    extent = float(np.ptp(xy[np.isfinite(xy).all(axis=1)], axis=0).max())
    best = int(np.argmin(medians))
    return apart[best] if medians[best] < SAME_PERSON * extent else None


def sensitivity(
    video: Path, detector: Path, pose: Path, *, end_s: float | None
) -> tuple[float, float]:
    """How far keypoints move (px, mean) when boxes are shifted by 0.2 % and 1 % of their height."""
    models = load_models(Settings(detector=detector, pose=pose))
    moved: tuple[list[float], list[float]] = ([], [])
    with open_video(video, end_s=end_s, every=8) as reader:
        for frame in reader:
            boxes, poses = models.find(frame.image)
            sides = boxes.xyxy[:, 2:] - boxes.xyxy[:, :2]
            for share, found in zip((0.002, 0.01), moved, strict=True):
                shift = share * sides.max(axis=1, keepdims=True, initial=0)
                other = models.estimate(frame.image, Boxes(boxes.xyxy + shift, boxes.confidence))
                apart = np.linalg.norm(other.xy - poses.xy, axis=2)
                found += apart[(poses.confidence > CONFIDENT) & np.isfinite(apart)].tolist()
    return float(np.mean(moved[0])), float(np.mean(moved[1]))


if __name__ == "__main__":
    main()
