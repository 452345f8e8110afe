"""`dance2pose smooth`: a temporal model over the poses of any tool."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from dance2pose import skeleton as skeletons
from dance2pose.errors import DataError, UsageError
from dance2pose.limits import model as limits
from dance2pose.mocap.bvh import read_bvh_file
from dance2pose.mocap.bvh_smoothing import bvh_text, smoothed_channels
from dance2pose.npz_files import AnyArray, read_arrays, write_arrays
from dance2pose.output_files import check_output, written_whole
from dance2pose.outputs import check_no_input
from dance2pose.reading.c3d import C3dFile
from dance2pose.smoothing import (
    DEFAULT_BETA,
    DEFAULT_MODEL,
    DEFAULT_WINDOW,
    check_window,
    find_model,
    smooth_part,
)
from dance2pose.smoothing import smooth as smooth_values
from dance2pose.tables import read_table, write_table

# What is smoothed in an .npz where no key is named: the first that is there.
_COORDINATES = ("xyz", "xy")

Smoother = Callable[..., AnyArray]


@dataclass(frozen=True)
class Smoothing:
    """The model of a run. whole: for a sequence that must hold the window. part: for one of
    several sequences in a file, which may be shorter."""

    whole: Smoother
    part: Smoother
    window: int


def smooth(
    poses: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    model: str = DEFAULT_MODEL,
    window: int = DEFAULT_WINDOW,
    key: str | None = None,
    cutoff: float | None = None,
    beta: float = DEFAULT_BETA,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Smooth a sequence of poses of any tool over time.

    Missing values stay missing and nothing is smoothed across them, nor across rows that are
    absent or a jump in time. Everything that is not a coordinate (times, names, confidences,
    flags) is copied; flags and errors in the file describe the poses before smoothing.

    Parameters
    ----------
    poses
        An .npz, .csv, .tsv, .trc, .c3d or .bvh file; one row (of a table) or one entry of the
        first axis (of an array) a frame. In a table with several rows a frame, a column such as
        person tells whose each is.
    output
        The file to write, of the same kind.
    model
        none, sma, ema, wma, mma (the paper's; they lag), the same with -zero-phase, one-euro,
        savitzky-golay or butterworth.
    window
        Window of the model in frames.
    key
        The array of an .npz to smooth; xyz or xy if not given.
    cutoff
        Cut-off frequency in hertz, for butterworth and one-euro, instead of the window.
    beta
        For one-euro: how much the cut-off rises with speed.
    overwrite
        Replace the output if it exists.
    quiet
        Say nothing.
    """
    check_window(model, window)
    kind = poses.suffix.lower()
    if kind not in KINDS:
        raise UsageError(f"{poses}: expected a {', '.join(KINDS)} file")
    if output.suffix.lower() != kind:
        raise UsageError(f"{output}: the output is of the same kind; give a name in {kind}")
    if key is not None and kind != ".npz":
        raise UsageError(f"{poses}: --key names an array of an .npz file, this is a {kind} file")
    check_no_input(output, [poses])
    check_output(output, overwrite=overwrite)
    how = Smoothing(
        partial(smooth_values, model=model, window=window, cutoff_hz=cutoff, beta=beta),
        partial(smooth_part, model=model, window=window, cutoff_hz=cutoff, beta=beta),
        window,
    )
    if kind == ".npz":
        what = _smooth_npz(poses, output, key, how, overwrite=overwrite)
    else:
        what = KINDS[kind](poses, output, how, overwrite=overwrite)
    if not quiet:
        lag = find_model(model).lag(window)
        up_to = "up to " if model == "one-euro" else ""
        late = f"late by {up_to}{lag:.3g} frames" if lag else "without lag"
        width = f"window {window}" if cutoff is None else f"cut-off {cutoff:g} Hz"
        print(f"smoothed {what}: {model}, {width}, {late}", file=sys.stderr)
        print(f"wrote {output}")


def _smooth_npz(
    source: Path, output: Path, key: str | None, how: Smoothing, *, overwrite: bool = False
) -> str:
    arrays = read_arrays(source)
    keys = [_key(source, arrays, key)]
    # The path of the dancer through the room belongs to the poses (see exchange.py).
    if keys == ["xyz"] and arrays.get("root", np.empty(0)).shape == (len(arrays["xyz"]), 3):
        keys.append("root")
    for name in keys:
        frame = _frame_numbers(arrays, arrays[name])
        arrays[name] = _smoothed(
            f"{source}: {name}", arrays[name], arrays.get("time_s"), frame, how.whole
        )
    old = _forget_the_old_poses(arrays) if keys[0] == "xyz" else []
    write_arrays(output, arrays, overwrite=overwrite)
    kept = ", ".join(name for name in arrays if name not in (*keys, *old)) or "nothing"
    again = f"computed again or dropped: {', '.join(old)}; " if old else ""
    return f"{' and '.join(keys)} ({again}kept as they are: {kept})"


