"""What `import dance2pose` offers beside the classes: one function for each thing a person does.

Names of files may be text or paths; poses may be those of this package or plain arrays.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy.typing as npt

from dance2pose import exchange, smoothing
from dance2pose.npz_files import read_arrays
from dance2pose.poses import FloatArray, Track2D, Track3D
from dance2pose.reading import read_poses, read_tracks

# Forms of 3D joints; every other file is looked into for keypoints.
_JOINTS = (".trc", ".c3d", ".bvh")


def load(path: Path | str, **how: Any) -> Track2D | Track3D | list[Track2D] | list[Track3D]:
    """Read keypoints or poses of dance2pose or of another tool.

    Parameters
    ----------
    path
        A `.npz` that dance2pose wrote; keypoints as OpenPose, COCO, AlphaPose, MMPose, rtmlib,
        MediaPipe, DeepLabCut and SLEAP write them; or joints in a TRC, C3D, BVH or CSV.
    **how
        What the file does not say: `frame_rate`, `skeleton`, `image_size` and `person` of
        keypoints, as `dance2pose lift` takes them; `unit` and `up` of joints.

    Returns
    -------
    Track2D, Track3D, or a list of either
        A `.npz` of dance2pose holds one; files of other tools hold several people.

    Raises
    ------
    DataError
        For a file that is missing, damaged, or of no known form.
    UsageError
        Where the file needs to be told something, or is told what it says itself.

    Examples
    --------
    >>> load("tape.npz").xyz.shape  # doctest: +SKIP
    (545, 17, 3)
    >>> load("alphapose.json", frame_rate=25)  # doctest: +SKIP
    [Track2D(dancer 1: ...), Track2D(dancer 2: ...)]
    """
    path = Path(path)
    if path.suffix.lower() == ".npz" and path.is_file():
        arrays = read_arrays(path)
        if "xyz" in arrays:
            return exchange.read_poses(path)
        if "xy" in arrays:
            return exchange.read_track(path)
    if path.suffix.lower() in _JOINTS:
        return list(read_poses(path, **how).tracks)
    return list(read_tracks(path, **how).tracks)


def smooth(
    poses: Any,
    *,
    model: str = smoothing.DEFAULT_MODEL,
    window: int = smoothing.DEFAULT_WINDOW,
    time_s: npt.ArrayLike | None = None,
) -> Any:
    """Run a temporal model over poses.

    Parameters
    ----------
    poses
        A Track3D, a Track2D, or an array (T, ...) whose first axis is time; NaN is missing, and
        nothing is smoothed across it.
    model
        sma, ema, wma or mma (the paper's equations 6 to 9, which lag), the same with -zero-phase,
        one-euro, savitzky-golay, butterworth or none.
    window
        Frames.
    time_s
        (T,) times of an array, seconds; tracks have their own.

    Returns
    -------
    Track3D, Track2D or numpy.ndarray
        As given, smoothed.

    Raises
    ------
    UsageError
        For an unknown model, or a window that the model cannot have.

    Examples
    --------
    >>> import numpy as np
    >>> smooth(np.array([0.0, 3.0, 3.0]), model="mma", window=3)
    array([0.        , 1.        , 1.66666667])
    """
    if isinstance(poses, Track3D):
        return smoothing.smooth_track(poses, model=model, window=window)
    if isinstance(poses, Track2D):
        return replace(poses, xy=_smoothed_keypoints(poses, model=model, window=window))
    return smoothing.smooth(poses, model=model, window=window, time_s=time_s)


def _smoothed_keypoints(track: Track2D, *, model: str, window: int) -> FloatArray:
    return smoothing.smooth(
        track.xy, model=model, window=min(window, len(track)), time_s=track.time_s
    )
