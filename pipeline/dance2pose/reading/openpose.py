"""OpenPose JSON, one file a picture (`--write_json`), and AlphaPose's `--format open` and `cmu`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dance2pose.reading.content import Content, Picture, Sighting, points
from dance2pose.reading.json_files import entry, first, require, whole_number

# OpenPose before 1.2 left out the "_2d".
_KEYPOINTS = ("pose_keypoints_2d", "pose_keypoints", "joints")
_PEOPLE = ("people", "bodies")


def is_openpose(content: Any) -> bool:
    """One picture: a list of people (or of AlphaPose's bodies)."""
    return isinstance(content, dict) and any(key in content for key in _PEOPLE)


def read_openpose(path: Path, content: Any) -> Content:
    """The one picture of a file; its name is the file's."""
    people, without = _people(path, content, "")
    found = Content("OpenPose", [Picture(people, name=path.name)])
    _say(found, without)
    return found


def is_alphapose_by_picture(content: Any) -> bool:
    """Pictures by their file name, each as OpenPose writes it."""
    if not isinstance(content, dict) or not content:
        return False
    return is_openpose(next(iter(content.values())))


def read_alphapose_by_picture(path: Path, content: Any) -> Content:
    """All pictures of a file."""
    pictures, without = [], 0
    for name, one in content.items():
        people, none = _people(path, one, f"[{name!r}]")
        pictures.append(Picture(people, name=name))
        without += none
    found = Content("AlphaPose (open or cmu)", pictures)
    _say(found, without)
    return found


def _people(path: Path, content: Any, inside: str) -> tuple[list[Sighting], int]:
    key = next((key for key in _PEOPLE if isinstance(content, dict) and key in content), "people")
    people, without = [], 0
    for n, one in enumerate(entry(path, content, key, list, inside)):
        place = f"{inside}{'.' if inside else ''}{key}[{n}]"
        if one is None or one == {}:
            without += 1
            continue
        keypoints_key = next((k for k in _KEYPOINTS if isinstance(one, dict) and k in one), None)
        if keypoints_key is None:
            require(path, one, _KEYPOINTS[:1], place)
        assert keypoints_key is not None
        numbers = entry(path, one, keypoints_key, list, place)
        if not numbers:  # only a hand or a face was found
            without += 1
            continue
        where = f"{path}: {place}.{keypoints_key}"
        keypoints = points(numbers, where)
        people.append(
            Sighting(keypoints, float(keypoints[:, 2].mean()), where, identity=_identity(one))
        )
    return people, without


def _identity(one: dict[str, Any]) -> str | None:
    """`person_id` of a tracking OpenPose; -1 stands for none."""
    value = first(one, "person_id", "idx")
    number = whole_number(value[0] if isinstance(value, list) and value else value)
    return None if number is None or number < 0 else str(number)


def _say(found: Content, without: int) -> None:
    if without:
        found.notes.append(f"{without} people without body keypoints are not there")
