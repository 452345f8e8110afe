"""Small videos for the tests, encoded with PyAV. Every picture carries its number, so that a test
can tell which one it got back, and which way up."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.filter import Graph
from av.stream import Disposition
from av.video.frame import VideoFrame

BITS = 8
LOSSLESS = {"qp": "0", "preset": "ultrafast"}


def numbered(number: int, width: int = 128, height: int = 96) -> np.ndarray:
    """(H, W, 3) BGR: on grey, a row of BITS black or white blocks along the top (the number, most
    significant left), blue in the bottom left corner, red in the bottom right."""
    image = np.full((height, width, 3), 110, dtype=np.uint8)
    block = width // BITS
    for bit in range(BITS):
        value = 235 if number >> (BITS - 1 - bit) & 1 else 20
        image[: height // 3, bit * block : (bit + 1) * block] = value
    image[2 * height // 3 :, : width // 4] = (200, 40, 40)
    image[2 * height // 3 :, 3 * width // 4 :] = (40, 40, 200)
    return image


def read_number(image: np.ndarray) -> int:
    """The number of a picture made by `numbered`, at any size."""
    height, width = image.shape[:2]
    block = width / BITS
    number = 0
    for bit in range(BITS):
        centre = image[height // 6, int((bit + 0.5) * block)].mean()
        assert not 100 < centre < 140, f"block {bit} is neither black nor white: {centre}"
        number = number * 2 + int(centre > 127)
    return number


def is_upright(image: np.ndarray) -> bool:
    """Whether the blue and red corners of `numbered` are where they belong."""
    height, width = image.shape[:2]
    left = image[5 * height // 6, width // 8].astype(int)
    right = image[5 * height // 6, 7 * width // 8].astype(int)
    return bool(left[0] - left[2] > 80 and right[2] - right[0] > 80)


def as_frame(image: np.ndarray, pixel_format: str, *, fields: str | None = None) -> VideoFrame:
    """A BGR image as an encoder's picture, marked as interlaced if fields is "tff" or "bff"."""
    frame = VideoFrame.from_ndarray(np.ascontiguousarray(image), format="bgr24")
    frame = frame.reformat(format=pixel_format, dst_colorspace="ITU601", dst_color_range="MPEG")
    if fields is None:
        return frame
    graph = Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=Fraction(1, 25)
    )
    graph.link_nodes(source, graph.add("setfield", fields), graph.add("buffersink")).configure()
    frame.pts = 0
    frame.time_base = Fraction(1, 25)
    graph.push(frame)
    return graph.vpull()


def make_video(
    path: Path,
    images: Iterable[np.ndarray],
    *,
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    rate: Fraction | int = 25,
    times_ms: Sequence[int] | None = None,
    sample_aspect: Fraction | None = None,
    turned: tuple[float, bool, bool] | None = None,
    fields: str | None = None,
    options: dict[str, str] | None = None,
    container_format: str | None = None,
    container_options: dict[str, str] | None = None,
    **context: Any,
) -> Path:
    """Encode `images` (BGR, one size) at a steady rate, or at `times_ms`.

    turned: (degrees, hflip, vflip) of the display matrix, counter-clockwise. fields: "tff" or "bff"
    marks the pictures interlaced. context: attributes of the codec context (colorspace …).
    """
    with av.open(
        str(path), "w", format=container_format, container_options=container_options or {}
    ) as container:
        stream: Any = None
        for number, image in enumerate(images):
            if stream is None:
                stream = container.add_stream(codec, rate=rate, options=options or {})
                stream.height, stream.width = image.shape[:2]
                stream.pix_fmt = pixel_format
                if times_ms is not None:
                    stream.codec_context.time_base = Fraction(1, 1000)
                if sample_aspect is not None:
                    stream.codec_context.sample_aspect_ratio = sample_aspect
                if turned is not None:
                    stream.set_display_rotation(turned[0], hflip=turned[1], vflip=turned[2])
                for name, value in context.items():
                    setattr(stream.codec_context, name, value)
            frame = as_frame(image, pixel_format, fields=fields)
            if times_ms is None:
                frame.pts, frame.time_base = number, 1 / Fraction(rate)
            else:
                frame.pts, frame.time_base = times_ms[number], Fraction(1, 1000)
            container.mux(stream.encode(frame))
        if stream is not None:
            container.mux(stream.encode(None))
    return path


def numbered_video(path: Path, count: int = 12, **options: Any) -> Path:
    """A video of `count` numbered pictures; options as of `make_video`, and width, height."""
    size = {name: options.pop(name) for name in ("width", "height") if name in options}
    return make_video(path, (numbered(number, **size) for number in range(count)), **options)


