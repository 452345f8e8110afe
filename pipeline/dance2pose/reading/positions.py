"""Positions in space of any tool as 3D tracks: npz, TRC, C3D, BVH and CSV."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dance2pose import exchange
from dance2pose import skeleton as skeletons
from dance2pose.errors import DataError, UsageError
from dance2pose.limits import model as limits
from dance2pose.mocap.bvh import node_positions, read_bvh_file
from dance2pose.poses import Timeline, Track3D, Unit
from dance2pose.reading.c3d import C3dFile
from dance2pose.reading.content import Float64Array
from dance2pose.reading.joint_names import best_skeleton, meaning
from dance2pose.tables import MotionTable, read_table

# What a unit of length is, and how many of the track's it makes.
_UNITS: dict[str, tuple[Unit, float]] = {
    "m": ("metres", 1.0),
    "metres": ("metres", 1.0),
    "meters": ("metres", 1.0),
    "cm": ("metres", 0.01),
    "mm": ("metres", 0.001),
    "bh": ("body heights", 1.0),
    "mbh": ("body heights", 0.001),
    "body heights": ("body heights", 1.0),
}
_FEWEST_JOINTS = 4
_KEYPOINT_SKELETONS = tuple(n for n in skeletons.names() if not skeletons.get(n).is_tree)
# A column of positions: joint, axis and, where it is said, unit (`left_knee_x_mm`, `LKnee Z`).
_COLUMN = re.compile(r"(.+?)[\s_.:]*([xyzXYZ])(?:[\s_.(]*(mm|cm|m|bh)\)?)?")
# BVH files name a bone by the joint it begins at, and the clavicle "shoulder".
_BONES = {
    "leftupleg": "left_hip",
    "leftleg": "left_knee",
    "leftarm": "left_shoulder",
    "leftforearm": "left_elbow",
    "lefthand": "left_wrist",
    "lefttoebase": "left_toe",
    "leftshoulder": "left_clavicle",
}


@dataclass(frozen=True)
class Positions:
    """Named points in space over time, as a file has them.

    xyz: (T, J, 3) in `unit` ("" where the file does not say), NaN where missing. up: "y" or "z".
    person: the name the file gives, or "".
    """

    names: tuple[str, ...]
    xyz: Float64Array
    timeline: Timeline
    unit: str
    up: str
    person: str = ""


@dataclass(frozen=True)
class ReadPoses:
    """The dancers of a file in 3D, and in words what was read as what."""

    tracks: list[Track3D]
    notes: tuple[str, ...]


def read_poses(path: Path, *, unit: str | None = None, up: str | None = None) -> ReadPoses:
    """The dancers in a file of positions in space.

    path: poses .npz, .trc, .c3d, .bvh (positions of its nodes) or .csv (columns such as
    `left_knee_x`, with frame or time). unit: m, cm, mm or bh (body heights), where the file does
    not say it. up: "y" or "z", where it is not what the format has by habit (z in C3D, else y).

    The tracks are in the lifting skeleton that the names of the points mean, in metres or body
    heights and world axes, the first joint at the origin and its path in `root`. Raises DataError
    naming the file and what is wrong, UsageError for settings that are missing.

    >>> read_poses(Path("take.trc")).tracks[0].xyz.shape  # doctest: +SKIP
    (545, 17, 3)
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix == ".npz":
        return ReadPoses([exchange.read_poses(path)], ())
    if suffix not in READERS:
        known = ", ".join([".npz", *READERS])
        raise DataError(f"{path}: not a form of 3D poses that is known; expected {known}")
    if unit is not None and unit.lower() not in _UNITS:
        raise UsageError(f"unit {unit!r} is not known; expected m, cm, mm or bh (body heights)")
    if up not in (None, "y", "z"):
        raise UsageError(f"up {up!r} is not possible; expected y or z")
    tracks, notes = [], []
    for number, found in enumerate(READERS[suffix](path), start=1):
        found = replace(found, unit=unit or found.unit, up=up or found.up)
        track, said = _track(path, found, number)
        tracks.append(track)
        notes.append(said)
    return ReadPoses(tracks, tuple(notes))


def _track(path: Path, found: Positions, person: int) -> tuple[Track3D, str]:
    if found.unit.lower() not in _UNITS:
        said = f"is {found.unit!r}" if found.unit else "is not said in the file"
        raise UsageError(f"{path}: the unit of length {said}; expected m, cm, mm or bh: give unit")
    unit, scale = _UNITS[found.unit.lower()]
    points = scale * found.xyz
    if found.up == "z":
        points = np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)
    target, xyz, known = _joints(found.names, points)
    if known < _FEWEST_JOINTS:
        raise DataError(
            f"{path}: the names {', '.join(found.names[:12])} are not those of a body that is"
            " known; expected names such as left_knee, LKnee or knee_r"
        )
    root = xyz[:, 0].copy()
    track = Track3D(
        person=person,
        timeline=found.timeline,
        xyz=xyz - root[:, np.newaxis],
        unit=unit,
        skeleton=target,
        reprojection_error=np.full(xyz.shape[:2], np.nan),
        valid=limits.load(target).is_valid(xyz - root[:, np.newaxis]),
        estimated=np.zeros(xyz.shape[:2], np.bool_),
        root=root,
    )
    whose = f"{found.person}: " if found.person else ""
    read_as = f"{target}, {unit}, {found.up} up"
    return track, f"{whose}{known} of {len(found.names)} points read as {read_as}"


