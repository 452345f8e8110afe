"""MediaPipe pose landmarks as JSON: 33 points a person, as parts of the picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dance2pose.errors import DataError
from dance2pose.reading.content import Content, Picture, Sighting
from dance2pose.reading.json_files import FRAME_KEYS, first, number, size_of, whole_number

_FRAMES = ("frames", "results", "data", "poses_by_frame")
# Of the JavaScript, Python and protobuf interfaces; world landmarks are metres and not these.
_LANDMARKS = ("pose_landmarks", "poseLandmarks", "landmarks", "landmark", "pose", "keypoints")
_SECONDS = ("time_s", "timestamp_s", "time", "timestamp_sec", "seconds")
_MILLISECONDS = ("timestamp_ms", "timestampMs", "time_ms")
_SURE = ("visibility", "presence", "score", "confidence")


def is_mediapipe(content: Any) -> bool:
    """Anything in which landmarks with x and y lie where MediaPipe's users put them."""
    frames, _ = _frames(content)
    one = next((one for one in frames[:10_000] if one and _poses(one)), None)
    return one is not None


def read_mediapipe(path: Path, content: Any) -> Content:
    """All frames; coordinates are parts of the picture, confidence is the visibility."""
    found = Content("MediaPipe landmarks", [], skeleton="blazepose33", normalised=True)
    frames, inside = _frames(content)
    size = size_of(content) if isinstance(content, dict) else None
    for n, frame in enumerate(frames):
        people = [
            _sighting(pose, f"{path}: {inside}[{n}] landmarks") for pose in _poses(frame or {})
        ]
        facts = frame if isinstance(frame, dict) else {}
        found.pictures.append(
            Picture(
                people,
                name=path.name if len(frames) == 1 else None,
                frame=whole_number(first(facts, *FRAME_KEYS)),
                time_s=_time(facts),
                size=size_of(facts) or size,
            )
        )
    _in_px_after_all(found)
    return found


def _in_px_after_all(found: Content) -> None:
    """Some people save landmarks already multiplied by the size of the picture."""
    people = [person.keypoints[:, :2] for picture in found.pictures for person in picture.people]
    if people and np.nanpercentile(np.abs(np.concatenate(people)), 90) > 10:
        found.normalised = False


def _frames(content: Any) -> tuple[list[Any], str]:
    """The entries of the frames, and what the list is called."""
    if isinstance(content, dict):
        key = next((key for key in _FRAMES if isinstance(content.get(key), list)), None)
        if key is not None:
            return content[key], key
        numbers = {whole_number(key) for key in content}
        if content and None not in numbers:  # poses by frame number
            return [{"frame": key, "pose": pose} for key, pose in content.items()], ""
        return [content], ""
    if isinstance(content, list):
        return ([content], "") if _is_pose(content) else (content, "")
    return [], ""


def _poses(frame: Any) -> list[list[Any]]:
    """The people of a frame, each a list of landmarks; none where nobody was found."""
    if isinstance(frame, dict):
        value = first(frame, *_LANDMARKS)
        return [] if value is None else _poses(value)
    if not isinstance(frame, list) or not frame:
        return []
    if _is_pose(frame):
        return [frame]
    return [pose for one in frame for pose in _poses(one)] if _is_nested(frame) else []


def _is_nested(frame: list[Any]) -> bool:
    return all(isinstance(one, (list, dict)) for one in frame) and not _is_pose(frame)


def _is_pose(value: Any) -> bool:
    """A list of landmarks: dictionaries with x and y."""
    return (
        isinstance(value, list)
        and bool(value)
        and all(isinstance(one, dict) and "x" in one and "y" in one for one in value)
    )


def _sighting(pose: list[Any], where: str) -> Sighting:
    values = [(number(one["x"]), number(one["y"]), _sure(one)) for one in pose]
    try:
        keypoints = np.array(values, np.float64)
    except (ValueError, TypeError) as error:
        raise DataError(f"{where} do not hold plain numbers: {error}") from error
    if len(keypoints) != 33:
        raise DataError(f"{where}: {len(keypoints)} of them, expected MediaPipe Pose's 33")
    return Sighting(keypoints, float(np.nan_to_num(keypoints[:, 2]).mean()), where)


def _sure(one: dict[str, Any]) -> float:
    value = number(first(one, *_SURE))
    return 1.0 if value is None else value


def _time(facts: dict[str, Any]) -> float | None:
    seconds = number(first(facts, *_SECONDS))
    if seconds is not None:
        return seconds
    milliseconds = number(first(facts, *_MILLISECONDS))
    return None if milliseconds is None else milliseconds / 1000
