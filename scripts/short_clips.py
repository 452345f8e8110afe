"""Short real clips, cut from longer videos, for tests and measurements of batches."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import av


def cut_clips(
    videos: list[Path], folder: Path, *, count: int, frames: int, height: int = 240
) -> list[Path]:
    """`count` clips of so many frames each, at places spread over the videos; no two are alike."""
    folder.mkdir(parents=True, exist_ok=True)
    made: list[Path] = []
    for number in range(count):
        video = videos[number % len(videos)]
        place = folder / f"{number:03d}_{video.stem}.mp4"
        _cut(video, place, skip=(number // len(videos)) * frames, frames=frames, height=height)
        made.append(place)
    return made


def _cut(video: Path, place: Path, *, skip: int, frames: int, height: int) -> None:
    with av.open(str(video)) as source, av.open(str(place), "w") as target:
        read = source.streams.video[0]
        rate = read.average_rate or 25
        written: Any = target.add_stream("libx264", rate=rate)
        written.height = height
        written.width = round(read.width * height / read.height / 2) * 2
        written.pix_fmt = "yuv420p"
        written.options = {"preset": "ultrafast"}
        for number, frame in enumerate(source.decode(read)):
            if skip <= number < skip + frames:
                picture = av.VideoFrame.from_image(frame.to_image())
                for packet in written.encode(picture):
                    target.mux(packet)
            elif number >= skip + frames:
                break
        for packet in written.encode():
            target.mux(packet)
