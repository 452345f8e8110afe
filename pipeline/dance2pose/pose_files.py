"""2D keypoints of other programs, as tracks: OpenPose JSON folders and COCO keypoint JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose import skeleton as skeletons
from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import read_track
from dance2pose.poses import Boxes, Poses2D, Timeline, Track2D
from dance2pose.tracking.tracker import Tracker

_LARGEST_JSON = 512 * 1024**2

# The skeleton of files that give none: the one that is published with so many keypoints.
_BY_COUNT = {
    len(skeletons.get(name)): name
    for name in ("coco17", "coco23", "body25", "halpe26", "mpii16", "blazepose33")
}


@dataclass(frozen=True)
class _Sighting:
    """One person of one picture: (J, 3) x, y in px and confidence; where it came from."""

    keypoints: npt.NDArray[np.float64]
    score: float
    where: str


@dataclass(frozen=True)
class _Picture:
    index: int
    people: list[_Sighting]


def read_tracks(
    path: Path,
    *,
    frame_rate: float | None = None,
    skeleton: str | None = None,
    image_size: tuple[int, int] | None = None,
    person: str | int = "auto",
    independent: bool = False,
) -> list[Track2D]:
    """The dancers in a file or folder of 2D keypoints.

    path: a track .npz (which tells everything itself), a folder of OpenPose
    `*_keypoints.json`, or a COCO .json (keypoint results, or annotations with their images).
    frame_rate: of the pictures, since those JSON files hold no times; time is then the number
    in the picture's name (or its `image_id`) over the frame rate. skeleton: where the number of
    keypoints does not tell it. image_size: (width, height) px where the file does not tell it;
    (0, 0) in the result stands for unknown. person: as in `choosing.choose`. independent: the
    pictures are unrelated; then nothing is tracked, and the one track holds the surest person of
    each picture, at one second a picture.

    Raises DataError naming the file and key that is wrong, UsageError for missing settings.
    """
    if path.suffix.lower() == ".npz":
        return [read_track(path)]
    if frame_rate is not None and not (np.isfinite(frame_rate) and frame_rate > 0):
        raise UsageError(f"a frame rate of {frame_rate} is not possible; give a positive number")
    if frame_rate is None and not independent:
        raise UsageError(
            f"{path}: holds no times; give the frame rate of the video it was made from"
        )
    if path.is_dir():
        pictures, found_size = _read_openpose(path), None
    elif path.suffix.lower() == ".json":
        pictures, found_size = _read_coco(path)
    elif not path.exists():
        raise DataError(f"{path}: no such file or folder")
    else:
        raise DataError(
            f"{path}: not a form of 2D keypoints that is known; expected a track .npz,"
            " a folder of OpenPose JSON files, or a COCO .json"
        )
    name = _skeleton(path, pictures, skeleton)
    size = image_size or found_size or (0, 0)
    if independent:
        return [_surest(pictures, name, size)]
    assert frame_rate is not None
    return _follow(pictures, name, size, frame_rate, person)


def _read_openpose(folder: Path) -> list[_Picture]:
    files = sorted(folder.glob("*.json"))
    if not files:
        raise DataError(f"{folder}: holds no .json file; expected OpenPose's *_keypoints.json")
    pictures = []
    for place, file in enumerate(files):
        people = _entry(file, _load_json(file), "people", list)
        sightings = []
        for i, entry in enumerate(people):
            where = f"{file}: people[{i}].pose_keypoints_2d"
            numbers = _entry(file, entry, "pose_keypoints_2d", list, inside=f"people[{i}]")
            if numbers:  # a person of whom only a hand or face was found has none
                keypoints = _triplets(numbers, where)
                sightings.append(_Sighting(keypoints, float(keypoints[:, 2].mean()), where))
        pictures.append(_Picture(_number_in(file.stem, place), sightings))
    return _in_order(pictures, folder)


def _read_coco(path: Path) -> tuple[list[_Picture], tuple[int, int] | None]:
    content = _load_json(path)
    if isinstance(content, dict):
        entries = _entry(path, content, "annotations", list)
        images = _entry(path, content, "images", list)
    elif isinstance(content, list):
        entries, images = content, []
    else:
        raise DataError(f"{path}: expected a list of keypoint results, or COCO annotations")
    places: dict[str, list[_Sighting]] = {
        str(_entry(path, image, "id", (int, str), inside=f"images[{i}]")): []
        for i, image in enumerate(images)
    }
    flags = isinstance(content, dict)  # annotations: 0 absent, 1 hidden, 2 visible
    for i, entry in enumerate(entries):
        inside = f"annotations[{i}]" if flags else f"[{i}]"
        image = str(_entry(path, entry, "image_id", (int, str), inside=inside))
        where = f"{path}: {inside}.keypoints"
        keypoints = _triplets(_entry(path, entry, "keypoints", list, inside=inside), where)
        if flags:
            keypoints[:, 2] = keypoints[:, 2] > 0
        score = entry.get("score", keypoints[:, 2].mean())
        if not isinstance(score, (int, float)):
            raise DataError(f"{path}: {inside}.score is {score!r}, expected a number")
        places.setdefault(image, []).append(_Sighting(keypoints, float(score), where))
    pictures = [
        _Picture(_number_in(Path(name).stem, place), people)
        for place, (name, people) in enumerate(places.items())
    ]
    return _in_order(pictures, path), _common_size(images)


def _common_size(images: Sequence[Any]) -> tuple[int, int] | None:
    """Width and height where all images have the same."""
    sizes = {(image.get("width"), image.get("height")) for image in images}
    if len(sizes) != 1:
        return None
    width, height = sizes.pop()
    return (width, height) if isinstance(width, int) and isinstance(height, int) else None


def _load_json(path: Path) -> Any:
    try:
        size = path.stat().st_size
        if size > _LARGEST_JSON:
            raise DataError(f"{path}: {size / 1e9:.1f} GB are too much for one JSON file; split it")
        return json.loads(path.read_bytes())
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error
    except (ValueError, RecursionError) as error:
        raise DataError(f"{path}: not a JSON file: {error}") from error


def _entry(
    path: Path, container: Any, key: str, kind: type | tuple[type, ...], *, inside: str = ""
) -> Any:
    """container[key], or DataError unless it is there and of the kind."""
    name = f"{inside}.{key}" if inside else key
    if not isinstance(container, dict) or key not in container:
        raise DataError(f"{path}: has no {name}")
    value = container[key]
    if not isinstance(value, kind):
        raise DataError(f"{path}: {name} is of type {type(value).__name__}")
    return value


def _triplets(numbers: list[Any], where: str) -> npt.NDArray[np.float64]:
    """Flat x, y, confidence as (J, 3); x and y NaN where the confidence is 0 or a value is not."""
    if len(numbers) % 3 or not numbers:
        raise DataError(f"{where} has {len(numbers)} numbers, expected x, y, confidence for each")
    try:
        keypoints = np.array(numbers, dtype=np.float64).reshape(-1, 3)
    except (ValueError, TypeError, OverflowError) as error:
        raise DataError(f"{where} does not hold plain numbers: {error}") from error
    missing = ~np.isfinite(keypoints).all(axis=1) | (keypoints[:, 2] <= 0)
    keypoints[missing] = (np.nan, np.nan, 0)
    return keypoints


def _number_in(stem: str, place: int) -> int:
    """The last number in a name, or its place where it has none."""
    numbers = re.findall(r"\d{1,18}", stem.removesuffix("_keypoints"))
    return int(numbers[-1]) if numbers else place


def _in_order(pictures: list[_Picture], path: Path) -> list[_Picture]:
    pictures = sorted(pictures, key=lambda picture: picture.index)
    for one, other in pairwise(pictures):
        if one.index == other.index:
            raise DataError(f"{path}: two pictures have the number {one.index}")
    return pictures


def _skeleton(path: Path, pictures: list[_Picture], named: str | None) -> str:
    """The skeleton named, or told by the number of keypoints; all people must fit it."""
    people = [person for picture in pictures for person in picture.people]
    if not people:
        if named is None:
            raise DataError(f"{path}: holds no person in any of {len(pictures)} pictures")
        return skeletons.get(named).name
    count = len(people[0].keypoints)
    name = named or _BY_COUNT.get(count)
    if name is None:
        known = ", ".join(f"{count} ({name})" for count, name in sorted(_BY_COUNT.items()))
        raise DataError(f"{people[0].where} has {count} keypoints; known numbers: {known}")
    expected = len(skeletons.get(name))
    for person in people:
        if len(person.keypoints) != expected:
            raise DataError(
                f"{person.where} has {len(person.keypoints)} keypoints, expected {expected}"
                f" ({name})"
            )
    return name


def _box(keypoints: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """xyxy around the keypoints that are there; NaN where none is."""
    seen = keypoints[np.isfinite(keypoints[:, 0]), :2]
    if not len(seen):
        return np.full(4, np.nan)
    return np.concatenate([seen.min(axis=0), seen.max(axis=0)])


def _follow(
    pictures: list[_Picture],
    skeleton: str,
    image_size: tuple[int, int],
    frame_rate: float,
    person: str | int,
) -> list[Track2D]:
    """These files do not say who is who: the tracker does."""
    tracker = Tracker(skeleton, image_size)
    joints = len(skeletons.get(skeleton))
    for picture in pictures:
        keypoints = np.array([p.keypoints for p in picture.people]).reshape(-1, joints, 3)
        boxes = np.array([_box(k) for k in keypoints]).reshape(-1, 4)
        tracker.update(
            picture.index,
            picture.index / frame_rate,
            Boxes(boxes, np.array([p.score for p in picture.people])),
            Poses2D(keypoints[:, :, :2], keypoints[:, :, 2], skeleton),
            cut=False,
        )
    return tracker.finish(person)


def _surest(pictures: list[_Picture], skeleton: str, image_size: tuple[int, int]) -> Track2D:
    """One row a picture: its surest person, NaN where there is none."""
    length, joints = len(pictures), len(skeletons.get(skeleton))
    keypoints = np.full((length, joints, 3), np.nan)
    keypoints[:, :, 2] = 0
    for row, picture in enumerate(pictures):
        if picture.people:
            keypoints[row] = max(picture.people, key=lambda p: p.score).keypoints
    return Track2D(
        person=1,
        timeline=Timeline(
            np.array([picture.index for picture in pictures], np.int64),
            np.arange(length, dtype=np.float64),
        ),
        xy=keypoints[:, :, :2].astype(np.float32),
        confidence=keypoints[:, :, 2].astype(np.float32),
        skeleton=skeleton,
        interpolated=np.zeros(length, np.bool_),
        box=np.array([_box(k) for k in keypoints], np.float32),
        image_size=image_size,
    )
