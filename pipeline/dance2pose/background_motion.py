"""How the camera turns and zooms, seen by what does not dance: the background.

Corners of the background are followed by optical flow (Lucas and Kanade 1981, pyramids after
Bouguet) from a key picture to the present one; RANSAC over homographies keeps those that move as
one; the turn and the zoom that move them so are fitted to these. Comparing with a key picture
rather than with the last one leaves no drift as long as the key is in view, and a key seen earlier
is taken up again when the camera comes back to it.
"""

from __future__ import annotations

from array import array
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from dance2pose.lifting.world.moving_camera import CameraMotion, joined_shots
from dance2pose.lifting.world.perspective import camera_of
from dance2pose.poses import FloatArray, Frame, Image

# The longer side of the picture that is looked at, px.
SIZE = 320
# A shot whose background never moves by more than this, px at SIZE (0.3 % of the longer side),
# root mean square over the picture, is one of a camera that stands still.
STILL_PX = 1.0
# A point of the background lies this near to where the others say, px at SIZE.
_AGREE_PX = 1.0
_CORNERS, _FEWEST = 120, 12
_QUALITY, _APART_PX = 0.003, 6.0
# Fewer of a key's corners than this part: time for another key.
_FADED = 0.5
# A picture that shows less than this part of a key's view cannot be compared with it.
_OVERLAP = 0.6
_TURNED = np.radians(60.0)
_MOST_KEYS = 32
_MARGIN = 0.1  # of a person's box, that hair and shadow may stand out
_FLOW_WINDOW, _FLOW_LEVELS = (13, 13), 2
_FLOW_ENOUGH = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)

_Grey = npt.NDArray[np.uint8]


