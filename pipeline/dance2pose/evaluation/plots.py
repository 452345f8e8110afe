"""Figures of results as PNG files. matplotlib is optional and imported only here.

Every figure can be read without colour: lines differ in dashes and markers too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dance2pose.output_files import written_whole
from dance2pose.poses import FloatArray

WHY_NO_PLOTS = (
    "no figures: matplotlib is not installed; install dance2pose with its extra `evaluate`"
)
_STYLES = ("o-", "s--", "^-.", "d:", "v-", "x--", "P-.", "*:")


@dataclass(frozen=True)
class Series:
    """One line of a plot: x and y (n,)."""

    name: str
    x: FloatArray
    y: FloatArray


def available() -> bool:
    """Whether figures can be drawn."""
    try:
        import matplotlib  # noqa: F401
    except ImportError:
        return False
    return True


def lines(
    path: Path,
    series: Sequence[Series],
    *,
    title: str,
    x_label: str,
    y_label: str,
    markers: bool = True,
    logarithmic: bool = False,
    overwrite: bool = False,
) -> Path:
    """A plot of lines with a legend."""
    figure, axes = _figure()
    for number, line in enumerate(series):
        style = _STYLES[number % len(_STYLES)]
        axes.plot(line.x, line.y, style if markers else style[1:], label=line.name, markersize=4)
    axes.set(title=title, xlabel=x_label, ylabel=y_label)
    if logarithmic:
        axes.set_yscale("log")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=4)
    return _save(figure, path, overwrite)


def bars(
    path: Path,
    labels: Sequence[str],
    groups: Mapping[str, FloatArray],
    *,
    title: str,
    y_label: str,
    line_at: float | None = None,
    overwrite: bool = False,
) -> Path:
    """Grouped bars: a group of bars for each label, one bar for each entry of `groups`."""
    figure, axes = _figure(width=11)
    width = 0.8 / len(groups)
    hatches = ("", "//", "..", "xx", "--", "\\\\", "oo", "++")
    for number, (name, values) in enumerate(groups.items()):
        at = np.arange(len(labels)) + (number - (len(groups) - 1) / 2) * width
        axes.bar(at, values, width, label=name, hatch=hatches[number % 8], edgecolor="white")
    if line_at is not None:
        axes.axhline(line_at, color="black", linewidth=1)
    axes.set(title=title, ylabel=y_label)
    axes.set_xticks(np.arange(len(labels)), labels, rotation=40, ha="right")
    axes.grid(axis="y", alpha=0.3)
    figure.legend(loc="outside lower center", ncols=len(groups))
    return _save(figure, path, overwrite)


def _figure(width: float = 8.0) -> tuple[Any, Any]:
    # The figure's own canvas, not pyplot: nothing global, no window system.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, 4.8), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.add_subplot()


def _save(figure: Any, path: Path, overwrite: bool) -> Path:
    with written_whole(path, overwrite=overwrite) as temporary:
        # No date and no version inside, so that the same numbers give the same file.
        figure.savefig(temporary, dpi=90, format="png", metadata={"Software": None})
    return path
