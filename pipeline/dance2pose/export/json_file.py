"""JSON: everything that is known of the joints, for any program. Missing numbers are null."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose.angles import track_angles
from dance2pose.export.scene import AXES, ExportScene, SceneDancer

FORMAT = "dance2pose poses"
VERSION = 1


def write_json(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write all dancers of the scene; nothing is lost."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "unit": scene.unit,
        "axes": AXES,
        "time": "seconds from the start of the video, of each frame",
        "provenance": json.loads(scene.provenance_json()),
        "dancers": [_dancer(dancer) for dancer in scene.dancers],
    }
    with path.open("w", encoding="utf-8") as file:
        json.dump(content, file, ensure_ascii=False, allow_nan=False)
    return ()


def _dancer(dancer: SceneDancer) -> dict[str, Any]:
    poses, skeleton = dancer.poses, dancer.skeleton
    content: dict[str, Any] = {
        "person": dancer.person,
        "shot": poses.shot,
        "skeleton": skeleton.name,
        "joints": list(skeleton.joints),
        "bones": [list(edge) for edge in skeleton.edges],
        "frame": poses.frame.tolist(),
        "time_s": poses.time_s.tolist(),
        "xyz": _plain(poses.xyz),
        "root": None if poses.root is None else _plain(poses.root),
        "sigma": None if poses.sigma is None else _plain(poses.sigma),
        "estimated": poses.estimated.tolist(),
        "valid": poses.valid.tolist(),
        "reprojection_error_px": _plain(poses.reprojection_error),
        "angles_deg": {
            name: {
                "value": _plain(curve.degrees),
                "sigma": None if curve.sigma_deg is None else _plain(curve.sigma_deg),
            }
            for name, curve in track_angles(poses).items()
        },
    }
    track = dancer.keypoints
    if track is not None:
        content["keypoints"] = {
            "skeleton": track.skeleton,
            "image_size": list(track.image_size),
            "xy_px": _plain(track.xy),
            "confidence": _plain(track.confidence),
            "interpolated": track.interpolated.tolist(),
        }
    return content


def _plain(array: npt.NDArray[Any]) -> Any:
    """Nested lists with None for NaN."""
    boxed = array.astype(object)
    boxed[np.isnan(array)] = None
    return boxed.tolist()