def _joints(names: tuple[str, ...], points: Float64Array) -> tuple[str, Float64Array, int]:
    """The lifting skeleton that the names mean, its joints, and how many names it knows.

    Joints that no point is named for are made of keypoints (a pelvis of the hips), where they can.
    """
    target, columns = best_skeleton(names, ("body17", "cmu17", "paper15"))
    xyz = np.full((len(points), len(skeletons.get(target)), 3), np.nan)
    xyz[:, list(columns)] = points[:, list(columns.values())]
    layout, keypoint_columns = best_skeleton(names, _KEYPOINT_SKELETONS)
    if target == "body17":
        keypoints = np.full((len(points), len(skeletons.get(layout)), 3), np.nan)
        keypoints[:, list(keypoint_columns)] = points[:, list(keypoint_columns.values())]
        sure = np.ones(keypoints.shape[:2])
        made, _ = skeletons.convert(keypoints, sure, source=layout, target=target)
        others = [j for j in range(xyz.shape[1]) if j not in columns]
        xyz[:, others] = made[:, others]
    return target, xyz, max(len(columns), len(keypoint_columns))


def _read_table(path: Path) -> list[Positions]:
    """TRC and CSV; people by their column, or by what stands before a colon."""
    table = read_table(path)
    trc = path.suffix.lower() == ".trc"
    axes_of, units = _joint_columns(table)
    if not axes_of:
        raise DataError(f"{path}: has no columns of x, y and z; expected such as left_knee_x")
    if len(units) > 1:
        raise DataError(f"{path}: its columns have the units {', '.join(sorted(units))}")
    unit = _trc_unit(table) if trc else "".join(units)
    values, times, frames = table.values(), table.times(), table.frames()
    if times is None:
        raise UsageError(f"{path}: has no column of times in seconds (time or time_s)")
    found = []
    for who, rows in table.members().items():
        timeline = _timeline(path, times[rows], None if frames is None else frames[rows])
        for person, joints in _by_person(axes_of).items():
            xyz = np.stack([values[np.ix_(rows, list(axes))] for axes in joints.values()], axis=1)
            label = " ".join(filter(None, [*who, person]))
            found.append(Positions(tuple(joints), xyz, timeline, unit, "y", label))
    return found


def _joint_columns(table: MotionTable) -> tuple[dict[str, tuple[int, int, int]], set[str]]:
    """Joint to where its x, y and z stand among the moving columns, and the units they name."""
    axes: dict[str, dict[str, int]] = {}
    units: set[str] = set()
    for place, column in enumerate(table.moving):
        match = _COLUMN.fullmatch(table.names[column])
        if match is not None:
            axes.setdefault(match[1], {})[match[2].lower()] = place
            units |= {match[3]} if match[3] else set()
    whole = {joint: (at["x"], at["y"], at["z"]) for joint, at in axes.items() if len(at) == 3}
    return whole, units


def _by_person(
    axes_of: dict[str, tuple[int, int, int]],
) -> dict[str, dict[str, tuple[int, int, int]]]:
    people: dict[str, dict[str, tuple[int, int, int]]] = {}
    for joint, axes in axes_of.items():
        person, _, name = joint.rpartition(":")
        people.setdefault(person, {})[name] = axes
    return people


def _trc_unit(table: MotionTable) -> str:
    names, values = (table.header[n].split("\t") for n in (1, 2))
    named = dict(zip((n.strip() for n in names), (v.strip() for v in values), strict=False))
    return named.get("Units", "")


def _timeline(path: Path, times: Float64Array, frames: Float64Array | None) -> Timeline:
    whole = frames is not None and (frames == np.round(frames)).all()
    numbers = frames if whole and frames is not None else np.arange(len(times))
    try:
        return Timeline(numbers.astype(np.int64), times)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error


def _read_c3d(path: Path) -> list[Positions]:
    recording = C3dFile(path)
    timeline = Timeline(recording.frame, recording.time_s)
    people: dict[str, list[int]] = {}
    for n, name in enumerate(recording.names):
        people.setdefault(name.rpartition(":")[0], []).append(n)
    return [
        Positions(
            tuple(recording.names[n].rpartition(":")[2] for n in columns),
            recording.points[:, columns],
            timeline,
            recording.unit,
            "z",
            person,
        )
        for person, columns in people.items()
    ]


def _read_bvh(path: Path) -> list[Positions]:
    """The nodes' positions. BVH says no unit; names are turned to those of joints."""
    take = read_bvh_file(path)
    names = tuple(name.rpartition(":")[2] for name in take.names)
    if any(meaning(name) == "leftforearm" for name in names):
        names = tuple(_joint_of_bone(name) for name in names)
    timeline = Timeline.regular(len(take.values), rate_hz=1 / take.frame_time)
    return [Positions(names, node_positions(take), timeline, "", "y")]


def _joint_of_bone(name: str) -> str:
    left = meaning(name).replace("right", "left", 1)
    joint = _BONES.get(left, name)
    return joint.replace("left", "right", 1) if meaning(name).startswith("right") else joint


READERS: dict[str, Callable[[Path], list[Positions]]] = {
    ".trc": _read_table,
    ".csv": _read_table,
    ".tsv": _read_table,
    ".c3d": _read_c3d,
    ".bvh": _read_bvh,
}
