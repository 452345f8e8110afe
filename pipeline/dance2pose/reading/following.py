"""People of picture after picture as tracks: by the file's names for them, or by the tracker."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.errors import DataError
from dance2pose.holes import usual_step
from dance2pose.poses import Boxes, FloatArray, Poses2D, Track2D
from dance2pose.reading.content import Float64Array, Picture, Sighting
from dance2pose.reading.numbering import Numbered
from dance2pose.tracking.choosing import choose
from dance2pose.tracking.gaps import fill_gaps
from dance2pose.tracking.settings import TrackingSettings
from dance2pose.tracking.tracker import Tracker

# Pictures that a file leaves out are rows without anyone, as if it had listed them; of a longer
# hole only the first, for nobody is followed or filled in across it.
_LONGEST_LISTED_S = 3.0
_MOST_ADDED = 1_000_000
# All tracks together: 2 GB of keypoints.
_MOST_KEYPOINTS = 150_000_000


@dataclass(frozen=True)
class VideoFacts:
    """What holds for all pictures of a file.

    frame_rate: pictures a second, None where each has its own time. size: (width, height) px.
    skeleton: of the keypoints. settings: how people are followed.
    """

    frame_rate: float | None
    size: tuple[int, int]
    skeleton: str
    settings: TrackingSettings


def follow(
    videos: Sequence[Numbered], facts: VideoFacts, person: str | int, *, one_person: bool
) -> tuple[list[Track2D], list[str]]:
    """The tracks of all videos, each video a shot of its own, and what is to be said."""
    tracks: list[Track2D] = []
    lengths: dict[int, int] = {}
    notes: list[str] = []
    for shot, video in enumerate(videos):
        listed, pictures = _with_absent_frames(video, facts.frame_rate)
        times = _times(listed, pictures, facts.frame_rate)
        if one_person or _are_identified(pictures):
            found, said = _by_identity(listed, times, pictures, facts)
            notes += [note for note in said if note not in notes]
        else:
            found = _by_tracker(listed, times, pictures, facts)
        lengths[shot] = len(listed)
        tracks += [replace(track, shot=shot) for track in found]
    return choose(tracks, person, frames_of_shot=lengths), notes


def surest(video: Numbered, facts: VideoFacts) -> Track2D:
    """Unrelated pictures: one row a picture, its surest person, NaN where there is none."""
    rows = {
        row: max(picture.people, key=lambda person: person.score)
        for row, picture in enumerate(video.pictures)
        if picture.people
    }
    times = np.arange(len(video.pictures), dtype=np.float64)
    return _track(np.array(video.frames, np.int64), times, rows, facts, threshold=0.0, fill_s=None)


def _with_absent_frames(
    video: Numbered, frame_rate: float | None
) -> tuple[list[int], list[Picture]]:
    """The frames and pictures with those that the file leaves out, as pictures without people."""
    step = round(usual_step(video.frames)) or 1
    longest = max(1, round(_LONGEST_LISTED_S * (frame_rate or 30.0) / step))
    jumps = np.diff(video.frames)
    if np.minimum(jumps // step, longest).sum() > _MOST_ADDED + len(video.frames):
        longest = 1
    frames, pictures = [video.frames[0]], [video.pictures[0]]
    for frame, picture in zip(video.frames[1:], video.pictures[1:], strict=True):
        absent = int((frame - frames[-1] - 1) // step)
        count = absent if absent <= longest else 1
        for _ in range(count):
            if frame - frames[-1] < 1.5 * step:
                break  # the next picture stands off the grid, close to here
            frames.append(frames[-1] + step)
            pictures.append(Picture([]))
        frames.append(frame)
        pictures.append(picture)
    return frames, pictures


def _times(
    frames: Sequence[int], pictures: Sequence[Picture], frame_rate: float | None
) -> Float64Array:
    """(T,) seconds. Times of the file come first; those of absent frames lie in between."""
    numbers = np.array(frames, np.float64)
    stated = [n for n, picture in enumerate(pictures) if picture.time_s is not None]
    if stated:
        known = [pictures[n].time_s or 0.0 for n in stated]
        if (np.diff(known) > 0).all():
            return np.interp(numbers, numbers[stated], known)
    assert frame_rate is not None
    return numbers / frame_rate


def _are_identified(pictures: Sequence[Picture]) -> bool:
    """Whether the file says of everyone who it is: names that differ within a picture, and more
    than one of them (tools that do not track write one and the same)."""
    names = set()
    for picture in pictures:
        here = [person.identity for person in picture.people]
        if None in here or len(set(here)) < len(here):
            return False
        names.update(here)
    return len(names) > 1


def _by_tracker(
    frames: Sequence[int], times: Float64Array, pictures: Sequence[Picture], facts: VideoFacts
) -> list[Track2D]:
    tracker = Tracker(facts.skeleton, facts.size, facts.settings)
    joints = len(skeletons.get(facts.skeleton))
    for frame, time_s, picture in zip(frames, times, pictures, strict=True):
        keypoints = np.array([p.keypoints for p in picture.people]).reshape(-1, joints, 3)
        boxes = np.array([_box(k) for k in keypoints]).reshape(-1, 4)
        tracker.update(
            frame,
            float(time_s),
            Boxes(boxes, np.array([p.score for p in picture.people])),
            Poses2D(keypoints[:, :, :2], keypoints[:, :, 2], facts.skeleton),
            cut=False,
        )
    return tracker.finish("all")


def _by_identity(
    frames: Sequence[int], times: Float64Array, pictures: Sequence[Picture], facts: VideoFacts
) -> tuple[list[Track2D], list[str]]:
    everyone: dict[str, dict[int, Sighting]] = {}
    for row, picture in enumerate(pictures):
        for person in picture.people:
            if _is_a_pose(person, facts.settings):
                everyone.setdefault(person.identity or "", {})[row] = person
    least = min(facts.settings.birth_sights, len(frames))
    kept = {who: rows for who, rows in everyone.items() if len(rows) >= least}
    notes = []
    if len(everyone) > 1:
        notes.append("who is who is taken from the file")
    if len(kept) < len(everyone):
        dropped = len(everyone) - len(kept)
        notes.append(f"{dropped} people seen in fewer than {least} frames are left out")
    joints = len(skeletons.get(facts.skeleton))
    if sum(max(rows) - min(rows) + 1 for rows in kept.values()) * joints > _MOST_KEYPOINTS:
        raise DataError(f"{len(kept)} people over {len(frames)} frames are too many to be followed")
    tracks = []
    for rows in kept.values():
        first, last = min(rows), max(rows)
        tracks.append(
            _track(
                np.array(frames[first : last + 1], np.int64),
                times[first : last + 1],
                {row - first: person for row, person in rows.items()},
                facts,
                threshold=facts.settings.min_confidence,
                fill_s=facts.settings.longest_gap_s,
            )
        )
    return tracks, notes


def _is_a_pose(person: Sighting, settings: TrackingSettings) -> bool:
    seen = person.keypoints[:, 2] >= settings.min_confidence
    return int(seen.sum()) >= min(settings.min_keypoints, len(seen))


def _track(
    frames: FloatArray,
    times: Float64Array,
    rows: dict[int, Sighting],
    facts: VideoFacts,
    *,
    threshold: float,
    fill_s: float | None,
) -> Track2D:
    """One person's rows as a track; short gaps are filled as the tracker fills them."""
    length, joints = len(frames), len(skeletons.get(facts.skeleton))
    keypoints = np.full((length, joints, 3), np.nan)
    keypoints[:, :, 2] = 0
    for row, person in rows.items():
        keypoints[row] = person.keypoints
    keypoints[keypoints[:, :, 2] < threshold] = (np.nan, np.nan, 0)
    box = np.array([_box(k) for k in keypoints], np.float32)
    xy, interpolated = keypoints[:, :, :2].astype(np.float32), np.zeros(length, np.bool_)
    if fill_s is not None:
        xy, filled = fill_gaps(xy, times, longest_s=fill_s)
        keypoints[filled, 2] = threshold / 2
        unseen = np.array([row not in rows for row in range(length)])
        interpolated = unseen & filled.any(axis=1)
    track = Track2D.from_arrays(
        xy,
        confidence=keypoints[:, :, 2],
        time_s=times,
        frame=frames,
        skeleton=facts.skeleton,
        image_size=facts.size,
    )
    return replace(track, box=box, interpolated=interpolated)


def _box(keypoints: Float64Array) -> Float64Array:
    """xyxy around the keypoints that are there; NaN where none is."""
    seen = keypoints[np.isfinite(keypoints[:, 0]), :2]
    if not len(seen):
        return np.full(4, np.nan)
    return np.concatenate([seen.min(axis=0), seen.max(axis=0)])
