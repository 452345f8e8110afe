"""Reader for ASF/AMC files (Acclaim): the skeleton in one file, the motion of a take in another.

Every bone has axes of its own at rest (`axis`); the take's angles turn the bone about those axes.
Angles are applied about fixed axes in the order written (extrinsic). With C the bone's rest axes
and M its motion, the bone's rotation in its parent's axes is C M C^-1, all axes being those of the
world at rest, so that offsets need no turning.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from dance2pose.errors import DataError
from dance2pose.mocap.motion import Motion
from dance2pose.poses import FloatArray

_DOFS = ("rx", "ry", "rz")
_ROOT_CHANNELS = ("tx", "ty", "tz", *_DOFS)


@dataclass
class _Bone:
    """A bone of the file: rest direction times length, rest axes, and the angles that move it."""

    end: npt.NDArray[np.float64]
    axes: Rotation
    dofs: tuple[str, ...] = ()


@dataclass
class _Skeleton:
    bones: dict[str, _Bone] = field(default_factory=dict)
    parents: dict[str, str] = field(default_factory=dict)  # child -> parent, parents first
    root_order: tuple[str, ...] = _ROOT_CHANNELS
    root_axes: Rotation = field(default_factory=Rotation.identity)
    root_position: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    root_orientation: npt.NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    axis_order: str = "xyz"


def read_asf_amc(asf: Path, amc: Path, *, rate_hz: float = 120.0) -> Motion:
    """Read a take; the format holds no frame rate, so it is given (CMU records at 120 Hz).

    Nodes are named as the file's bones and stand where the bone starts; the end of a bone without
    children is the node `<bone>_end`. Raises DataError naming the file and line of what is wrong.
    """
    if not rate_hz > 0:
        raise DataError(f"{amc}: frame rate of {rate_hz} Hz; expected a positive number")
    skeleton = _read_asf(asf)
    frames = _read_amc(amc, skeleton)
    return _motion(skeleton, frames, 1 / rate_hz)


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers from 1 and words of every line that holds any; comments dropped."""
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror}") from error
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            yield number, words


def _numbers(words: list[str], count: int) -> npt.NDArray[np.float64]:
    if len(words) != count:
        raise ValueError(f"{len(words)} values, expected {count}")
    values = np.array([float(word) for word in words])
    if not np.isfinite(values).all():
        raise ValueError("a value that is not finite")
    return values


def _read_asf(path: Path) -> _Skeleton:
    skeleton = _Skeleton()
    section = ""
    draft: dict[str, list[str]] = {}
    number = 0
    for number, words in _lines(path):
        try:
            if words[0].startswith(":"):
                section = words[0]
            elif section == ":units":
                if words[:2] == ["angle", "rad"]:
                    raise ValueError("angles in radians are not supported; expected 'angle deg'")
            elif section == ":root":
                _root_line(skeleton, words)
            elif section == ":bonedata":
                match words:
                    case ["begin"]:
                        draft = {}
                    case ["end"]:
                        skeleton.bones[draft["name"][0]] = _bone(draft)
                    case [key, *values]:
                        draft[key] = values
            elif section == ":hierarchy" and words not in (["begin"], ["end"]):
                _hierarchy_line(skeleton, words)
        except KeyError as error:
            raise DataError(f"{path}:{number}: a bone without {error}") from error
        except ValueError as error:
            raise DataError(f"{path}:{number}: not understood: {error}") from error
    if not skeleton.parents:
        raise DataError(f"{path}:{number}: has no :hierarchy; is the file truncated, or no ASF?")
    lost = [name for name in skeleton.bones if name not in skeleton.parents]
    if lost:
        raise DataError(f"{path}: bones without a place in the hierarchy: {', '.join(lost)}")
    return skeleton


def _root_line(skeleton: _Skeleton, words: list[str]) -> None:
    match words[0].lower():
        case "order":
            order = tuple(word.lower() for word in words[1:])
            if sorted(order) != sorted(_ROOT_CHANNELS):
                raise ValueError(f"root order {order}, expected each of {_ROOT_CHANNELS}")
            skeleton.root_order = order
        case "axis":
            skeleton.axis_order = _axis_order(words[1])
        case "position":
            skeleton.root_position = _numbers(words[1:], 3)
        case "orientation":
            skeleton.root_orientation = _numbers(words[1:], 3)
    skeleton.root_axes = Rotation.from_euler(
        skeleton.axis_order, skeleton.root_orientation, degrees=True
    )


def _axis_order(word: str) -> str:
    if sorted(word.lower()) != ["x", "y", "z"]:
        raise ValueError(f"axis order {word!r}, expected a permutation of XYZ")
    return word.lower()