@dataclass(frozen=True)
class _Key:
    """A picture to compare with. points: (N, 1, 2) px of its corners. directions: (N, 3) to them,
    in the first frame's axes."""

    picture: _Grey
    points: npt.NDArray[np.float32]
    directions: FloatArray
    rotation: FloatArray
    zoom: float


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
        width, height = image_size
        self._scale = min(1.0, SIZE / max(width, height))
        self._size = (max(1, round(width * self._scale)), max(1, round(height * self._scale)))
        self._camera = camera_of(self._size, fov_deg)
        self._shots: list[CameraMotion] = []
        self._start()

    def _start(self) -> None:
        # Plain numbers: objects for each of an hour's frames would take much memory.
        self._frames = array("q")
        self._rotations = array("d")
        self._zooms = array("d")
        self._known = array("b")
        self._moved = array("d")
        self._rotation: FloatArray = np.eye(3)
        self._keys: list[_Key] = []
        self._key: _Key | None = None
        self._last: tuple[_Grey, _Grey] | None = None

    def update(self, frame: Frame, boxes: FloatArray, *, cut: bool = False) -> None:
        """The next frame. boxes: (N, 4) xyxy px, its people. cut: a new shot begins with it."""
        if cut and self._frames:
            self._end_shot()
        picture = self._prepared(frame.image)
        background = self._background(boxes)
        rotation, zoom, known = self._estimated(picture, background)
        self._last = picture, background
        self._frames.append(frame.index)
        self._rotation = rotation
        self._rotations.frombytes(rotation.astype(np.float64).tobytes())
        self._zooms.append(zoom)
        self._known.append(known)
        self._moved.append(self._movement(rotation, zoom))

    def _estimated(self, picture: _Grey, background: _Grey) -> tuple[FloatArray, float, bool]:
        """Rotation and zoom of this frame, and whether they are known."""
        if self._last is None:
            self._key = self._new_key(picture, background, np.eye(3), 1.0)
            return np.eye(3), 1.0, self._key is not None
        before = self._rotation, self._zooms[-1]
        found = self._followed(self._key, picture, background, *before)
        if found is None:  # something stands before the key's corners: those of the last picture
            self._key = self._new_key(*self._last, *before)
            found = self._followed(self._key, picture, background, *before)
        if found is None:
            return *before, False
        rotation, zoom, share = found
        assert self._key is not None
        if share < _FADED or not self._overlaps(self._key, rotation, zoom):
            self._next_key(picture, background, rotation, zoom)
        return rotation, zoom, True

    def finish(self) -> CameraMotion:
        """The motion over all frames given. A shot whose camera hardly moved stands still."""
        if self._frames:
            self._end_shot()
        return joined_shots(self._shots)

    def _end_shot(self) -> None:
        frames = len(self._frames)
        rotation, zoom = np.array(self._rotations).reshape(frames, 3, 3), np.array(self._zooms)
        if float(np.quantile(self._moved, 0.98)) < STILL_PX:
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

    def _prepared(self, image: Image) -> _Grey:
        step = max(1, int(0.5 / self._scale))  # averaging every pixel takes long
        grey = cv2.cvtColor(image[::step, ::step], cv2.COLOR_BGR2GRAY)
        small = cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.uint8)

    def _background(self, boxes: FloatArray) -> _Grey:
        """Mask, 255 where no person is."""
        mask = np.full(self._size[::-1], 255, np.uint8)
        for x0, y0, x1, y1 in boxes * self._scale:
            if not np.isfinite([x0, y0, x1, y1]).all():
                continue
            dx, dy = _MARGIN * (x1 - x0), _MARGIN * (y1 - y0)
            left, top = max(0, int(x0 - dx)), max(0, int(y0 - dy))
            mask[top : max(0, int(y1 + dy) + 1), left : max(0, int(x1 + dx) + 1)] = 0
        return mask

    def _followed(
        self,
        key: _Key | None,
        picture: _Grey,
        background: _Grey,
        rotation: FloatArray,
        zoom: float,
    ) -> tuple[FloatArray, float, float] | None:
        """Rotation, zoom, and the share of the key's corners that say so; near those given."""
        if key is None:
            return None
        guess = self._seen(key.directions, rotation, zoom).astype(np.float32)[:, None]
        at, found, _ = cv2.calcOpticalFlowPyrLK(
            key.picture,
            picture,
            key.points,
            guess.copy(),
            winSize=_FLOW_WINDOW,
            maxLevel=_FLOW_LEVELS,
            criteria=_FLOW_ENOUGH,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        inside = _values(background, np.asarray(at[:, 0], np.float64)) > 0
        rows = np.flatnonzero((found[:, 0] > 0) & inside)
        if len(rows) < _FEWEST:
            return None
        cv2.setRNGSeed(0)  # the same video, the same result
        _, agree = cv2.findHomography(key.points[rows], at[rows], cv2.RANSAC, _AGREE_PX)
        if agree is None:
            return None
        rows = rows[agree[:, 0] > 0]
        if len(rows) < _FEWEST:
            return None
        turned = self._fitted(key.directions[rows], at[rows, 0], rotation, zoom)
        return (*turned, len(rows) / len(key.points))

    def _fitted(
        self, directions: FloatArray, at: FloatArray, rotation: FloatArray, zoom: float
    ) -> tuple[FloatArray, float]:
        """Gauss-Newton over the turn and the logarithm of the zoom."""
        focal = self._camera.focal_px
        for _ in range(4):
            seen = directions @ rotation  # in this frame's axes
            x, y, ahead = seen[:, 0], seen[:, 1], -seen[:, 2]
            off = np.asarray(at - self._seen(directions, rotation, zoom)) * [1.0, -1.0]
            # Of (x, y) / ahead after a small turn w of the camera, which moves what is seen by
            # seen x w, and a small zoom.
            u, v = x / ahead, y / ahead
            one = np.ones(len(u))
            slope = np.stack(
                [
                    np.stack([-u * v, one + u * u, v, u], axis=1),
                    np.stack([-(one + v * v), u * v, -u, v], axis=1),
                ],
                axis=1,
            )
            step = np.linalg.lstsq(
                focal * zoom * slope.reshape(-1, 4), off.reshape(-1), rcond=None
            )[0]
            rotation = rotation @ Rotation.from_rotvec(step[:3]).as_matrix()
            zoom = float(zoom * np.exp(np.clip(step[3], -0.5, 0.5)))
            if np.abs(step).max() < 1e-6:
                break
        return rotation, zoom

    def _seen(self, directions: FloatArray, rotation: FloatArray, zoom: float) -> FloatArray:
        """Where (N, 2) px, y down, directions (N, 3) of the first frame's axes are seen."""
        seen = directions @ rotation
        ahead = np.maximum(-seen[:, 2:], 1e-3)
        flat = self._camera.centre + self._camera.focal_px * zoom * seen[:, :2] / ahead
        return np.asarray(flat * np.array([1.0, -1.0]))

    def _directions(self, points: FloatArray, rotation: FloatArray, zoom: float) -> FloatArray:
        flat = (points * [1.0, -1.0] - self._camera.centre) / (self._camera.focal_px * zoom)
        rays = np.concatenate([flat, -np.ones((len(flat), 1))], axis=1)
        return np.asarray(rays @ rotation.T)

    def _new_key(
        self, picture: _Grey, background: _Grey, rotation: FloatArray, zoom: float
    ) -> _Key | None:
        corners = cv2.goodFeaturesToTrack(picture, _CORNERS, _QUALITY, _APART_PX, mask=background)
        if corners is None or len(corners) < _FEWEST:
            return None
        directions = self._directions(corners[:, 0].astype(float), rotation, zoom)
        points = np.asarray(corners, dtype=np.float32)
        key = _Key(picture, points, directions, rotation, zoom)
        self._keys = [*self._keys[-_MOST_KEYS:], key]
        return key

    def _next_key(
        self, picture: _Grey, background: _Grey, rotation: FloatArray, zoom: float
    ) -> None:
        """The oldest key whose view is in sight and which this picture resembles; else itself."""
        for key in self._keys:
            if key is not self._key and self._overlaps(key, rotation, zoom):
                again = self._followed(key, picture, background, rotation, zoom)
                if again is not None and again[2] >= _FADED:
                    self._key = key
                    return
                break
        self._key = self._new_key(picture, background, rotation, zoom) or self._key

    def _overlaps(self, key: _Key, rotation: FloatArray, zoom: float) -> bool:
        turned = np.arccos(np.clip((key.rotation[:, 2] @ rotation[:, 2]), -1, 1))
        if turned > _TURNED:  # soon told
            return False
        at = self._seen(key.directions, rotation, zoom)
        width, height = self._size
        inside = ((at >= 0) & (at < [width, height])).all(axis=1)
        ahead = (key.directions @ rotation)[:, 2] < 0
        return bool((inside & ahead).mean() >= _OVERLAP and 0.6 < zoom / key.zoom < 1.6)

    def _movement(self, rotation: FloatArray, zoom: float) -> float:
        """Root mean square movement since the shot's first frame, px at SIZE, over the picture."""
        width, height = self._size
        grid = np.stack(np.meshgrid([0.1, 0.5, 0.9], [0.1, 0.5, 0.9]), axis=-1).reshape(-1, 2)
        points = grid * [width, height]
        first = self._directions(points, np.eye(3), 1.0)
        moved = self._seen(first, rotation, zoom) - points
        return float(np.sqrt(np.square(moved).sum(axis=1).mean()))


def _values(mask: _Grey, at: FloatArray) -> _Grey:
    """The mask at points (N, 2); 0 outside of it."""
    x, y = np.rint(np.nan_to_num(at, nan=-1.0)).clip(-1, 1e6).astype(int).T
    height, width = mask.shape
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    out = np.zeros(len(at), np.uint8)
    out[inside] = mask[y[inside], x[inside]]
    return out
