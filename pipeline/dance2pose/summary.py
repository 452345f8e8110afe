"""A result in figures, as a person reads them at the end of a run and a ledger keeps them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dance2pose.results import Result


@dataclass(frozen=True)
class Summary:
    """What came of a run, for the person at the terminal and for a batch's ledger."""

    files: tuple[Path, ...]
    dancers: int
    frames: int
    frames_with_pose: int
    shares: tuple[float, ...]
    mean_confidence: float
    share_invalid_bones: float
    notes: tuple[str, ...]

    @property
    def recording(self) -> Path:
        return self.files[0]

    @property
    def share_with_pose(self) -> float:
        return self.frames_with_pose / self.frames if self.frames else 0.0


def summarise(result: Result, files: Sequence[Path], notes: Sequence[str] = ()) -> Summary:
    """The figures of a result, as a person reads them at the end of a run."""
    frames = len(result.source.timeline)
    seen: set[int] = set()
    shares = []
    for dancer in result.dancers:
        has_pose = ~np.isnan(dancer.keypoints.xy).all(axis=(1, 2))
        seen.update(dancer.keypoints.frame[has_pose].tolist())
        shares.append(float(has_pose.sum()) / frames)
    tracks = [dancer.keypoints for dancer in result.dancers]
    confidence = np.concatenate([t.confidence[~np.isnan(t.xy).any(axis=2)] for t in tracks])
    raw = [dancer.raw for dancer in result.dancers]
    valid = np.concatenate([r.valid[~np.isnan(r.xyz).all(axis=(1, 2))].ravel() for r in raw])
    return Summary(
        files=tuple(files),
        dancers=len(tracks),
        frames=frames,
        frames_with_pose=len(seen),
        shares=tuple(shares),
        mean_confidence=float(confidence.mean()) if confidence.size else float("nan"),
        share_invalid_bones=float(1 - valid.mean()) if valid.size else float("nan"),
        notes=(*result.findings, *notes),
    )
