"""A result read back from its .npz files."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import read_poses, read_provenance, read_track
from dance2pose.export.scene import ExportScene, SceneDancer
from dance2pose.poses import Track2D


def load_scene(result: Path, *, video: Path | None = None) -> ExportScene:
    """The dancers of a result, read back from its files.

    Parameters
    ----------
    result
        The poses .npz (or the .rrd that has one beside it); the `.dancer_N.npz` beside that, and
        the `.track.npz` of each, are read where they are there.
    video
        The file that the dancers were seen in; if not given, the file of the name and size that
        the provenance tells, where it lies beside the poses.

    Raises
    ------
    DataError
        Naming what is wrong with a file.
    """
    poses = poses_file(result)
    if video is not None and not video.is_file():
        raise DataError(f"{video}: no such video file")
    dancers = [_dancer(path) for path in (poses, *_others(poses))]
    people = [p.person for p in dancers]
    if len(set(people)) < len(people):
        raise DataError(
            f"{poses}: the files beside it hold the same dancer twice ({people}); "
            "they come from different runs, move those that do not belong away"
        )
    provenance = read_provenance(poses)
    return ExportScene(tuple(dancers), video or _video(poses.parent, provenance), provenance)


def poses_file(result: Path) -> Path:
    """The poses .npz that is meant by a result's name."""
    poses = result.with_suffix(".npz") if result.suffix.lower() == ".rrd" else result
    if poses.suffix.lower() != ".npz":
        raise UsageError(f"{result}: expected the poses (.npz) or the recording (.rrd) of a result")
    if not poses.is_file():
        beside = f", which goes with {result}" if poses != result else ""
        raise DataError(f"{poses}: no such file{beside}; expected the poses (.npz) of a result")
    return poses


def _video(folder: Path, provenance: Mapping[str, Any]) -> Path | None:
    source = provenance.get("source")
    if not isinstance(source, dict):
        return None
    name, size = source.get("file_name"), source.get("size_bytes")
    if not isinstance(name, str) or Path(name).name != name or not name:
        return None
    path = folder / name
    return path if path.is_file() and path.stat().st_size == size else None


def _others(poses: Path) -> list[Path]:
    """OUT.dancer_2.npz … in the order of their numbers."""
    pattern = re.compile(rf"{re.escape(poses.stem)}\.dancer_(\d{{1,9}})\.npz")
    found = {}
    for path in poses.parent.iterdir():
        match = pattern.fullmatch(path.name)
        if match:
            found[int(match[1])] = path
    return [found[number] for number in sorted(found)]


def _dancer(path: Path) -> SceneDancer:
    poses = read_poses(path)
    return SceneDancer(poses, _keypoints(path.with_name(f"{path.stem}.track.npz"), poses.person))


def _keypoints(path: Path, person: int) -> Track2D | None:
    if not path.is_file():
        return None
    track = read_track(path)
    if track.person != person:
        raise DataError(f"{path}: holds dancer {track.person}, the poses beside it {person}")
    return track
