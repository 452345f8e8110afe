"""What a recording holds of each dancer: entity paths, colours, and the columns that are sent.

Every array goes out whole with `send_columns`, which is about a hundred times faster than a call
a frame. All functions send to an open `rerun.RecordingStream`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dance2pose.angles import joint_angles
from dance2pose.placement import positions
from dance2pose.poses import BoolArray, Dancer, FloatArray, IntArray, Track2D, Track3D
from dance2pose.quiet_rerun import rr
from dance2pose.skeleton import Skeleton, get

PICTURE = "/video"
WORLD = "/world"
PROVENANCE = "/provenance"

Colour = tuple[int, int, int]
# One a dancer, legible on a dark ground and on most pictures; never near the two side colours.
_DANCERS: tuple[Colour, ...] = (
    (255, 214, 64),
    (80, 220, 130),
    (225, 130, 255),
    (240, 240, 240),
    (64, 224, 224),
    (255, 160, 200),
)
LEFT: Colour = (80, 160, 255)
RIGHT: Colour = (255, 100, 80)
_RAW: Colour = (105, 105, 115)
_PLOT: Colour = (220, 220, 220)


def dancer_colour(person: int) -> Colour:
    """The colour of a dancer by number from 1."""
    return _DANCERS[(person - 1) % len(_DANCERS)]


def keypoints_path(person: int) -> str:
    return f"{PICTURE}/dancer_{person}/keypoints"


def box_path(person: int) -> str:
    return f"{PICTURE}/dancer_{person}/box"


def dancer_path(person: int) -> str:
    return f"{WORLD}/dancer_{person}"


def plots_path(person: int) -> str:
    return f"/plots/dancer_{person}"


@dataclass(frozen=True)
class Clock:
    """The frames that were processed: frame (T,) indices and time_s (T,) presentation times."""

    frame: IntArray
    time_s: npt.NDArray[np.float64]

    def columns(self) -> list[rr.TimeColumn]:
        """Both timelines of the recording."""
        return [
            rr.TimeColumn("frame", sequence=self.frame),
            rr.TimeColumn("video_time", duration=self.time_s),
        ]

    def after(self, frame: int) -> Clock:
        """The first processed frame after `frame`; empty where it was the last."""
        later = np.searchsorted(self.frame, frame, side="right")
        return Clock(self.frame[later : later + 1], self.time_s[later : later + 1])


def send_static(stream: rr.RecordingStream, dancers: list[Dancer], offsets: FloatArray) -> None:
    """Axes, skeletons, colours and styles: all that does not change over time."""
    stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    _send_classes(stream, PICTURE, [(d.person, d.track.skeleton) for d in dancers])
    _send_classes(stream, WORLD, [(d.person, d.smoothed.skeleton) for d in dancers])
    for dancer, offset in zip(dancers, offsets, strict=True):
        person, path = dancer.person, dancer_path(dancer.person)
        stream.log(path, rr.Transform3D(translation=offset), static=True)
        raw = rr.AnnotationContext(_skeleton_class(person, dancer.raw.skeleton, faint=True))
        stream.log(f"{path}/raw", raw, static=True)
        for name, track, radius in (
            ("joints", dancer.smoothed, 4.0),
            ("raw", dancer.raw, 2.0),
        ):
            stream.log(
                f"{path}/{name}",
                rr.Points3D.from_fields(
                    radii=rr.Radius.ui_points(radius),
                    show_labels=False,
                    class_ids=person,
                    keypoint_ids=range(len(get(track.skeleton))),
                ),
                static=True,
            )
        stream.log(
            keypoints_path(person),
            rr.Points2D.from_fields(
                radii=rr.Radius.ui_points(3.0),
                show_labels=False,
                draw_order=20.0,
                class_ids=person,
                keypoint_ids=range(len(get(dancer.track.skeleton))),
            ),
            static=True,
        )
        stream.log(
            box_path(person),
            rr.Boxes2D.from_fields(
                labels=f"dancer {person}",
                show_labels=len(dancers) > 1,
                draw_order=10.0,
                radii=rr.Radius.ui_points(0.75),
                class_ids=person,
            ),
            static=True,
        )


def _send_classes(stream: rr.RecordingStream, path: str, skeletons: list[tuple[int, str]]) -> None:
    classes = [_skeleton_class(person, name) for person, name in skeletons]
    if classes:
        stream.log(path, rr.AnnotationContext(classes), static=True)


def _skeleton_class(person: int, skeleton: str, *, faint: bool = False) -> rr.ClassDescription:
    """A skeleton in the dancer's colour, its joints coloured by side."""
    form = get(skeleton)
    colour = _RAW if faint else dancer_colour(person)
    joints = [
        rr.AnnotationInfo(id=j, label=name, color=_RAW if faint else _side_colour(form, j, colour))
        for j, name in enumerate(form.joints)
    ]
    return rr.ClassDescription(
        info=rr.AnnotationInfo(id=person, label=f"dancer {person}", color=colour),
        keypoint_annotations=joints,
        keypoint_connections=form.bones,
    )


def _side_colour(form: Skeleton, joint: int, middle: Colour) -> Colour:
    parts = form.joints[joint].split("_")
    return LEFT if "left" in parts else RIGHT if "right" in parts else middle


