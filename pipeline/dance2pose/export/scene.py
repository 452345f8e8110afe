"""What an export writes: the dancers of one result, their video, and where it all came from."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dance2pose import __version__
from dance2pose.errors import UsageError
from dance2pose.poses import Track2D, Track3D, Unit
from dance2pose.skeleton import Skeleton, get

AXES = "x right, y up, z towards the viewer; right-handed"


@dataclass(frozen=True)
class SceneDancer:
    """One dancer: joints, and the keypoints that they were lifted from where they are at hand."""

    poses: Track3D
    keypoints: Track2D | None = None

    @property
    def person(self) -> int:
        return self.poses.person

    @property
    def name(self) -> str:
        return f"dancer_{self.person}"

    @property
    def skeleton(self) -> Skeleton:
        return get(self.poses.skeleton)


@dataclass(frozen=True)
class ExportScene:
    """The dancers of one result.

    dancers: at least one, all in one unit. video: the file that they were seen in, or None.
    provenance: where the result comes from, as plain values that JSON can hold.

    Raises UsageError without a dancer, and for dancers in different units.
    """

    dancers: tuple[SceneDancer, ...]
    video: Path | None = None
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.dancers:
            raise UsageError("there is no dancer to export")
        units = sorted({p.poses.unit for p in self.dancers})
        if len(units) > 1:
            raise UsageError(f"dancers in different units ({' and '.join(units)}) make no scene")

    @classmethod
    def of(cls, poses: Track3D | Sequence[Track3D], **rest: Any) -> ExportScene:
        """A scene of poses alone."""
        tracks = [poses] if isinstance(poses, Track3D) else list(poses)
        return cls(tuple(SceneDancer(track) for track in tracks), **rest)

    @property
    def unit(self) -> Unit:
        return self.dancers[0].poses.unit

    def alone(self, dancer: SceneDancer) -> ExportScene:
        """The same scene with one of its dancers."""
        return replace(self, dancers=(dancer,))

    def provenance_json(self) -> str:
        """Provenance as one line of JSON, with the program's name and version."""
        made_by = {"program": "dance2pose", "version": __version__, "axes": AXES, "unit": self.unit}
        return json.dumps({**made_by, **self.provenance}, default=str)


# How a unit is abbreviated in the names of columns.
UNIT_SUFFIX: dict[Unit, str] = {"metres": "m", "body heights": "bh"}
