"""The parts a body is made of: tapered capsules and ellipsoids around the resting bones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from figure_renderer.rig import BONES, rest_direction

Array = npt.NDArray[np.float64]
SMOOTHING_M, FINE_SMOOTHING_M = 0.018, 0.005


@dataclass(frozen=True)
class Shape:
    """Proportions. stature in metres; the others are factors about 1 (bust: 0 to 1)."""

    stature: float = 1.68
    girth: float = 1.0
    legs: float = 1.0
    arms: float = 1.0
    shoulders: float = 1.0
    hips: float = 1.0
    head: float = 1.0
    bust: float = 0.6

    @staticmethod
    def random(rng: np.random.Generator) -> Shape:
        female = rng.random() < 0.6
        return Shape(
            stature=rng.normal(1.63 if female else 1.74, 0.07),
            girth=float(np.clip(rng.normal(1.03, 0.13), 0.8, 1.45)),
            legs=rng.normal(1.0, 0.03),
            arms=rng.normal(1.0, 0.03),
            shoulders=rng.normal(0.96 if female else 1.08, 0.05),
            hips=rng.normal(1.03 if female else 0.95, 0.06),
            head=rng.normal(1.0, 0.05),
            bust=rng.uniform(0.3, 1.0) if female else 0.0,
        )


class Solids:
    """Signed distances of the body's parts at points (N, 3)."""

    def __init__(self, points: Array) -> None:
        self.points = points
        self.parts: list[tuple[int, Array]] = []

    def capsule(
        self, bone: str, a: Array, b: Array, ra: float, rb: float, squash: float = 1.0
    ) -> None:
        """A tapered capsule; squash < 1 flattens it front to back."""
        scale = np.array([1.0, 1.0, 1.0 / squash])
        p, a, b = self.points * scale, np.asarray(a) * scale, np.asarray(b) * scale
        axis = b - a
        t = np.clip((p - a) @ axis / (axis @ axis), 0, 1)
        distance = np.linalg.norm(p - a - t[:, None] * axis, axis=1) - (ra + (rb - ra) * t)
        self.parts.append((BONES.index(bone), distance))

    def ellipsoid(self, bone: str, centre: Array, radii: tuple[float, float, float]) -> None:
        r = np.array(radii)
        d = self.points - centre
        k0 = np.linalg.norm(d / r, axis=1)
        k1 = np.linalg.norm(d / r**2, axis=1)
        distance = k0 * (k0 - 1) / np.maximum(k1, 1e-9)
        self.parts.append((BONES.index(bone), distance))

    def union(self) -> Array:
        """Smooth union; hands, feet and face, whose parts are thin, are blended less."""
        stacked = np.stack([d for _, d in self.parts])
        nearest = stacked.min(0)
        fine = np.array([BONES[bone].endswith(("hand", "foot", "head")) for bone, _ in self.parts])
        near_fine = stacked[fine].min(0) - stacked[~fine].min(0)
        mix = np.clip(0.5 - near_fine / 0.04, 0, 1)
        smoothing = SMOOTHING_M + (FINE_SMOOTHING_M - SMOOTHING_M) * mix
        total = np.exp(-np.minimum((stacked - nearest) / smoothing, 50)).sum(0)
        return nearest - smoothing * np.log(total)

    def of_bone(self) -> Array:
        """(N, B) distance to each bone's own parts."""
        out = np.full((len(self.points), len(BONES)), 9.0)
        for bone, d in self.parts:
            out[:, bone] = np.minimum(out[:, bone], d)
        return out


def body_solids(points: Array, shape: Shape, joints: Array) -> Solids:
    """All parts. Radii are those of a slim adult of 1.68 m, times stature and girth; the smooth
    union adds about a centimetre where parts meet."""
    s = shape.stature / 1.68
    g = s * shape.girth
    at = dict(zip(BONES, joints, strict=True))
    solid = Solids(points)

    def up(bone: str, x: float, y: float, z: float) -> Array:
        return at[bone] + s * np.array([x, y, z])

    # Trunk: pelvis, waist, ribs, shoulders.
    w = shape.hips
    solid.ellipsoid("pelvis", up("pelvis", 0, -0.02, -0.005), (0.145 * g * w, 0.105 * s, 0.095 * g))
    for sign in (1, -1):
        solid.ellipsoid(
            "pelvis", up("pelvis", sign * 0.062 * w, -0.055, -0.05), (0.07 * g, 0.08 * s, 0.068 * g)
        )
    solid.ellipsoid("spine", up("spine", 0, 0.01, 0.008), (0.112 * g, 0.11 * s, 0.08 * g))
    rib = 0.128 * g * (0.6 + 0.4 * shape.shoulders)
    solid.ellipsoid("chest", up("chest", 0, 0.07, 0.005), (rib, 0.14 * s, 0.092 * g))
    solid.ellipsoid("chest", up("chest", 0, 0.15, -0.012), (rib * 1.05, 0.075 * s, 0.075 * g))
    for sign in (1, -1):
        if shape.bust > 0:
            r = 0.048 * g * (0.8 + 0.4 * shape.bust)
            out = 0.055 + 0.02 * shape.bust
            solid.ellipsoid("chest", up("chest", sign * 0.06, 0.075, out), (r, r, r * 0.9))
    # Head and neck; the face is a second, narrower ellipsoid with a nose.
    h = s * shape.head
    head = at["head"]
    solid.capsule(
        "neck", up("neck", 0, -0.03, 0), head + h * np.array([0, 0.02, 0.0]), 0.047 * g, 0.043 * g
    )
    solid.ellipsoid(
        "head", head + h * np.array([0, 0.088, -0.008]), (0.066 * h, 0.08 * h, 0.085 * h)
    )
    solid.ellipsoid("head", head + h * np.array([0, 0.03, 0.03]), (0.05 * h, 0.078 * h, 0.062 * h))
    solid.capsule(
        "head",
        head + h * np.array([0, 0.06, 0.085]),
        head + h * np.array([0, 0.037, 0.1]),
        0.005 * h,
        0.009 * h,
    )
    for sign, side in ((1, "left"), (-1, "right")):
        solid.ellipsoid(
            "head",
            head + h * np.array([sign * 0.07, 0.052, -0.005]),
            (0.009 * h, 0.026 * h, 0.016 * h),
        )
        _arm(solid, at, side, s, g)
        _leg(solid, at, side, sign, s, g, w)
    return solid


