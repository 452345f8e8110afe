"""Reader for BVH files (Biovision hierarchy).

Angles are degrees in the file; channels apply in the order written, each about the axes left by
those before it (intrinsic).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from dance2pose.errors import DataError
from dance2pose.mocap.motion import Motion
from dance2pose.poses import FloatArray

_CHANNELS = {f"{axis}{kind}" for axis in "XYZ" for kind in ("position", "rotation")}


@dataclass
class _Hierarchy:
    names: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[tuple[float, float, float]] = field(default_factory=list)
    channels: list[list[str]] = field(default_factory=list)


@dataclass(frozen=True)
class BvhFile:
    """A take as the file has it: its lines up to MOTION, and the numbers behind.

    names, parents, offsets (J, 3): of the nodes, as in `Motion`. channels: one list of names
    ("Xposition", "Zrotation" ...) a node, in the order of the columns. values: (T, columns),
    degrees and the file's unit of length. frame_time: seconds.
    """

    header: tuple[str, ...]
    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: npt.NDArray[np.float64]
    channels: tuple[tuple[str, ...], ...]
    values: npt.NDArray[np.float64]
    frame_time: float


def read_bvh_file(path: Path) -> BvhFile:
    """Read the channels of a take. Raises DataError as `read_bvh` does."""
    header, hierarchy, values, frame_time = _read(path)
    channels = tuple(tuple(names) for names in hierarchy.channels)
    return BvhFile(
        tuple(header),
        tuple(hierarchy.names),
        tuple(hierarchy.parents),
        np.array(hierarchy.offsets, np.float64),
        channels,
        values,
        frame_time,
    )


def node_positions(take: BvhFile) -> npt.NDArray[np.float64]:
    """Positions (T, J, 3) of all nodes; a node's own position channels stand for its offset."""
    frames = len(take.values)
    position: npt.NDArray[np.float64] = np.zeros((frames, len(take.names), 3))
    world: list[Rotation] = []
    column = 0
    for j, (parent, channels) in enumerate(zip(take.parents, take.channels, strict=True)):
        block = take.values[:, column : column + len(channels)]
        column += len(channels)
        here = np.tile(take.offsets[j], (frames, 1))
        for i, name in enumerate(channels):
            if name.endswith("position"):
                here[:, "XYZ".index(name[0])] = block[:, i]
        turns = [i for i, name in enumerate(channels) if name.endswith("rotation")]
        turn = Rotation.identity(frames)
        if turns:
            order = "".join(channels[i][0] for i in turns)
            turn = Rotation.from_euler(order, block[:, turns], degrees=True)
        if parent >= 0:
            here = position[:, parent] + world[parent].apply(here)
            turn = world[parent] * turn
        position[:, j] = here
        world.append(turn)
    return position


def read_bvh(path: Path) -> Motion:
    """Read a whole take. Raises DataError naming the file and line of what is wrong."""
    _, hierarchy, values, frame_time = _read(path)
    return _motion(hierarchy, values, frame_time)


def _read(path: Path) -> tuple[list[str], _Hierarchy, npt.NDArray[np.float64], float]:
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    motion_line = next((i for i, line in enumerate(lines) if line.strip() == "MOTION"), None)
    if not lines or lines[0].strip() != "HIERARCHY":
        raise DataError(f"{path}:1: expected HIERARCHY, the first line of a BVH file")
    if motion_line is None:
        raise DataError(f"{path}: has no MOTION section; is the file truncated?")
    hierarchy = _parse_hierarchy(path, lines[:motion_line])
    values, frame_time = _parse_frames(path, lines, motion_line, hierarchy)
    return lines[:motion_line], hierarchy, values, frame_time


