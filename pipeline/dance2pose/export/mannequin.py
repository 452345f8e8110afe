"""A jointed mannequin around the bones of a rig: rounded limbs, a trunk, a head, hands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from dance2pose.export.rig import Rig, rest_directions
from dance2pose.poses import FloatArray
from dance2pose.skeleton import Skeleton

Side = Literal["middle", "left", "right"]
SIDES: tuple[Side, ...] = ("middle", "left", "right")

_SIDES_AROUND = 12
_RINGS_AT_END = 4
# Share of a limb over which its skin also follows the bone before it.
_BLEND = 0.12

# Radii at both ends of the limb that ends at a joint, as shares of the height of the body.
_LIMBS = {
    "elbow": (0.030, 0.023),
    "wrist": (0.023, 0.016),
    "knee": (0.050, 0.032),
    "ankle": (0.032, 0.022),
    "toe": (0.024, 0.017),
    "shoulder": (0.024, 0.032),
    "hip": (0.050, 0.052),
    "head": (0.026, 0.024),
}
_TRUNK = ((0.085, 0.060), (0.075, 0.055))  # half width, half depth; at the hips, at the neck
_HEAD = (0.047, 0.068, 0.056)
_HAND = (0.028, 0.018, 0.012)
# From the trunk's length to the height of the body, after Drillis and Contini.
_HEIGHT_PER_TRUNK = 1 / 0.288


@dataclass(frozen=True)
class Mesh:
    """Triangles in the rest pose, each vertex bound to nodes of the rig.

    positions, normals: (V, 3). triangles: (F, 3) by side of the body. nodes, weights: (V, 4).
    """

    positions: FloatArray
    normals: FloatArray
    triangles: dict[Side, npt.NDArray[np.int64]]
    nodes: npt.NDArray[np.int64]
    weights: FloatArray


@dataclass(frozen=True)
class _Part:
    positions: FloatArray
    normals: FloatArray
    triangles: npt.NDArray[np.int64]
    side: Side
    node: int
    before: int
    share_before: FloatArray


def make_mesh(rig: Rig, skeleton: Skeleton) -> Mesh:
    """The mannequin of a rig; sizes follow the length of its trunk."""
    height = rig.lengths[0] * _HEIGHT_PER_TRUNK
    rest, places = rest_directions(skeleton), _rest_positions(rig)
    parts = []
    for i, node in enumerate(rig.nodes):
        if node.bone is None:
            continue
        end = skeleton.joints[skeleton.bones[node.bone][1]]
        span = rest[node.bone] * rig.lengths[node.bone]
        kind = end.rsplit("_", 1)[-1]
        side = _side(end)
        if kind in _LIMBS:
            radii = [(r * height, r * height) for r in _LIMBS[kind]]
            parts.append(_limb(places[i], span, radii, side, i, node.parent))
        else:
            radii = [(a * height, b * height) for a, b in _TRUNK]
            parts.append(_limb(places[i], span, radii, side, i, 0))
        if kind == "head":
            parts.append(_ball(places[i] + span, _HEAD, height, side, i))
        if kind == "wrist":
            beyond = places[i] + span * (1 + 0.022 * height / max(np.linalg.norm(span), 1e-9))
            parts.append(_ball(beyond, _HAND, height, side, i))
    return _joined(parts)


def _side(joint: str) -> Side:
    return next((side for side in SIDES if joint.startswith(f"{side}_")), "middle")


def _rest_positions(rig: Rig) -> FloatArray:
    """(N, 3) places of the nodes at rest, the root at the origin."""
    places = np.zeros((len(rig.nodes), 3))
    for i, node in enumerate(rig.nodes):
        if node.parent >= 0:
            places[i] = places[node.parent] + rig.offsets[i]
    return places


def _limb(
    start: FloatArray,
    span: FloatArray,
    radii: list[tuple[float, float]],
    side: Side,
    node: int,
    before: int,
) -> _Part:
    """A tapered tube with round ends along `span`; radii: (across, through) at both ends."""
    length = float(np.linalg.norm(span))
    along = span / length if length > 0 else np.array([0.0, 1.0, 0.0])
    # Across is as near to x as can be, so that a trunk is wide from left to right.
    hint = np.array([1.0, 0, 0]) if abs(along[0]) < 0.9 else np.array([0, 1.0, 0])
    across = hint - (hint @ along) * along
    across /= np.linalg.norm(across)
    through = np.cross(along, across)
    (a0, b0), (a1, b1) = radii
    turn = np.linspace(0, np.pi / 2, _RINGS_AT_END + 1)
    # Height along the bone and share of the radius: round end, straight, round end.
    heights = np.concatenate([-min(a0, b0) * np.cos(turn), length + min(a1, b1) * np.sin(turn)])
    shrink = np.concatenate([np.sin(turn), np.cos(turn)])
    share = np.clip(heights / length if length > 0 else heights * 0, 0, 1)
    wide = (a0 + (a1 - a0) * share) * np.maximum(shrink, 1e-3)
    deep = (b0 + (b1 - b0) * share) * np.maximum(shrink, 1e-3)
    angle = np.linspace(0, 2 * np.pi, _SIDES_AROUND, endpoint=False)
    ring = np.cos(angle)[:, None] * across, np.sin(angle)[:, None] * through
    points = (
        start
        + heights[:, None, None] * along
        + wide[:, None, None] * ring[0]
        + deep[:, None, None] * ring[1]
    )
    follow = np.clip(0.5 - heights / max(_BLEND * length, 1e-9) / 2, 0, 0.5)
    return _tube(points, side, node, before, follow)


def _ball(
    centre: FloatArray, radii: tuple[float, ...], height: float, side: Side, node: int
) -> _Part:
    polar = np.linspace(0.02, np.pi - 0.02, 2 * _RINGS_AT_END)
    angle = np.linspace(0, 2 * np.pi, _SIDES_AROUND, endpoint=False)
    round_ = np.stack(
        [
            np.sin(polar)[:, None] * np.sin(angle),
            -np.cos(polar)[:, None] * np.ones_like(angle),
            np.sin(polar)[:, None] * np.cos(angle),
        ],
        axis=-1,
    )
    points = centre + round_ * np.array(radii) * height
    return _tube(points, side, node, node, np.zeros(len(points)))


def _tube(points: FloatArray, side: Side, node: int, before: int, follow: FloatArray) -> _Part:
    """Rings (R, S, 3) as triangles that face outwards. follow: (R,) weight of `before`."""
    rings, around = points.shape[:2]
    index = np.arange(rings * around).reshape(rings, around)
    low, high = index[:-1], index[1:]
    low_next, high_next = np.roll(low, -1, axis=1), np.roll(high, -1, axis=1)
    quads = np.stack([low, low_next, high_next, low, high_next, high], axis=-1)
    positions = points.reshape(-1, 3)
    triangles = quads.reshape(-1, 3)
    normals = _normals(positions, triangles)
    middle = positions.mean(axis=0)
    if ((positions - middle) * normals).sum() < 0:
        triangles, normals = triangles[:, ::-1], -normals
    return _Part(positions, normals, triangles, side, node, before, np.repeat(follow, around))


def _normals(positions: FloatArray, triangles: npt.NDArray[np.int64]) -> FloatArray:
    a, b, c = (positions[triangles[:, i]] for i in range(3))
    faces = np.cross(b - a, c - a)
    normals = np.zeros_like(positions)
    for i in range(3):
        np.add.at(normals, triangles[:, i], faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    upright = np.array([0.0, 1.0, 0.0])
    unit: FloatArray = np.where(length > 0, normals / np.where(length > 0, length, 1), upright)
    return unit


def _joined(parts: list[_Part]) -> Mesh:
    starts = np.cumsum([0, *(len(part.positions) for part in parts)])
    total = int(starts[-1])
    nodes, weights = np.zeros((total, 4), np.int64), np.zeros((total, 4))
    triangles: dict[Side, list[npt.NDArray[np.int64]]] = {side: [] for side in SIDES}
    for part, start in zip(parts, starts[:-1], strict=True):
        rows = slice(int(start), int(start) + len(part.positions))
        follow = part.share_before if part.before != part.node else np.zeros(len(part.positions))
        nodes[rows, 0] = part.node
        nodes[rows, 1] = np.where(follow > 0, part.before, 0)
        weights[rows, 0], weights[rows, 1] = 1 - follow, follow
        triangles[part.side].append(part.triangles + start)
    return Mesh(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        {side: np.concatenate(found) for side, found in triangles.items() if found},
        nodes,
        weights,
    )
