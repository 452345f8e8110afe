"""What a recording holds of each dancer over time: entity paths, and the columns that are sent.

Arrays go out with `send_columns`, thousands of frames at a time, which is about a hundred times
faster than a call a frame. All functions send to an open `rerun.RecordingStream`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dance2pose.portions import dancer_rows, portions, timeline_rows
from dance2pose.poses import Dancer, FloatArray, Timeline, Track2D, Track3D
from dance2pose.recording.overlays import (
    Ground,
    drawn_over_picture,
    floor_under,
    known_joints,
    send_columns_of,
    standing,
)
from dance2pose.recording.plots import angle_curves, trust_curves
from dance2pose.recording.quiet_rerun import rr
from dance2pose.skeleton import get

PICTURE = "/video"
WORLD = "/world"
PROVENANCE = "/provenance"


def piece_path(number: int) -> str:
    """Where a piece of the video file lies; the frames of PICTURE refer to it."""
    return f"/video_file/{number:04}"


def keypoints_path(person: int) -> str:
    return f"{PICTURE}/dancer_{person}/keypoints"


def box_path(person: int) -> str:
    return f"{PICTURE}/dancer_{person}/box"


def dancer_path(person: int) -> str:
    return f"{WORLD}/dancer_{person}"


def joints_path(person: int) -> str:
    return f"{dancer_path(person)}/joints"


def raw_path(person: int) -> str:
    return f"{dancer_path(person)}/raw"


def filled_in_path(person: int) -> str:
    return f"{PICTURE}/dancer_{person}/filled_in"


def projected_path(person: int) -> str:
    return f"{PICTURE}/dancer_{person}/projected"


def ruler_path() -> str:
    return f"{WORLD}/ruler"


def plots_path(person: int) -> str:
    return f"/plots/dancer_{person}"


def time_columns(timeline: Timeline) -> list[rr.TimeColumn]:
    """Both timelines of the recording."""
    return [
        rr.TimeColumn("frame", sequence=timeline.frame),
        rr.TimeColumn("video_time", duration=timeline.time_s),
    ]


def _first_after(timeline: Timeline, frame: int) -> Timeline:
    """The first frame after `frame`; empty where it was the last."""
    later = int(np.searchsorted(timeline.frame, frame, side="right"))
    return Timeline(timeline.frame[later : later + 1], timeline.time_s[later : later + 1])


@dataclass(frozen=True)
class _Rows:
    """Where and when one dancer's rows go: `timeline` are the frames of the dancer's track, and
    `end` is the first frame after it, if any."""

    stream: rr.RecordingStream
    timeline: Timeline
    end: Timeline

    def send(self, path: str, columns: rr.ComponentColumnList) -> None:
        rr.send_columns(path, time_columns(self.timeline), columns, recording=self.stream)

    def send_all(self, path: str, columns: rr.ComponentColumnList) -> None:
        """As `send`, and nothing at the end."""
        self.send(path, columns)
        if len(self.end.frame):
            gone = rr.Clear.columns(is_recursive=[False])
            rr.send_columns(path, time_columns(self.end), gone, recording=self.stream)

    def clear(self, path: str, columns: rr.ComponentColumnList) -> None:
        """Send `columns`, one row of nothing, for the end: the viewer would go on showing the
        last value that it knows."""
        if len(self.end.frame):
            rr.send_columns(path, time_columns(self.end), columns, recording=self.stream)


def send_dancer(
    stream: rr.RecordingStream,
    dancer: Dancer,
    timeline: Timeline,
    flush: Callable[[], None] = lambda: None,
) -> None:
    """Everything of one dancer that changes over time.

    timeline: every processed frame. flush: waits until what was sent is on its way to the file; it
    is called every few thousand frames.
    """
    track = dancer.keypoints
    if not len(track):
        return
    end = _first_after(timeline, int(track.frame[-1]))
    stands, floor = standing(dancer.smoothed), floor_under(dancer.smoothed)
    filled_in = bool(track.interpolated.any())
    for rows in portions(len(track)):
        part = dancer_rows(dancer, rows)
        is_last = rows.stop == len(track)
        to = _Rows(stream, part.timeline, end if is_last else timeline_rows(end, slice(0)))
        _send_frames(to, part, Ground(stands[rows], floor), filled_in=filled_in)
        flush()
    _send_curves(_Rows(stream, track.timeline, end), dancer, flush)


def _send_frames(rows: _Rows, dancer: Dancer, ground: Ground, *, filled_in: bool) -> None:
    """What is seen of the dancer in the picture and in the world, in these frames."""
    person = dancer.person
    _send_keypoints(rows, dancer.keypoints, filled_in=filled_in)
    _send_boxes(rows, dancer.keypoints)
    _send_projected(rows, dancer)
    _send_joints(rows, joints_path(person), known_joints(dancer.smoothed))
    send_columns_of(
        dancer,
        ground,
        lambda part, columns: rows.send_all(f"{dancer_path(person)}/{part}", columns),
    )
    _send_joints(rows, raw_path(person), dancer.raw.world_xyz)
    _send_thin_bones(rows, raw_path(person), dancer.raw)


def _send_curves(rows: _Rows, dancer: Dancer, flush: Callable[[], None]) -> None:
    """Joint angles and what tells how far to trust a frame: one number a frame each."""
    base = plots_path(dancer.person)
    for joint, curve in angle_curves(dancer).items():
        rows.send(f"{base}/angle/{joint}", rr.Scalars.columns(scalars=curve.values))
        flush()
    for name, curve in trust_curves(dancer).items():
        rows.send(f"{base}/{name}", rr.Scalars.columns(scalars=curve.values))
        flush()


def _send_keypoints(rows: _Rows, track: Track2D, *, filled_in: bool) -> None:
    """Keypoints, every row with all of them: the viewer leaves out those that are NaN.

    Rows that were filled in across a gap, if there are any in the track, are an entity of their
    own, which looks otherwise.
    """
    seen = np.where(track.interpolated[:, None, None], np.nan, track.xy)
    _send_points(rows, keypoints_path(track.person), seen)
    if filled_in:
        filled = np.where(track.interpolated[:, None, None], track.xy, np.nan)
        _send_points(rows, filled_in_path(track.person), filled)


def _send_points(rows: _Rows, path: str, points: FloatArray) -> None:
    frames, keypoints = points.shape[:2]
    xy = points.reshape(-1, 2).astype(np.float32)
    rows.send(path, rr.Points2D.columns(positions=xy).partition([keypoints] * frames))
    gone = np.full((keypoints, 2), np.nan, np.float32)
    rows.clear(path, rr.Points2D.columns(positions=gone).partition([keypoints]))


def _send_projected(rows: _Rows, dancer: Dancer) -> None:
    """The 3D skeleton where the camera sees it."""
    drawn = drawn_over_picture(dancer)
    if drawn is None:
        return
    bones, known = drawn
    columns = rr.LineStrips2D.columns(strips=bones[known].astype(np.float32))
    rows.send_all(projected_path(dancer.person), columns.partition(known.sum(axis=1)))


def _send_boxes(rows: _Rows, track: Track2D) -> None:
    path = box_path(track.person)
    known = ~np.isnan(track.box).any(axis=1)
    low, high = np.split(track.box[known].astype(np.float32), 2, axis=1)
    boxes = rr.Boxes2D.columns(centers=(low + high) / 2, half_sizes=(high - low) / 2)
    rows.send(path, boxes.partition(known.astype(int)))
    none = np.zeros((0, 2), np.float32)
    rows.clear(path, rr.Boxes2D.columns(centers=none, half_sizes=none).partition([0]))


def _send_joints(rows: _Rows, path: str, places: FloatArray) -> None:
    """Joints (T, J, 3); those that are NaN are not drawn."""
    xyz = places.astype(np.float32)
    frames, joints = xyz.shape[:2]
    columns = rr.Points3D.columns(positions=xyz.reshape(-1, 3))
    rows.send(path, columns.partition([joints] * frames))
    gone = np.full((joints, 3), np.nan, np.float32)
    rows.clear(path, rr.Points3D.columns(positions=gone).partition([joints]))


def _send_thin_bones(rows: _Rows, path: str, track: Track3D) -> None:
    """The bones as lines, whose width can be set; those of an annotation context have one width.

    Where two skeletons coincide, the one for comparison must not hide the other.
    """
    bones = track.world_xyz[:, np.array(get(track.skeleton).bones)].astype(np.float32)
    known = ~np.isnan(bones).any(axis=(2, 3))
    columns = rr.LineStrips3D.columns(strips=bones[known])
    rows.send(path, columns.partition(known.sum(axis=1)))
    rows.clear(path, rr.LineStrips3D.columns(strips=bones[:0, 0]).partition([0]))
