"""BVH (Biovision hierarchy): for Blender, MotionBuilder, Maya.

y up, the dancer's left at +x at rest. Lengths are in centimetres, or hundredths of a body height
where the height is not known. The file has one rate, one length a bone and no gaps.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.even_rate import bridged, even, is_known
from dance2pose.export.rig import Rig, make_rig, stretch
from dance2pose.export.scene import ExportScene
from dance2pose.poses import FloatArray

_PER_UNIT = 100.0
_ORDER = "ZXY"
_TURNS = " ".join(f"{axis}rotation" for axis in _ORDER)


def write_bvh(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write the one dancer of the scene; returns what the form could not keep, in sentences."""
    (dancer,) = scene.dancers
    motion = even(dancer.poses.time_s, dancer.poses.world_xyz, frame=dancer.poses.frame)
    xyz = bridged(motion.time_s, motion.xyz)
    rig = make_rig(motion.time_s, xyz, dancer.skeleton)
    path.write_text(bvh_text(rig, motion.rate), encoding="ascii")
    unit = "cm" if scene.unit == "metres" else "hundredths of a body height"
    notes = [
        f"{motion.rate:.6g} frames a second from {motion.time_s[0]:.3f} s of the video, lengths in "
        f"{unit}, neither of which BVH can say"
    ]
    moved = stretch(motion.xyz, rig, dancer.skeleton)
    if (moved > 1e-6).any():
        median, most = np.nanmedian(moved) * 100, np.nanmax(moved) * 100
        notes.append(
            f"one length a bone moved joints by {median:.2f} (median) to {most:.2f} {unit} (most)"
        )
    holes = int((~is_known(motion.xyz)).sum())
    if holes:
        notes.append(f"{holes} frames without a pose are bridged by straight lines")
    return tuple(notes)


def bvh_text(rig: Rig, rate: float) -> str:
    """The whole file as text."""
    lines = ["HIERARCHY"]
    _hierarchy(rig, 0, 0, lines)
    channels = _channels(rig)
    lines += ["MOTION", f"Frames: {len(channels)}", f"Frame Time: {1 / rate:.9f}"]
    lines += [" ".join(f"{value:.6f}" for value in row) for row in channels]
    return "\n".join(lines) + "\n"


def _hierarchy(rig: Rig, i: int, depth: int, lines: list[str]) -> None:
    node, inset = rig.nodes[i], "\t" * depth
    x, y, z = rig.offsets[i] * _PER_UNIT
    channels = f"6 Xposition Yposition Zposition {_TURNS}" if depth == 0 else f"3 {_TURNS}"
    lines += [f"{inset}{'JOINT' if depth else 'ROOT'} {node.name}", f"{inset}{{"]
    lines += [f"{inset}\tOFFSET {x:.6f} {y:.6f} {z:.6f}", f"{inset}\tCHANNELS {channels}"]
    children = [c for c, other in enumerate(rig.nodes) if other.parent == i]
    for child in children:
        _hierarchy(rig, child, depth + 1, lines)
    if not children:
        x, y, z = rig.offsets[i] * _PER_UNIT / 4  # a tip, so that the end has a length to draw
        lines += [f"{inset}\tEnd Site", f"{inset}\t{{"]
        lines += [f"{inset}\t\tOFFSET {x:.6f} {y:.6f} {z:.6f}", f"{inset}\t}}"]
    lines.append(f"{inset}}}")


def _channels(rig: Rig) -> FloatArray:
    """(T, 3 + 3 N) values in the order of the hierarchy: depth first, as it is written."""
    columns = [rig.root * _PER_UNIT]
    for i in _depth_first(rig, 0):
        angles = Rotation.from_quat(rig.turns[:, i]).as_euler(_ORDER, degrees=True)
        columns.append(np.unwrap(angles, period=360, axis=0))
    channels: FloatArray = np.hstack(columns)
    return channels


def _depth_first(rig: Rig, i: int) -> list[int]:
    children = [c for c, other in enumerate(rig.nodes) if other.parent == i]
    return [i, *(node for child in children for node in _depth_first(rig, child))]
