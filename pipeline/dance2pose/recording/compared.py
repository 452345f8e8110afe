"""A recording of two performances, side by side and one over the other, in the first one's time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dance2pose.comparison import Comparison
from dance2pose.poses import FloatArray, Timeline
from dance2pose.recording.entities import time_columns
from dance2pose.recording.placement import SPACING
from dance2pose.recording.quiet_rerun import rr, rrb
from dance2pose.recording.stream import open_stream
from dance2pose.recording.style import dancer_colour, side_colour

APPLICATION_ID = "dance2pose"
_WORLD, _PLOTS, _TABLE = "/world", "/plots", "/table"
_GAP_COLOUR = (255, 80, 80)
# The classes of both performances, and with them their colours.
_A, _B = 1, 5
_BACKGROUND = (22, 24, 28)


def write_compared(
    path: Path, found: Comparison, *, recording_id: str, names: tuple[str, str], table: str
) -> None:
    """Write the recording. names: of the two performances. table: Markdown to show beside it."""
    with open_stream(path, application_id=APPLICATION_ID, recording_id=recording_id) as file:
        stream = file.rerun
        stream.send_recording_name(" and ".join(names))
        timeline = Timeline(found.frame, found.time_s)
        _send_style(stream, found, names)
        for place in ("a", "over/a"):
            _send_joints(stream, f"{_WORLD}/{place}", timeline, found.a)
        for place in ("b", "over/b"):
            _send_joints(stream, f"{_WORLD}/{place}", timeline, found.b)
        _send_gaps(stream, timeline, found)
        for name, values in _curves(found).items():
            columns = rr.Scalars.columns(scalars=values)
            rr.send_columns(f"{_PLOTS}/{name}", time_columns(timeline), columns, recording=stream)
        text = rr.TextDocument(table, media_type=rr.MediaType.MARKDOWN)
        stream.log(_TABLE, text, static=True)
        stream.send_blueprint(_blueprint(found, names))


def _send_style(stream: rr.RecordingStream, found: Comparison, names: tuple[str, str]) -> None:
    stream.log(_WORLD, rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    stream.log(
        _WORLD,
        rr.AnnotationContext(
            [
                rr.ClassDescription(
                    info=rr.AnnotationInfo(id=number, label=name, color=dancer_colour(number)),
                    keypoint_annotations=[
                        rr.AnnotationInfo(
                            id=j, label=joint, color=side_colour(joint, dancer_colour(number))
                        )
                        for j, joint in enumerate(found.skeleton.joints)
                    ],
                    keypoint_connections=found.skeleton.bones,
                )
                for number, name in ((_A, names[0]), (_B, names[1]))
            ]
        ),
        static=True,
    )
    apart = SPACING[found.unit]
    floor = _floor(found)
    for place, x in (("a", -apart), ("over", 0.0), ("b", apart)):
        stream.log(f"{_WORLD}/{place}", rr.Transform3D(translation=(x, floor, 0)), static=True)
    for place, number in (("a", _A), ("over/a", _A), ("b", _B), ("over/b", _B)):
        points = rr.Points3D.from_fields(
            radii=rr.Radius.ui_points(4.0 if place != "over/b" else 2.5),
            show_labels=False,
            class_ids=number,
            keypoint_ids=range(len(found.skeleton)),
        )
        stream.log(f"{_WORLD}/{place}", points, static=True)
    lines = rr.LineStrips3D.from_fields(radii=rr.Radius.ui_points(0.7), colors=_GAP_COLOUR)
    stream.log(f"{_WORLD}/over/difference", lines, static=True)
    for name in _curves(found):
        line = rr.SeriesLines(colors=(220, 220, 220), names=name.replace("_", " "), widths=1.5)
        stream.log(f"{_PLOTS}/{name}", line, static=True)


def _floor(found: Comparison) -> float:
    """How far both are raised so that feet are about on the floor."""
    heights = np.concatenate([found.a[..., 1].ravel(), found.b[..., 1].ravel()])
    heights = heights[~np.isnan(heights)]
    return -float(np.percentile(heights, 0.5)) if heights.size else 0.0


def _send_joints(
    stream: rr.RecordingStream, path: str, timeline: Timeline, xyz: FloatArray
) -> None:
    frames, joints = xyz.shape[:2]
    columns = rr.Points3D.columns(positions=xyz.reshape(-1, 3).astype(np.float32))
    rr.send_columns(
        path, time_columns(timeline), columns.partition([joints] * frames), recording=stream
    )


def _send_gaps(stream: rr.RecordingStream, timeline: Timeline, found: Comparison) -> None:
    """A line from every joint to where the other performance has it."""
    pairs = np.stack([found.a, found.b], axis=2).astype(np.float32)
    known = ~np.isnan(pairs).any(axis=(2, 3))
    columns = rr.LineStrips3D.columns(strips=pairs[known])
    path = f"{_WORLD}/over/difference"
    rr.send_columns(
        path, time_columns(timeline), columns.partition(known.sum(axis=1)), recording=stream
    )


def _curves(found: Comparison) -> dict[str, FloatArray]:
    """Mean distance of the joints, and how much later the second performance is."""
    known = ~np.isnan(found.distance[:, 1:])
    count = known.sum(axis=1)
    total = np.where(known, found.distance[:, 1:], 0).sum(axis=1)
    mean = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return {"difference": mean, "later_by_s": found.time_b_s - found.time_s}


def _blueprint(found: Comparison, names: tuple[str, str]) -> rrb.Blueprint:
    height = _floor(found)
    apart = SPACING[found.unit]
    world = rrb.Spatial3DView(
        origin=_WORLD,
        name=f"{names[0]} | one over the other | {names[1]}",
        background=_BACKGROUND,
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=(0.2 * apart, 1.3 * height, 2.1 * apart),
            look_target=(0, height, 0),
            eye_up=(0, 1, 0),
        ),
    )
    plots = [
        rrb.TimeSeriesView(
            origin=f"{_PLOTS}/{name}", name=title, plot_legend=rrb.PlotLegend(visible=False)
        )
        for name, title in (
            ("difference", f"Mean difference of joints, {found.unit}"),
            ("later_by_s", "Second performance later by, s"),
        )
    ]
    table = rrb.TextDocumentView(origin=_TABLE, name="Differences")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(world, rrb.Horizontal(*plots), row_shares=[3, 1]),
            table,
            column_shares=[2, 1],
        ),
        rrb.TimePanel(timeline="video_time", state="collapsed", loop_mode="all"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )
