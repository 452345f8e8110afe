"""`dance2pose smooth`: a temporal model over the poses of any tool."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from dance2pose.errors import DataError, UsageError
from dance2pose.npz_files import AnyArray, read_arrays, write_arrays
from dance2pose.output_files import check_output
from dance2pose.smoothing import (
    DEFAULT_BETA,
    DEFAULT_MODEL,
    DEFAULT_WINDOW,
    check_window,
    find_model,
)
from dance2pose.smoothing import smooth as smooth_values
from dance2pose.tables import read_table, write_table

# What is smoothed in an .npz where no key is named: the first that is there.
_COORDINATES = ("xyz", "xy")

Smoother = Callable[..., AnyArray]


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

    Missing values stay missing and nothing is smoothed across them. Everything that is not a
    coordinate (times, names, confidences, flags) is copied; flags and errors in the file describe
    the poses before smoothing.

    Parameters
    ----------
    poses
        An .npz, .csv or .trc file; one row (of a table) or one entry of the first axis (of an
        array) a frame.
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
    if kind not in (".npz", ".csv", ".trc"):
        raise UsageError(f"{poses}: expected a .npz, .csv or .trc file")
    if output.suffix.lower() != kind:
        raise UsageError(f"{output}: the output is of the same kind; give a name in {kind}")
    if key is not None and kind != ".npz":
        raise UsageError(f"{poses}: --key names an array of an .npz file, this is a {kind} file")
    check_output(output, overwrite=overwrite)
    model_of_run = partial(smooth_values, model=model, window=window, cutoff_hz=cutoff, beta=beta)
    if kind == ".npz":
        what = _smooth_npz(poses, output, key, model_of_run, overwrite=overwrite)
    else:
        what = _smooth_table(poses, output, model_of_run, overwrite=overwrite)
    if not quiet:
        lag = find_model(model).lag(window)
        up_to = "up to " if model == "one-euro" else ""
        late = f"late by {up_to}{lag:.3g} frames" if lag else "without lag"
        print(f"smoothed {what}: {model}, window {window}, {late}", file=sys.stderr)
        print(f"wrote {output}")


def _smooth_npz(
    source: Path, output: Path, key: str | None, model: Smoother, *, overwrite: bool
) -> str:
    arrays = read_arrays(source)
    keys = [_key(source, arrays, key)]
    # The path of the dancer through the room belongs to the poses (see exchange.py).
    if keys == ["xyz"] and arrays.get("root", np.empty(0)).shape == (len(arrays["xyz"]), 3):
        keys.append("root")
    for name in keys:
        arrays[name] = _smoothed(f"{source}: {name}", arrays[name], arrays.get("time_s"), model)
    write_arrays(output, arrays, overwrite=overwrite)
    kept = ", ".join(name for name in arrays if name not in keys) or "nothing"
    return f"{' and '.join(keys)} (kept as they are: {kept})"


def _smooth_table(source: Path, output: Path, model: Smoother, *, overwrite: bool) -> str:
    table = read_table(source)
    values = _smoothed(f"{source}", table.values(), table.times(), model)
    write_table(output, table, values, overwrite=overwrite)
    kept = ", ".join(n or "(unnamed)" for c, n in enumerate(table.names) if c not in table.moving)
    return f"{len(table.moving)} columns over {len(values)} frames (kept as they are: {kept})"


def _key(source: Path, arrays: dict[str, AnyArray], key: str | None) -> str:
    there = ", ".join(f"{name} {array.shape}" for name, array in arrays.items()) or "nothing"
    if key is None:
        key = next((name for name in _COORDINATES if name in arrays), None)
        if key is None:
            raise UsageError(f"{source}: has neither xyz nor xy; give --key; it holds: {there}")
    elif key not in arrays:
        raise UsageError(f"{source}: has no array {key!r}; it holds: {there}")
    return key


def _smoothed(where: str, values: AnyArray, time_s: AnyArray | None, model: Smoother) -> AnyArray:
    """`smoothing.smooth` with errors that name the place. NaN alone is no sequence of poses."""
    if values.dtype.kind == "f" and values.size and np.isnan(values).all():
        raise DataError(f"{where} holds no value, only missing ones; there is nothing to smooth")
    try:
        return model(values, time_s=time_s)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from error
