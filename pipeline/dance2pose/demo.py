"""The demo: the bundled clip through the bundled models, and how far the result is from the truth.

The clip is rendered from motion capture (`scripts/make_demo_clip.py`), so that the true joints are
known; the models are small ones trained on other rendered figures
(`scripts/train_demo_models.py`). Everything between is what any video goes through.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from dance2pose.assets import asset
from dance2pose.errors import DataError, OutputError
from dance2pose.evaluation.metrics import pa_errors
from dance2pose.exchange import read_poses, read_track
from dance2pose.npz_files import read_arrays
from dance2pose.options import OutputOptions, Settings
from dance2pose.poses import FloatArray, Track2D, Track3D
from dance2pose.progress import Progress
from dance2pose.reconstruction import reconstruct
from dance2pose.skeleton import get
from dance2pose.summary import Summary

CLIP, TRUTH = "demo_clip.mp4", "demo_truth.npz"
DETECTOR, POSE = "demo_detector.onnx", "demo_pose.onnx"
FOLDER = Path("dance2pose-demo")
# A keypoint this near, in torso lengths, counts as found (PCK@0.2).
NEAR_TORSO = 0.2


@dataclass(frozen=True)
class Truth:
    """What the clip shows. time_s: (T,). keypoints: (T, 23, 2) px of coco23, hidden ones
    included. joints: (T, 17, 3) of body17, metres, y up. stature_m: body height."""

    time_s: npt.NDArray[np.float64]
    keypoints: FloatArray
    joints: FloatArray
    stature_m: float


@dataclass(frozen=True)
class Accuracy:
    """How far a reconstruction of the clip is from the truth.

    frames: of the clip. frames_with_pose: those that were lifted. pa_mpjpe_mm: mean distance of
    the joints of body17 in them, each pose moved, turned and scaled to lie closest to the truth.
    pck: share of the 17 keypoints of COCO, over all frames, found within 0.2 torso lengths
    (shoulder to opposite hip) of where they are; a missing one is not found.
    """

    frames: int
    frames_with_pose: int
    pa_mpjpe_mm: float
    pck: float


def read_truth(path: Path | None = None) -> Truth:
    """The truth of the bundled clip. Raises DataError where the file is damaged."""
    path = path or asset(TRUTH)
    arrays = read_arrays(path)
    try:
        return Truth(
            time_s=arrays["time_s"].astype(np.float64),
            keypoints=arrays["keypoints"].astype(np.float64),
            joints=arrays["joints"].astype(np.float64),
            stature_m=float(arrays["stature_m"]),
        )
    except KeyError as error:
        raise DataError(f"{path}: has no array {error}; install dance2pose again") from error


def run_demo(
    folder: Path = FOLDER, *, overwrite: bool = False, progress: Progress | None = None
) -> tuple[Summary, Accuracy]:
    """Reconstruct the bundled clip into `folder` and compare the result with the truth.

    Raises OutputError where the folder cannot be made or holds the files already, and DataError
    where the installation lacks what the demo needs.
    """
    truth = read_truth()
    settings = Settings.of(
        detector=asset(DETECTOR), pose=asset(POSE), person="largest", height_m=truth.stature_m
    )
    # The recording shows JPEG frames, so that a viewer needs no decoder for H.264.
    outputs = OutputOptions(picture="frames")
    clip = asset(CLIP)
    try:
        folder.mkdir(exist_ok=True)
    except FileExistsError as error:
        raise OutputError(f"{folder}: is a file, expected a folder to write to") from error
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror or error}") from error
    recording = folder / "demo.rrd"
    summary = reconstruct(
        clip, recording, settings, outputs=outputs, overwrite=overwrite, progress=progress
    )
    track = read_track(recording.with_suffix(".track.npz"))
    poses = read_poses(recording.with_suffix(".npz"))
    return summary, accuracy(track, poses, truth)


def accuracy(track: Track2D, poses: Track3D, truth: Truth) -> Accuracy:
    """Compare a reconstruction of the clip with the truth, frame by frame by their times."""
    there = {_milliseconds(time): row for row, time in enumerate(truth.time_s)}
    rows = np.array([there.get(_milliseconds(time), -1) for time in poses.time_s])
    known, rows = rows >= 0, rows[rows >= 0]
    xyz = poses.xyz[known].astype(np.float64)
    errors = pa_errors(xyz, truth.joints[rows])
    near = np.zeros(truth.keypoints.shape[:2], dtype=bool)
    distance = np.linalg.norm(track.xy[known] - truth.keypoints[rows], axis=-1)
    near[rows] = distance <= NEAR_TORSO * torso_length(truth.keypoints[rows])[:, None]
    lifted = np.isfinite(errors).all(axis=1)
    return Accuracy(
        frames=len(truth.time_s),
        frames_with_pose=int(lifted.sum()),
        pa_mpjpe_mm=1000 * float(errors[lifted].mean()) if lifted.any() else float("nan"),
        pck=float(near[:, : len(get("coco17"))].mean()),
    )


def torso_length(keypoints: FloatArray) -> FloatArray:
    """The longer diagonal (T,) from shoulder to opposite hip of COCO keypoints (T, J, 2)."""
    names = get("coco17")
    left, right = (
        keypoints[:, names.index(f"{side}_shoulder")] - keypoints[:, names.index(f"{other}_hip")]
        for side, other in (("left", "right"), ("right", "left"))
    )
    longer: FloatArray = np.maximum(np.linalg.norm(left, axis=-1), np.linalg.norm(right, axis=-1))
    return longer


def _milliseconds(time_s: float) -> int:
    return round(1000 * float(time_s))
