"""SLEAP's analysis files (.h5): tracks (tracks, 2, nodes, frames) and the names of the nodes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dance2pose.errors import DataError
from dance2pose.reading.content import Content, Picture, Sighting
from dance2pose.reading.h5_files import read_dataset


def is_sleap(file: Any) -> bool:
    return "tracks" in file and "node_names" in file


def read_sleap(path: Path, file: Any) -> Content:
    """Every track is a person; frames are counted from 0."""
    tracks = file["tracks"]
    nodes = _names(path, file["node_names"])
    if tracks.dtype.kind != "f" or tracks.ndim != 4 or tracks.shape[1:3] != (2, len(nodes)):
        raise DataError(
            f"{path}: tracks has shape {tracks.shape} and type {tracks.dtype},"
            f" expected numbers (tracks, 2, {len(nodes)}, frames)"
        )
    xy = np.moveaxis(read_dataset(path, tracks).astype(np.float64), (3, 0, 2, 1), (0, 1, 2, 3))
    scores = np.ones(xy.shape[:3])
    kept = file.get("point_scores")
    if kept is not None and kept.shape == (tracks.shape[0], *tracks.shape[2:]):
        found_scores = read_dataset(path, kept).astype(np.float64)
        scores = np.moveaxis(found_scores, (2, 0, 1), (0, 1, 2))
    people = _names(path, file["track_names"]) if "track_names" in file else []
    found = Content("SLEAP analysis", [], joints=tuple(nodes), open_scores=True)
    found.one_person = xy.shape[1] == 1
    together = np.concatenate([xy, scores[..., np.newaxis]], axis=-1)
    for n, frame in enumerate(together):
        sightings = []
        for who, keypoints in enumerate(frame):
            seen = np.isfinite(keypoints[:, :2]).all(axis=1)
            if not seen.any():
                continue
            # A point that was placed by hand has no score; it is there all the same.
            keypoints[seen & ~(keypoints[:, 2] > 0), 2] = 1.0
            name = people[who] if who < len(people) else str(who)
            score = float(np.nan_to_num(keypoints[:, 2]).mean())
            sightings.append(Sighting(keypoints, score, f"{path}: frame {n}", identity=name))
        found.pictures.append(Picture(sightings, frame=n))
    return found


def _names(path: Path, dataset: Any) -> list[str]:
    names = read_dataset(path, dataset).ravel().tolist()
    return [n.decode(errors="replace") if isinstance(n, bytes) else str(n) for n in names]
