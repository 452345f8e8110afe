"""Tracks some frames at a time: what is made of an hour of them is never held as a whole."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np

from dance2pose.poses import Dancer, Timeline, Track2D, Track3D
from dance2pose.viewpoint import Viewpoint

# Frames that are worked on together: positions of 17 joints are 1.2 MB.
FRAMES = 3_000

Track = TypeVar("Track", Track2D, Track3D)


def portions(length: int) -> Iterator[slice]:
    """Rows that follow each other, FRAMES of them at a time."""
    for start in range(0, length, FRAMES):
        yield slice(start, min(start + FRAMES, length))


def dancer_rows(dancer: Dancer, rows: slice) -> Dancer:
    """The dancer in these rows of the track; arrays are looked at, not copied."""
    keypoints, raw = track_rows(dancer.keypoints, rows), track_rows(dancer.raw, rows)
    return Dancer(keypoints, raw, track_rows(dancer.smoothed, rows))


def track_rows(track: Track, rows: slice) -> Track:
    """The track in these rows."""
    changed: dict[str, Any] = {}
    for field in dataclasses.fields(track):
        value = getattr(track, field.name)
        if isinstance(value, np.ndarray):
            changed[field.name] = value[rows]
        elif isinstance(value, Timeline):
            changed[field.name] = timeline_rows(value, rows)
        elif isinstance(value, Viewpoint):
            rotation, focal_px = value.rotation[rows], value.focal_px[rows]
            changed[field.name] = dataclasses.replace(value, rotation=rotation, focal_px=focal_px)
    return dataclasses.replace(track, **changed)


def timeline_rows(timeline: Timeline, rows: slice) -> Timeline:
    """The frames of these rows."""
    return Timeline(timeline.frame[rows], timeline.time_s[rows])
