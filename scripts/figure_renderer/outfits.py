"""Random clothes: street and practice wear, dresses, and costumes with skirts and head-dresses."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from figure_renderer.body import Body
from figure_renderer.clothes import Outfit, Skirt
from figure_renderer.rig import BONES

Array = npt.NDArray[np.float64]
Rng = np.random.Generator
_SKINS = np.array(
    [
        [0.82, 0.58, 0.46],
        [0.68, 0.43, 0.3],
        [0.5, 0.28, 0.17],
        [0.3, 0.15, 0.09],
        [0.12, 0.06, 0.04],
    ]
)
_GOLD = (0.9, 0.6, 0.15)


def random_colour(rng: Rng) -> Array:
    """Linear RGB; often grey, black or white, as clothes are."""
    kind = rng.random()
    if kind < 0.2:
        return np.full(3, rng.uniform(0.005, 0.06)) * rng.uniform(0.8, 1.2, 3)
    if kind < 0.32:
        return np.full(3, rng.uniform(0.5, 0.9)) * rng.uniform(0.9, 1.05, 3)
    if kind < 0.42:
        return np.full(3, rng.uniform(0.06, 0.5)) * rng.uniform(0.9, 1.1, 3)
    hue, saturation, value = rng.random(), rng.uniform(0.2, 1.0), rng.uniform(0.08, 0.9)
    wheel = np.clip(np.abs((hue * 6 + np.array([0.0, 4.0, 2.0])) % 6 - 3) - 1, 0, 1)
    out: Array = (value * (1 - saturation * (1 - wheel))) ** 1.8
    return out


def _pattern(rng: Rng) -> tuple[float, float]:
    kind = int(rng.choice(6, p=[0.5, 0.1, 0.1, 0.14, 0.08, 0.08]))
    return float(kind), float(rng.uniform(4, 30))


def random_surface(rng: Rng, kind: int, **values: Any) -> dict[str, Any]:
    colour = random_colour(rng)
    return {
        "kind": kind,
        "colour_a": colour,
        "colour_b": random_colour(rng) if rng.random() < 0.6 else colour * 0.6,
        "pattern": _pattern(rng),
        "finish": (float(rng.uniform(0, 0.5)), 0.0),
        "trim": random_colour(rng),
        "planks": 0.0,
        **values,
    }


def gold(rng: Rng | None = None) -> dict[str, Any]:
    """A golden surface."""
    shift = np.ones(3) if rng is None else rng.uniform(0.8, 1.2, 3)
    return {
        "kind": 0,
        "colour_a": np.array(_GOLD) * shift,
        "colour_b": np.array([0.75, 0.42, 0.1]) * shift,
        "pattern": (0.0, 1.0),
        "finish": (0.9, 0.8),
        "trim": _GOLD,
        "planks": 0.0,
    }


def hair_surface(colour: Array) -> dict[str, Any]:
    return {
        "kind": 0,
        "colour_a": colour,
        "colour_b": colour * 0.7,
        "pattern": (3.0, 40.0),
        "finish": (0.45, 0.0),
        "trim": colour,
        "planks": 0.0,
    }


def crown(tiers: int, height: float, width: float) -> Array:
    """Profile of a tiered, tapering head-dress with a spire."""
    steps = [(width * 0.9, 0.0), (width, 0.02)]
    for k in range(1, tiers + 1):
        r, y = width * (1 - k / (tiers + 1.5)), 0.02 + height * 0.6 * k / tiers
        steps += [(r * 1.02 + 0.006, y - 0.012), (r * 1.1 + 0.006, y - 0.004), (r, y)]
    steps += [(0.02, height * 0.75), (0.01, height), (0.0, height * 1.15)]
    return np.array(steps)


def body_landmarks(body: Body) -> dict[str, float]:
    """Heights over stature at which clothes begin and end."""
    at = dict(zip(BONES, body.joints, strict=True))
    s = body.shape.stature
    return {
        "neck": float(at["neck"][1] / s + 0.01),
        "ribs": float(at["chest"][1] / s),
        "waist": float((at["pelvis"][1] + 0.06) / s),
        "hips": float(at["left_thigh"][1] / s),
    }


def base_uniforms(body: Body) -> dict[str, Any]:
    """The body's shader for someone in nothing but skin and short hair."""
    head, mark = body.joints[BONES.index("head")], body_landmarks(body)
    black = np.zeros(3)
    return {
        "cut": (-1.0, 2.0, mark["waist"], -1.0),
        "thickness": (0.004, 0.008, 0.012, 0.0),
        "landmarks": (mark["neck"], head[1], head[2], body.shape.stature / 1.68 * body.shape.head),
        "neckline": (mark["neck"] - 0.03, 0.3),
        "skin": _SKINS[2],
        "hair": np.array([0.02, 0.015, 0.012]),
        "top_a": black,
        "top_b": black,
        "bottom_a": black,
        "bottom_b": black,
        "shoe": (-1.0, 0.0, 0.0),
        "gold": _GOLD,
        "lips": np.array([0.5, 0.1, 0.1]),
        "top_pattern": (0.0, 1.0),
        "bottom_pattern": (0.0, 1.0),
        "has_hair": 1.0,
        "jewels": 0.0,
        "sash": 0.0,
        "wrinkle": 0.3,
    }


