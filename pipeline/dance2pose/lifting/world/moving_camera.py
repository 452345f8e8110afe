"""A camera that turns and zooms on the spot, frame by frame.

Camera axes here are x right, y up, z towards the viewer, as everywhere in `lifting`. The reference
is the first frame of a shot: its camera has no turn and no zoom.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dance2pose.errors import DataError
from dance2pose.poses import BoolArray, FloatArray, IntArray

# A turn of less than this, and a zoom by less, are not worth a word.
_LEAST_TURN_DEG, _LEAST_ZOOM = 1.0, 1.02
# The part of a shot's frames in which the background may be lost before that is told.
_FEW_LOST = 0.05


@dataclass(frozen=True)
class CameraMotion:
    """How the camera turns and zooms, for F frames of one video.

    Parameters
    ----------
    frame : (F,) int64, strictly increasing
        Frame indices, as in `Track2D.frame`.
    rotation : (F, 3, 3)
        Axes of the shot's first camera from this frame's camera axes: a direction d seen in this
        frame is ``rotation @ d`` in the first. The identity where the camera stands still.
    zoom : (F,)
        Focal length, as a multiple of that of the shot's first frame.
    known : (F,) bool
        False where too little background was seen; the last known turn and zoom stand there.
    shot : (F,) int64
        Number of the shot.
    """

    frame: IntArray
    rotation: FloatArray
    zoom: FloatArray
    known: BoolArray
    shot: IntArray

    def __post_init__(self) -> None:
        frames = len(self.frame)
        if self.rotation.shape != (frames, 3, 3):
            raise ValueError(f"rotation has shape {self.rotation.shape}, expected {frames}, 3, 3")
        for name in ("zoom", "known", "shot"):
            if getattr(self, name).shape != (frames,):
                raise ValueError(f"{name} has shape {getattr(self, name).shape}, expected {frames}")

    def __len__(self) -> int:
        return len(self.frame)

    def at(self, frame: IntArray) -> CameraMotion:
        """The rows of these frames (T,). Raises DataError for a frame that is not among them."""
        rows = np.searchsorted(self.frame, frame)
        inside = rows < len(self.frame)
        if not inside.all() or not np.array_equal(self.frame[rows], frame):
            raise DataError("the camera's motion is not known in every frame of the track")
        return CameraMotion(
            self.frame[rows],
            self.rotation[rows],
            self.zoom[rows],
            self.known[rows],
            self.shot[rows],
        )

    @property
    def moves(self) -> bool:
        """Whether the camera turns or zooms at all."""
        still = (self.rotation == np.eye(3)).all() and (self.zoom == 1).all()
        return bool(len(self) and not still)

    def spans(self) -> dict[int, tuple[float, float, float, float]]:
        """Of every shot, how far the camera pans, tilts and rolls, degrees, and the largest zoom
        divided by the smallest."""
        out = {}
        for shot in np.unique(self.shot):
            rows = self.shot == shot
            # Whole turns are unwrapped, so that a camera may pan all the way round.
            angles = np.unwrap(np.radians(self._angles_deg()[rows]), axis=0)
            pan, tilt, roll = np.degrees(np.ptp(angles, axis=0))
            zoom = self.zoom[rows]
            out[int(shot)] = (float(pan), float(tilt), float(roll), float(zoom.max() / zoom.min()))
        return out

    def _angles_deg(self) -> FloatArray:
        """Pan, tilt and roll (F, 3)."""
        ahead, up = -self.rotation[:, :, 2], self.rotation[:, :, 1]
        pan = np.arctan2(ahead[:, 0], -ahead[:, 2])
        tilt = np.arcsin(np.clip(ahead[:, 1], -1, 1))
        level = np.stack([np.cos(pan), np.zeros(len(pan)), np.sin(pan)], axis=1)
        roll = np.arcsin(np.clip((up * level).sum(axis=1), -1, 1))
        return np.asarray(np.degrees(np.stack([pan, tilt, roll], axis=1)))

    def notes(self) -> tuple[str, ...]:
        """What a reader of the result must know, a sentence for each shot that moves."""
        out = []
        spans = self.spans()
        for shot, (pan, tilt, roll, zoom) in spans.items():
            where = f" in shot {shot + 1}" if len(spans) > 1 else ""
            words = [
                f"{verb} by {angle:.0f} degrees"
                for verb, angle in (("pans", pan), ("tilts", tilt), ("rolls", roll))
                if angle >= _LEAST_TURN_DEG
            ]
            words += [f"zooms by a factor of {zoom:.2g}"] if zoom >= _LEAST_ZOOM else []
            if words:
                together = " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))
                out.append(f"The camera {together}{where}; this is undone in the dancers' paths.")
            lost = float(1 - self.known[self.shot == shot].mean())
            if lost > _FEW_LOST:
                out.append(
                    f"Whether the camera moves cannot be told in {lost:.0%} of the frames{where}: "
                    "too little background is seen; it is taken to stand still there."
                )
        return tuple(out)


def joined_shots(shots: list[CameraMotion]) -> CameraMotion:
    """The shots of one video, one after the other."""
    if not shots:
        none = np.zeros(0, np.int64)
        return CameraMotion(none, np.zeros((0, 3, 3)), np.zeros(0), np.zeros(0, bool), none)
    for before, after in pairwise(shots):
        if before.frame[-1] >= after.frame[0]:
            raise ValueError("shots overlap")
    return CameraMotion(
        np.concatenate([s.frame for s in shots]),
        np.concatenate([s.rotation for s in shots]),
        np.concatenate([s.zoom for s in shots]),
        np.concatenate([s.known for s in shots]),
        np.concatenate([s.shot for s in shots]),
    )
