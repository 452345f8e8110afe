"""Where the camera looks in one picture, told by the background of another.

Corners of the background are followed by optical flow (Lucas and Kanade 1981, pyramids after
Bouguet) from a key picture to the present one; RANSAC over turns and zooms keeps those that move as
one; the turn and the zoom that move them so are fitted to these. Comparing with a key picture
rather than with the last one leaves no drift as long as the key is in view, and a key seen earlier
is taken up again when the camera comes back to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from dance2pose.lifting.world.perspective import camera_of
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.small_picture import SIZE, Grey, small_size

# A point of the background lies this near to where the others say, px at SIZE.
_AGREE_PX = 0.8
# Guesses at the movement, from two points each: if a third of the points agree, one of these is
# of two such but in one case of a thousand.
_GUESSES = 64
_CORNERS, _FEWEST = 80, 12
_QUALITY, _APART_PX = 0.003, 5.0
# Fewer of a key's corners than this part: time for another key.
_FADED = 0.5
# A picture that shows less than this part of a key's view cannot be compared with it.
_OVERLAP = 0.6
_LEAST_COSINE = 0.5  # of the angle between them
_MOST_KEYS = 32
_MARGIN = 0.1  # of a person's box, that hair and shadow may stand out
_FLOW_WINDOW, _FLOW_LEVELS = (13, 13), 2
_FLOW_ENOUGH = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)
# A step of the fit that moves no point by a hundredth of a pixel is the last.
_LAST_STEP_RAD = 3e-5
# Of the sum of the normal equations' diagonal, added to it.
_LEAST_PART = 1e-9
_DIAGONAL = np.diag_indices(4)
# From axes y up to pixels y down.
_DOWN = np.array([1.0, -1.0])
# Where the whole picture's movement is measured, as shares of its sides.
_GRID = np.stack(np.meshgrid([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]), axis=-1).reshape(-1, 2)


@dataclass(frozen=True)
class View:
    """Where the camera looks. rotation: (3, 3), in the first frame's axes. zoom: since then."""

    rotation: FloatArray
    zoom: float


FIRST_VIEW = View(np.eye(3), 1.0)


@dataclass(frozen=True)
class Scene:
    """A small grey picture, and its mask: 255 where no person is."""

    picture: Grey
    background: Grey


@dataclass(frozen=True)
class Sight:
    """A view, and the share of the key's corners that say so."""

    view: View
    share: float


@dataclass(frozen=True)
class _Key:
    """A picture to compare with. points: (N, 1, 2) px of its corners. directions: (N, 3) to them,
    in the first frame's axes."""

    picture: Grey
    points: npt.NDArray[np.float32]
    directions: FloatArray
    view: View


