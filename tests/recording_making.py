"""Made-up dancers for recordings, and what a recording holds, read back without a viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from dance2pose.poses import Dancer, Frame, Timeline, Track2D, Track3D
from dance2pose.provenance import Provenance, SourceFile
from dance2pose.skeleton import get

KEYPOINTS, JOINTS = "halpe26", "body17"
# A person standing, x right and y up, in body heights from the pelvis, in body17's order.
_STANDING = np.array(
    [
        (0, 0, 0),
        *((0, 0.3, 0), (0.1, 0.3, 0), (0.13, 0.12, 0.05), (0.14, -0.03, 0.15)),
        *((-0.1, 0.3, 0), (-0.25, 0.32, 0), (-0.38, 0.4, 0)),
        (0, 0.4, 0.02),
        *((0.06, -0.02, 0), (0.07, -0.25, 0), (0.07, -0.48, 0), (0.08, -0.5, 0.08)),
        *((-0.06, -0.02, 0), (-0.08, -0.25, 0.1), (-0.08, -0.45, 0), (-0.09, -0.48, 0.08)),
    ]
)


def make_dancer(
    person: int = 1,
    *,
    frame: list[int],
    time_s: list[float],
    x: float = 60.0,
    size: tuple[int, int] = (128, 96),
    with_sigma: bool = True,
    root: np.ndarray | None = None,
) -> Dancer:
    """A dancer with made-up keypoints and joints; the pose is lost in row 3, the box in row 2."""
    rng = np.random.default_rng(person)
    rows, keypoints, joints = len(frame), len(get(KEYPOINTS)), len(get(JOINTS))
    frames, times = np.array(frame, np.int64), np.array(time_s)
    lost = np.arange(rows) == 3

    xy = np.array([x, size[1] / 2]) + rng.normal(0, size[1] / 8, (rows, keypoints, 2))
    confidence = rng.uniform(0.3, 1.0, (rows, keypoints))
    xy[lost], confidence[lost] = np.nan, 0
    xy[0, 4], confidence[0, 4] = np.nan, 0
    box = np.full((rows, 4), np.nan)
    box[~lost] = [x - 20, 10, x + 20, size[1] - 10]
    box[2:3] = np.nan
    track = Track2D(
        person,
        Timeline(frames, times),
        xy,
        confidence,
        KEYPOINTS,
        np.zeros(rows, bool),
        box,
        size,
    )

    def lifted(noise: float) -> Track3D:
        xyz = _STANDING + rng.normal(0, noise, (rows, joints, 3))
        error = rng.gamma(2, 1, (rows, joints))
        xyz[lost], error[lost] = np.nan, np.nan
        return Track3D(
            person,
            Timeline(frames, times),
            xyz,
            "body heights",
            JOINTS,
            error,
            rng.random((rows, joints - 1)) > 0.2,
            np.zeros((rows, joints), bool),
            np.full((rows, joints), 0.02) if with_sigma else None,
            root,
        )

    return Dancer(track, lifted(0.02), lifted(0.005))


def timeline_of(frames: Sequence[Frame]) -> Timeline:
    """The timeline of frames that were read."""
    return Timeline(
        np.array([f.index for f in frames], np.int64), np.array([f.time_s for f in frames], float)
    )


NO_FRAMES = timeline_of([])


def make_provenance(name: str = "dance.mp4") -> Provenance:
    return Provenance(
        SourceFile(name, 1234, "ab" * 32, {"duration s": 1.5, "frame count": 12}),
        {"detector": SourceFile("d.onnx", 77, "cd" * 32, {"kind": "detector"})},
        {"window": 5, "npz": True},
        {"dancers": "1"},
        {"numpy": "2.0"},
        ("The last second is missing.",),
        "2026-01-01 12:00 UTC",
    )


class Recording:
    """The rows of a recording, by entity path and component."""

    def __init__(self, path: Path) -> None:
        self.reader = rr.chunk.RrdReader(path)
        self.chunks = [(c.entity_path, c.to_record_batch()) for c in self.reader.stream()]

    @property
    def entities(self) -> set[str]:
        return {path for path, _ in self.chunks if not path.startswith("/__")}

    @property
    def timelines(self) -> set[str]:
        return {
            field.name
            for _, rows in self.chunks
            for field in rows.schema
            if (field.metadata or {}).get(b"rerun:kind") == b"index"
        }

    def rows(self, entity: str, component: str) -> list[tuple[int, float, Any]]:
        """(frame, time in s, value) of every row that is not static, by frame."""
        found = []
        for path, rows in self.chunks:
            names = rows.schema.names
            if path == entity and component in names and "frame" in names:
                columns = (rows.column(n).to_pylist() for n in ("frame", component))
                times = rows.column("video_time").cast("int64").to_pylist()
                found += [
                    (f, t / 1e9, v)
                    for (f, v), t in zip(zip(*columns, strict=True), times, strict=True)
                ]
        return sorted(found, key=lambda row: row[0])

    def static(self, entity: str, component: str) -> Any:
        """The static value of a component."""
        values = [
            rows.column(component)[0].as_py()
            for path, rows in self.chunks
            if path == entity
            and component in rows.schema.names
            and "frame" not in rows.schema.names
        ]
        assert len(values) == 1, f"{entity} {component}: {len(values)} static values"
        return values[0]
