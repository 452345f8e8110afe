"""A strip of small pictures with skeletons, for the report."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.errors import OutputError
from dance2pose.poses import Frame, Image, Track2D

HEIGHT = 120
PICTURES = 5
_KEPT = 8 * PICTURES
_JPEG_QUALITY = 70
# One a dancer (BGR), legible on most pictures.
_COLOURS = ((64, 214, 255), (130, 220, 80), (255, 130, 225), (224, 224, 64), (100, 160, 255))


@dataclass
class Thumbnails:
    """Looks at every frame of a run and keeps a few small ones, evenly, however long it is."""

    _kept: list[tuple[int, float, Image]] = field(default_factory=list)
    _every: int = 1
    _count: int = 0

    def __call__(self, frame: Frame) -> None:
        if self._count % self._every == 0:
            height, width = frame.image.shape[:2]
            scale = HEIGHT / height
            size = (max(1, min(4 * HEIGHT, round(width * scale))), HEIGHT)
            small = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA)
            self._kept.append((frame.index, scale, np.asarray(small, np.uint8)))
            if len(self._kept) > _KEPT:
                self._kept = self._kept[::2]
                self._every *= 2
        self._count += 1

    def write(self, path: Path, tracks: Sequence[Track2D]) -> None:
        """Write the strip as JPEG: frames with a pose where there are any, evenly in time."""
        with_pose = {
            int(frame) for t in tracks for frame in t.frame[~np.isnan(t.xy).all(axis=(1, 2))]
        }
        kept = [entry for entry in self._kept if entry[0] in with_pose] or self._kept
        if not kept:
            return
        places = np.linspace(0, len(kept) - 1, min(PICTURES, len(kept))).round().astype(int)
        pictures = [_drawn(*kept[int(place)], tracks=tracks) for place in places]
        done, content = cv2.imencode(
            ".jpg", cv2.hconcat(pictures), [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
        )
        if not done:
            raise OutputError(f"{path}: the strip of thumbnails cannot be encoded")
        path.write_bytes(content.tobytes())


def _drawn(frame: int, scale: float, picture: Image, *, tracks: Sequence[Track2D]) -> Image:
    drawn = picture.copy()
    for track in tracks:
        row = int(np.searchsorted(track.frame, frame))
        if row < len(track) and track.frame[row] == frame:
            _draw(drawn, track.xy[row] * scale, track)
    return drawn


def _draw(
    picture: Image, xy: np.ndarray[tuple[int, ...], np.dtype[np.floating]], track: Track2D
) -> None:
    colour = _COLOURS[(track.person - 1) % len(_COLOURS)]
    for a, b in skeletons.get(track.skeleton).bones:
        if np.isfinite(xy[[a, b]]).all():
            start, end = (
                tuple(point) for point in xy[[a, b]].clip(-9999, 9999).round().astype(int).tolist()
            )
            cv2.line(picture, start, end, colour, 1, cv2.LINE_AA)
