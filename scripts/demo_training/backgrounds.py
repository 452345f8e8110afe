"""Procedural pictures to stand behind and in front of the figures: nothing in them is a person."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Image = npt.NDArray[np.uint8]


def _noise(rng: np.random.Generator, size: int) -> npt.NDArray[np.float32]:
    """Cloudy noise (size, size, 3) about 0."""
    out = np.zeros((size, size, 3), np.float32)
    roughness = rng.uniform(0.4, 0.95)
    cells, strength = int(rng.integers(2, 5)), 1.0
    while cells < size:
        channels = 3 if rng.random() < 0.4 else 1
        grid = rng.normal(0, strength, (cells, cells, channels)).astype(np.float32)
        layer = cv2.resize(grid, (size, size), interpolation=cv2.INTER_CUBIC)
        out += layer.reshape(size, size, channels)
        cells, strength = cells * 2, strength * roughness
    return out


def _colour(rng: np.random.Generator) -> list[int]:
    if rng.random() < 0.25:  # the tones of skin and wood, so that colour alone tells nothing
        base = np.array([170, 120, 90]) * rng.uniform(0.4, 1.3)
        return [int(c) for c in np.clip(base + rng.normal(0, 15, 3), 0, 255)]
    if rng.random() < 0.4:
        return [int(rng.integers(0, 256))] * 3
    return [int(c) for c in rng.integers(0, 256, 3)]


def _shapes(rng: np.random.Generator, image: Image) -> None:
    """Furniture, windows, poles, steps, blobs and sticks."""
    size = len(image)
    for _ in range(int(rng.integers(0, 22))):
        colour = _colour(rng)
        x, y = (int(v) for v in rng.integers(-20, size + 20, 2))
        kind = rng.integers(0, 6)
        if kind == 0:
            w, h = (int(v) for v in rng.integers(4, size // 2, 2))
            cv2.rectangle(image, (x, y), (x + w, y + h), colour, int(rng.choice([-1, 2, 5])))
        elif kind == 1:
            axes = tuple(int(v) for v in rng.integers(3, size // 4, 2))
            cv2.ellipse(image, (x, y), axes, float(rng.uniform(0, 180)), 0, 360, colour, -1)
        elif kind == 2:  # limb-like sticks
            for _ in range(int(rng.integers(1, 4))):
                step = rng.normal(0, size / 6, 2)
                to = (int(x + step[0]), int(y + step[1]))
                cv2.line(image, (x, y), to, colour, int(rng.integers(2, 14)), cv2.LINE_AA)
                x, y = to
        elif kind == 3:
            corners = rng.normal(0, size / 6, (int(rng.integers(3, 8)), 2)) + np.array([x, y])
            cv2.fillPoly(image, [corners.astype(np.int32)], colour)
        elif kind == 4:
            gap, width = int(rng.integers(6, 40)), int(rng.integers(1, 10))
            vertical = rng.random() < 0.6
            for k in range(int(rng.integers(3, 20))):
                a = (x + k * gap, y) if vertical else (x, y + k * gap)
                b = (x + k * gap, y + size) if vertical else (x + size, y + k * gap)
                cv2.line(image, a, b, colour, width)
        else:
            horizon = int(rng.integers(size // 3, size))
            image[horizon:] = np.array(colour, np.uint8)


def background(rng: np.random.Generator, size: int) -> Image:
    """One picture (size, size, 3)."""
    base = np.array(_colour(rng), np.float32) + _noise(rng, size) * rng.uniform(2, 45)
    if rng.random() < 0.4:
        ramp = np.linspace(-1, 1, size, dtype=np.float32) * rng.uniform(10, 90)
        base += ramp[:, None, None] if rng.random() < 0.7 else ramp[None, :, None]
    image = np.clip(base, 0, 255).astype(np.uint8)
    _shapes(rng, image)
    if rng.random() < 0.5:
        image = cv2.GaussianBlur(image, (0, 0), float(rng.uniform(0.5, 4)))
    grain = rng.normal(0, rng.uniform(0, 8), image.shape)
    return np.clip(image + grain, 0, 255).astype(np.uint8)


def backgrounds(seed: int, count: int, size: int) -> Image:
    """(count, size, size, 3)."""
    rng = np.random.default_rng(seed)
    return np.stack([background(rng, size) for _ in range(count)])
