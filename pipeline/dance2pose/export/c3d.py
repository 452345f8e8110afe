"""C3D: for Mokka, Visual3D, Vicon and everything in biomechanics.

z up, y away from the viewer. Millimetres, or thousandths of a body height where the height is not
known; POINT:UNITS says which. A missing joint has the residual -1. The number of the first frame
keeps the time: frame n is at (n - 1) / rate seconds of the video.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dance2pose import __version__
from dance2pose.errors import UsageError
from dance2pose.export.extras import need
from dance2pose.export.names import labelled
from dance2pose.export.scene import ExportScene
from dance2pose.export.together import on_one_clock
from dance2pose.poses import FloatArray

_PER_UNIT = 1000.0
_UNITS = {"metres": "mm", "body heights": "mBH"}
# Frame numbers are 16-bit in the header, and programs follow it.
_LAST_FRAME = 65_535
# A string in the file is at most 255 bytes long.
_PIECE = 80


def write_c3d(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write all dancers of the scene into one file; returns what it could not keep."""
    ezc3d = need("ezc3d", "c3d")
    motion = on_one_clock(scene)
    first = max(0, motion.first)
    if len(motion.xyz) > _LAST_FRAME:
        raise UsageError(
            f"{path}: {len(motion.xyz)} frames; C3D holds {_LAST_FRAME} at most, export a part"
        )
    notes = [f"resampled to {motion.rate:.6g} frames a second"]
    if first + len(motion.xyz) > _LAST_FRAME:
        notes.append(f"frame 1 is at {first / motion.rate:.3f} s of the video, too late to number")
        first = 0
    file = ezc3d.c3d()
    file["header"]["points"]["first_frame"] = first
    point = file["parameters"]["POINT"]
    point["RATE"]["value"] = [motion.rate]
    point["UNITS"]["value"] = [_UNITS[scene.unit]]
    point["LABELS"]["value"] = labelled(scene.dancers)
    point["DESCRIPTIONS"]["value"] = ["joint centre"] * motion.xyz.shape[1]
    file.add_parameter("POINT", "X_SCREEN", ["+X"])
    file.add_parameter("POINT", "Y_SCREEN", ["+Z"])
    file.add_parameter("MANUFACTURER", "SOFTWARE", ["dance2pose"])
    file.add_parameter("MANUFACTURER", "VERSION_LABEL", [__version__])
    file.add_parameter("DANCE2POSE", "PROVENANCE", _pieces(scene.provenance_json()))
    points, residuals = _points(motion.xyz)
    file["data"]["points"] = points
    file["data"]["meta_points"]["residuals"] = residuals
    file["data"]["meta_points"]["camera_masks"] = np.zeros((7, *residuals.shape[1:]), bool)
    file.write(str(path))
    return tuple(notes)


def _points(xyz: FloatArray) -> tuple[FloatArray, FloatArray]:
    """(4, J, T) homogeneous points, z up, and (1, J, T) residuals."""
    turned = np.stack([xyz[..., 0], -xyz[..., 2], xyz[..., 1]]) * _PER_UNIT
    points = np.concatenate([turned, np.ones((1, *turned.shape[1:]))]).transpose(0, 2, 1)
    residuals = np.where(np.isnan(points[:1]), -1.0, 0.0)
    return np.ascontiguousarray(points), residuals


def _pieces(text: str) -> list[str]:
    """Text in pieces that fit; joined they are the text."""
    return [text[i : i + _PIECE] for i in range(0, len(text), _PIECE)]