def _arm(solid: Solids, at: dict[str, Array], side: str, s: float, g: float) -> None:
    shoulder, elbow = at[f"{side}_upper_arm"], at[f"{side}_forearm"]
    wrist = at[f"{side}_hand"]
    along = rest_direction(f"{side}_hand")
    solid.capsule(
        f"{side}_collar",
        at[f"{side}_collar"] + s * np.array([0, -0.012, -0.01]),
        shoulder + s * np.array([0, 0.0, 0]),
        0.042 * g,
        0.046 * g,
    )
    middle = shoulder + 0.45 * (elbow - shoulder)
    solid.capsule(f"{side}_upper_arm", shoulder, middle, 0.047 * g, 0.042 * g)
    solid.capsule(f"{side}_upper_arm", middle, elbow, 0.042 * g, 0.034 * g)
    muscle = elbow + 0.28 * (wrist - elbow)
    solid.capsule(f"{side}_forearm", elbow, muscle, 0.034 * g, 0.037 * g)
    solid.capsule(f"{side}_forearm", muscle, wrist, 0.037 * g, 0.022 * g)
    # Hand: palm down, thumb forward.
    forward = np.array([0.0, 0.0, 1.0])
    knuckles = wrist + 0.085 * s * along
    for k, (z, length) in enumerate(((0.03, 0.075), (0.01, 0.085), (-0.01, 0.078), (-0.03, 0.06))):
        base = knuckles + s * z * forward
        solid.capsule(f"{side}_hand", wrist + s * 0.5 * z * forward, base, 0.013 * s, 0.012 * s)
        tip = base + length * s * along + s * 0.012 * (1.5 - k) * forward * 0.6
        solid.capsule(f"{side}_hand", base, tip, 0.0085 * s, 0.0065 * s)
    thumb = wrist + s * (0.045 * along + 0.052 * forward)
    solid.capsule(f"{side}_hand", wrist + s * 0.012 * forward, thumb, 0.013 * s, 0.01 * s)
    solid.capsule(
        f"{side}_hand", thumb, thumb + s * (0.05 * along + 0.02 * forward), 0.0095 * s, 0.007 * s
    )


def _leg(
    solid: Solids, at: dict[str, Array], side: str, sign: int, s: float, g: float, w: float
) -> None:
    hip, knee, ankle = at[f"{side}_thigh"], at[f"{side}_shin"], at[f"{side}_foot"]

    def off(base: Array, x: float, y: float, z: float) -> Array:
        return base + s * np.array([sign * x, y, z])

    thigh = f"{side}_thigh"
    solid.capsule(
        thigh, off(hip, 0.006, -0.02, 0), off(hip, 0, -0.2, 0.01), 0.074 * g * w, 0.064 * g
    )
    solid.capsule(thigh, off(hip, 0, -0.2, 0.01), knee, 0.064 * g, 0.052 * g)
    shin = f"{side}_shin"
    calf = off(knee, 0, -0.13, -0.02)
    solid.capsule(shin, knee, calf, 0.051 * g, 0.053 * g)
    solid.capsule(shin, calf, ankle, 0.053 * g, 0.034 * g)
    foot = f"{side}_foot"
    solid.capsule(
        foot, off(ankle, 0, -0.01, 0), off(ankle, 0, -0.045, -0.025), 0.031 * s, 0.029 * s
    )
    ball = off(ankle, 0.008, -0.058, 0.11)
    solid.capsule(foot, off(ankle, 0, -0.03, 0.01), ball, 0.032 * s, 0.02 * s)
    for x, z, r in (
        (-0.02, 0.18, 0.0115),
        (0.002, 0.178, 0.009),
        (0.02, 0.168, 0.0085),
        (0.036, 0.15, 0.008),
    ):
        solid.capsule(
            foot, off(ball, x * 0.6, -0.002, 0), off(ankle, x, -0.07, z), 0.016 * s, r * s
        )
