"""MP4: the film with the keypoints over it, and the joints in 3D beside it.

Every frame that was processed keeps its own time, to a ninety-thousandth of a second, counted from
the first of them. Without sound.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import reduce
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from dance2pose.errors import OutputError, UsageError
from dance2pose.export.drawing import Room, draw_skeleton
from dance2pose.export.scene import ExportScene
from dance2pose.poses import Frame, Image
from dance2pose.recording.placement import floor_height
from dance2pose.skeleton import get
from dance2pose.video import open_video

_CLOCK = Fraction(1, 90_000)
# The encoder's quality; lower is better and larger.
_CRF = "20"
_TALLEST = 1080
_SHORTEST = 360
_BIT_RATE = 8_000_000


def write_overlay(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write the film of the scene; its frames are read from the video again."""
    if scene.video is None:
        raise UsageError(f"{path}: the result does not name its video; give it with --video")
    draw: _Drawing | None = None
    start_s = min(float(p.poses.time_s[0]) for p in scene.dancers)
    try:
        with av.open(str(path), "w", format="mp4") as container:
            container.metadata["comment"] = f"dance2pose; time 0 is {start_s:.6f} s of the video"
            stream: Any = None
            last = -1
            for frame in _frames(scene):
                draw = draw or _Drawing(scene, frame.image)
                image = draw(frame)
                stream = stream or _open_stream(container, image)
                picture = av.VideoFrame.from_ndarray(image, format="bgr24")
                picture.time_base = _CLOCK
                picture.pts = last = max(last + 1, round((frame.time_s - start_s) / _CLOCK))
                container.mux(stream.encode(picture))
            if stream is None:
                raise UsageError(f"{path}: {scene.video} has none of the frames of the result")
            container.mux(stream.encode(None))
    except av.error.FFmpegError as error:
        raise OutputError(f"{path}: cannot be encoded: {error}") from error
    return ("without sound",)


def _open_stream(container: Any, image: Image) -> Any:
    height, width = image.shape[:2]
    if "libx264" in av.codecs_available:
        stream = container.add_stream("libx264", options={"crf": _CRF, "bf": "0"})
    else:
        stream = container.add_stream("mpeg4", options={"bf": "0"})
        stream.bit_rate = _BIT_RATE
    stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
    stream.time_base = stream.codec_context.time_base = _CLOCK
    return stream


def _frames(scene: ExportScene) -> Iterator[Frame]:
    """The processed frames of the video, from the first dancer's to the last one's."""
    assert scene.video is not None
    numbers = np.unique(np.concatenate([p.poses.frame for p in scene.dancers]))
    every = reduce(np.gcd, np.diff(numbers), 0) or 1
    start_s = min(float(p.poses.time_s[0]) for p in scene.dancers)
    with open_video(scene.video, start_s=max(0.0, start_s - 1e-4) or None) as frames:
        for frame in frames:
            if frame.index > numbers[-1]:
                break
            if frame.index >= numbers[0] and (frame.index - numbers[0]) % every == 0:
                yield frame


class _Drawing:
    """Draws one frame after another: the film on the left, the room on the right."""

    def __init__(self, scene: ExportScene, image: Image) -> None:
        height, width = image.shape[:2]
        self._scale = float(np.clip(1.0, _SHORTEST / height, _TALLEST / height))
        self._size = _even(width * self._scale), _even(height * self._scale)
        self._dancers = scene.dancers
        self._rows = [
            {int(frame): row for row, frame in enumerate(p.poses.frame)} for p in scene.dancers
        ]
        self._places = []
        for p in scene.dancers:
            floor = np.nan_to_num(floor_height(p.poses.world_xyz)) if p.poses.root is None else 0.0
            self._places.append(p.poses.world_xyz - np.array([0.0, float(floor), 0.0]))
        everywhere = np.concatenate([places.reshape(-1, 3) for places in self._places])
        room_width = _even(max(0.75 * self._size[1], 0.5 * self._size[0]))
        self._room = Room.around(everywhere, (room_width, self._size[1]))
        self._empty = self._room.empty()

    def __call__(self, frame: Frame) -> Image:
        film: Image = cv2.resize(frame.image, self._size).astype(np.uint8)
        room = self._empty.copy()
        for dancer, rows, places in zip(self._dancers, self._rows, self._places, strict=True):
            row = rows.get(frame.index)
            if row is None:
                continue
            track = dancer.keypoints
            if track is not None:
                here = np.searchsorted(track.frame, frame.index)
                if here < len(track) and track.frame[here] == frame.index:
                    xy = (track.xy[here] + 0.5) * self._scale - 0.5
                    draw_skeleton(film, xy, get(track.skeleton), dancer.person)
            draw_skeleton(room, self._room.project(places[row]), dancer.skeleton, dancer.person)
        return np.hstack([film, room])


def _even(length: float) -> int:
    return max(2, 2 * round(length / 2))