class BackgroundView:
    """Tells the views of one shot, beginning with `begin`.

    image_size: (width, height) px of the pictures. fov_deg: field of view across the longer side
    of the first picture, None for the assumed one.
    """

    def __init__(self, image_size: tuple[int, int], fov_deg: float | None) -> None:
        width, height = image_size
        self._scale = min(1.0, SIZE / max(width, height))
        self._size = small_size(width, height)
        self._camera = camera_of(self._size, fov_deg)
        self._keys: list[_Key] = []
        self._key: _Key | None = None

    def scene(self, picture: Grey, boxes: FloatArray) -> Scene:
        """What is looked at of a small picture with people in boxes (N, 4), xyxy px of the large
        one."""
        return Scene(picture, self._background(boxes))

    def begin(self, scene: Scene) -> bool:
        """A new shot. Returns whether there is background enough to tell its views by."""
        self._keys = []
        self._key = self._new_key(scene, FIRST_VIEW)
        return self._key is not None

    def glance(self, scene: Scene, near: View) -> Sight | None:
        """The view of a scene, near the given one, by the present key alone; None if untold."""
        return None if self._key is None else self._followed(self._key, scene, near)

    def look(self, scene: Scene, last: Scene, near: View) -> View | None:
        """The view of a scene that follows `last`, whose view is `near`; None if untold."""
        sight = self.glance(scene, near)
        if sight is None:  # something stands before the key's corners: those of the last picture
            self._key = self._new_key(last, near)
            sight = self.glance(scene, near)
        return None if sight is None else self.settle(scene, sight)

    def settle(self, scene: Scene, sight: Sight) -> View:
        """Take the sight for the view of the scene, and another key where this one fades."""
        assert self._key is not None
        if sight.share < _FADED or not self._overlaps(self._key, sight.view):
            self._next_key(scene, sight.view)
        return sight.view

    def movement(self, rotation: FloatArray, zoom: FloatArray) -> FloatArray:
        """Root mean square movement (T,) over the picture since the first frame, px at SIZE.

        rotation: (T, 3, 3); zoom: (T,).
        """
        points = _GRID * self._size
        first = self._directions(points, FIRST_VIEW)
        moved = self._seen(first, rotation, zoom[:, None, None]) - points
        return np.asarray(np.sqrt(np.square(moved).sum(axis=2).mean(axis=1)))

    def apart(self, one: View, other: View) -> float:
        """Root mean square distance of the picture's points in two views, px at SIZE."""
        directions = self._directions(_GRID * self._size, one)
        moved = self._seen(directions, other.rotation, other.zoom) - _GRID * self._size
        return float(np.sqrt(np.square(moved).sum(axis=1).mean()))

    def _background(self, boxes: FloatArray) -> Grey:
        mask = np.full(self._size[::-1], 255, np.uint8)
        for x0, y0, x1, y1 in boxes * self._scale:
            if not np.isfinite([x0, y0, x1, y1]).all():
                continue
            dx, dy = _MARGIN * (x1 - x0), _MARGIN * (y1 - y0)
            left, top = max(0, int(x0 - dx)), max(0, int(y0 - dy))
            mask[top : max(0, int(y1 + dy) + 1), left : max(0, int(x1 + dx) + 1)] = 0
        return mask

    def _followed(self, key: _Key, scene: Scene, near: View) -> Sight | None:
        guess = self._seen(key.directions, near.rotation, near.zoom).astype(np.float32)[:, None]
        at, found, _ = cv2.calcOpticalFlowPyrLK(
            key.picture,
            scene.picture,
            key.points,
            guess.copy(),  # the answer is written into it
            winSize=_FLOW_WINDOW,
            maxLevel=_FLOW_LEVELS,
            criteria=_FLOW_ENOUGH,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        rows = np.flatnonzero(
            (found[:, 0] > 0) & _shown(scene.background, np.asarray(at[:, 0], np.float64))
        )
        if len(rows) < _FEWEST:
            return None
        directions, seen = key.directions[rows], np.asarray(at[rows, 0], np.float64)
        view = self._by_most(directions, seen, near)
        if view is None:
            view = self._roughly(directions, seen, near)
        agree = self._agree(directions, seen, view)
        if agree.sum() < _FEWEST:
            return None
        view = self._fitted(directions[agree], seen[agree], view)
        return Sight(view, agree.sum() / len(key.points))

    def _agree(self, directions: FloatArray, at: FloatArray, view: View) -> BoolArray:
        off = at - self._seen(directions, view.rotation, view.zoom)
        return np.asarray(np.square(off).sum(axis=1) < _AGREE_PX**2)

    def _by_most(self, directions: FloatArray, at: FloatArray, near: View) -> View | None:
        """The view by which more than half of the points move as one, which is soon told where
        most move as their median does; else None."""
        slope, off = self._linear(directions, at, near)
        half = len(off) // 2
        away = np.square(off - np.sort(off, axis=0)[half]).sum(axis=1)
        agree = away <= max(np.sort(away)[half], _AGREE_PX**2)
        view = _stepped(near, _solved(slope[agree], off[agree]))
        agree = self._agree(directions, at, view)
        return view if 2 * agree.sum() > len(at) else None

    def _roughly(self, directions: FloatArray, at: FloatArray, near: View) -> View:
        """The view to first order, by the most points that move as one: RANSAC, each guess at the
        movement being that of two points."""
        count = len(directions)
        slope, off = self._linear(directions, at, near)
        rng = np.random.default_rng(0)  # the same video, the same result
        one = rng.integers(0, count, _GUESSES)
        pairs = np.stack([one, (one + rng.integers(1, count, _GUESSES)) % count], axis=1)
        steps = np.linalg.solve(slope[pairs].reshape(-1, 4, 4), off[pairs].reshape(-1, 4, 1))
        left = (slope.reshape(-1, 4) @ steps[:, :, 0].T).reshape(count, 2, -1) - off[:, :, None]
        agree = np.square(left).sum(axis=1) < _AGREE_PX**2
        most = agree[:, np.argmax(agree.sum(axis=0))]
        return _stepped(near, _solved(slope[most], off[most]))

    def _fitted(self, directions: FloatArray, at: FloatArray, near: View) -> View:
        """Gauss-Newton over the turn and the logarithm of the zoom."""
        view = near
        for _ in range(4):
            step = _solved(*self._linear(directions, at, view))
            view = _stepped(view, step)
            if np.abs(step).max() < _LAST_STEP_RAD:
                break
        return view

    def _linear(
        self, directions: FloatArray, at: FloatArray, view: View
    ) -> tuple[FloatArray, FloatArray]:
        """What a small turn and zoom do to what is seen (N, 2, 4), and what they should (N, 2)."""
        seen = directions @ view.rotation  # in this frame's axes
        focal = self._camera.focal_px * view.zoom
        # Of (x, y) / ahead after a small turn w of the camera, which moves what is seen by
        # seen x w, and a small zoom.
        flat = seen[:, :2] / np.maximum(-seen[:, 2:], 1e-3)
        u, v = flat.T
        slope = np.empty((len(u), 2, 4))
        slope[:, 0, 0] = slope[:, 1, 1] = u * v
        slope[:, 0, 0] *= -1
        slope[:, 0, 1], slope[:, 1, 0] = 1 + u * u, -1 - v * v
        slope[:, 0, 2], slope[:, 1, 2] = v, -u
        slope[:, :, 3] = flat
        return focal * slope, at * _DOWN - (self._camera.centre + focal * flat)

    def _seen(
        self, directions: FloatArray, rotation: FloatArray, zoom: float | FloatArray
    ) -> FloatArray:
        """Where (..., N, 2) px, y down, directions (N, 3) of the first frame's axes are seen."""
        seen = directions @ rotation
        ahead = np.maximum(-seen[..., 2:], 1e-3)
        flat = self._camera.centre + self._camera.focal_px * zoom * seen[..., :2] / ahead
        return np.asarray(flat * _DOWN)

    def _directions(self, points: FloatArray, view: View) -> FloatArray:
        flat = (points * _DOWN - self._camera.centre) / (self._camera.focal_px * view.zoom)
        rays = np.concatenate([flat, -np.ones((len(flat), 1))], axis=1)
        return np.asarray(rays @ view.rotation.T)

    def _new_key(self, scene: Scene, view: View) -> _Key | None:
        corners = cv2.goodFeaturesToTrack(
            scene.picture, _CORNERS, _QUALITY, _APART_PX, mask=scene.background
        )
        if corners is None or len(corners) < _FEWEST:
            return None
        directions = self._directions(corners[:, 0].astype(float), view)
        key = _Key(scene.picture, np.asarray(corners, np.float32), directions, view)
        self._keys = [*self._keys[-_MOST_KEYS:], key]
        return key

    def _next_key(self, scene: Scene, view: View) -> None:
        """The oldest key whose view is in sight and which this picture resembles; else itself."""
        for key in self._keys:
            if key is not self._key and self._overlaps(key, view):
                again = self._followed(key, scene, view)
                if again is not None and again.share >= _FADED:
                    self._key = key
                    return
                break
        self._key = self._new_key(scene, view) or self._key

    def _overlaps(self, key: _Key, view: View) -> bool:
        """Whether a picture of this view shows enough of the key's."""
        x, y, behind = key.view.rotation[:, 2] @ view.rotation  # the key's axis, in this view's
        if behind < _LEAST_COSINE:
            return False
        focal = self._camera.focal_px * view.zoom / behind
        width, height = self._size
        share = max(0.0, 1 - focal * abs(x) / width) * max(0.0, 1 - focal * abs(y) / height)
        return bool(share >= _OVERLAP and 0.6 < view.zoom / key.view.zoom < 1.6)


def _solved(slope: FloatArray, off: FloatArray) -> FloatArray:
    """The step (4,) by which slope (N, 2, 4) comes nearest to off (N, 2)."""
    flat = slope.reshape(-1, 4)
    normal = flat.T @ flat
    normal[_DIAGONAL] += _LEAST_PART * normal.trace()  # points too near each other tell no zoom
    return np.asarray(np.linalg.solve(normal, flat.T @ off.reshape(-1)))


def _stepped(view: View, step: FloatArray) -> View:
    """The view after a turn (rotation vector) and the logarithm of a zoom."""
    rotation = view.rotation @ rotation_by(step[:3])
    return View(rotation, float(view.zoom * np.exp(np.clip(step[3], -0.5, 0.5))))


def rotation_by(turn: FloatArray) -> FloatArray:
    """The matrix (3, 3) of a rotation vector. (OpenCV's takes a tenth of SciPy's time.)"""
    return np.asarray(cv2.Rodrigues(turn)[0])


def turn_of(rotation: FloatArray) -> FloatArray:
    """The rotation vector of a matrix (3, 3)."""
    return np.asarray(cv2.Rodrigues(rotation)[0][:, 0])


def between(one: View, other: View, share: float) -> View:
    """The view that share (0..1, or beyond) of the way leads to, turning and zooming evenly."""
    turn = share * turn_of(one.rotation.T @ other.rotation)
    zoom = float(one.zoom * (other.zoom / one.zoom) ** share)
    return View(one.rotation @ rotation_by(turn), zoom)


def _shown(mask: Grey, at: FloatArray) -> BoolArray:
    """(N,) whether points (N, 2) px lie where the mask is not 0; not outside of it."""
    height, width = mask.shape
    inside = (at > -0.5) & (at < (width - 0.5, height - 0.5))  # and are numbers
    shown: BoolArray = inside[:, 0] & inside[:, 1]
    column, row = np.rint(at[shown]).astype(int).T
    shown[shown] = mask[row, column] > 0
    return shown