def _forget_the_old_poses(arrays: dict[str, AnyArray]) -> list[str]:
    """In a poses file, recompute or drop what described the poses before smoothing, as
    `smooth_track` does. Returns the names of the arrays that are not as they were."""
    name = str(arrays.get("skeleton", ""))
    if name not in skeletons.names() or "valid" not in arrays or "unit" not in arrays:
        return []
    xyz = arrays["xyz"]
    if skeletons.get(name).is_tree and xyz.shape[1:] == (len(skeletons.get(name)), 3):
        arrays["valid"] = limits.load(name).is_valid(xyz)
    if "reprojection_error" in arrays:
        arrays["reprojection_error"] = np.full_like(arrays["reprojection_error"], np.nan)
    changed = ["valid", *(["sigma"] if arrays.pop("sigma", None) is not None else [])]
    return [*changed, "reprojection_error"]


def _frame_numbers(arrays: dict[str, AnyArray], values: AnyArray) -> AnyArray | None:
    """The array `frame`, where it is what its name says: one rising number a row."""
    frame = arrays.get("frame")
    if frame is None or frame.shape != values.shape[:1] or frame.dtype.kind not in "iu":
        return None
    return frame if (np.diff(frame.astype(np.int64)) > 0).all() else None


def _smooth_table(source: Path, output: Path, how: Smoothing, *, overwrite: bool = False) -> str:
    table = read_table(source)
    values, times, frames = table.values(), table.times(), table.frames()
    if np.isnan(values).all():
        raise _nothing(f"{source}")
    members = table.members()
    longest = max(members.values(), key=len)
    _check_length(f"{source}", len(longest), how.window, several=len(members) > 1)
    for rows in members.values():
        values[rows] = _smoothed(
            f"{source}",
            values[rows],
            None if times is None else times[rows],
            None if frames is None else frames[rows],
            how.part,
            empty=True,
        )
    write_table(output, table, values, overwrite=overwrite)
    others = [n or "(unnamed)" for c, n in enumerate(table.names) if c not in table.moving]
    kept = ", ".join(dict.fromkeys(others))
    whose = ""
    if len(members) > 1:
        columns = " and ".join(table.names[c] for c in table.groups)
        whose = f" of {len(members)} sequences told apart by {columns}"
    return f"{len(table.moving)} columns over {len(values)} rows{whose} (kept as they are: {kept})"


def _smooth_c3d(source: Path, output: Path, how: Smoothing, *, overwrite: bool = False) -> str:
    recording = C3dFile(source)
    points = _smoothed(f"{source}", recording.points, recording.time_s, None, how.whole)
    recording.write(output, points, overwrite=overwrite)
    return f"{points.shape[1]} markers over {len(points)} frames (kept as it is: all else)"


def _smooth_bvh(source: Path, output: Path, how: Smoothing, *, overwrite: bool = False) -> str:
    take = read_bvh_file(source)
    times = np.arange(len(take.values)) * take.frame_time
    values = smoothed_channels(
        take, lambda columns: _smoothed(f"{source}", columns, times, None, how.whole)
    )
    with written_whole(output, overwrite=overwrite) as temporary:
        temporary.write_text(bvh_text(take, values), encoding="utf-8")
    return f"{len(take.channels)} nodes over {len(values)} frames (kept as they are: offsets)"


# What is smoothed, by suffix.
KINDS: dict[str, Callable[..., str]] = {
    ".npz": _smooth_npz,
    ".csv": _smooth_table,
    ".tsv": _smooth_table,
    ".trc": _smooth_table,
    ".c3d": _smooth_c3d,
    ".bvh": _smooth_bvh,
}


def _key(source: Path, arrays: dict[str, AnyArray], key: str | None) -> str:
    there = ", ".join(f"{name} {array.shape}" for name, array in arrays.items()) or "nothing"
    if key is None:
        key = next((name for name in _COORDINATES if name in arrays), None)
        if key is None:
            raise UsageError(f"{source}: has neither xyz nor xy; give --key; it holds: {there}")
    elif key not in arrays:
        raise UsageError(f"{source}: has no array {key!r}; it holds: {there}")
    return key


def _smoothed(
    where: str,
    values: AnyArray,
    time_s: AnyArray | None,
    frame: AnyArray | None,
    model: Smoother,
    *,
    empty: bool = False,
) -> AnyArray:
    """`smoothing.smooth` with errors that name the place. NaN alone is no sequence of poses."""
    if not empty and values.dtype.kind == "f" and values.size and np.isnan(values).all():
        raise _nothing(where)
    try:
        return model(values, time_s=time_s, frame=frame)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from error


def _check_length(where: str, longest: int, window: int, *, several: bool) -> None:
    if window > longest:
        sequence = "longest of its sequences" if several else "sequence"
        raise UsageError(
            f"{where}: a window of {window} frames is longer than the {sequence} of"
            f" {longest} frames; give a window of at most {longest}"
        )


def _nothing(where: str) -> DataError:
    return DataError(f"{where} holds no value, only missing ones; there is nothing to smooth")
