"""Synthetic dancers for the tests of the tracker: where they are is known, sights are staged."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dance2pose.poses import Boxes, Image, Poses2D, Track2D
from dance2pose.tracking.tracker import Tracker

WIDTH, HEIGHT = 640, 360
J = 17  # coco17

Path2D = Callable[[float], tuple[float, float]]


@dataclass(frozen=True)
class Actor:
    """Someone on the stage. place: centre px at a time in seconds. seen: whether at that time."""

    place: Path2D
    size: float = 100.0
    colour: tuple[int, int, int] = (128, 128, 128)
    seen: Callable[[float], bool] = lambda time_s: True

    def keypoints(self, time_s: float) -> np.ndarray:
        """(J, 2): a fixed body whose limbs swing."""
        body = np.random.default_rng(5).uniform(-0.5, 0.5, (J, 2))
        body[5], body[6], body[11], body[12] = (-0.2, -0.3), (0.2, -0.3), (-0.15, 0), (0.15, 0)
        swing = 0.06 * np.sin(6 * time_s + np.arange(J))[:, None] * (np.arange(J) > 6)[:, None]
        return (body + swing) * (0.45 * self.size, self.size) + self.place(time_s)

    def box(self, time_s: float) -> np.ndarray:
        half = np.array([0.25 * self.size, 0.5 * self.size])
        centre = np.array(self.place(time_s))
        return np.concatenate([centre - half, centre + half])


def times(rate: float, seconds: float) -> np.ndarray:
    return np.arange(round(rate * seconds)) / rate


def perform(
    actors: Sequence[Actor],
    time_s: np.ndarray,
    *,
    noise: float = 1.0,
    cuts: Sequence[int] = (),
    pictures: bool = False,
    seed: int = 0,
    tracker: Tracker | None = None,
) -> Tracker:
    """Show the actors to a tracker, every frame in another order, with noise in px."""
    rng = np.random.default_rng(seed)
    tracker = tracker or Tracker("coco17", (WIDTH, HEIGHT))
    for frame, now in enumerate(time_s.tolist()):
        there = [actor for actor in actors if actor.seen(now)]
        there = [there[i] for i in rng.permutation(len(there))]
        boxes = np.array([a.box(now) + rng.normal(0, noise, 4) for a in there]).reshape(-1, 4)
        xy = np.array([a.keypoints(now) + rng.normal(0, noise, (J, 2)) for a in there])
        tracker.update(
            frame,
            now,
            Boxes(boxes, np.full(len(there), 0.9)),
            Poses2D(xy.reshape(-1, J, 2), np.full((len(there), J), 0.8), "coco17"),
            cut=frame in cuts,
            image=_picture(actors, there, now) if pictures else None,
        )
    return tracker


def _picture(actors: Sequence[Actor], there: Sequence[Actor], now: float) -> Image:
    """A grey stage with coloured bodies; the first actors stand in front."""
    image = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    for actor in reversed(actors):
        if actor in there:
            left, top, right, bottom = actor.box(now).round().astype(int).clip(0)
            image[top:bottom, left:right] = actor.colour
    return image


def who(track: Track2D, actors: Sequence[Actor]) -> set[int]:
    """The actors that a track follows, over all rows in which it has a box."""
    found = set()
    for row in np.flatnonzero(np.isfinite(track.box[:, 0])):
        now = float(track.time_s[row])
        truth = np.array([actor.keypoints(now) for actor in actors if actor.seen(now)])
        names = [i for i, actor in enumerate(actors) if actor.seen(now)]
        away = np.linalg.norm(truth - track.xy[row], axis=2).mean(axis=1)
        found.add(names[int(away.argmin())])
    return found
