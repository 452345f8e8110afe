"""Bone lengths of dancers in a text file, written by one run and read by the next.

    unit = "body heights"

    [dancers.1]
    skeleton = "body17"
    lengths = { neck = 0.2911, left_shoulder = 0.1088, ... }
    spread = { neck = 0.021, left_shoulder = 0.034, ... }

TOML. Each bone is named by the joint it ends at. `spread` is the standard deviation of each length
as a part of it; left out, it is the one that carefully measured lengths have.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dance2pose.body import BODY_HEIGHT_MM, Body, body_bones_mm
from dance2pose.errors import DataError, UsageError
from dance2pose.output_files import written_whole
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

_UNIT = "body heights"
_MEASURED_SPREAD = 0.02
_LARGEST_FILE = 1_000_000  # bytes
_SKELETONS = ("cmu17", "body17")
_SHORTEST, _LONGEST = 0.2, 4.0  # of a bone beside the one body's


def write_bodies(path: Path, bodies: Mapping[str, Body], *, overwrite: bool = False) -> None:
    """Write the bodies of dancers, by number or name. Raises OutputError where that fails."""
    lines = ["# Bone lengths that dance2pose found; give them to the next run with --body.", ""]
    lines.append(f'unit = "{_UNIT}"')
    for name, body in bodies.items():
        joints = get(body.skeleton).joints[1:]
        lengths = body.lengths_mm / BODY_HEIGHT_MM
        lines += ["", f"[dancers.{_key(name)}]", f'skeleton = "{body.skeleton}"']
        lines.append(f"lengths = {_table(joints, lengths)}")
        lines.append(f"spread = {_table(joints, body.spread)}")
    with written_whole(path, overwrite=overwrite) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_body(path: Path, body: Body, *, name: str = "1", overwrite: bool = False) -> None:
    """Write the body of one dancer."""
    write_bodies(path, {name: body}, overwrite=overwrite)


def read_bodies(path: Path) -> dict[str, Body]:
    """The bodies in a file, by the dancers' numbers or names.

    Raises DataError where it cannot be read or says something that is no body.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise DataError(f"{path}: larger than {_LARGEST_FILE} bytes; expected a body file")
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError) as error:
        raise DataError(f"{path}: not TOML: {error}; expected a body file") from error
    if content.get("unit") != _UNIT:
        raise DataError(f'{path}: unit is {content.get("unit")!r}; expected "{_UNIT}"')
    dancers = content.get("dancers")
    if not isinstance(dancers, dict) or not dancers:
        raise DataError(f"{path}: names no dancer; expected at least one table [dancers.NAME]")
    return {name: _body(f"{path}, dancer {name}", entry) for name, entry in dancers.items()}


def body_for(bodies: Mapping[str, Body], person: int) -> Body | None:
    """The body of a person by number; of a file with one dancer that one, whoever it is."""
    if len(bodies) == 1:
        return next(iter(bodies.values()))
    return bodies.get(str(person))


def _key(name: str) -> str:
    if name and all(c.isascii() and (c.isalnum() or c in "_-") for c in name):
        return name
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    if not escaped.isprintable():
        raise UsageError(f"dancer's name {name!r} has characters that no line of text can hold")
    return f'"{escaped}"'


def _table(joints: tuple[str, ...], values: FloatArray) -> str:
    pairs = (f"{joint} = {value:.5f}" for joint, value in zip(joints, values, strict=True))
    return "{ " + ", ".join(pairs) + " }"


def _body(place: str, entry: Any) -> Body:
    if not isinstance(entry, dict) or entry.get("skeleton") not in _SKELETONS:
        found = entry.get("skeleton") if isinstance(entry, dict) else entry
        raise DataError(f"{place}: skeleton is {found!r}; expected one of {', '.join(_SKELETONS)}")
    skeleton = entry["skeleton"]
    usual = body_bones_mm(skeleton)
    lengths = _values(place, entry, "lengths", skeleton) * BODY_HEIGHT_MM
    if not ((lengths > _SHORTEST * usual) & (lengths < _LONGEST * usual)).all():
        worst = get(skeleton).joints[1 + int(np.abs(np.log(lengths / usual)).argmax())]
        raise DataError(f"{place}: the bone to {worst} has a length that no body has")
    spread = np.full(len(usual), _MEASURED_SPREAD)
    if "spread" in entry:
        spread = _values(place, entry, "spread", skeleton)
    if not ((spread > 0) & (spread < 1)).all():
        raise DataError(f"{place}: spread must lie between 0 and 1")
    return Body(skeleton, lengths * usual.sum() / lengths.sum(), spread)


def _values(place: str, entry: dict[str, Any], what: str, skeleton: str) -> FloatArray:
    table, joints = entry.get(what), get(skeleton).joints[1:]
    if not isinstance(table, dict) or set(table) != set(joints):
        raise DataError(f"{place}: {what} must name these bones: {', '.join(joints)}")
    values = [table[joint] for joint in joints]
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in values)
    if not numbers or not all(0 < v < 100 and math.isfinite(v) for v in values):
        raise DataError(f"{place}: {what} must be positive numbers")
    return np.array(values, dtype=float)
