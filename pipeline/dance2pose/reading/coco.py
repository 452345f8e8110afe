"""COCO keypoint annotations, and results lists as COCO and AlphaPose write them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dance2pose.errors import DataError
from dance2pose.reading.content import Content, Float64Array, Picture, Sighting, box_from, points
from dance2pose.reading.json_files import (
    FRAME_KEYS,
    entry,
    first,
    number,
    require,
    size_of,
    whole_number,
)

_IDENTITY = ("track_id", "person_id", "idx", "instance_id")
_PERSON = 1  # COCO's own number of the category


def is_annotations(content: Any) -> bool:
    return isinstance(content, dict) and "annotations" in content


def read_annotations(path: Path, content: Any) -> Content:
    """`images` and their `annotations`; those of other categories than person are left out."""
    images = content.get("images", [])
    entries = entry(path, content, "annotations", list, "")
    if not isinstance(images, list):
        raise DataError(f"{path}: images is of type {type(images).__name__}")
    found = Content("COCO annotations", [])
    named = _NamedPictures()
    for n, image in enumerate(images):
        require(path, image, ("id",), f"images[{n}]")
        named.add(_picture(image), image["id"])
    categories = content.get("categories")
    kinds = _person_categories(categories)
    found.joints = _joint_names(categories, kinds)
    flags = _are_flags(entries)
    left_out = crowds = 0
    for n, one in enumerate(entries):
        inside = f"annotations[{n}]"
        if isinstance(one, dict) and "category_id" in one and not _is_person(one, kinds):
            left_out += 1
        elif isinstance(one, dict) and one.get("iscrowd") == 1:
            crowds += 1
        else:
            _add(path, one, inside, named, flags=flags, corner_and_size=True)
    found.pictures = named.pictures
    _say(found, left_out, crowds, named.empty)
    return found


def is_results(content: Any) -> bool:
    """A list of people, each with the picture it was found in."""
    if not isinstance(content, list):
        return False
    one = next((one for one in content if one), None)
    return one is None or (isinstance(one, dict) and "image_id" in one and "keypoints" in one)


def read_results(path: Path, content: Any) -> Content:
    """A list of people with `image_id` and `keypoints`; what names no person is left out."""
    named = _NamedPictures()
    kinds = {one["category_id"] for one in content if _has_category(one)}
    person = _PERSON if _PERSON in kinds else None
    left_out = 0
    for n, one in enumerate(content):
        if one is None or one == {}:
            named.empty += 1
        elif person is not None and _has_category(one) and one["category_id"] != person:
            left_out += 1
        else:
            _add(path, one, f"[{n}]", named, flags=False, corner_and_size=True)
    found = Content("keypoint results (COCO, AlphaPose)", named.pictures)
    _say(found, left_out, 0, named.empty)
    return found


class _NamedPictures:
    """The pictures by what the entries call them, in the order of the file."""

    def __init__(self) -> None:
        self.pictures: list[Picture] = []
        self.empty = 0
        self._by_name: dict[str, Picture] = {}

    def add(self, picture: Picture, name: Any) -> Picture:
        return self._by_name.setdefault(str(name), self._kept(picture, str(name)))

    def _kept(self, picture: Picture, name: str) -> Picture:
        if name not in self._by_name:
            self.pictures.append(picture)
        return picture

    def of(self, one: dict[str, Any]) -> Picture:
        name = str(one["image_id"])
        if name in self._by_name:
            return self._by_name[name]
        key = whole_number(one["image_id"])
        frame = whole_number(first(one, *FRAME_KEYS))
        return self.add(
            Picture([], name=None if key is not None else name, key=key, frame=frame), name
        )


def _picture(image: dict[str, Any]) -> Picture:
    video = first(image, "video_id", "video", "video_name", "vid_id")
    name = first(image, "file_name", "image_name")
    return Picture(
        [],
        name=name if isinstance(name, str) else None,
        frame=whole_number(first(image, *FRAME_KEYS)),
        key=image["id"] if isinstance(image["id"], (int, str)) else None,
        video="" if video is None else str(video),
        size=size_of(image),
    )


def _add(
    path: Path, one: Any, inside: str, named: _NamedPictures, *, flags: bool, corner_and_size: bool
) -> None:
    require(path, one, ("image_id", "keypoints"), inside)
    if not isinstance(one["image_id"], (int, str, float)):
        raise DataError(f"{path}: {inside}.image_id is of type {type(one['image_id']).__name__}")
    numbers = entry(path, one, "keypoints", list, inside)
    where = f"{path}: {inside}.keypoints"
    picture = named.of(one)
    if not numbers:
        named.empty += 1
        return
    keypoints = points(numbers, where, first(one, "keypoint_scores", "keypoints_scores"))
    if flags:
        if not keypoints[:, 2].any():  # every keypoint is flagged absent
            named.empty += 1
            return
        keypoints[:, 2] = keypoints[:, 2] > 0
    picture.people.append(
        Sighting(
            keypoints,
            _score(path, one, inside, keypoints),
            where,
            box=box_from(first(one, "bbox", "box"), corner_and_size=corner_and_size),
            identity=_identity(one),
        )
    )


def _score(path: Path, one: dict[str, Any], inside: str, keypoints: Float64Array) -> float:
    value = one.get("score")
    if value is None:
        return float(np.nanmean(keypoints[:, 2])) if np.isfinite(keypoints[:, 2]).any() else 0.0
    found = number(value[0] if isinstance(value, list) and value else value)
    if found is None:
        raise DataError(f"{path}: {inside}.score is {value!r}, expected a number")
    return found


def _identity(one: dict[str, Any]) -> str | None:
    value = first(one, *_IDENTITY)
    while isinstance(value, list):  # AlphaPose nests it
        value = value[0] if value else None
    return None if value is None else str(value)


def _are_flags(entries: list[Any]) -> bool:
    """Annotations hold flags (0 absent, 1 hidden, 2 visible), but some tools put scores there."""
    for one in entries[:1000]:
        numbers = one.get("keypoints") if isinstance(one, dict) else None
        if isinstance(numbers, list) and any(v not in (0, 1, 2, None) for v in numbers[2::3]):
            return False
    return True


def _has_category(one: Any) -> bool:
    return isinstance(one, dict) and isinstance(one.get("category_id"), int)


def _person_categories(categories: Any) -> set[Any] | None:
    """The ids of people: categories called person, else those with keypoints, else any."""
    if not isinstance(categories, list) or not categories:
        return None
    known = [c for c in categories if isinstance(c, dict) and "id" in c]
    people = [c for c in known if str(c.get("name", "")).lower() in ("person", "human", "people")]
    chosen = people or [c for c in known if c.get("keypoints")] or known
    return {c["id"] for c in chosen if isinstance(c["id"], (int, str))}


def _is_person(one: dict[str, Any], kinds: set[Any] | None) -> bool:
    kind = one["category_id"]
    if kinds is None:
        return True
    return isinstance(kind, (int, str)) and kind in kinds


def _joint_names(categories: Any, kinds: set[Any] | None) -> tuple[str, ...] | None:
    """Names of the keypoints as the category of people lists them, where it lists any."""
    if kinds is None or not isinstance(categories, list):
        return None
    lists = [c.get("keypoints") for c in categories if isinstance(c, dict) and c.get("id") in kinds]
    names = lists[0] if lists else None
    if isinstance(names, list) and names and all(isinstance(name, str) for name in names):
        return tuple(names)
    return None


def _say(found: Content, left_out: int, crowds: int, empty: int) -> None:
    if left_out:
        found.notes.append(f"{left_out} entries of other categories than person are left out")
    if crowds:
        found.notes.append(f"{crowds} entries of crowds are left out")
    if empty:
        found.notes.append(f"{empty} people without keypoints are not there")
