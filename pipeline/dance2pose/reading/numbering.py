"""Which frame of which video a picture is: numbers that are names.

A frame number that the file states comes first, then the number in the picture's file name, then
the entry's id, then its place. In a name the number is the last group of digits that differs
from picture to picture, whatever stands behind it (`dance.mp4_12`, `cam2.00031`,
`frame_00031 (1).jpg`, `take2_000012_keypoints.json`); what stands before it names the video.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from dance2pose.errors import DataError
from dance2pose.reading.content import Picture
from dance2pose.reading.json_files import whole_number

# What programs append to the name of a picture; never digits, which may be the number.
_SUFFIX = re.compile(
    r"(\.(json|jpe?g|png|bmp|tiff?|webp|gif|exr|dpx)|_(keypoints|rendered|pose|landmarks))$",
    re.IGNORECASE,
)
_COPY = re.compile(r"\s*\(\d+\)$|\s+-\s+copy$", re.IGNORECASE)
_DIGITS = re.compile(r"\d{1,18}")
# A century of frames is less; such numbers are dates or hashes.
_NO_FRAME = 10**12


@dataclass(frozen=True)
class Numbered:
    """The pictures of one video by rising frame number."""

    video: str
    frames: list[int]
    pictures: list[Picture]


def numbered(
    pictures: Sequence[Picture], where: str, *, unrelated: bool = False
) -> tuple[list[Numbered], list[str]]:
    """The pictures by video and frame number, and what is to be said about it.

    where: the file, for errors. unrelated: the pictures are not of a video, so that numbers are
    only an order. DataError where two pictures of a video have one number.
    """
    numbering, notes = _videos_and_numbers(pictures)
    groups: dict[str, list[tuple[int, int]]] = {}
    for row, (video, number) in enumerate(numbering):
        groups.setdefault("" if unrelated else video, []).append((number, row))
    found = []
    for video, rows in groups.items():
        rows.sort()
        numbers = [number for number, _ in rows]
        if unrelated and len(set(numbers)) < len(numbers):
            numbers = list(range(len(rows)))
        _check_once(rows, numbers, pictures, where)
        found.append(Numbered(video, numbers, [pictures[row] for _, row in rows]))
    if len(found) > 1:
        shown = ", ".join(repr(group.video or "?") for group in found[:5])
        more = ", …" if len(found) > 5 else ""
        notes.append(f"{len(found)} videos are in it, each followed by itself: {shown}{more}")
    return found, notes


def _check_once(
    rows: list[tuple[int, int]], numbers: list[int], pictures: Sequence[Picture], where: str
) -> None:
    for n in range(1, len(numbers)):
        if numbers[n] == numbers[n - 1]:
            one, other = (_called(pictures[rows[k][1]]) for k in (n - 1, n))
            raise DataError(
                f"{where}: two pictures have the number {numbers[n]}: {one} and {other}"
            )


def _called(picture: Picture) -> str:
    named = [picture.name, picture.key, picture.frame]
    return next((repr(x) for x in named if x is not None), "one without a name")


def _videos_and_numbers(pictures: Sequence[Picture]) -> tuple[list[tuple[str, int]], list[str]]:
    """Video and number of every picture, from the first of the sources that all of them have."""
    names = [picture.name for picture in pictures]
    named = _by_names(names)
    videos = [picture.video for picture in pictures]
    if named is not None and not any(videos):
        videos = [video for video, _ in named]
    sources = {
        "the frame number stated": _all([picture.frame for picture in pictures]),
        "the file name": None if named is None else _all([number for _, number in named]),
        "the id": _all([whole_number(picture.key) for picture in pictures]),
        "the place in the file": list(range(len(pictures))),
    }
    there = [
        (source, list(zip(videos, numbers, strict=True)))
        for source, numbers in sources.items()
        if numbers is not None
    ]
    source, numbering = there[0]
    others = [other for other, them in there[1:-1] if _order(them) != _order(numbering)]
    notes = [
        f"{source} and {other} put the pictures in another order; {source} holds"
        for other in others
    ]
    if named is None and None not in names and source in ("the id", "the place in the file"):
        notes.append(f"the names of the pictures hold no frame numbers; {source} holds")
    return numbering, notes


def _all(numbers: Sequence[int | None]) -> list[int] | None:
    """The numbers, where every picture has one that can be a frame's."""
    known = [n for n in numbers if n is not None and abs(n) < _NO_FRAME]
    return known if len(known) == len(numbers) else None


def _order(numbering: list[tuple[str, int]]) -> list[int]:
    return sorted(range(len(numbering)), key=lambda row: numbering[row])


def _by_names(names: Sequence[str | None]) -> list[tuple[str, int]] | None:
    """Video and number from the names, None where they do not have them."""
    known = [name for name in names if name is not None]
    if not known or len(known) < len(names):
        return None
    readings = [_read_names(known, copies=copies) for copies in (False, True)]
    usable = [reading for reading in readings if reading is not None and _is_sequence(reading)]
    # "(1)" is a copy's mark, unless only it tells the pictures from each other.
    return min(usable, key=lambda r: len(r) - len(set(r)), default=None)


def _is_sequence(numbering: list[tuple[str, int]]) -> bool:
    """Names tell an order where most pictures share their video with others."""
    videos = Counter(video for video, _ in numbering)
    return len(numbering) == 1 or 2 * len(videos) <= len(numbering)


def _read_names(names: list[str], *, copies: bool) -> list[tuple[str, int]] | None:
    """copies: keep "(1)" at the end of a name as a number of its own."""
    stems = [_stem(name, copies=copies) for name in names]
    varying: dict[tuple[str, ...], list[set[str]]] = {}
    for stem in stems:
        groups = _DIGITS.findall(stem)
        seen = varying.setdefault(tuple(_DIGITS.split(stem)), [set() for _ in groups])
        for values, group in zip(seen, groups, strict=True):
            values.add(group)
    numbering = []
    for stem in stems:
        text = _DIGITS.split(stem)
        spans = [match.span() for match in _DIGITS.finditer(stem)]
        if not spans:
            return None
        differ = [n for n, values in enumerate(varying[tuple(text)]) if len(values) > 1]
        start, stop = spans[differ[-1] if differ else -1]
        numbering.append((stem[:start].strip(" ._-") + _behind(stem[stop:]), int(stem[start:stop])))
    return numbering


def _behind(rest: str) -> str:
    return f"…{rest}" if rest.strip(" ._-") else ""


def _stem(name: str, *, copies: bool) -> str:
    """The name without what is no part of it: folders' separators unified, suffixes off."""
    stem = name.replace("\\", "/").strip()
    while True:
        shorter = _SUFFIX.sub("", stem)
        if not copies and _DIGITS.search(_COPY.sub("", shorter)):
            shorter = _COPY.sub("", shorter)
        if shorter == stem:
            return stem
        stem = shorter