def _bone(draft: dict[str, list[str]]) -> _Bone:
    direction = _numbers(draft["direction"], 3)
    length = _numbers(draft["length"], 1)[0]
    *angles, order = draft["axis"]
    axes = Rotation.from_euler(_axis_order(order), _numbers(angles, 3), degrees=True)
    dofs = tuple(word.lower() for word in draft.get("dof", []))
    if not set(dofs) <= set(_DOFS):
        raise ValueError(f"degrees of freedom {dofs}, expected some of {_DOFS}")
    return _Bone(direction * length, axes, dofs)


def _hierarchy_line(skeleton: _Skeleton, words: list[str]) -> None:
    parent, *children = words
    if parent != "root" and parent not in skeleton.parents:
        raise ValueError(f"{parent!r} is used as a parent before it is named as a child")
    for child in children:
        if child not in skeleton.bones:
            raise ValueError(f"{child!r} is not in :bonedata")
        if child in skeleton.parents:
            raise ValueError(f"{child!r} has two parents")
        skeleton.parents[child] = parent


def _read_amc(path: Path, skeleton: _Skeleton) -> dict[str, FloatArray]:
    """The values (T, channels) of root and of every bone that moves."""
    wanted = {"root": len(_ROOT_CHANNELS)}
    wanted |= {name: len(bone.dofs) for name, bone in skeleton.bones.items() if bone.dofs}
    frames: list[dict[str, FloatArray]] = []
    number = 0
    for number, words in _lines(path):
        if words[0].startswith(":"):
            if words[0].lower() == ":radians":
                raise DataError(f"{path}:{number}: angles in radians; expected :DEGREES")
            continue
        if len(words) == 1 and words[0].isdigit():
            _check_complete(path, number, frames, wanted)
            frames.append({})
            continue
        if not frames:
            raise DataError(f"{path}:{number}: {words[0]!r} before the first frame number")
        if words[0] not in wanted:
            raise DataError(f"{path}:{number}: {words[0]!r} does not move in the ASF skeleton")
        try:
            frames[-1][words[0]] = _numbers(words[1:], wanted[words[0]])
        except ValueError as error:
            raise DataError(f"{path}:{number}: {words[0]}: {error}") from error
    if not frames:
        raise DataError(f"{path}: holds no frame")
    _check_complete(path, number, frames, wanted)
    return {name: np.stack([frame[name] for frame in frames]) for name in wanted}


def _check_complete(
    path: Path, number: int, frames: list[dict[str, FloatArray]], wanted: dict[str, int]
) -> None:
    missing = [name for name in wanted if frames and name not in frames[-1]]
    if missing:
        raise DataError(
            f"{path}:{number}: frame {len(frames)} ends without {', '.join(missing)};"
            " is the file truncated?"
        )


def _motion(skeleton: _Skeleton, values: dict[str, FloatArray], frame_time_s: float) -> Motion:
    frames = len(values["root"])
    names, parents, offsets = ["root"], [-1], [np.zeros(3)]
    root = values["root"]
    columns = [skeleton.root_order.index(name) for name in ("tx", "ty", "tz")]
    turns = [c for c in skeleton.root_order if c in _DOFS]
    angles = root[:, [skeleton.root_order.index(c) for c in turns]]
    rotations = [
        _turn(skeleton.root_axes, "".join(c[1] for c in turns), angles),
    ]
    for name, parent in skeleton.parents.items():
        bone = skeleton.bones[name]
        names.append(name)
        parents.append(names.index(parent))
        offsets.append(skeleton.bones[parent].end if parent != "root" else np.zeros(3))
        if bone.dofs:
            order = "".join(dof[1] for dof in bone.dofs)
            rotations.append(_turn(bone.axes, order, values[name]))
        else:
            rotations.append(np.broadcast_to(np.eye(3), (frames, 3, 3)))
    for name in (n for n in skeleton.parents if n not in skeleton.parents.values()):
        names.append(f"{name}_end")
        parents.append(names.index(name))
        offsets.append(skeleton.bones[name].end)
        rotations.append(np.broadcast_to(np.eye(3), (frames, 3, 3)))
    position: FloatArray = skeleton.root_position + root[:, columns]
    return Motion(
        tuple(names),
        tuple(parents),
        np.stack(offsets),
        np.stack(rotations, axis=1),
        position,
        frame_time_s,
    )


def _turn(axes: Rotation, order: str, angles: FloatArray) -> FloatArray:
    """C M C^-1 (T, 3, 3) for extrinsic angles (T, len(order)) in degrees."""
    moved = Rotation.from_euler(order, angles, degrees=True)
    matrix: FloatArray = (axes * moved * axes.inv()).as_matrix()
    return matrix
