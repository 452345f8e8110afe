"""The blueprint of a recording: picture above, world below, plots and provenance beside them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dance2pose.poses import Dancer, FloatArray
from dance2pose.recording.entities import (
    PICTURE,
    PROVENANCE,
    WORLD,
    plots_path,
    raw_path,
)
from dance2pose.recording.overlays import all_positions
from dance2pose.recording.placement import Placement
from dance2pose.recording.plots import trust_curves
from dance2pose.recording.quiet_rerun import rr, rrb

_BACKGROUND = (22, 24, 28)
_GRID = (120, 120, 130, 110)
# The viewer's own vertical angle of view, and the least shape a 3D view is expected to have.
_VIEW_ANGLE = np.radians(55.0)
_VIEW_ASPECT = 1.6
# From where the world is first seen where the camera is not known: from the front, somewhat raised.
_EYE_RISE = np.radians(10.0)
# More dancers than this are not shown beside each other.
_MOST_BESIDE = 4

# Title of a plot, and the angle that it shows of both sides.
_ANGLE_PLOTS = {
    "Elbow flexion": "elbow_flexion",
    "Shoulder elevation": "shoulder_elevation",
    "Shoulder abduction": "shoulder_abduction",
    "Hip flexion": "hip_flexion",
    "Hip abduction": "hip_abduction",
    "Knee flexion": "knee_flexion",
    "Ankle flexion": "ankle_flexion",
}
_TRUNK_PLOT = ("Trunk lean", "trunk_lean")
# Angles that are never negative start at 0; the others go both ways.
_BOTH_WAYS = ("abduction", "hip_flexion", "ankle")


def blueprint(
    dancers: Sequence[Dancer], placement: Placement, image_size: tuple[int, int]
) -> rrb.Blueprint:
    """The layout that opens with the recording. image_size: (width, height) px."""
    width, height = image_size
    picture = rrb.Spatial2DView(
        origin=PICTURE,
        name="Video and keypoints",
        visual_bounds=rrb.VisualBounds2D(x_range=(0, width), y_range=(0, height)),
    )
    provenance = rrb.TextDocumentView(origin=PROVENANCE, name="Provenance")
    together = [_together(dancers)] if 1 < len(dancers) <= _MOST_BESIDE else []
    tabs: list[rrb.Container | rrb.View] = [
        *[_plots(dancer) for dancer in dancers],
        *together,
        provenance,
    ]
    beside = rrb.Tabs(*tabs, active_tab=0)
    left = rrb.Vertical(picture, _world(dancers, placement)) if dancers else picture
    return rrb.Blueprint(
        rrb.Horizontal(left, beside, column_shares=[1, 1]),
        rrb.TimePanel(timeline="video_time", state="collapsed", loop_mode="all"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def _world(dancers: Sequence[Dancer], placement: Placement) -> rrb.Spatial3DView:
    unit = dancers[0].smoothed.unit
    balls = (
        "; balls hold 68 % of true joints" if any(d.raw.sigma is not None for d in dancers) else ""
    )
    centre, size = _extent(dancers, placement)
    return rrb.Spatial3DView(
        origin=WORLD,
        contents=["$origin/**", *(f"- {raw_path(d.person)}" for d in dancers if _unsmoothed(d))],
        name=f"3D joints ({unit}{balls})",
        background=_BACKGROUND,
        line_grid=rrb.LineGrid3D(
            visible=True,
            spacing=0.5,
            plane=rr.components.Plane3D((0, 1, 0), 0.0),
            stroke_width=0.75,
            color=_GRID,
        ),
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=_eye(dancers, centre, size),
            look_target=centre,
            eye_up=(0, 1, 0),
        ),
    )


def _unsmoothed(dancer: Dancer) -> bool:
    """Whether the poses before and after smoothing are the same, and one of them is enough."""
    return np.array_equal(dancer.raw.xyz, dancer.smoothed.xyz, equal_nan=True)


def _extent(dancers: Sequence[Dancer], placement: Placement) -> tuple[FloatArray, FloatArray]:
    """Centre (3,) and size (3,) of what the joints fill, without their wildest hundredth."""
    points = all_positions(dancers, placement.offsets)
    points = points[~np.isnan(points).any(axis=1)]
    if not len(points):
        return np.zeros(3), np.ones(3)
    low, high = np.percentile(points, [0.5, 99.5], axis=0)
    return (low + high) / 2, high - low


def _eye(dancers: Sequence[Dancer], centre: FloatArray, size: FloatArray) -> FloatArray:
    """Where the eye stands: where the camera stood, and further back where it must to see all.

    So the world looks as the picture does, with the dancers in the same order.
    """
    seen = dancers[0].smoothed.viewpoint
    direction = np.array([0.0, np.sin(_EYE_RISE), np.cos(_EYE_RISE)])
    distance = 0.0
    if seen is not None:
        from_centre = seen.position - centre
        distance = float(np.linalg.norm(from_centre))
        if distance > 0:
            direction = from_centre / distance
    return np.asarray(centre + max(distance, _eye_distance(size)) * direction)


def _eye_distance(size: FloatArray) -> float:
    """How far away the eye sees all of it, with a margin."""
    half_angle = np.tan(_VIEW_ANGLE / 2)
    needed = max(size[1] / (2 * half_angle), size[0] / (2 * half_angle * _VIEW_ASPECT), 0.3)
    return float(1.05 * needed + size[2] / 2)


def _plots(dancer: Dancer) -> rrb.Vertical:
    """Joint angles above, trust below; all share one time axis when one is zoomed."""
    base = plots_path(dancer.person)
    angles = [
        _plot(
            base,
            [f"angle/{side}_{angle}" for side in ("left", "right")],
            f"{title}, degrees (blue left, red right)",
            bottom=-95.0 if any(word in angle for word in _BOTH_WAYS) else 0.0,
            top=185.0,
        )
        for title, angle in _ANGLE_PLOTS.items()
    ]
    angles.append(_plot(base, [f"angle/{_TRUNK_PLOT[1]}"], f"{_TRUNK_PLOT[0]}, degrees", top=185.0))
    trust = [
        _plot(base, [name], title[0].upper() + title[1:], top=_plot_top(name, values))
        for name, (title, values) in trust_curves(dancer).items()
    ]
    return rrb.Vertical(
        rrb.Grid(*angles, grid_columns=2),
        rrb.Grid(*trust, grid_columns=2 if len(trust) == 4 else 3),
        name=f"Dancer {dancer.person}",
        row_shares=[4, 2] if len(trust) == 4 else [4, 1],
    )


def _together(dancers: Sequence[Dancer]) -> rrb.Grid:
    """The angles of all dancers, one column each."""
    views = [
        _plot(
            plots_path(dancer.person),
            [f"angle/{side}_{angle}" for side in ("left", "right")],
            f"Dancer {dancer.person}: {title[0].lower() + title[1:]}, degrees",
            bottom=-95.0 if any(word in angle for word in _BOTH_WAYS) else 0.0,
            top=185.0,
        )
        for title, angle in _ANGLE_PLOTS.items()
        for dancer in dancers
    ]
    return rrb.Grid(*views, grid_columns=len(dancers), name="Dancers beside each other")


def _plot(
    base: str, entities: Sequence[str], name: str, *, top: float, bottom: float = 0.0
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=base,
        contents=[f"+ {base}/{entity}" for entity in entities],
        name=name,
        plot_legend=rrb.PlotLegend(visible=False),
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        axis_y=rrb.ScalarAxis(range=(bottom, top)),
    )


def _plot_top(name: str, values: FloatArray) -> float:
    """The top of a plot that starts at 0, so that small values do not look large."""
    known = values[~np.isnan(values)]
    least = {
        "confidence": 1.05,
        "invalid_bones": 4.0,
        "reprojection_error": 10.0,
        "sigma": 10.0,
    }.get(name, 0.0)
    top = float(known.max()) * 1.05 if known.size else 0.0
    return max(least, top) or 1.0
