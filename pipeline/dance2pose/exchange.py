"""Tracks and poses as .npz files, for other programs and for the later stages.

Track (2D): `xy` (T, J, 2) px, `confidence` (T, J), `time_s` (T,), `frame` (T,), `joints` (J,)
names, `skeleton` a name, `image_size` (2,) width and height; optional `person`, `shot`,
`interpolated` (T,), `box` (T, 4). Poses (3D): `xyz` (T, J, 3), `time_s`, `frame`, `joints`,
`skeleton`, `unit`, `valid` (T, J - 1), `reprojection_error` (T, J); optional `person`, `shot`,
`estimated` (T, J), `sigma` (T, J), `root` (T, 3). The meaning of each is that of the field of
the same name in `poses.Track2D` and `poses.Track3D`. Missing numbers are NaN.

Both hold `format`, the text "dance2pose track 2" or "dance2pose poses 2", and `provenance`, JSON
text ("{}" where nothing is known). Files of the first version have neither, and are read too.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np
import numpy.typing as npt

from dance2pose import skeleton as skeletons
from dance2pose.errors import DataError, UsageError
from dance2pose.npz_files import AnyArray, read_arrays, write_arrays
from dance2pose.poses import Timeline, Track2D, Track3D, Unit

TRACK_FORMAT, POSES_FORMAT = "dance2pose track", "dance2pose poses"
VERSION = 2


def write_track(
    path: Path,
    track: Track2D,
    *,
    provenance: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> None:
    """Write `track.npz`, complete or not at all. provenance: what JSON can hold.

    Raises OutputError.
    """
    arrays: dict[str, AnyArray] = {
        **_about(TRACK_FORMAT, provenance),
        "xy": track.xy.astype(np.float32),
        "confidence": track.confidence.astype(np.float32),
        "time_s": track.time_s.astype(np.float64),
        "frame": track.frame.astype(np.int64),
        "joints": np.array(skeletons.get(track.skeleton).joints),
        "skeleton": np.array(track.skeleton),
        "image_size": np.array(track.image_size, np.int64),
        "person": np.array(track.person, np.int64),
        "shot": np.array(track.shot, np.int64),
        "interpolated": track.interpolated.astype(np.bool_),
        "box": track.box.astype(np.float32),
    }
    write_arrays(path, arrays, overwrite=overwrite)


def read_track(path: Path) -> Track2D:
    """Read `track.npz`; DataError names the file and the key that is not as it should be."""
    keys = _Keys(path, read_arrays(path))
    keys.check_format(TRACK_FORMAT)
    if "xy" not in keys.arrays and "xyz" in keys.arrays:
        raise DataError(f"{path}: holds 3D poses (xyz), expected a 2D track (xy)")
    xy = keys.floats("xy", (None, None, 2))
    length, joints = xy.shape[:2]
    if length == 0:
        raise DataError(f"{path}: xy has shape {xy.shape}: the track has no frame")
    width, height = keys.integers("image_size", (2,)).tolist()
    if width < 0 or height < 0:
        raise DataError(f"{path}: image_size is {width} x {height}, expected width and height")
    optional = keys.optional
    return Track2D(
        person=int(keys.integers("person", ())) if optional("person") else 1,
        timeline=keys.timeline(length),
        xy=xy,
        confidence=keys.floats("confidence", (length, joints)),
        skeleton=keys.skeleton(joints),
        interpolated=keys.flags("interpolated", (length,))
        if optional("interpolated")
        else np.zeros(length, np.bool_),
        box=keys.floats("box", (length, 4))
        if optional("box")
        else np.full((length, 4), np.nan, np.float32),
        image_size=(width, height),
        shot=int(keys.integers("shot", ())) if optional("shot") else 0,
    )


def _about(kind: str, provenance: Mapping[str, Any] | None) -> dict[str, AnyArray]:
    return {
        "format": np.array(f"{kind} {VERSION}"),
        "provenance": np.array(json.dumps(provenance or {}, ensure_ascii=False)),
    }


def write_poses(
    path: Path,
    track: Track3D,
    *,
    provenance: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> None:
    """Write `poses.npz`, complete or not at all. provenance: what JSON can hold.

    Raises OutputError.
    """
    arrays: dict[str, AnyArray] = {
        **_about(POSES_FORMAT, provenance),
        "xyz": track.xyz,
        "time_s": track.time_s.astype(np.float64),
        "frame": track.frame.astype(np.int64),
        "joints": np.array(skeletons.get(track.skeleton).joints),
        "skeleton": np.array(track.skeleton),
        "unit": np.array(track.unit),
        "valid": track.valid.astype(np.bool_),
        "reprojection_error": track.reprojection_error,
        "person": np.array(track.person, np.int64),
        "shot": np.array(track.shot, np.int64),
        "estimated": track.estimated.astype(np.bool_),
    }
    if track.sigma is not None:
        arrays["sigma"] = track.sigma
    if track.root is not None:
        arrays["root"] = track.root
    write_arrays(path, arrays, overwrite=overwrite)


def read_poses(path: Path) -> Track3D:
    """Read `poses.npz`; DataError names the file and the key that is not as it should be."""
    keys = _Keys(path, read_arrays(path))
    keys.check_format(POSES_FORMAT)
    if "xyz" not in keys.arrays and "xy" in keys.arrays:
        raise DataError(f"{path}: holds a 2D track (xy), expected 3D poses (xyz); lift it first")
    xyz = keys.floats("xyz", (None, None, 3))
    length, joints = xyz.shape[:2]
    if length == 0:
        raise DataError(f"{path}: xyz has shape {xyz.shape}: there is no frame")
    optional = keys.optional
    return Track3D(
        person=int(keys.integers("person", ())) if optional("person") else 1,
        timeline=keys.timeline(length),
        xyz=xyz,
        unit=keys.unit(),
        skeleton=keys.skeleton(joints),
        reprojection_error=keys.floats("reprojection_error", (length, joints)),
        valid=keys.flags("valid", (length, joints - 1)),
        estimated=keys.flags("estimated", (length, joints))
        if optional("estimated")
        else np.zeros((length, joints), np.bool_),
        sigma=keys.floats("sigma", (length, joints)) if optional("sigma") else None,
        root=keys.floats("root", (length, 3)) if optional("root") else None,
        shot=int(keys.integers("shot", ())) if optional("shot") else 0,
    )


def read_provenance(path: Path) -> dict[str, Any]:
    """What a track or poses file says of its own making; empty for files of the first version."""
    keys = _Keys(path, read_arrays(path))
    if not keys.optional("provenance"):
        return {}
    try:
        found = json.loads(keys.text("provenance"))
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: provenance is not JSON: {error}") from error
    if not isinstance(found, dict):
        raise DataError(f"{path}: provenance is {type(found).__name__}, expected a JSON object")
    return found


class _Keys:
    """The arrays of one file, taken out by name, kind and shape, or DataError."""

    def __init__(self, path: Path, arrays: dict[str, AnyArray]) -> None:
        self.path = path
        self.arrays = arrays

    def optional(self, key: str) -> bool:
        return key in self.arrays

    def take(self, key: str, kinds: str, shape: tuple[int | None, ...]) -> AnyArray:
        """The array `key`; `kinds` are NumPy's one-letter kinds; None matches any length."""
        if key not in self.arrays:
            there = ", ".join(self.arrays) or "nothing"
            raise DataError(f"{self.path}: has no array {key!r}; it holds: {there}")
        array = self.arrays[key]
        if array.dtype.kind not in kinds:
            wanted = {"fiu": "numbers", "iu": "integers", "b": "flags (bool)", "U": "text"}[kinds]
            raise DataError(f"{self.path}: {key} has type {array.dtype}, expected {wanted}")
        fits = array.ndim == len(shape) and all(
            want in (None, have) for want, have in zip(shape, array.shape, strict=True)
        )
        if not fits:
            expected = "(" + ", ".join("any" if n is None else str(n) for n in shape) + ")"
            raise DataError(f"{self.path}: {key} has shape {array.shape}, expected {expected}")
        return array

    def floats(self, key: str, shape: tuple[int | None, ...]) -> npt.NDArray[np.floating[Any]]:
        array = self.take(key, "fiu", shape)
        if np.isinf(array).any():
            raise DataError(f"{self.path}: {key} holds infinite numbers; missing ones are NaN")
        return array if array.dtype.kind == "f" else array.astype(np.float64)

    def integers(self, key: str, shape: tuple[int | None, ...]) -> npt.NDArray[np.int64]:
        return self.take(key, "iu", shape).astype(np.int64)

    def flags(self, key: str, shape: tuple[int | None, ...]) -> npt.NDArray[np.bool_]:
        return self.take(key, "b", shape)

    def text(self, key: str) -> str:
        return str(self.take(key, "U", ()))

    def timeline(self, length: int) -> Timeline:
        times = self.floats("time_s", (length,)).astype(np.float64)
        try:
            return Timeline(self.integers("frame", (length,)), times)
        except DataError as error:
            raise DataError(f"{self.path}: {error}") from error

    def check_format(self, kind: str) -> None:
        """Files of the first version say nothing; a version that is yet to come is refused."""
        if not self.optional("format"):
            return
        found = self.text("format")
        known = {
            f"{known} {n}" for known in (TRACK_FORMAT, POSES_FORMAT) for n in range(VERSION + 1)
        }
        if found not in known:
            raise DataError(
                f"{self.path}: format is {found!r}, expected {kind!r} up to version {VERSION}; "
                "a newer dance2pose may have written it"
            )

    def skeleton(self, joints: int) -> str:
        name = self.text("skeleton")
        try:
            known = skeletons.get(name)
        except UsageError as error:
            raise DataError(f"{self.path}: {error}") from error
        listed = tuple(self.take("joints", "U", (joints,)).tolist())
        if listed != known.joints:
            raise DataError(
                f"{self.path}: joints are {', '.join(listed)};"
                f" the skeleton {name} has {', '.join(known.joints)}"
            )
        return name

    def unit(self) -> Unit:
        unit = self.text("unit")
        if unit not in get_args(Unit):
            known = " or ".join(repr(name) for name in get_args(Unit))
            raise DataError(f"{self.path}: unit is {unit!r}, expected {known}")
        return cast(Unit, unit)