def _parse_hierarchy(path: Path, lines: list[str]) -> _Hierarchy:
    tree = _Hierarchy()
    stack: list[int] = []
    for number, line in enumerate(lines[1:], start=2):
        words = line.split()
        try:
            match words:
                case [] | ["{"]:
                    pass
                case ["ROOT" | "JOINT", *name] if name:
                    stack.append(_add_node(tree, " ".join(name), stack))
                case ["End", "Site"]:
                    stack.append(_add_node(tree, f"{tree.names[stack[-1]]}_end", stack))
                case ["OFFSET", x, y, z]:
                    tree.offsets[stack[-1]] = (float(x), float(y), float(z))
                case ["CHANNELS", count, *names] if int(count) == len(names):
                    if not set(names) <= _CHANNELS:
                        raise DataError(f"{path}:{number}: unknown channel in {names}")
                    tree.channels[stack[-1]] = names
                case ["}"]:
                    stack.pop()
                case _:
                    raise DataError(f"{path}:{number}: not understood: {line.strip()[:80]!r}")
        except (ValueError, IndexError) as error:
            raise DataError(f"{path}:{number}: not understood: {line.strip()[:80]!r}") from error
    if stack or not tree.names:
        raise DataError(f"{path}: the hierarchy is not closed; is the file truncated?")
    return tree


def _add_node(tree: _Hierarchy, name: str, stack: list[int]) -> int:
    if not stack and tree.names:
        raise ValueError("a second root")
    tree.names.append(name)
    tree.parents.append(stack[-1] if stack else -1)
    tree.offsets.append((0.0, 0.0, 0.0))
    tree.channels.append([])
    return len(tree.names) - 1


def _parse_frames(
    path: Path, lines: list[str], motion_line: int, tree: _Hierarchy
) -> tuple[npt.NDArray[np.float64], float]:
    header = " ".join(lines[motion_line + 1 : motion_line + 3])
    match = re.fullmatch(r"\s*Frames:\s*(\d+)\s+Frame Time:\s*([0-9.eE+-]+)\s*", header)
    if match is None:
        raise DataError(f"{path}:{motion_line + 2}: expected 'Frames: N' and 'Frame Time: S'")
    frames, frame_time = int(match[1]), float(match[2])
    if frame_time <= 0 or frames == 0:
        raise DataError(f"{path}:{motion_line + 2}: {frames} frames of {frame_time} s")
    columns = sum(len(names) for names in tree.channels)
    first = motion_line + 3
    rows = [(n, line) for n, line in enumerate(lines[first:], first + 1) if line.strip()]
    if len(rows) != frames:
        raise DataError(f"{path}: {len(rows)} rows of motion, the header says {frames}")
    values = np.empty((frames, columns))
    for i, (number, line) in enumerate(rows):
        words = line.split()
        if len(words) != columns:
            raise DataError(f"{path}:{number}: {len(words)} values, expected {columns}")
        try:
            values[i] = words
        except ValueError as error:
            raise DataError(f"{path}:{number}: not a number: {error}") from error
    if not np.isfinite(values).all():
        raise DataError(f"{path}: holds values that are not finite")
    return values, frame_time


def _motion(tree: _Hierarchy, values: npt.NDArray[np.float64], frame_time: float) -> Motion:
    frames, joints = len(values), len(tree.names)
    rotations = np.broadcast_to(np.eye(3), (frames, joints, 3, 3)).copy()
    offsets: FloatArray = np.array(tree.offsets)
    root_position = np.broadcast_to(offsets[0], (frames, 3)).copy()
    column = 0
    for j, channels in enumerate(tree.channels):
        block = values[:, column : column + len(channels)]
        column += len(channels)
        turns = [i for i, name in enumerate(channels) if name.endswith("rotation")]
        if turns:
            order = "".join(channels[i][0] for i in turns)
            rotations[:, j] = Rotation.from_euler(order, block[:, turns], degrees=True).as_matrix()
        if j == 0:
            for i, name in enumerate(channels):
                if name.endswith("position"):
                    root_position[:, "XYZ".index(name[0])] = block[:, i]
    return Motion(
        tuple(tree.names), tuple(tree.parents), offsets, rotations, root_position, frame_time
    )
