"""What the figure wears: colours and cuts of the body's shader, skirts, hair and head-dresses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from figure_renderer.body import Body
from figure_renderer.renderer import Mesh
from figure_renderer.rig import BONES

Array = npt.NDArray[np.float64]
RING, LEVELS = 72, 22


@dataclass(frozen=True)
class Skirt:
    """length: down the leg (1 = ankle). flare: metres added to the radius at the ankle."""

    length: float
    flare: float
    pleats: int
    pleat_depth: float
    uniforms: dict[str, Any]


@dataclass(frozen=True)
class Outfit:
    """Uniforms of the body's shader, and what is worn over it.

    headwear: (profile (N, 2) of radius and height above the head's centre, uniforms); ball: a bun
    or knot as (centre in head axes, radii, uniforms).
    """

    uniforms: dict[str, Any]
    skirt: Skirt | None = None
    headwear: list[tuple[Array, float, dict[str, Any]]] = field(default_factory=list)
    balls: list[tuple[Array, Array, dict[str, Any]]] = field(default_factory=list)
    tail: tuple[float, float, dict[str, Any]] | None = None

    def meshes(self, body: Body, rotation: Array, position: Array) -> list[Mesh]:
        """Everything worn that is not the body's own surface, in the world."""
        out = []
        head = BONES.index("head")
        scale = body.shape.stature / 1.68 * body.shape.head
        turn, at = rotation[head], position[head]
        if self.skirt is not None:
            out.append(_skirt(self.skirt, body, rotation, position))
        for profile, tilt, uniforms in self.headwear:
            lean = np.array(
                [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
            )
            mesh = lathe(profile * scale, uniforms)
            out.append(
                _moved(mesh, turn @ lean, at + turn @ (scale * np.array([0, 0.085, -0.008])))
            )
        for centre, radii, uniforms in self.balls:
            angle = np.linspace(-np.pi / 2, np.pi / 2, 9)
            mesh = lathe(np.stack([np.cos(angle), np.sin(angle)], 1), uniforms)
            radii = radii * scale
            mesh = Mesh(
                mesh.vertices * radii,
                _unit(mesh.normals / radii),
                mesh.uv,
                mesh.faces,
                uniforms,
                True,
            )
            out.append(_moved(mesh, turn, at + turn @ (centre * scale)))
        if self.tail is not None:
            out.append(_tail(self.tail, body, rotation, position, scale))
        return out


def _unit(v: Array) -> Array:
    out: Array = v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9)
    return out


def _moved(mesh: Mesh, turn: Array, to: Array) -> Mesh:
    return Mesh(
        mesh.vertices @ turn.T + to, mesh.normals @ turn.T, mesh.uv, mesh.faces, mesh.uniforms, True
    )


def sheet_faces(rows: int, columns: int) -> npt.NDArray[np.int32]:
    """Triangles of a grid of vertices."""
    i = np.arange((rows - 1) * columns).reshape(rows - 1, columns)[:, :-1].ravel()
    quads = np.stack([i, i + 1, i + columns, i + 1, i + columns + 1, i + columns], 1)
    return quads.reshape(-1, 3).astype(np.int32)


def sheet_normals(grid: Array) -> Array:
    """Normals (rows * columns, 3) of a grid (rows, columns, 3), closed along its columns."""
    along = np.gradient(grid, axis=0)
    wrapped = np.concatenate([grid[:, -2:-1], grid, grid[:, 1:2]], 1)
    around = (wrapped[:, 2:] - wrapped[:, :-2]) / 2
    return _unit(np.cross(along, around)).reshape(-1, 3)


def lathe(profile: Array, uniforms: dict[str, Any], *, sides: int = 25) -> Mesh:
    """A surface of revolution about y from (N, 2) radii and heights."""
    theta = np.linspace(0, 2 * np.pi, sides)
    r, y = profile[:, :1], profile[:, 1:]
    grid = np.stack([r * np.cos(theta), np.broadcast_to(y, (len(r), sides)), r * np.sin(theta)], -1)
    uv = np.stack(np.broadcast_arrays(theta / 6.2832, y), -1).reshape(-1, 2)
    normals = sheet_normals(grid)
    return Mesh(grid.reshape(-1, 3), normals, uv, sheet_faces(len(r), sides), uniforms, True)


def _skirt(skirt: Skirt, body: Body, rotation: Array, position: Array) -> Mesh:
    """A cloth hung from the waist around both legs.

    At each level it is the convex hull, seen from above, of the two legs at that length and of a
    cone around their middle; a lifted leg lifts the cloth on its side.
    """
    at = dict(zip(BONES, position, strict=True))
    size = body.shape.stature / 1.68
    girth, hips = size * body.shape.girth, body.shape.hips
    turn = rotation[BONES.index("pelvis")]
    theta = np.linspace(0, 2 * np.pi, RING)
    waist = at["pelvis"] + turn @ np.array([0, 0.085 * size, 0])
    across, ahead = turn[:, 0].copy(), turn[:, 2].copy()
    grid = np.empty((LEVELS, RING, 3))
    pleat = 1 + skirt.pleat_depth * np.cos(skirt.pleats * theta)
    for k, t in enumerate(np.linspace(0, 1, LEVELS)):
        down = t * skirt.length  # along the leg, 0 hip, 1 ankle
        legs = [_leg_point(at, side, down) for side in ("left", "right")]
        middle = (legs[0] + legs[1]) / 2
        centre = waist + (middle - waist) * min(1.0, t * 4) if t < 0.25 else middle
        # Rings turn from the pelvis's axes to level ones.
        level = min(1.0, down * 1.2)
        x = _unit(across * (1 - level) + level * _unit(across * np.array([1, 0, 1])))
        z = _unit(ahead * (1 - level) + level * _unit(np.cross(x, [0.0, 1.0, 0.0])))
        directions = np.cos(theta)[:, None] * x + np.sin(theta)[:, None] * z
        cone = (0.125 + 0.035 * min(1, t * 6)) * girth * hips + skirt.flare * down
        radius = np.full(RING, cone)
        if t < 0.2:
            flat = np.sqrt(np.cos(theta) ** 2 + (0.78 * np.sin(theta)) ** 2)
            radius = radius * (flat + (1 - flat) * t / 0.2)
        lift = np.zeros(RING)
        for leg in legs:
            reach = directions @ (leg - centre) + (0.105 - 0.035 * min(down, 1)) * girth
            weight = 1 / (1 + np.exp(-np.clip((reach - radius) / 0.03, -30, 30)))
            lift = lift + weight * (leg[1] - centre[1])
            radius = np.logaddexp(radius / 0.02, reach / 0.02) * 0.02
        radius = radius * (1 + (pleat - 1) * min(1, 1.5 * t))
        grid[k] = centre + radius[:, None] * directions
        grid[k, :, 1] += lift
    grid[:, :, 1] = np.maximum(grid[:, :, 1], 0.006)
    around = theta / 6.2832 * (1.2 if skirt.length > 0.5 else 0.8)
    uv = np.stack(
        np.broadcast_arrays(around[None, :], np.linspace(0, 1, LEVELS)[:, None]), -1
    ).reshape(-1, 2)
    normals = sheet_normals(grid)
    return Mesh(grid.reshape(-1, 3), normals, uv, sheet_faces(LEVELS, RING), skirt.uniforms, True)


def _leg_point(at: dict[str, Array], side: str, down: float) -> Array:
    hip, knee, foot = at[f"{side}_thigh"], at[f"{side}_shin"], at[f"{side}_foot"]
    if down < 0.5:
        return hip + (knee - hip) * down * 2
    return knee + (foot - knee) * (down - 0.5) * 2


def _tail(
    tail: tuple[float, float, dict[str, Any]],
    body: Body,
    rotation: Array,
    position: Array,
    scale: float,
) -> Mesh:
    """Long hair: a tapered rope from the back of the head, hanging down the back."""
    length, width, uniforms = tail
    head, chest = BONES.index("head"), BONES.index("chest")
    start = position[head] + rotation[head] @ (scale * np.array([0, 0.09, -0.09]))
    nape = position[head] + rotation[head] @ (scale * np.array([0, -0.03, -0.1]))
    back = position[chest] + rotation[chest] @ (scale * np.array([0, 0.28 - length, -0.14]))
    t = np.linspace(0, 1, 12)[:, None]
    path = (1 - t) ** 2 * start + 2 * t * (1 - t) * nape + t**2 * back
    radius = width * np.sqrt(np.clip(t * 6, 0.05, 1)) * (1 - 0.75 * t)
    theta = np.linspace(0, 2 * np.pi, 13)
    x, z = rotation[head][:, 0], rotation[head][:, 2]
    ring = np.cos(theta)[:, None] * x + 0.6 * np.sin(theta)[:, None] * z
    grid = path[:, None] + radius[:, None] * ring[None]
    uv = np.stack(np.broadcast_arrays(theta[None] * 3, t * 2), -1).reshape(-1, 2)
    return Mesh(grid.reshape(-1, 3), sheet_normals(grid), uv, sheet_faces(12, 13), uniforms, True)
