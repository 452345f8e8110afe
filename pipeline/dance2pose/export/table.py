"""Tables for pandas, R and spreadsheets: CSV (wide, long, keypoints) and Parquet.

Every column says its unit: `_m` metres or `_bh` body heights, `_px`, `_deg`, `_s`. World axes as in
`export.scene.AXES`. Times are the frames' own. A missing value is an empty cell (a null in
Parquet); frames of a hole in time have no row.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from dance2pose.angles import track_angles
from dance2pose.errors import UsageError
from dance2pose.export.scene import AXES, UNIT_SUFFIX, ExportScene, SceneDancer
from dance2pose.poses import Track2D
from dance2pose.skeleton import get

Columns = Mapping[str, Any]


def write_wide(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """One row a dancer and frame: joints, their sigma, angles and their sigma."""
    _write_csv(path, _stacked(scene, wide_columns))
    return ()


def write_long(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """One row a dancer, frame and joint."""
    _write_csv(path, _stacked(scene, long_columns))
    return ()


def write_keypoints(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """One row a dancer, frame and keypoint of the picture, hands and face where seen."""
    tracks = [p.keypoints for p in scene.dancers if p.keypoints is not None]
    if len(tracks) < len(scene.dancers):
        raise UsageError(
            f"{path}: the result has no keypoints; they are read from its .track.npz files"
        )
    _write_csv(path, _joined([keypoint_columns(track) for track in tracks]))
    return ()


def write_parquet(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """The columns of the wide table, with unit, axes and provenance in the file's metadata."""
    table = _stacked(scene, wide_columns).replace_schema_metadata(
        {"unit": scene.unit, "axes": AXES, "dance2pose": scene.provenance_json()}
    )
    pa.parquet.write_table(table, path, compression="zstd")
    return ()


def wide_columns(dancer: SceneDancer) -> Columns:
    """Columns (T,) of one dancer by name."""
    poses, unit = dancer.poses, UNIT_SUFFIX[dancer.poses.unit]
    columns = _row_columns(dancer)
    places = dancer.poses.world_xyz
    for j, joint in enumerate(dancer.skeleton.joints):
        for axis, letter in enumerate("xyz"):
            columns[f"{joint}_{letter}_{unit}"] = places[:, j, axis]
        if poses.sigma is not None:
            columns[f"{joint}_sigma_{unit}"] = poses.sigma[:, j]
    for name, curve in track_angles(poses).items():
        columns[f"{name}_deg"] = curve.degrees
        if curve.sigma_deg is not None:
            columns[f"{name}_sigma_deg"] = curve.sigma_deg
    return columns


def long_columns(dancer: SceneDancer) -> Columns:
    """Columns (T * J,) of one dancer by name; the joints of a frame follow one another."""
    poses, unit = dancer.poses, UNIT_SUFFIX[dancer.poses.unit]
    frames, joints = poses.xyz.shape[:2]
    columns = {name: np.repeat(values, joints) for name, values in _row_columns(dancer).items()}
    columns["joint"] = np.tile(dancer.skeleton.joints, frames)
    places = dancer.poses.world_xyz
    for axis, letter in enumerate("xyz"):
        columns[f"{letter}_{unit}"] = places[..., axis].ravel()
    if poses.sigma is not None:
        columns[f"sigma_{unit}"] = poses.sigma.ravel()
    columns["reprojection_error_px"] = poses.reprojection_error.ravel()
    columns["estimated"] = poses.estimated.ravel()
    return columns


def keypoint_columns(track: Track2D) -> Columns:
    """Columns (T * K,) of one dancer's keypoints by name."""
    frames, keypoints = track.xy.shape[:2]
    rows = {
        "dancer": np.full(frames, track.person),
        "shot": np.full(frames, track.shot),
        "frame": track.frame,
        "time_s": track.time_s,
        "interpolated": track.interpolated,
    }
    columns = {name: np.repeat(values, keypoints) for name, values in rows.items()}
    columns["keypoint"] = np.tile(get(track.skeleton).joints, frames)
    columns["x_px"], columns["y_px"] = track.xy.reshape(-1, 2).T
    columns["confidence"] = track.confidence.ravel()
    return columns


def _row_columns(dancer: SceneDancer) -> dict[str, Any]:
    poses = dancer.poses
    return {
        "dancer": np.full(len(poses), dancer.person),
        "shot": np.full(len(poses), poses.shot),
        "frame": poses.frame,
        "time_s": poses.time_s,
    }


def _stacked(scene: ExportScene, columns: Callable[[SceneDancer], Columns]) -> pa.Table:
    return _joined([columns(dancer) for dancer in scene.dancers])


def _joined(parts: Sequence[Columns]) -> pa.Table:
    """One table of all dancers, one after another; NaN becomes null."""
    tables = [
        pa.table({name: pa.array(values, from_pandas=True) for name, values in part.items()})
        for part in parts
    ]
    return pa.concat_tables(tables, promote_options="permissive")


def _write_csv(path: Path, table: pa.Table) -> None:
    options = pa.csv.WriteOptions(quoting_style="needed")
    pa.csv.write_csv(table, path, write_options=options)
