"""2D keypoints of any tool as tracks of dancers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import read_track
from dance2pose.npz_files import read_arrays
from dance2pose.options import parse_person
from dance2pose.poses import Track2D
from dance2pose.reading.content import Content, Picture
from dance2pose.reading.following import VideoFacts, follow, surest
from dance2pose.reading.layouts import in_layout
from dance2pose.reading.measurements import Size, measured
from dance2pose.reading.numbering import Numbered, numbered
from dance2pose.reading.registry import read_content
from dance2pose.tracking.settings import TrackingSettings

MIN_CONFIDENCE = TrackingSettings().min_confidence
# What is lost where nobody says the size.
_NO_SIZE = (
    "the size of the picture is not known, so that only poses and no path through the room are"
    " found"
)
# Above this share of keypoints below the threshold, the threshold is worth a word.
_MANY_UNSURE = 0.3


@dataclass(frozen=True)
class ReadTracks:
    """The dancers of a file, and in words what was read as what and what was left out."""

    tracks: list[Track2D]
    notes: tuple[str, ...]


def read_tracks(
    path: Path,
    *,
    frame_rate: float | None = None,
    skeleton: str | None = None,
    image_size: Size | None = None,
    person: str | int = "auto",
    independent: bool = False,
    min_confidence: float = MIN_CONFIDENCE,
) -> ReadTracks:
    """The dancers in a file or folder of 2D keypoints of any tool.

    path: a track .npz (which says everything itself), or a file or folder in one of
    `registry.FORMATS`. frame_rate: of the video, for files without times; time is then the frame
    number over it. skeleton: where neither names nor the number of keypoints tell it. image_size:
    (width, height) px where the file does not tell it; (0, 0) in the result stands for unknown.
    person: as in `choosing.choose`. independent: the pictures are unrelated; then nothing is
    tracked, and the one track holds the surest person of each picture, at one second a picture.
    min_confidence: keypoints below it count as not seen.

    Keypoints that were not seen are NaN; a short hole in time is filled and marked, nothing is
    followed across a long one (`tracking.settings.TrackingSettings`).

    Raises DataError naming the file and what is wrong with it, UsageError for missing or
    impossible settings.

    >>> found = read_tracks(Path("alphapose-results.json"), frame_rate=30)  # doctest: +SKIP
    >>> found.notes  # doctest: +SKIP
    ('keypoint results (COCO, AlphaPose): 545 pictures', '17 keypoints read as coco17 ...')
    """
    path = Path(path)
    _check_settings(frame_rate, skeleton, image_size, person, min_confidence)
    if path.suffix.lower() == ".npz" and not path.is_dir() and _is_track(path):
        return _read_npz(path, frame_rate, skeleton, image_size, person)
    content = read_content(path)
    if not content.pictures:
        raise DataError(f"{path}: holds no picture and no person")
    notes = [f"{content.form}: {len(content.pictures)} pictures", *content.notes]
    where = str(path)
    size, said = _size(content, where, image_size, independent=independent)
    content.pictures, more = measured(content, where, size)
    notes += said + more
    name, pictures, more = in_layout(content.pictures, content, where, skeleton)
    notes += more
    videos, more = numbered(pictures, where, unrelated=independent)
    notes += more
    settings = TrackingSettings(min_confidence=min_confidence)
    facts = VideoFacts(frame_rate, size or (0, 0), name, settings)
    if independent:
        return ReadTracks([surest(videos[0], facts)], tuple(notes))
    if frame_rate is None and not all(_has_times(video) for video in videos):
        raise UsageError(
            f"{path}: holds no times; give the frame rate of the video it was made from"
            " (--frame-rate)"
        )
    if any(_runs_backwards(video) for video in videos):
        notes.append("times in the file do not rise with the frames and are not used")
    notes += _unsure(pictures, min_confidence)
    tracks, more = follow(videos, facts, person, one_person=content.one_person)
    return ReadTracks(tracks, tuple(notes + more))


def _check_settings(
    frame_rate: float | None,
    skeleton: str | None,
    image_size: Size | None,
    person: str | int,
    min_confidence: float,
) -> None:
    parse_person(person)
    if skeleton is not None:
        skeletons.get(skeleton)
    if frame_rate is not None and not (np.isfinite(frame_rate) and frame_rate > 0):
        raise UsageError(f"a frame rate of {frame_rate} is not possible; give a positive number")
    if image_size is not None and min(image_size) <= 0:
        raise UsageError(f"an image size of {image_size[0]} x {image_size[1]} is not possible")
    if not 0 <= min_confidence <= 1:
        raise UsageError(f"a least confidence of {min_confidence} is not possible; give 0 to 1")


def _is_track(path: Path) -> bool:
    arrays = read_arrays(path)
    return not {"keypoints", "scores"} <= set(arrays) or "xy" in arrays


def _read_npz(
    path: Path,
    frame_rate: float | None,
    skeleton: str | None,
    image_size: Size | None,
    person: str | int,
) -> ReadTracks:
    given = {
        "--frame-rate": frame_rate is not None,
        "--skeleton": skeleton is not None,
        "--image-size": image_size is not None,
    }
    named = [option for option, there in given.items() if there]
    if named:
        raise UsageError(
            f"{path}: a track .npz says itself what {' and '.join(named)} would; leave"
            f" {'it' if len(named) == 1 else 'them'} out"
        )
    track = read_track(path)
    if isinstance(parse_person(person), int) and parse_person(person) != track.person:
        raise UsageError(f"{path}: holds person {track.person} alone, {person} was asked for")
    return ReadTracks([track], () if min(track.image_size) > 0 else (_NO_SIZE,))


def _size(
    content: Content, where: str, given: Size | None, *, independent: bool
) -> tuple[Size | None, list[str]]:
    """The size of all pictures, None where it is not known or every picture has its own."""
    sizes = {picture.size for picture in content.pictures if picture.size is not None}
    shown = " and ".join(f"{w} x {h}" for w, h in sorted(sizes)[:3])
    if given is not None:
        other = bool(sizes - {given})
        told = f"the file says {shown}, {given[0]} x {given[1]} was given and holds"
        return given, [told] if other else []
    if len(sizes) == 1:
        return sizes.pop(), []
    if sizes and not independent:
        raise DataError(
            f"{where}: its pictures have different sizes ({shown}), which pictures of one video do"
            " not; split it by video, or give --image-size"
        )
    if independent:
        return None, []
    return None, [f"{_NO_SIZE}; --image-size WIDTH HEIGHT finds it"]


def _has_times(video: Numbered) -> bool:
    """Whether the file says when each picture was; times that run backwards are none."""
    return all(p.time_s is not None for p in video.pictures) and not _runs_backwards(video)


def _runs_backwards(video: Numbered) -> bool:
    known = [picture.time_s for picture in video.pictures if picture.time_s is not None]
    return not (np.diff(known) > 0).all()


def _unsure(pictures: list[Picture], least: float) -> list[str]:
    parts = [person.keypoints[:, 2] for picture in pictures for person in picture.people]
    scores = np.concatenate(parts) if parts else np.empty(0)
    unsure = (scores > 0) & (scores < least)
    share = unsure.sum() / max((scores > 0).sum(), 1)
    if share < _MANY_UNSURE:
        return []
    return [f"{share:.0%} of the keypoints are less sure than {least:g} and count as not seen"]
