"""Keypoints of two planted people, written as other tools write them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dance2pose import skeleton
from dance2pose.reading.joint_names import meaning

WIDTH, HEIGHT = 640, 360
RATE = 25.0

# A standing figure, x to its left and y down, 100 units tall.
_PLACES = {
    "nose": (0, 8), "lefteye": (2, 6), "righteye": (-2, 6), "leftear": (5, 7), "rightear": (-5, 7),
    "neck": (0, 18), "head": (0, 7), "headtop": (0, 0), "upperneck": (0, 15), "thorax": (0, 20),
    "neckbase": (0, 16), "spine": (0, 35), "pelvis": (0, 50), "leftshoulder": (11, 20),
    "rightshoulder": (-11, 20), "leftelbow": (16, 35), "rightelbow": (-16, 35),
    "leftwrist": (17, 49), "rightwrist": (-17, 49), "lefthip": (7, 50), "righthip": (-7, 50),
    "leftknee": (8, 72), "rightknee": (-8, 72), "leftankle": (8, 93), "rightankle": (-8, 93),
    "leftbigtoe": (11, 99), "rightbigtoe": (-11, 99), "leftsmalltoe": (14, 98),
    "rightsmalltoe": (-14, 98), "leftheel": (7, 96), "rightheel": (-7, 96),
}  # fmt: skip


def body(name: str, *, frame: int, left: float, sure: float = 0.9) -> np.ndarray:
    """(J, 3) x, y, confidence of a figure that walks to the right and bends its arms."""
    joints = skeleton.get(name).joints
    places = []
    for n, joint in enumerate(joints):
        part = meaning(joint)
        if part not in _PLACES:  # fingers and faces
            side = "left" if "left" in joint else "right" if "right" in joint else ""
            hand = any(w in joint for w in ("finger", "thumb", "hand", "pinky", "index"))
            near = _PLACES[f"{side}wrist"] if hand else _PLACES["nose"]
            places.append((near[0] + 0.3 * (n % 7), near[1] + 0.4 * (n % 5)))
            continue
        x, y = _PLACES[part]
        bend = np.sin(frame / 4) * {"elbow": 3, "wrist": 7}.get(part[-5:], 0)
        places.append((x + bend, y))
    xy = 1.8 * np.array(places, float) + (left + 2.5 * frame, 40)
    confidence = sure - 0.3 * np.arange(len(joints)) / len(joints)
    return np.column_stack([xy, confidence]).round(4)


@dataclass(frozen=True)
class Person:
    who: str
    keypoints: np.ndarray


# Frame number to the people in it.
Scene = dict[int, list[Person]]


def scene(name: str, frames: Sequence[int] = range(3, 15), people: int = 2) -> Scene:
    lefts = {"ann": 120.0, "bo": 420.0}
    return {
        frame: [
            Person(who, body(name, frame=frame, left=left))
            for who, left in list(lefts.items())[:people]
        ]
        for frame in frames
    }


Writer = Callable[[Path, Scene], Path]


def _flat(person: Person) -> list[float]:
    return person.keypoints.ravel().tolist()


def _json(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


def openpose(folder: Path, frames: Scene) -> Path:
    out = folder / "openpose"
    out.mkdir()
    for frame, people in frames.items():
        entries = [{"person_id": [-1], "pose_keypoints_2d": _flat(p)} for p in people]
        _json(out / f"take2_{frame:012d}_keypoints.json", {"version": 1.3, "people": entries})
    return out


def coco(folder: Path, frames: Scene, *, size: tuple[int, int] = (WIDTH, HEIGHT)) -> Path:
    """As CVAT exports it: ids in another order than the file names."""
    ids = {frame: 900 - 7 * frame for frame in frames}
    images = [
        {"id": ids[f], "file_name": f"frame_{f:06d}.PNG", "width": size[0], "height": size[1]}
        for f in frames
    ]
    annotations = []
    for frame, people in frames.items():
        for person in people:
            points = person.keypoints.copy()
            points[:, 2] = np.where(points[:, 2] > 0, 2, 0)
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": ids[frame],
                    "category_id": 1,
                    "keypoints": points.ravel().tolist(),
                }
            )
    return _json(folder / "coco.json", {"images": images, "annotations": annotations})


def results(folder: Path, frames: Scene) -> Path:
    entries = [
        {"image_id": frame, "category_id": 1, "keypoints": _flat(p), "score": 0.8}
        for frame, people in frames.items()
        for p in people
    ]
    return _json(folder / "results.json", entries)


def alphapose(folder: Path, frames: Scene) -> Path:
    entries = [
        {
            "image_id": f"{frame}.jpg",
            "category_id": 1,
            "keypoints": _flat(p),
            "score": 2.9,
            "box": [p.keypoints[:, 0].min(), p.keypoints[:, 1].min(), 60.0, 180.0],
            "idx": [0.0],
        }
        for frame, people in frames.items()
        for p in people
    ]
    return _json(folder / "alphapose-results.json", entries)


def alphapose_by_picture(folder: Path, frames: Scene) -> Path:
    content = {
        f"dance.mp4_{frame}": {"version": "AlphaPose", "people": [
            {"pose_keypoints_2d": _flat(p)} for p in people
        ]}
        for frame, people in frames.items()
    }  # fmt: skip
    return _json(folder / "alphapose-open.json", content)


def _instance(person: Person) -> dict[str, Any]:
    points = person.keypoints
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    return {
        "keypoints": points[:, :2].tolist(),
        "keypoint_scores": points[:, 2].tolist(),
        "bbox": [[*low.tolist(), *high.tolist()]],
        "bbox_score": 0.97,
    }


def mmpose(folder: Path, frames: Scene) -> Path:
    joints = skeleton.get("coco17").joints
    meta = {
        "dataset_name": "coco",
        "num_keypoints": len(joints),
        "keypoint_id2name": {str(n): joint for n, joint in enumerate(joints)},
    }
    info = [
        {"frame_id": frame, "instances": [_instance(p) for p in people]}
        for frame, people in frames.items()
    ]
    return _json(folder / "results_dance.json", {"meta_info": meta, "instance_info": info})


def mmpose_inferencer(folder: Path, frames: Scene) -> Path:
    info = [
        {"frame_id": frame, "instances": [_instance(p) for p in people]}
        for frame, people in frames.items()
    ]
    return _json(folder / "dance.json", info)


def mmpose_pictures(folder: Path, frames: Scene) -> Path:
    out = folder / "predictions"
    out.mkdir()
    for frame, people in frames.items():
        _json(out / f"cam2.{frame:05d}.json", [_instance(p) for p in people])
    return out


def rtmlib(folder: Path, frames: Scene) -> Path:
    entries = [
        {
            "frame": frame,
            "keypoints": [p.keypoints[:, :2].tolist() for p in people],
            "scores": [p.keypoints[:, 2].tolist() for p in people],
        }
        for frame, people in frames.items()
    ]
    return _json(folder / "rtmlib.json", entries)


def rtmlib_arrays(folder: Path, frames: Scene) -> Path:
    """(T, N, J, 2) from frame 0 on; NaN where nobody is."""
    joints = len(skeleton.get("coco17"))
    keypoints = np.full((max(frames) + 1, 2, joints, 2), np.nan)
    scores = np.zeros(keypoints.shape[:3])
    for frame, people in frames.items():
        for n, person in enumerate(people):
            keypoints[frame, n] = person.keypoints[:, :2]
            scores[frame, n] = person.keypoints[:, 2]
    np.savez(folder / "rtmlib.npz", keypoints=keypoints, scores=scores)
    return folder / "rtmlib.npz"


def _landmarks(person: Person) -> list[dict[str, float]]:
    return [
        {
            "x": (x + 0.5) / WIDTH if x or y else 0.0,
            "y": (y + 0.5) / HEIGHT if x or y else 0.0,
            "z": -0.1,
            "visibility": sure,
        }
        for x, y, sure in person.keypoints
    ]


def mediapipe(folder: Path, frames: Scene) -> Path:
    content = {
        "width": WIDTH,
        "height": HEIGHT,
        "frames": [
            {
                "frame": frame,
                "timestamp_ms": 1000 * frame / RATE,
                "landmarks": [_landmarks(p) for p in people],
                "worldLandmarks": [_landmarks(p) for p in people],
            }
            for frame, people in frames.items()
        ],
    }
    return _json(folder / "pose.json", content)


def mediapipe_csv(folder: Path, frames: Scene) -> Path:
    """x1, y1, z1, v1 ... of one person."""
    header = ["frame", *(f"{axis}{n}" for n in range(1, 34) for axis in "xyzv")]
    lines = [",".join(header)]
    for frame, people in frames.items():
        cells = [""] * 132
        if people:
            cells = [str(v) for mark in _landmarks(people[0]) for v in mark.values()]
        lines.append(",".join([str(frame), *cells]))
    (folder / "landmarks.csv").write_text("\n".join(lines) + "\n")
    return folder / "landmarks.csv"


def mediapipe_long_csv(folder: Path, frames: Scene) -> Path:
    lines = ["frame,person,landmark,x,y,z,visibility"]
    for frame, people in frames.items():
        for person in people:
            for name, mark in zip(
                skeleton.get("blazepose33").joints, _landmarks(person), strict=True
            ):
                values = ",".join(str(v) for v in mark.values())
                lines.append(f"{frame},{person.who},{name.upper()},{values}")
    (folder / "long.csv").write_text("\n".join(lines) + "\n")
    return folder / "long.csv"


def _deeplabcut_columns(people: Sequence[str]) -> list[tuple[str, str, str, str]]:
    joints = skeleton.get("coco17").joints
    return [
        ("DLC_net", who, joint, axis)
        for who in people
        for joint in joints
        for axis in ("x", "y", "likelihood")
    ]


def _deeplabcut_rows(frames: Scene, people: Sequence[str]) -> list[list[float]]:
    rows = []
    for here in frames.values():
        known = {p.who: p for p in here}
        row: list[float] = []
        for who in people:
            row += _flat(known[who]) if who in known else [np.nan] * 51
        rows.append(row)
    return rows


def deeplabcut(folder: Path, frames: Scene) -> Path:
    return _deeplabcut_csv(folder, frames, ["ann", "bo"], "DLC_el.csv", separator=",")


def deeplabcut_semicolons(folder: Path, frames: Scene) -> Path:
    """One animal, three header lines, saved again by a German spreadsheet."""
    return _deeplabcut_csv(folder, frames, ["ann"], "DLC_de.csv", separator=";")


def _deeplabcut_csv(
    folder: Path, frames: Scene, people: Sequence[str], name: str, *, separator: str
) -> Path:
    columns = _deeplabcut_columns(people)
    heads = ("scorer", "individuals", "bodyparts", "coords")
    lines = [
        separator.join([head, *(column[n] for column in columns)])
        for n, head in enumerate(heads)
        if head != "individuals" or len(people) > 1
    ]
    for frame, row in zip(frames, _deeplabcut_rows(frames, people), strict=True):
        cells = ["" if np.isnan(v) else str(v) for v in row]
        if separator == ";":
            cells = [cell.replace(".", ",") for cell in cells]
        lines.append(separator.join([str(frame), *cells]))
    (folder / name).write_text("\n".join(lines) + "\n")
    return folder / name


def deeplabcut_h5(folder: Path, frames: Scene) -> Path:
    import pandas as pd

    columns = pd.MultiIndex.from_tuples(
        _deeplabcut_columns(["ann", "bo"]), names=["scorer", "individuals", "bodyparts", "coords"]
    )
    rows = np.array(_deeplabcut_rows(frames, ["ann", "bo"]))
    table = pd.DataFrame(rows, index=list(frames), columns=columns)
    table.to_hdf(folder / "DLC.h5", key="df_with_missing", format="table", mode="w")
    return folder / "DLC.h5"


def sleap_csv(folder: Path, frames: Scene) -> Path:
    joints = skeleton.get("coco17").joints
    header = ["track", "frame_idx", "instance.score"]
    header += [f"{joint}.{axis}" for joint in joints for axis in ("x", "y", "score")]
    lines = [",".join(header)]
    for frame, people in frames.items():
        for p in people:
            lines.append(",".join([p.who, str(frame), "0.9", *(str(v) for v in _flat(p))]))
    (folder / "labels.analysis.csv").write_text("\n".join(lines) + "\n")
    return folder / "labels.analysis.csv"


def sleap_h5(folder: Path, frames: Scene) -> Path:
    import h5py

    joints = skeleton.get("coco17").joints
    tracks = np.full((2, 2, len(joints), max(frames) + 1), np.nan)
    scores = np.full((2, len(joints), max(frames) + 1), np.nan)
    for frame, people in frames.items():
        for p in people:
            who = ["ann", "bo"].index(p.who)
            tracks[who, :, :, frame] = p.keypoints[:, :2].T
            scores[who, :, frame] = p.keypoints[:, 2]
    with h5py.File(folder / "labels.analysis.h5", "w") as file:
        file["tracks"], file["point_scores"] = tracks, scores
        file["node_names"] = np.array([j.encode() for j in joints])
        file["track_names"] = np.array([b"ann", b"bo"])
    return folder / "labels.analysis.h5"


@dataclass(frozen=True)
class Made:
    """A format as the tests make it. people: how many it holds. flags: confidences are flags.

    names: the file says who is who. leaves_out: frames without anyone may have no entry.
    """

    write: Writer
    skeleton: str
    people: int = 2
    flags: bool = False
    leaves_out: bool = True
    needs_size: bool = False
    times: bool = False


MADE = {
    "openpose": Made(openpose, "body25"),
    "coco": Made(coco, "coco17", flags=True),
    "results": Made(results, "coco17"),
    "alphapose": Made(alphapose, "halpe26"),
    "alphapose 136": Made(alphapose, "halpe136"),
    "alphapose by picture": Made(alphapose_by_picture, "coco18"),
    "mmpose": Made(mmpose, "coco17"),
    "mmpose inferencer": Made(mmpose_inferencer, "wholebody133"),
    "mmpose pictures": Made(mmpose_pictures, "mpii16"),
    "rtmlib": Made(rtmlib, "halpe26"),
    "rtmlib arrays": Made(rtmlib_arrays, "coco17", leaves_out=False),
    "mediapipe": Made(mediapipe, "blazepose33", times=True),
    "mediapipe csv": Made(mediapipe_csv, "blazepose33", people=1, needs_size=True),
    "mediapipe long csv": Made(mediapipe_long_csv, "blazepose33", needs_size=True),
    "deeplabcut": Made(deeplabcut, "coco17"),
    "deeplabcut semicolons": Made(deeplabcut_semicolons, "coco17", people=1),
    "deeplabcut h5": Made(deeplabcut_h5, "coco17"),
    "sleap csv": Made(sleap_csv, "coco17"),
    "sleap h5": Made(sleap_h5, "coco17", leaves_out=False),
}
