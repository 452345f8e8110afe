"""The data that flows between the stages: frozen dataclasses over NumPy arrays.

T frames, N people, J joints or keypoints. Missing is NaN, never 0 and never a guess. Time is the
frame's own presentation timestamp in seconds. Image axes: x right, y down, pixels, the centre of
the top-left pixel at (0, 0). Camera axes: x right, y down, z forward. World axes: x right, y up,
z towards the viewer (right-handed).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, Self

import numpy as np
import numpy.typing as npt

from dance2pose.array_records import ArrayRecord, require_shape
from dance2pose.errors import DataError
from dance2pose.viewpoint import Viewpoint

FloatArray = npt.NDArray[np.floating[Any]]
BoolArray = npt.NDArray[np.bool_]
IntArray = npt.NDArray[np.int64]
Inner = tuple[int, int, int, int]
Image = npt.NDArray[np.uint8]

Unit = Literal["body heights", "metres"]


@dataclass(frozen=True, eq=False, repr=False)
class Timeline(ArrayRecord):
    """The frames of a sequence and when each was shown.

    frame: (T,) int64, indices in the video; time_s: (T,) float64, presentation times in seconds.
    Both strictly increase: a repeated or reversed time is no time, and a hole stays a hole.

    Raises
    ------
    DataError
        Where they do not increase, differ in length, or a time is not a number.

    Examples
    --------
    >>> Timeline.regular(3, rate_hz=25)
    Timeline(3 frames, 0 to 2, 0.000 to 0.080 s)
    """

    frame: IntArray
    time_s: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        require_shape("frame", self.frame, (None,))
        require_shape("time_s", self.time_s, (len(self.frame),))
        _require_increasing("frame", self.frame)
        _require_increasing("time_s", self.time_s)

    @classmethod
    def regular(cls, length: int, *, rate_hz: float, start_s: float = 0.0) -> Self:
        """`length` frames from 0, `rate_hz` of them a second."""
        frame = np.arange(length, dtype=np.int64)
        return cls(frame, start_s + frame / rate_hz)

    def __len__(self) -> int:
        return len(self.frame)

    def __repr__(self) -> str:
        if not len(self):
            return "Timeline(0 frames)"
        return (
            f"Timeline({len(self)} frames, {self.frame[0]} to {self.frame[-1]}, "
            f"{self.time_s[0]:.3f} to {self.time_s[-1]:.3f} s)"
        )


def _require_increasing(name: str, values: npt.NDArray[Any]) -> None:
    bad = ~np.isfinite(values)
    bad[1:] |= ~(np.diff(values) > 0)
    if bad.any():
        row = int(np.argmax(bad))
        before = f" after {values[row - 1]}" if row else ""
        raise DataError(f"{name} must strictly increase; row {row} is {values[row]}{before}")


@dataclass(frozen=True)
class Frame:
    """One decoded picture.

    index: number of the frame in the file, counted in presentation order from 0.
    time_s: presentation timestamp in seconds from the start of the video.
    image: (H, W, 3) uint8 BGR, upright, square pixels, progressive.
    inner: (left, top, width, height) px of the picture in the image where it has black borders,
    because the recording changed its format; None where it fills it.
    decoded_small: (h, w) uint8, the small grey picture where the decoder gave it; see `small`.
    """

    index: int
    time_s: float
    image: Image
    inner: Inner | None = None
    decoded_small: Image | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        require_shape("image", self.image, (None, None, 3))
        if self.image.dtype != np.uint8:
            raise ValueError(f"image has dtype {self.image.dtype}, expected uint8")

    @cached_property
    def small(self) -> Image:
        """The picture small and grey (h, w), made once; see `small_picture`."""
        if self.decoded_small is not None:
            return self.decoded_small
        from dance2pose.small_picture import small_grey

        return small_grey(self.image)


@dataclass(frozen=True)
class Boxes:
    """People found in one frame. xyxy: (N, 4) px; confidence: (N,) in 0..1."""

    xyxy: FloatArray
    confidence: FloatArray

    def __post_init__(self) -> None:
        require_shape("xyxy", self.xyxy, (None, 4))
        require_shape("confidence", self.confidence, (len(self.xyxy),))

    def __len__(self) -> int:
        return len(self.xyxy)


@dataclass(frozen=True)
class Poses2D:
    """The keypoints of N people in one frame.

    xy: (N, J, 2) px, NaN where missing. confidence: (N, J), the model's own score (not
    comparable between models), 0 where xy is NaN. skeleton: a name of `dance2pose.skeleton`.
    """

    xy: FloatArray
    confidence: FloatArray
    skeleton: str

    def __post_init__(self) -> None:
        require_shape("xy", self.xy, (None, None, 2))
        require_shape("confidence", self.confidence, self.xy.shape[:2])

    def __len__(self) -> int:
        return len(self.xy)


@dataclass(frozen=True, eq=False, repr=False)
class Track2D(ArrayRecord):
    """One dancer's keypoints over time.

    person: number of the dancer from 1. timeline: T rows, every processed frame between the first
    and last sight of the dancer. xy: (T, J, 2) px, NaN where missing. confidence: (T, J), 0 where
    missing. interpolated: (T,) True where the pose was filled in across a short gap.
    box: (T, 4) xyxy px, NaN where not detected. shot: number of the shot the track belongs to,
    from 0. image_size: (width, height) px of the upright, square-pixel picture, (0, 0) unknown.
    """

    person: int
    timeline: Timeline
    xy: FloatArray
    confidence: FloatArray
    skeleton: str
    interpolated: BoolArray
    box: FloatArray
    image_size: tuple[int, int]
    shot: int = 0

    def __post_init__(self) -> None:
        length = len(self.timeline)
        require_shape("xy", self.xy, (length, None, 2))
        require_shape("confidence", self.confidence, (length, self.xy.shape[1]))
        require_shape("interpolated", self.interpolated, (length,))
        require_shape("box", self.box, (length, 4))

    @classmethod
    def from_arrays(
        cls,
        xy: npt.ArrayLike,
        *,
        skeleton: str,
        time_s: npt.ArrayLike,
        confidence: npt.ArrayLike | None = None,
        frame: npt.ArrayLike | None = None,
        image_size: tuple[int, int] = (0, 0),
        person: int = 1,
        shot: int = 0,
    ) -> Self:
        """A track from what a person has: keypoints, and when they were seen.

        Parameters
        ----------
        xy
            (T, J, 2) px, x right, y down; NaN where a keypoint is missing.
        skeleton
            Name of the keypoints' layout, as `dance2pose.skeleton` knows it: coco17, halpe26 ...
        time_s
            (T,) presentation times in seconds, strictly increasing.
        confidence
            (T, J) of the keypoint model, 0 or more; 1 where seen if not given.
        frame
            (T,) frame numbers, strictly increasing; 0 to T - 1 if not given.
        image_size
            (width, height) px of the picture; without it no path through the room is found.
        person, shot
            Number of the dancer from 1, and of the shot from 0.

        Raises
        ------
        DataError
            Where shapes do not fit each other or times do not increase.

        Examples
        --------
        >>> import numpy as np
        >>> xy = np.random.default_rng(0).uniform(0, 480, (7, 17, 2))
        >>> Track2D.from_arrays(xy, time_s=np.arange(7) / 25, skeleton="coco17")
        Track2D(dancer 1: 7 frames, 0 to 6, 0.000 to 0.240 s; 17 keypoints of coco17)
        """
        points = np.asarray(xy, dtype=np.float64)
        if points.ndim != 3 or points.shape[-1] != 2:
            raise DataError(f"xy has shape {points.shape}, expected (frames, keypoints, 2)")
        length = len(points)
        missing = np.asarray(~np.isfinite(points).all(axis=2))
        sure = np.ones(missing.shape) if confidence is None else np.array(confidence, np.float64)
        if sure.shape != missing.shape:
            raise DataError(f"confidence has shape {sure.shape}, expected {missing.shape}")
        times = np.asarray(time_s, np.float64)
        numbers = np.arange(length) if frame is None else np.asarray(frame)
        for name, values in (("time_s", times), ("frame", numbers)):
            if values.shape != (length,):
                raise DataError(f"{name} has shape {values.shape}, expected ({length},)")
        return cls(
            person=person,
            timeline=Timeline(numbers.astype(np.int64), times),
            xy=np.where(missing[..., None], np.nan, points),
            confidence=np.where(missing, 0.0, sure),
            skeleton=skeleton,
            interpolated=np.zeros(length, np.bool_),
            box=np.full((length, 4), np.nan),
            image_size=image_size,
            shot=shot,
        )

    @property
    def frame(self) -> IntArray:
        """(T,) frame numbers."""
        return self.timeline.frame

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        """(T,) presentation times in seconds."""
        return self.timeline.time_s

    def __len__(self) -> int:
        return len(self.timeline)

    def __repr__(self) -> str:
        return (
            f"Track2D(dancer {self.person}: {_span(self.timeline)}; "
            f"{self.xy.shape[1]} keypoints of {self.skeleton})"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Track3D(ArrayRecord):
    """One dancer's joints over time.

    timeline: as in Track2D. xyz: (T, J, 3) in world axes, the first joint (pelvis) at the
    origin, NaN where nothing is known. unit: of xyz. reprojection_error: (T, J) px, NaN where no
    keypoint was seen. valid: (T, J - 1) bool, one flag a bone (bone b ends at joint b + 1),
    False where the bone breaks a joint-angle limit. estimated: (T, J) True where the joint was
    not seen and comes from the body model alone. sigma: (T, J) radius in `unit` of the
    ball about the joint that holds the true one in about 68 of 100 cases (twice it: 95), or None
    where the lifter does not know; not an error along one axis. root: (T, 3) position of the
    first joint in the world, in `unit`, or None where it is not known. shot: as in Track2D; the
    world axes of two shots are two worlds. viewpoint: the camera that saw it, or None where it is
    not known (files of poses do not hold it, and it does not count in comparing tracks).
    """

    person: int
    timeline: Timeline
    xyz: FloatArray
    unit: Unit
    skeleton: str
    reprojection_error: FloatArray
    valid: BoolArray
    estimated: BoolArray
    sigma: FloatArray | None = None
    root: FloatArray | None = None
    shot: int = 0
    viewpoint: Viewpoint | None = dataclasses.field(default=None, compare=False)

    def __post_init__(self) -> None:
        length = len(self.timeline)
        require_shape("xyz", self.xyz, (length, None, 3))
        joints = self.xyz.shape[1]
        require_shape("reprojection_error", self.reprojection_error, (length, joints))
        require_shape("valid", self.valid, (length, joints - 1))
        require_shape("estimated", self.estimated, (length, joints))
        if self.sigma is not None:
            require_shape("sigma", self.sigma, (length, joints))
        if self.root is not None:
            require_shape("root", self.root, (length, 3))

    @property
    def frame(self) -> IntArray:
        """(T,) frame numbers."""
        return self.timeline.frame

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        """(T,) presentation times in seconds."""
        return self.timeline.time_s

    @property
    def world_xyz(self) -> FloatArray:
        """(T, J, 3) joints in the world: on the root trajectory where it is known, else `xyz`."""
        return self.xyz if self.root is None else self.xyz + self.root[:, None]

    def __len__(self) -> int:
        return len(self.timeline)

    def __repr__(self) -> str:
        path = "path known" if self.root is not None else "no path"
        return (
            f"Track3D(dancer {self.person}: {_span(self.timeline)}; "
            f"{self.xyz.shape[1]} joints of {self.skeleton} in {self.unit}, {path})"
        )


def _span(timeline: Timeline) -> str:
    return repr(timeline).removeprefix("Timeline(").removesuffix(")")


@dataclass(frozen=True)
class Dancer:
    """All that is known of one dancer: keypoints, the lifted poses, and the same smoothed.

    The three share `person`, `timeline` and `shot` (ValueError where they do not).
    """

    keypoints: Track2D
    raw: Track3D
    smoothed: Track3D

    def __post_init__(self) -> None:
        for track in (self.raw, self.smoothed):
            if (track.person, track.shot) != (self.person, self.shot):
                raise ValueError("the tracks of a dancer are of one person in one shot")
            if track.timeline != self.keypoints.timeline:
                raise ValueError("the tracks of a dancer have one timeline")

    @property
    def person(self) -> int:
        return self.keypoints.person

    @property
    def shot(self) -> int:
        return self.keypoints.shot

    @property
    def timeline(self) -> Timeline:
        return self.keypoints.timeline

    def __repr__(self) -> str:
        return f"Dancer({self.person}: {_span(self.timeline)}, shot {self.shot})"