def send_dancer(stream: rr.RecordingStream, dancer: Dancer, clock: Clock) -> None:
    """Everything of one dancer that changes over time.

    The viewer keeps showing the last value it knows, so the first frame after the dancer's last
    one takes the skeleton off again.
    """
    _send_keypoints(stream, dancer.track, clock)
    path = dancer_path(dancer.person)
    _send_joints(stream, f"{path}/joints", dancer.smoothed, clock)
    _send_joints(stream, f"{path}/raw", dancer.raw, clock)
    _send_plots(stream, dancer)


def _track_clock(track: Track2D | Track3D) -> Clock:
    return Clock(track.frame, track.time_s)


def _send_keypoints(stream: rr.RecordingStream, track: Track2D, clock: Clock) -> None:
    times, end = _track_clock(track), clock.after(int(track.frame[-1]))
    frames, joints = track.xy.shape[:2]
    path = keypoints_path(track.person)
    xy = track.xy.reshape(-1, 2).astype(np.float32)
    columns = rr.Points2D.columns(positions=xy).partition([joints] * frames)
    _send(stream, path, times, columns)

    boxes = track.box[~np.isnan(track.box).any(axis=1)]
    seen = (~np.isnan(track.box).any(axis=1)).astype(int)
    half_sizes = (boxes[:, 2:] - boxes[:, :2]) / 2
    box_columns = rr.Boxes2D.columns(
        half_sizes=half_sizes.astype(np.float32),
        centers=(boxes[:, :2] + half_sizes).astype(np.float32),
    ).partition(seen)
    _send(stream, box_path(track.person), times, box_columns)
    if len(end.frame):
        gone = np.full((joints, 2), np.nan, np.float32)
        _send(stream, path, end, rr.Points2D.columns(positions=gone).partition([joints]))
        nothing = np.zeros((0, 2), np.float32)
        _send(
            stream,
            box_path(track.person),
            end,
            rr.Boxes2D.columns(half_sizes=nothing, centers=nothing).partition([0]),
        )


def _send_joints(stream: rr.RecordingStream, path: str, track: Track3D, clock: Clock) -> None:
    end = clock.after(int(track.frame[-1]))
    xyz = positions(track).astype(np.float32)
    frames, joints = xyz.shape[:2]
    columns = rr.Points3D.columns(positions=xyz.reshape(-1, 3)).partition([joints] * frames)
    _send(stream, path, _track_clock(track), columns)
    if len(end.frame):
        gone = np.full((joints, 3), np.nan, np.float32)
        _send(stream, path, end, rr.Points3D.columns(positions=gone).partition([joints]))


def _send_plots(stream: rr.RecordingStream, dancer: Dancer) -> None:
    base, times = plots_path(dancer.person), _track_clock(dancer.smoothed)
    for name, values in joint_angles(dancer.smoothed.xyz, dancer.smoothed.skeleton).items():
        _send_plot(
            stream,
            f"{base}/angle/{name}",
            name.replace("_", " "),
            values,
            times,
            LEFT if name.startswith("left") else RIGHT,
        )
    for name, (title, values) in quality_plots(dancer).items():
        _send_plot(stream, f"{base}/{name}", title, values, times, _PLOT)


def quality_plots(dancer: Dancer) -> dict[str, tuple[str, FloatArray]]:
    """What tells how far to trust each frame: by entity name, its title and values (T,).

    NaN where the frame has no pose: means over what was seen, a count of what was lifted.
    """
    track, joints = dancer.track, dancer.smoothed
    seen = np.asarray(~np.isnan(track.xy).any(axis=2))
    lifted = ~np.isnan(joints.xyz).all(axis=(1, 2))
    plots = {
        "confidence": ("mean keypoint confidence", _row_mean(track.confidence, seen)),
        "reprojection_error": (
            "mean reprojection error, px",
            _row_mean(joints.reprojection_error, ~np.isnan(joints.reprojection_error)),
        ),
        "invalid_bones": (
            "invalid bones",
            np.where(lifted, (~joints.valid).sum(axis=1), np.nan),
        ),
    }
    if joints.sigma is not None:
        sigma = _row_mean(joints.sigma, ~np.isnan(joints.sigma))
        plots["sigma"] = (f"mean standard deviation, {joints.unit}", sigma)
    return plots


def _row_mean(values: FloatArray, known: BoolArray) -> FloatArray:
    """Mean (T,) over the known values (T, J) of each row, NaN where a row has none."""
    count = known.sum(axis=1)
    total = np.where(known, values, 0).sum(axis=1, dtype=np.float64)
    mean: FloatArray = np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)
    return mean


def _send_plot(
    stream: rr.RecordingStream,
    path: str,
    title: str,
    values: FloatArray,
    times: Clock,
    colour: Colour,
) -> None:
    style = rr.SeriesLines(colors=colour, names=title, widths=1.5)
    stream.log(path, style, static=True)
    _send(stream, path, times, rr.Scalars.columns(scalars=values.astype(np.float64)))


def _send(
    stream: rr.RecordingStream, path: str, times: Clock, columns: rr.ComponentColumnList
) -> None:
    rr.send_columns(path, times.columns(), columns, recording=stream)
