"""MMPose 1.x predictions (demo scripts and inferencer), and other lists of pictures with people."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dance2pose.errors import DataError
from dance2pose.reading.content import Content, Picture, Sighting, box_from, points
from dance2pose.reading.json_files import FRAME_KEYS, first, number, require, size_of, whole_number

_NAME = ("img_path", "image_path", "file_name", "image", "image_name", "image_id")
_PEOPLE = ("instances", "people", "persons", "poses")
_KEYPOINTS = ("keypoints", "pose_keypoints_2d")
_SCORES = ("keypoint_scores", "keypoints_scores", "keypoint_score", "scores", "keypoints_visible")
_IDENTITY = ("track_id", "instance_id", "person_id", "id")


def is_mmpose(content: Any) -> bool:
    """`meta_info` and `instance_info`, the inferencer's lists, or a picture's list of people."""
    if isinstance(content, dict):
        return "instance_info" in content or "predictions" in content or _is_frame(content)
    if not isinstance(content, list):
        return False
    one = next((one for one in content if one), None)
    if isinstance(one, list):
        one = next((person for person in one if person), None)
        return isinstance(one, dict) and "keypoints" in one
    return isinstance(one, dict) and (_is_frame(one) or _is_person(one))


def read_mmpose(path: Path, content: Any) -> Content:
    """All pictures; a file with one picture's people is named by itself."""
    found = Content("MMPose predictions", [], open_scores=True)
    entries, inside = content, ""
    if isinstance(content, dict):
        found.joints = _joint_names(content.get("meta_info"))
        key = next((key for key in ("instance_info", "predictions") if key in content), "")
        entries, inside = (content[key], key) if key else ([content], "")
    if not isinstance(entries, list):
        raise DataError(f"{path}: {inside} is of type {type(entries).__name__}, expected a list")
    if any(isinstance(one, dict) and _is_person(one) for one in entries):
        people = _people(path, entries, inside, found)
        found.pictures.append(Picture(people, name=path.name))
    else:
        for n, one in enumerate(entries):
            found.pictures.append(_picture(path, one, f"{inside}[{n}]", found))
    return found


def _is_frame(one: dict[str, Any]) -> bool:
    return any(isinstance(one.get(key), list) for key in _PEOPLE)


def _is_person(one: dict[str, Any]) -> bool:
    return "keypoints" in one and "image_id" not in one and any(key in one for key in _SCORES[:3])


def _picture(path: Path, one: Any, inside: str, found: Content) -> Picture:
    if one is None or one == {} or one == []:
        return Picture([])
    if isinstance(one, list):
        return Picture(_people(path, one, inside, found))
    key = next((k for k in _PEOPLE if isinstance(one, dict) and k in one), None)
    if key is None:
        require(path, one, _PEOPLE[:1], inside)
    assert key is not None
    people = one[key]
    if not isinstance(people, list):
        raise DataError(f"{path}: {inside}.{key} is of type {type(people).__name__}")
    name = first(one, *_NAME)
    return Picture(
        _people(path, people, f"{inside}.{key}", found),
        name=name if isinstance(name, str) else None,
        frame=whole_number(first(one, *FRAME_KEYS)),
        time_s=number(first(one, "time_s", "timestamp_s")),
        size=size_of(one),
    )


def _people(path: Path, people: list[Any], inside: str, found: Content) -> list[Sighting]:
    sightings, without = [], 0
    for n, one in enumerate(people):
        place = f"{inside}[{n}]"
        key = next((k for k in _KEYPOINTS if isinstance(one, dict) and k in one), _KEYPOINTS[0])
        if one is None or one == {} or (isinstance(one, dict) and one.get(key) == []):
            without += 1
            continue
        require(path, one, (key,), place)
        where = f"{path}: {place}.{key}"
        keypoints = points(one[key], where, first(one, *_SCORES))
        score = number(first(one, "bbox_score", "score"))
        identity = first(one, *_IDENTITY)
        sightings.append(
            Sighting(
                keypoints,
                float(np.nan_to_num(keypoints[:, 2]).mean()) if score is None else score,
                where,
                box=box_from(one.get("bbox"), corner_and_size=False),
                identity=None if identity is None or identity == -1 else str(identity),
            )
        )
    if without:
        found.notes.append(f"{without} people without keypoints in {inside or path.name}")
    return sightings


def _joint_names(meta: Any) -> tuple[str, ...] | None:
    """`keypoint_id2name` by rising id."""
    names = meta.get("keypoint_id2name") if isinstance(meta, dict) else None
    if not isinstance(names, dict) or not names:
        return None
    numbers = [whole_number(key) for key in names]
    if sorted(n for n in numbers if n is not None) != list(range(len(names))):
        return None
    return tuple(str(names[key]) for key in sorted(names, key=int))
