"""How long a batch will take, from a short measurement."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dance2pose.archive.ledger_tables import Item
from dance2pose.archive.recipe import Recipe
from dance2pose.errors import Dance2PoseError
from dance2pose.reconstruction import reconstruct
from dance2pose.video import open_video

# What is measured: so much of so many of the videos, spread over the collection.
_VIDEOS = 3
_SECONDS = 3.0


@dataclass(frozen=True)
class Estimate:
    """hours: with the given workers. measured: videos that were tried. unread: that say no length
    of their own and are counted as the others' mean."""

    hours: float
    frames: int
    seconds_a_frame: float
    measured: int
    unread: int


def estimate(items: Sequence[Item], recipe: Recipe, workers: int) -> Estimate | None:
    """Hours for the items; None where no video could be measured."""
    frames = [_frame_count(item.path) for item in items]
    known = [count for count in frames if count]
    step = max(1, len(items) // _VIDEOS)
    tried = [_seconds_a_frame(item, recipe) for item in items[::step][:_VIDEOS]]
    speeds = [speed for speed in tried if speed is not None]
    if not known or not speeds:
        return None
    unread = len(frames) - len(known)
    total = sum(known) + round(unread * sum(known) / len(known))
    speed = sum(speeds) / len(speeds)
    return Estimate(total * speed / workers / 3600, total, speed, len(speeds), unread)


def _frame_count(path: Path) -> int | None:
    try:
        with open_video(path) as frames:
            info = frames.info
            if info.frame_count:
                return int(info.frame_count)
            if info.duration_s and info.frame_rate:
                return round(float(info.duration_s) * float(info.frame_rate))
    except Dance2PoseError:
        pass
    return None


def _seconds_a_frame(item: Item, recipe: Recipe) -> float | None:
    """Time a frame takes, over the first seconds of a video; its start-up counts too."""
    own = recipe.with_row(item.overrides)
    start = own.settings.video.start_s or 0.0
    short = own.changed(end_s=start + _SECONDS)
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        try:
            summary = reconstruct(
                item.path, Path(folder) / "recording.rrd", short.settings, outputs=short.outputs
            )
        except Dance2PoseError:
            return None
    return (time.monotonic() - began) / max(1, summary.frames)