@dataclass(frozen=True)
class TrackPlan:
    """A video track for `make_tracks`: numbered pictures from `first` on, at a steady rate."""

    count: int
    rate: int = 25
    start_ms: int = 0
    first: int = 0
    width: int = 128
    height: int = 96
    is_default: bool = False


def make_tracks(
    path: Path,
    tracks: Sequence[TrackPlan],
    *,
    codec: str = "libx264",
    pixel_format: str = "yuv420p",
    sound_s: float | None = None,
    metadata: dict[str, str] | None = None,
) -> Path:
    """Several video tracks in one file, and sound from 0 s on if asked for. metadata: of each."""
    with av.open(str(path), "w") as container:
        streams: list[Any] = []
        for plan in tracks:
            stream: Any = container.add_stream(codec, rate=plan.rate)
            stream.width, stream.height, stream.pix_fmt = plan.width, plan.height, pixel_format
            stream.codec_context.time_base = Fraction(1, 1000 * plan.rate)
            stream.disposition = Disposition.default if plan.is_default else Disposition(0)
            stream.metadata.update(metadata or {})
            streams.append(stream)
        if sound_s is not None:
            _add_silence(container, sound_s)
        for plan, stream in zip(tracks, streams, strict=True):
            for number in range(plan.count):
                image = numbered(plan.first + number, plan.width, plan.height)
                frame = as_frame(image, pixel_format)
                frame.pts = plan.start_ms * plan.rate + 1000 * number
                frame.time_base = Fraction(1, 1000 * plan.rate)
                container.mux(stream.encode(frame))
            container.mux(stream.encode(None))
    return path


def _add_silence(container: Any, length_s: float) -> None:
    stream = container.add_stream("aac", rate=8000, layout="mono")
    for number in range(int(length_s * 8000 / 1024) + 1):
        frame = av.AudioFrame.from_ndarray(
            np.zeros((1, 1024), dtype=np.float32), format="fltp", layout="mono"
        )
        frame.sample_rate, frame.pts = 8000, number * 1024
        container.mux(stream.encode(frame))
    container.mux(stream.encode(None))


def show_only(path: Path, seconds: float) -> Path:
    """Set the one edit of an MP4 so that only so many seconds are shown."""
    data = bytearray(path.read_bytes())
    length = struct.pack(">I", round(seconds * 1000))  # FFmpeg's time scale of the movie
    edit = data.index(b"elst") + 4
    assert data[edit : edit + 8] == struct.pack(">II", 0, 1), "one edit, version 0"
    data[edit + 8 : edit + 12] = length
    for box, offset in ((b"tkhd", 24), (b"mvhd", 20)):
        start = data.index(box)
        data[start + offset : start + offset + 4] = length
    path.write_bytes(data)
    return path


def make_sound(path: Path) -> Path:
    """A file with sound alone."""
    with av.open(str(path), "w") as container:
        _add_silence(container, 1)
    return path


def scene(seed: int, width: int = 320, height: int = 240) -> np.ndarray:
    """A still background of coloured blobs and edges; each seed another."""
    random = np.random.default_rng(seed)
    coarse = random.integers(30, 200, size=(height // 40, width // 40, 3)).astype(np.uint8)
    image = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
    for _ in range(12):
        x, y = random.integers(0, width), random.integers(0, height)
        size = random.integers(15, 70, size=2)
        colour = tuple(int(value) for value in random.integers(20, 230, size=3))
        cv2.rectangle(image, (int(x), int(y)), (int(x + size[0]), int(y + size[1])), colour, -1)
    return image


def with_dancer(background: np.ndarray, time: float, *, size: float = 0.25) -> np.ndarray:
    """The background with a tall textured ellipse that swings from side to side, `time` in s."""
    image = background.copy()
    height, width = image.shape[:2]
    x = int(width * (0.5 + 0.3 * np.sin(5 * time)))
    centre, axes = (x, height // 2), (int(width * size / 4), int(height * size * 1.6))
    cv2.ellipse(image, centre, axes, 20 * np.sin(9 * time), 0, 360, (60, 90, 220), -1)
    for offset in range(-60, 60, 12):
        cv2.line(
            image, (x - 20, height // 2 + offset), (x + 20, height // 2 + offset), (240,) * 3, 3
        )
    return image


def woven(first: np.ndarray, second: np.ndarray, *, fields: str = "tff") -> np.ndarray:
    """One interlaced picture of two moments: "tff" puts the first on the even lines."""
    image = first.copy() if fields == "tff" else second.copy()
    image[1::2] = second[1::2] if fields == "tff" else first[1::2]
    return image
