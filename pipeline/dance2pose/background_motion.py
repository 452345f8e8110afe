"""How the camera turns and zooms, seen by what does not dance: the background.

`background_view` tells where the camera looks in a single picture. Several times a second are
enough for a camera that stands, pans or zooms evenly: frames between two that were looked at are
interpolated. Where the camera is not where its even movement would have taken it, every frame is
looked at. (A jolt that is over by the next look goes unseen.)
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.background_view import FIRST_VIEW, BackgroundView, Scene, View
from dance2pose.lifting.world.moving_camera import CameraMotion, joined_shots
from dance2pose.poses import FloatArray, Frame

# A shot whose background never moves by more than this, px at SIZE (0.3 % of the longer side),
# root mean square over the picture, is one of a camera that stands still.
STILL_PX = 1.0
# The camera is looked at so often where it moves evenly: eight times a second, the hands that hold
# it moving it no faster, ...
LOOK_EVERY_S = 0.125
# ... holding no more pictures than this.
MOST_WAITING = 4
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
    frame: Frame
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
    >>> from dance2pose.poses import Frame
    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> picture = rng.integers(0, 255, (120, 160, 3), np.uint8)
    >>> follower = CameraMotionEstimator((160, 120))
    >>> for index in range(3):
    ...     follower.update(Frame(index, index / 25, picture), np.zeros((0, 4)))
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
        # The views of the last frames.
        self._views: list[View] = []
        self._waiting: list[_Waiting] = []
        # The last scene, and the last frames that were looked at, one after the other.
        self._last: Scene | None = None
        self._looked: list[_Looked] = []
        # Looks that may be taken yet before all waiting frames are looked at again.
        self._credit = 0

    def update(self, frame: Frame, boxes: FloatArray, *, cut: bool = False) -> None:
        """The next frame. boxes: (N, 4) xyxy px, its people. cut: a new shot begins with it."""
        if cut:
            self._end_shot()
        self._waiting.append(_Waiting(frame, boxes))
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
        times = [last, *(one.frame.time_s for one in self._waiting)]
        return 2 * times[-1] - times[-2] - last > LOOK_EVERY_S + _ROUNDING_S

    def _look(self) -> None:
        """Look at the last of the waiting frames, and where need be at all of them."""
        waiting, self._waiting = self._waiting, []
        if self._credit and len(waiting) > 1 and self._looked_at_once(waiting):
            self._credit -= 1
            return
        for one in waiting:
            self._look_at(one)
        self._credit = LOOKS_UNCOMPARED if self._was_even(waiting) else 0

    def _was_even(self, waiting: list[_Waiting]) -> bool:
        """Whether interpolation would have done for the frames that were just looked at."""
        rows = len(waiting) + 1
        if len(self._frames) < rows or not all(self._known[-rows:]):
            return False
        views, last_s = self._views[-rows:], self._looked[-rows].time_s
        step_s = waiting[-1].frame.time_s - last_s
        for view, one in zip(views[1:-1], waiting, strict=False):
            guessed = _between(views[0], views[-1], (one.frame.time_s - last_s) / step_s)
            if self._background.apart(guessed, view) > BETWEEN_PX:
                return False
        return True

    def _looked_at_once(self, waiting: list[_Waiting]) -> bool:
        """Look at the last frame; False, and nothing is done, if the camera moves unevenly."""
        start, one = self._looked[-1], waiting[-1]
        expected = self._expected(one.frame.time_s)
        if expected is None or not start.known:
            return False
        scene = self._background.scene(one.frame.image, one.boxes)
        sight = self._background.glance(scene, expected)
        if sight is None or self._background.apart(expected, sight.view) > EVEN_PX:
            return False
        view = self._background.settle(scene, sight)
        step_s = one.frame.time_s - start.time_s
        for between in waiting[:-1]:
            share = (between.frame.time_s - start.time_s) / step_s
            self._record(between.frame, _between(start.view, view, share), known=True)
        self._record(one.frame, view, known=True)
        self._remember(scene, _Looked(one.frame.time_s, view, True))
        return True

    def _expected(self, time_s: float) -> View | None:
        """Where the camera would look now by its speed since about `LOOK_EVERY_S` ago."""
        now = self._looked[-1]
        for before in reversed(self._looked):
            since_s = now.time_s - before.time_s
            if since_s >= LOOK_EVERY_S / 2 and before.known:
                return _between(before.view, now.view, (time_s - before.time_s) / since_s)
        return None

    def _look_at(self, one: _Waiting) -> None:
        scene = self._background.scene(one.frame.image, one.boxes)
        if self._last is None:
            view, known = FIRST_VIEW, self._background.begin(scene)
        else:
            near = self._views[-1]
            found = self._background.look(scene, self._last, near)
            view, known = found or near, found is not None
        self._record(one.frame, view, known=known)
        self._remember(scene, _Looked(one.frame.time_s, view, known))

    def _record(self, frame: Frame, view: View, *, known: bool) -> None:
        self._frames.append(frame.index)
        self._rotations.frombytes(view.rotation.astype(np.float64).tobytes())
        self._zooms.append(view.zoom)
        self._known.append(known)
        self._views = [*self._views[-MOST_WAITING:], view]

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


def _between(one: View, other: View, share: float) -> View:
    """The view that share (0..1, or beyond) of the way leads to, turning and zooming evenly."""
    turn = Rotation.from_matrix(one.rotation.T @ other.rotation).as_rotvec()
    rotation = one.rotation @ Rotation.from_rotvec(share * turn).as_matrix()
    return View(rotation, float(one.zoom * (other.zoom / one.zoom) ** share))
