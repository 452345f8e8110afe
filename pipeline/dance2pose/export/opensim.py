"""Tables for OpenSim: TRC (places of joints) and MOT (joint angles).

Both are y up, as OpenSim is. Missing values are empty cells in TRC and `nan` in MOT.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dance2pose.angles import pelvis_rotation, track_angles
from dance2pose.export.names import labelled
from dance2pose.export.scene import ExportScene, SceneDancer
from dance2pose.export.together import on_one_clock
from dance2pose.poses import FloatArray, Unit

# TRC files are in millimetres by habit.
_TRC: dict[Unit, tuple[str, float]] = {"metres": ("mm", 1000.0), "body heights": ("bh", 1.0)}

# OpenSim's coordinates (Rajagopal 2016) and the angle that each is, with its sign.
_LIMB_COORDINATES = {
    "hip_flexion": ("hip_flexion", 1),
    "hip_adduction": ("hip_abduction", -1),
    "knee_angle": ("knee_flexion", 1),
    "ankle_angle": ("ankle_flexion", 1),
    "arm_flex": ("shoulder_flexion", 1),
    "arm_add": ("shoulder_abduction", -1),
    "elbow_flex": ("elbow_flexion", 1),
}


def write_trc(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write all dancers of the scene; returns what the form could not keep."""
    motion = on_one_clock(scene)
    labels = labelled(scene.dancers)
    unit, per_unit = _TRC[scene.unit]
    rate, frames = f"{motion.rate:.10g}", len(motion.xyz)
    lines = [
        f"PathFileType\t4\t(X/Y/Z)\t{_title(scene)}.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame"
        "\tOrigNumFrames",
        f"{rate}\t{rate}\t{frames}\t{len(labels)}\t{unit}\t{rate}\t1\t{frames}",
        "Frame#\tTime\t" + "\t\t\t".join(labels) + "\t\t",
        "\t\t" + "\t".join(f"{a}{i}" for i in range(1, len(labels) + 1) for a in "XYZ"),
        "",
    ]
    values = motion.xyz.reshape(frames, -1) * per_unit
    for row, time_s in enumerate(motion.time_s):
        cells = ("" if np.isnan(value) else f"{value:.6f}" for value in values[row])
        lines.append(f"{row + 1}\t{time_s:.6f}\t" + "\t".join(cells))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    notes = [f"resampled to {motion.rate:.6g} frames a second"]
    if unit == "bh":
        notes.append("lengths are body heights, which OpenSim does not know; give a height for mm")
    return tuple(notes)


def write_mot(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write the angles of the one dancer of the scene, at the true times of the frames."""
    (dancer,) = scene.dancers
    columns = coordinates(dancer)
    names = ["time", *columns]
    values = np.column_stack([dancer.poses.time_s, *columns.values()])
    lines = [
        _title(scene),
        "version=1",
        f"nRows={len(values)}",
        f"nColumns={len(names)}",
        "inDegrees=yes",
        f"# {scene.provenance_json()}",
        "endheader",
        "\t".join(names),
    ]
    lines += ["\t".join(f"{value:.6f}" for value in row) for row in values]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return ("no axial rotation of limbs: one camera's joints do not hold it throughout",)


def _title(scene: ExportScene) -> str:
    """The name that the file gives itself, on one line; it says who wrote it."""
    stem = " ".join(scene.video.stem.split()) if scene.video else "poses"
    return f"{stem}_dance2pose"


def coordinates(dancer: SceneDancer) -> dict[str, FloatArray]:
    """OpenSim's coordinates by name, (T,) degrees (and metres for the place of the pelvis).

    The pelvis is taken as one piece with the trunk, which is what the joints show of it; so the
    hips bend against the trunk, and the lumbar joint only turns.
    """
    angles = track_angles(dancer.poses)
    columns = _pelvis(dancer)
    for side in ("r", "l"):
        whole = "right" if side == "r" else "left"
        for name, (angle, sign) in _LIMB_COORDINATES.items():
            if f"{whole}_{angle}" in angles:
                columns[f"{name}_{side}"] = sign * angles[f"{whole}_{angle}"].degrees
    if "trunk_rotation" in angles:
        columns["lumbar_rotation"] = angles["trunk_rotation"].degrees
    return columns


def _pelvis(dancer: SceneDancer) -> dict[str, FloatArray]:
    degrees = pelvis_rotation(dancer.poses)
    columns = {
        name: degrees[:, i]
        for i, name in enumerate(("pelvis_tilt", "pelvis_list", "pelvis_rotation"))
    }
    if dancer.poses.unit == "metres" and dancer.poses.root is not None:
        for axis, name in enumerate(("pelvis_tx", "pelvis_ty", "pelvis_tz")):
            columns[name] = dancer.poses.root[:, axis]
    return columns
