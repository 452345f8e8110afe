"""What came of one video: the data that every writer takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dance2pose.body import Body
from dance2pose.poses import Dancer, Timeline
from dance2pose.provenance import Provenance
from dance2pose.video import VideoInfo


@dataclass(frozen=True)
class Source:
    """The video that was read. timeline: every frame that was processed."""

    info: VideoInfo
    sha256: str
    timeline: Timeline
    deinterlaced: bool = False

    @property
    def path(self) -> Path:
        return self.info.path

    @property
    def image_size(self) -> tuple[int, int]:
        """(width, height) px of the frames as read: upright, square pixels."""
        return self.info.size

    @property
    def frame_rate(self) -> float | None:
        """Average frames a second, for information: time is each frame's own timestamp."""
        return self.info.frame_rate


@dataclass(frozen=True)
class Shot:
    """A stretch of a video between two cuts. number: from 0; frames: first and last, inclusive."""

    number: int
    first_frame: int
    last_frame: int


@dataclass(frozen=True)
class Result:
    """All that is known of a video after its analysis.

    shots: in order. dancers: the people asked for, by number. provenance: source, models,
    settings and what was done. findings: what a reader must know before use, in sentences. bodies:
    the bone lengths that were found, by the dancers' numbers.
    """

    source: Source
    shots: tuple[Shot, ...]
    dancers: tuple[Dancer, ...]
    provenance: Provenance
    findings: tuple[str, ...] = ()
    bodies: Mapping[str, Body] = field(default_factory=dict)

    def __repr__(self) -> str:
        people = f"{len(self.dancers)} dancer" + ("s" if len(self.dancers) != 1 else "")
        return (
            f"{type(self).__name__}({self.source.path.name}: {len(self.source.timeline)} frames "
            f"in {len(self.shots)} shot{'s' if len(self.shots) != 1 else ''}, {people})"
        )

    def about(self) -> Mapping[str, Any]:
        """The provenance as JSON can hold it, for the files that have room for it."""
        return self.provenance.to_dict()
