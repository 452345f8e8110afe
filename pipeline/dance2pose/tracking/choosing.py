"""Who of the people found is a dancer: prominence, numbering, and the choice of `--person`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from dance2pose.errors import UsageError
from dance2pose.options import parse_person
from dance2pose.poses import BoolArray, Track2D
from dance2pose.tracking.matching import box_sizes

# By default everyone at least this prominent, measured by the most prominent of the shot, is a
# dancer; the others are passers-by, spectators or spurious detections.
COMPARABLE = 0.3


def choose(
    tracks: Sequence[Track2D], person: str | int, *, frames_of_shot: Mapping[int, int]
) -> list[Track2D]:
    """Number the tracks and pick those asked for.

    All tracks are numbered from 1 by falling prominence, then by order of appearance, whatever
    is asked for, so that a number means the same person in every run. person: "auto" keeps, in
    every shot, the most prominent and all of comparable prominence; "all" keeps everyone;
    "largest" and "central" keep one person a shot; a number keeps that one. Returns the tracks
    by number; none where there are none.

    Raises UsageError for a number that nobody has, or a word that is not one of `options.PERSONS`.
    """
    wanted = parse_person(person)
    weighed = [(prominence(t, frames_of_shot[t.shot]), t) for t in tracks]
    weighed.sort(key=lambda pair: (-pair[0], pair[1].shot, int(pair[1].frame[0])))
    weighed = [(p, replace(t, person=n)) for n, (p, t) in enumerate(weighed, start=1)]
    if not weighed or wanted == "all":
        return [track for _, track in weighed]
    if isinstance(wanted, int):
        if wanted > len(weighed):
            raise UsageError(
                f"person {wanted} was asked for, but {len(weighed)} were found;"
                " person all shows them all"
            )
        return [weighed[wanted - 1][1]]
    if wanted == "central" and not all(weighed[0][1].image_size):
        raise UsageError("who is central cannot be told where the size of the picture is unknown")
    chosen: list[Track2D] = []
    for shot in {track.shot for _, track in weighed}:
        of_shot = [pair for pair in weighed if pair[1].shot == shot]
        if wanted == "auto":
            chosen += [track for p, track in of_shot if p >= COMPARABLE * of_shot[0][0]]
        elif wanted == "largest":
            chosen.append(max((track for _, track in of_shot), key=mean_size))
        else:
            chosen.append(max((track for _, track in of_shot), key=centrality))
    return sorted(chosen, key=lambda track: track.person)


def prominence(track: Track2D, frames_of_shot: int) -> float:
    """How much a shot is about a person: size x duration x centrality x confidence.

    Each is a share (0..1): of the picture, of the frames of the shot, see `centrality`, of sure
    keypoints.
    """
    share = min(1.0, seen(track).sum() / max(frames_of_shot, 1))
    return float(mean_size(track) * share * centrality(track) * mean_confidence(track))


def seen(track: Track2D) -> BoolArray:
    """(T,) where the person was detected."""
    return np.isfinite(track.box[:, 0])


def mean_size(track: Track2D) -> float:
    """Mean root of the box area over that of the picture (px where its size is unknown)."""
    picture = np.sqrt(float(np.prod(track.image_size))) or 1.0
    return float(box_sizes(track.box[seen(track)]).mean() / picture)


def centrality(track: Track2D) -> float:
    """1 in the middle of the picture, falling to a half at its corners; the mean over time.

    Everyone is as central as any other where the size of the picture is unknown.
    """
    half = np.array(track.image_size) / 2
    if not half.all():
        return 1.0
    boxes = track.box[seen(track)]
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2
    away = np.linalg.norm(centres - half, axis=1) / np.linalg.norm(half)
    return float(1 - 0.5 * np.clip(away, 0, 1).mean())


def mean_confidence(track: Track2D) -> float:
    """Mean confidence of all keypoints where the person was detected, missing ones as 0."""
    return float(np.clip(track.confidence[seen(track)], 0, 1).mean())