def random_outfit(rng: Rng, body: Body) -> Outfit:
    """Street and practice clothes, dresses, and costumes with long skirts and head-dresses."""
    mark, values = body_landmarks(body), base_uniforms(body)
    tone = rng.uniform(0, len(_SKINS) - 1.001)
    low = int(tone)
    skin = _SKINS[low] + (tone - low) * (_SKINS[low + 1] - _SKINS[low])
    hair = np.array([0.03, 0.02, 0.015]) if rng.random() < 0.6 else random_colour(rng) * 0.6
    kind = rng.choice(["costume", "trousers", "shorts", "dress", "one colour", "bare"],
                      p=[0.26, 0.34, 0.12, 0.12, 0.12, 0.04])  # fmt: skip
    top, bottom = random_colour(rng), random_colour(rng)
    values |= {
        "skin": skin,
        "hair": hair,
        "lips": skin * np.array([0.95, 0.5, 0.5]),
        "top_a": top,
        "top_b": random_colour(rng),
        "bottom_a": bottom,
        "bottom_b": random_colour(rng),
        "top_pattern": _pattern(rng),
        "bottom_pattern": _pattern(rng),
        "wrinkle": float(rng.uniform(0.1, 0.6)),
        "has_hair": float(rng.random() < 0.94),
        "neckline": (mark["neck"] - rng.uniform(-0.01, 0.06), rng.uniform(0.1, 0.6)),
        "thickness": (
            rng.uniform(0.002, 0.025),
            rng.uniform(0.002, 0.04),
            rng.uniform(0.004, 0.035),
            0.008,
        ),
    }
    sleeve = float(rng.choice([-0.05, 0.3, 0.5, 1.0]) + rng.uniform(-0.04, 0.04))
    trouser = float(rng.choice([0.4, 0.75, 1.0], p=[0.2, 0.2, 0.6]) + rng.uniform(-0.05, 0.03))
    skirt = None
    hem = mark["hips"] + rng.uniform(-0.03, 0.04)
    if kind == "costume":
        hem = mark["ribs"] + rng.uniform(-0.06, 0.02) if rng.random() < 0.6 else hem
        values["jewels"] = float(rng.random() < 0.7)
        values["sash"] = float(rng.choice([0.0, 0.012, 0.03]))
        if rng.random() < 0.7:
            skirt = _random_skirt(rng, (0.7, 1.0), bottom)
    elif kind == "dress":
        hem = mark["waist"] - 0.02
        skirt = _random_skirt(rng, (0.25, 1.0), top if rng.random() < 0.7 else bottom)
        trouser = -1.0
    elif kind == "shorts":
        trouser = float(rng.uniform(0.15, 0.5))
    elif kind == "one colour":
        values |= {"bottom_a": top, "bottom_b": values["top_b"]}
        values["bottom_pattern"] = values["top_pattern"]
    elif kind == "bare":
        hem = 2.0
    values["cut"] = (sleeve if hem < 1 else -1.0, hem, mark["waist"] + 0.01, trouser)
    if rng.random() < 0.35:
        values["shoe"] = random_colour(rng)
    return Outfit(values, skirt, *_random_head(rng, kind == "costume", hair))


def _random_skirt(rng: Rng, length: tuple[float, float], colour: Array) -> Skirt:
    uniforms = random_surface(rng, 3, colour_a=colour, pattern=_pattern(rng))
    if rng.random() < 0.5:
        uniforms["trim"] = colour
    return Skirt(
        length=float(rng.uniform(*length)),
        flare=float(rng.uniform(0.0, 0.28)),
        pleats=int(rng.integers(6, 26)),
        pleat_depth=float(rng.uniform(0, 0.09)),
        uniforms=uniforms,
    )


def _random_head(rng: Rng, costume: bool, hair: Array) -> tuple[list[Any], list[Any], Any]:
    headwear: list[Any] = []
    balls: list[Any] = []
    tail = None
    stuff = hair_surface(hair)
    if costume and rng.random() < 0.6:
        metal = gold(rng) if rng.random() < 0.7 else random_surface(rng, 0)
        profile = crown(int(rng.integers(1, 5)), rng.uniform(0.08, 0.3), rng.uniform(0.07, 0.11))
        headwear.append((profile, float(rng.uniform(-0.35, 0.1)), metal))
    elif rng.random() < 0.1:  # a hat or a scarf
        brim = rng.uniform(0.09, 0.17)
        profile = np.array(
            [(0.08, -0.005), (brim, 0.005), (0.093, 0.02), (0.08, 0.07), (0.0, 0.085)]
        )
        headwear.append((profile, float(rng.uniform(-0.2, 0.2)), random_surface(rng, 0)))
    if rng.random() < 0.35:
        r = rng.uniform(0.03, 0.06)
        centre = np.array([0.0, rng.uniform(0.03, 0.17), -rng.uniform(0.07, 0.12)])
        balls.append((centre, np.array([r, r, r * 0.8]), stuff))
    if rng.random() < 0.3:
        tail = (float(rng.uniform(0.05, 0.4)), float(rng.uniform(0.025, 0.09)), stuff)
    return headwear, balls, tail
