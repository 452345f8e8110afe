"""Where one shot of an edited video ends and the next begins.

Two pictures are of two scenes if they differ much on average. On a stage the light changes faster
than anything else, so they are made free of it first: small, grey, every neighbourhood brought to
the same mean and contrast. A camera that follows a dancer moves the whole picture, so the two are
laid over each other first. A recording that changes its format shows the same scene between black
borders, so only what is inside is compared. What then still differs is another scene.

The decision is made at once, frame by frame: a dissolve is not seen as a cut, nor is a step between
two nearly equal views of the same room.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
import numpy.typing as npt

from dance2pose.poses import Frame, Image, Inner
from dance2pose.small_picture import Grey

# Pictures are compared at this size, px. Larger gains nothing and follows fast limbs more.
SIZE = 64

# The contrast every neighbourhood is brought to (standard deviation in grey levels), and the size
# of a neighbourhood (standard deviation of its Gaussian window, px at SIZE).
CONTRAST = 48.0
NEIGHBOURHOOD = SIZE / 8

# Contrast (standard deviation, grey levels) below which a neighbourhood is noise, not structure.
NOISE = 4.0

# Mean difference of two prepared pictures above which they are two scenes. Unrelated noise would
# differ by 1.13 x CONTRAST = 54. Measured on seven real videos of dancing and walking: at most 26
# between frames of one shot six frames apart, 25 for sudden changes of light, 16 for pans by 12 %
# of the width; at least 41 between different cameras, 32 from a view to its enlargement.
THRESHOLD = 30.0

# Mean deviation from grey below which a prepared picture shows nothing: black, or a white flash.
LEAST_STRUCTURE = 12.0

# Larger shifts between two pictures, as a part of their size, are chance, not a camera's movement.
MAX_SHIFT = 0.25

_NOTHING = np.full((SIZE, SIZE), 128, np.uint8)


class ShotDetector:
    """Tells, frame by frame, where a new shot begins."""

    def __init__(self) -> None:
        self._last: _Sight | None = None

    def is_cut(self, frame: Frame) -> bool:
        """Whether `frame` is the first of a new shot. Give it every frame, in order.

        A frame without structure (black, or white with a flash) is never a cut; the next is
        compared with the last that had some. The first frame of a video is not a cut.
        """
        inner = None if frame.inner is None else _shrunk(frame)
        picture = prepare(frame.small, inner)
        if _distance(picture, _NOTHING) < LEAST_STRUCTURE:
            return False
        last, self._last = self._last, _Sight(frame.small, inner, picture)
        # Laid over each other they can only differ less: most frames need no closer look.
        if last is None or _distance(last.prepared, picture) < THRESHOLD:
            return False
        if not differ(*align(last.prepared, picture)):
            return False
        return last.inner == inner or _common_parts_differ(last, self._last)


@dataclass(frozen=True)
class _Sight:
    """A frame's small picture, where in it the picture is within borders, and it prepared."""

    small: Grey
    inner: Inner | None
    prepared: Image


def _shrunk(frame: Frame) -> Inner:
    """Where the picture is within borders, in the small picture: whole pixels of it."""
    assert frame.inner is not None
    left, top, width, height = frame.inner
    scale = np.array(frame.small.shape) / frame.image.shape[:2]
    (y0, y1), (x0, x1) = np.array([[top, top + height], [left, left + width]]) * scale[:, None]
    height, width = frame.small.shape
    x, y = min(ceil(x0), width - 1), min(ceil(y0), height - 1)
    return x, y, max(1, int(x1) - x), max(1, int(y1) - y)


def _common_parts_differ(last: _Sight, now: _Sight) -> bool:
    """Whether two frames of different formats differ also where both have a picture: the wider
    may show more of one scene."""
    if last.small.shape != now.small.shape:
        return True
    height, width = now.small.shape
    inner = [one.inner or (0, 0, width, height) for one in (last, now)]
    left, top = (max(i[side] for i in inner) for side in (0, 1))
    right, bottom = (min(i[side] + i[side + 2] for i in inner) for side in (0, 1))
    if right <= left or bottom <= top:
        return True
    common = left, top, right - left, bottom - top
    return differ(*align(prepare(last.small, common), prepare(now.small, common)))


def prepare(small: Grey, inner: Inner | None = None) -> Image:
    """A small picture -> (SIZE, SIZE) uint8, independent of brightness and contrast.

    inner: (left, top, width, height) px of the picture within black borders.
    """
    if inner is not None:
        left, top, width, height = inner
        small = small[top : top + height, left : left + width]
    twice = cv2.resize(small, (2 * SIZE, 2 * SIZE), interpolation=cv2.INTER_LINEAR)
    grey = cv2.resize(twice, (SIZE, SIZE), interpolation=cv2.INTER_AREA).astype(np.float32)
    centred = grey - _blurred(grey)
    variance = _blurred(centred * centred)
    even = 128 + CONTRAST * centred / np.sqrt(variance + NOISE**2)
    return np.asarray(np.clip(even, 0, 255), dtype=np.uint8)


def _blurred(picture: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    """The mean of every neighbourhood, within two standard deviations of its window."""
    side = 4 * round(NEIGHBOURHOOD) + 1
    return np.asarray(cv2.GaussianBlur(picture, (side, side), NEIGHBOURHOOD), np.float32)


def align(before: Image, after: Image) -> tuple[Image, Image]:
    """The parts of two prepared pictures that show the same place, if the camera moved.

    The shift comes from phase correlation. The pictures come back whole where no shift is found, or
    where laying one over the other does not help.
    """
    window = cv2.createHanningWindow((SIZE, SIZE), cv2.CV_32F)
    grey = [picture.astype(np.float32) - 128 for picture in (before, after)]
    (shift_x, shift_y), _ = cv2.phaseCorrelate(grey[0], grey[1], window)
    x, y = round(shift_x), round(shift_y)
    if max(abs(x), abs(y)) > MAX_SHIFT * SIZE:
        return before, after
    cut = SIZE - abs(y), SIZE - abs(x)
    moved_before = before[max(0, -y) :, max(0, -x) :][: cut[0], : cut[1]]
    moved_after = after[max(0, y) :, max(0, x) :][: cut[0], : cut[1]]
    if _distance(moved_before, moved_after) < _distance(before, after):
        return moved_before, moved_after
    return before, after


def _distance(one: Image, other: Image) -> float:
    return cv2.norm(one, other, cv2.NORM_L1) / one.size


def differ(before: Image, after: Image) -> bool:
    """Whether two prepared pictures show two scenes."""
    return _distance(before, after) >= THRESHOLD
