"""How the camera turns and zooms, seen by what does not dance: the background.

`background_view` tells where the camera looks in a single picture. Several times a second are
enough for a camera that stands, pans or zooms evenly: frames between two that were looked at are
interpolated. Where the camera is not where its even movement would have taken it, the frame in the
middle is looked at too, and so on between while interpolation does not do. (A jolt that is over by
the next look goes unseen.)
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np

from dance2pose.background_view import FIRST_VIEW, BackgroundView, Scene, View, between
from dance2pose.lifting.world.moving_camera import CameraMotion, joined_shots
from dance2pose.poses import FloatArray
from dance2pose.small_picture import Grey

# A shot whose background never moves by more than this, px at SIZE (0.3 % of the longer side),
# root mean square over the picture, is one of a camera that stands still.
STILL_PX = 0.8
# The camera is looked at so often where it moves evenly: eight times a second, the hands that hold
# it moving it no faster, ...
LOOK_EVERY_S = 0.125
# ... holding no more small pictures than this.
MOST_WAITING = 16
# It moves evenly while interpolation between two looks, where it was last compared with looking,
# was this near, px at SIZE, root mean square: a camera that moves by less stands still, ...
BETWEEN_PX = STILL_PX
# ... and while it is this near to where its speed would have taken it: what shakes at random is
# off by twice as much from the line through two looks beyond them as between them.
EVEN_PX = 2 * BETWEEN_PX
# That is compared at the start of a shot, after uneven movement, and every so many looks.
LOOKS_UNCOMPARED = 8
# Timestamps are rounded in the file.
_ROUNDING_S = 1e-3


@dataclass(frozen=True)
class _Looked:
    """A frame that was looked at."""

    time_s: float
    view: View
    known: bool


@dataclass(frozen=True)
class _Waiting:
    index: int
    time_s: float
    picture: Grey
    boxes: FloatArray


class CameraMotionEstimator:
    """Follows the camera through a video, frame by frame.

    Parameters
    ----------
    image_size : (width, height)
        Of the upright pictures, px.
    fov_deg : float or None
        Field of view across the longer side of the first frame of each shot; the one that is
        assumed in lifting where it is not known.

    Examples
    --------
    >>> import numpy as np
    >>> picture = np.random.default_rng(0).integers(0, 255, (120, 160), np.uint8)
    >>> follower = CameraMotionEstimator((160, 120))
    >>> for index in range(3):
    ...     follower.update(index, index / 25, picture, np.zeros((0, 4)))
    >>> follower.finish().moves
    False
    """

    def __init__(self, image_size: tuple[int, int], fov_deg: float | None = None) -> None:
        self._background = BackgroundView(image_size, fov_deg)
        self._shots: list[CameraMotion] = []
        self._start()

    def _start(self) -> None:
        # Plain numbers: objects for each of an hour's frames would take much memory.
        self._frames = array("q")
        self._rotations = array("d")
        self._zooms = array("d")
        self._known = array("b")
        self._waiting: list[_Waiting] = []
        # The last scene, and the last frames that were looked at, one after the other.
        self._last: Scene | None = None
        self._looked: list[_Looked] = []
        # Looks that may be taken yet before all waiting frames are looked at again.
        self._credit = 0

    def update(
        self, index: int, time_s: float, picture: Grey, boxes: FloatArray, *, cut: bool = False
    ) -> None:
        """The next frame.

        index, time_s, picture: a `Frame`'s index, time and small picture, all that is held of it.
        boxes: (N, 4) xyxy px, its people. cut: a new shot begins with it.
        """
        if cut:
            self._end_shot()
        self._waiting.append(_Waiting(index, time_s, picture, boxes))
        if self._is_time():
            self._look()

    def finish(self) -> CameraMotion:
        """The motion over all frames given. A shot whose camera hardly moved stands still."""
        self._end_shot()
        return joined_shots(self._shots)

    def _is_time(self) -> bool:
        """Whether the next frame would come too late to look again."""
        if not self._looked or len(self._waiting) >= MOST_WAITING:
            return True
        last = self._looked[-1].time_s
        times = [last, *(one.time_s for one in self._waiting)]
        return 2 * times[-1] - times[-2] - last > LOOK_EVERY_S + _ROUNDING_S

    def _look(self) -> None:
        """Look at the last of the waiting frames, and where need be at others between."""
        waiting, self._waiting = self._waiting, []
        if len(waiting) == 1 or not self._looked_at_some(waiting):
            for one in waiting:
                self._look_at(one)

    def _looked_at_some(self, waiting: list[_Waiting]) -> bool:
        """Look at as few frames as tell the views of all; False, and nothing is done, where one of
        these shows nothing."""
        start, last = self._looked[-1], waiting[-1]
        expected = self._expected(last.time_s)
        scene = self._background.scene(last.picture, last.boxes)
        sight = self._background.glance(scene, expected or start.view)
        if sight is None or not start.known:
            return False
        end = _Looked(last.time_s, sight.view, True)
        was_even = expected and self._background.apart(expected, sight.view) <= EVEN_PX
        if self._credit and was_even:
            self._credit -= 1
            views = [_at(start, end, one.time_s) for one in waiting[:-1]]
        else:
            found = self._views_between(start, waiting[:-1], end)
            if found is None:
                return False
            views, is_even = found
            self._credit = LOOKS_UNCOMPARED if is_even else 0
        view = self._background.settle(scene, sight)
        for one, seen in zip(waiting, [*views, view], strict=True):
            self._record(one, seen, known=True)
        self._remember(scene, end)
        return True

    def _views_between(
        self, start: _Looked, frames: list[_Waiting], end: _Looked
    ) -> tuple[list[View], bool] | None:
        """The views of frames between two that were looked at, and whether interpolation would
        have done: the one in the middle tells. None where that shows nothing."""
        if not frames:
            return [], True
        half = len(frames) // 2
        middle = frames[half]
        guess = _at(start, end, middle.time_s)
        scene = self._background.scene(middle.picture, middle.boxes)
        sight = self._background.glance(scene, guess)
        if sight is None:
            return None
        here = _Looked(middle.time_s, sight.view, True)
        parts = (start, frames[:half], here), (here, frames[half + 1 :], end)
        if self._background.apart(guess, sight.view) <= BETWEEN_PX:
            before, after = ([_at(a, b, one.time_s) for one in part] for a, part, b in parts)
            return [*before, here.view, *after], True
        found = [self._views_between(*part) for part in parts]
        if found[0] is None or found[1] is None:
            return None
        return [*found[0][0], here.view, *found[1][0]], False

    def _expected(self, time_s: float) -> View | None:
        """Where the camera would look now by its speed since about `LOOK_EVERY_S` ago."""
        now = self._looked[-1]
        for before in reversed(self._looked):
            since_s = now.time_s - before.time_s
            if since_s >= LOOK_EVERY_S / 2 and before.known:
                return _at(before, now, time_s)
        return None

    def _look_at(self, one: _Waiting) -> None:
        scene = self._background.scene(one.picture, one.boxes)
        if self._last is None:
            view, known = FIRST_VIEW, self._background.begin(scene)
        else:
            near = self._looked[-1].view
            found = self._background.look(scene, self._last, near)
            view, known = found or near, found is not None
        self._record(one, view, known=known)
        self._remember(scene, _Looked(one.time_s, view, known))

    def _record(self, one: _Waiting, view: View, *, known: bool) -> None:
        self._frames.append(one.index)
        self._rotations.frombytes(view.rotation.astype(np.float64).tobytes())
        self._zooms.append(view.zoom)
        self._known.append(known)

    def _remember(self, scene: Scene, looked: _Looked) -> None:
        self._last = scene
        self._looked = [*self._looked[-2 * MOST_WAITING :], looked]

    def _end_shot(self) -> None:
        if self._waiting:
            self._look()
        if not self._frames:
            return
        frames = len(self._frames)
        rotation, zoom = np.array(self._rotations).reshape(frames, 3, 3), np.array(self._zooms)
        moved = self._background.movement(rotation, zoom)
        if float(np.quantile(moved, 0.98)) < STILL_PX:
            rotation, zoom = np.broadcast_to(np.eye(3), (frames, 3, 3)), np.ones(frames)
        self._shots.append(
            CameraMotion(
                np.array(self._frames, np.int64),
                rotation,
                zoom,
                np.array(self._known, np.bool_),
                np.full(frames, len(self._shots), np.int64),
            )
        )
        self._start()


def _at(one: _Looked, other: _Looked, time_s: float) -> View:
    """Where the camera looks at another time, turning and zooming evenly."""
    return between(one.view, other.view, (time_s - one.time_s) / (other.time_s - one.time_s))
