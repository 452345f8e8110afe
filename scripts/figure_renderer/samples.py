"""Random dancers: bodies, clothes, light, places and cameras for training and testing models."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from figure_renderer.body import Body, build_body
from figure_renderer.outfits import random_colour, random_outfit, random_surface
from figure_renderer.renderer import Actor, Camera, Light, Mesh, Renderer
from figure_renderer.rig import BONES, Performance
from figure_renderer.solids import Shape

Array = npt.NDArray[np.float64]
Rng = np.random.Generator
PICTURE = 224
BODIES_AT_ONCE, SAMPLES_PER_BODY = 10, 250
# How often each kind of take is drawn, by the beginning of its name; the rest share what is left.
_KINDS = {"05": 0.22, "60": 0.2, "94": 0.16, "135": 0.14}


@dataclass(frozen=True)
class Sample:
    """picture: (224, 224, 3) uint8 RGB. mask: (224, 224) the figure's coverage. keypoints:
    (23, 2) px of coco23, hidden ones included. in_place: False where nothing but the figure is
    drawn, and the picture is black around it."""

    picture: npt.NDArray[np.uint8]
    mask: npt.NDArray[np.uint8]
    keypoints: Array
    in_place: bool


def random_light(rng: Rng) -> Light:
    """Daylight, a room, or a stage with coloured light."""
    azimuth, height = rng.uniform(0, 2 * np.pi), rng.uniform(0.15, 1.5)
    direction = np.array([np.sin(azimuth), height, np.cos(azimuth)])
    tint = rng.uniform(0.75, 1.15, 3) if rng.random() < 0.75 else 0.15 + 1.1 * random_colour(rng)
    grey = rng.uniform(0.08, 0.6)
    return Light(
        direction=direction,
        key=rng.uniform(0.3, 2.6) * tint,
        sky=grey * rng.uniform(0.8, 1.2, 3),
        ground=grey * rng.uniform(0.3, 0.8) * rng.uniform(0.8, 1.2, 3),
        fill=rng.uniform(0.0, 0.35) * rng.uniform(0.8, 1.2, 3),
        pool=(0.0, 0.0, float(rng.uniform(1.5, 5)), float(rng.random() < 0.2) * 0.8),
    )


def quad(
    corners: Sequence[Sequence[float]], normal: Sequence[float], uniforms: dict[str, Any]
) -> Mesh:
    """A flat rectangle that casts no shadow."""
    return Mesh(
        np.array(corners, dtype=float),
        np.tile(np.array(normal, dtype=float), (4, 1)),
        np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]),
        np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
        uniforms,
        casts=False,
    )


def _random_place(rng: Rng, camera: Camera) -> list[Mesh]:
    """A floor, and a wall behind the figure as the camera sees it."""
    scale = (float(rng.choice([0, 0, 2, 3, 3, 4, 5])), float(rng.uniform(0.5, 5)))
    planks = float(rng.random() < 0.3) * rng.uniform(0.07, 0.25)
    floor = quad(
        [(-30, 0, -30), (30, 0, -30), (30, 0, 30), (-30, 0, 30)],
        (0, 1, 0),
        random_surface(rng, 1, pattern=scale, planks=planks),
    )
    away = -camera.eye * np.array([1.0, 0.0, 1.0])
    away /= np.linalg.norm(away)
    side = np.cross(away, [0.0, 1.0, 0.0])
    middle = away * rng.uniform(1.0, 6.0)
    corners = [
        middle + side * x + np.array([0, y, 0])
        for x, y in ((-25, -1), (25, -1), (25, 14), (-25, 14))
    ]
    kind = 2 if rng.random() < 0.25 else 4
    pattern = (float(rng.choice([0, 0, 1, 2, 3, 3, 5])), float(rng.uniform(0.4, 4)))
    finish = random_surface(rng, kind, pattern=pattern)
    finish["trim"] = (9.0, 9.1, 0.0) if kind == 2 else finish["trim"]
    return [floor, quad([list(c) for c in corners], list(-away), finish)]


def _random_camera(rng: Rng, points: Array, facing: float, size: int) -> Camera:
    """A camera that frames the points, more often seen from the front."""
    azimuth = rng.uniform(-np.pi, np.pi) if rng.random() < 0.55 else rng.normal(0, 0.7)
    height = rng.uniform(-0.12, 0.45) if rng.random() < 0.93 else rng.uniform(0.45, 1.1)
    azimuth += facing
    distance = np.exp(rng.uniform(np.log(1.9), np.log(9.0)))
    middle = (points.min(0) + points.max(0)) / 2
    eye = middle + distance * np.array(
        [np.sin(azimuth) * np.cos(height), np.sin(height), np.cos(azimuth) * np.cos(height)]
    )
    eye[1] = max(eye[1], 0.1)
    roll = rng.normal(0, 0.04)
    probe = Camera.looking_at(eye, middle, 100.0, (size, size), roll)
    seen = probe.project(points)
    extent = float((seen.max(0) - seen.min(0)).max())
    focal = 100.0 * size * rng.uniform(0.66, 0.84) / extent
    centre = (seen.max(0) + seen.min(0)) / 2 - (size - 1) / 2
    # Turn the camera so that the figure is near the middle of the picture.
    ray = np.array([*(centre / 100.0), 1.0]) @ probe.rotation
    aim = eye + ray * np.linalg.norm(middle - eye)
    jitter = rng.normal(0, 0.02, 3) * extent / 100.0 * distance
    return Camera.looking_at(eye, aim + jitter, focal, (size, size), roll)


class SampleMaker:
    """Renders one random dancer after another; the same seed gives the same samples."""

    def __init__(self, takes: Sequence[Performance], *, size: int = PICTURE, cell_m: float = 0.016):
        self.takes, self.size, self.cell = list(takes), size, cell_m
        self.renderer = Renderer((size, size), supersample=1, shadow_size=384, soft_shadows=False)
        self.weights = _take_weights(self.takes)

    def samples(self, seed: int) -> Iterator[Sample]:
        rng = np.random.default_rng(seed)
        bodies: list[Body] = []
        made = 0
        while True:
            if (
                len(bodies) < BODIES_AT_ONCE and made >= 20 * len(bodies)
            ) or made % SAMPLES_PER_BODY == 0:
                bodies.append(build_body(Shape.random(rng), cell_m=self.cell))
                if len(bodies) > BODIES_AT_ONCE:
                    self.renderer.forget(bodies.pop(0))
            yield self._sample(rng, bodies[rng.integers(len(bodies))])
            made += 1

    def _sample(self, rng: Rng, body: Body) -> Sample:
        take = self.takes[rng.choice(len(self.takes), p=self.weights)]
        rotation = loosened(rng, take.rotation[rng.integers(len(take))])
        position = on_floor(body, rotation)
        keypoints = body.posed_keypoints(rotation, position)
        crown_top = position[BONES.index("head")] + rotation[BONES.index("head")] @ [0, 0.2, 0]
        facing = float(np.arctan2(rotation[0, 0, 2], rotation[0, 2, 2]))
        camera = _random_camera(rng, np.vstack([keypoints, crown_top]), facing, self.size)
        outfit = random_outfit(rng, body)
        in_place = bool(rng.random() < 0.5)
        place = _random_place(rng, camera) if in_place else []
        picture, mask = self.renderer.draw(
            [Actor(body, rotation, position, outfit.uniforms)],
            [*outfit.meshes(body, rotation, position), *place],
            camera,
            random_light(rng),
            shadow_centre=position[0],
        )
        return Sample(picture, mask, camera.project(keypoints), in_place)


def on_floor(body: Body, rotation: Array) -> Array:
    """Joints of the posed body over the origin, its lowest foot on the floor."""
    position = body.posed_joints(rotation, np.array([0.0, 1.0, 0.0]))
    lowest = body.posed_keypoints(rotation, position)[:, 1].min() - 0.02
    return position - np.array([0.0, lowest, 0.0])


def loosened(rng: Rng, rotation: Array) -> Array:
    """The pose with the limbs and the head turned a little, so that no two samples are alike."""
    out = rotation.copy()
    spread = 0.12 if rng.random() < 0.7 else 0.35
    for bone, name in enumerate(BONES):
        if name.endswith(("head", "upper_arm", "forearm", "hand", "thigh", "shin", "foot")):
            factor = {"head": 1.6, "hand": 1.6, "thigh": 0.6, "shin": 0.6}.get(
                name.split("_")[-1], 1.0
            )
            axis = rng.normal(0, spread * factor, 3)
            angle = np.linalg.norm(axis)
            k = axis / angle
            skew = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
            turn = np.eye(3) + np.sin(angle) * skew + (1 - np.cos(angle)) * skew @ skew
            out[bone] = out[bone] @ turn
    return out


def _take_weights(takes: Sequence[Performance]) -> Array:
    kinds = [next((k for k in _KINDS if t.name.startswith(k + "_")), "") for t in takes]
    shares = {k: v for k, v in _KINDS.items() if k in kinds}
    shares[""] = 1 - sum(shares.values())
    weights = np.array([float(shares[k] * len(t)) for k, t in zip(kinds, takes, strict=True)])
    for kind in set(kinds):
        members = np.array([k == kind for k in kinds])
        weights[members] *= shares[kind] / weights[members].sum()
    out: Array = weights / weights.sum()
    return out
