"""The dancer's path through the room, seen by a perspective camera: error and foot-slide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.evaluation.cameras import IMAGE_SIZE, rotation
from dance2pose.evaluation.lifters import DEFAULT
from dance2pose.evaluation.metrics import foot_slide, mean_over, true_contacts
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.evaluation.tables import Cell, Table
from dance2pose.lifting.lifted import Observed
from dance2pose.mocap.corpus import Take, resample
from dance2pose.poses import FloatArray
from dance2pose.progress import Progress

FOV_DEG = 50.0
CAMERA_HEIGHT_MM = 1300.0
NEAREST_MM = 3000.0  # of the dancer to the camera


@dataclass(frozen=True)
class _Room:
    """world: (T, J, 3) mm, x right, y up from the floor, z towards the camera's side; observed:
    what a level perspective camera sees of it."""

    world: FloatArray
    observed: Observed


def _room(take: Take, azimuth_deg: float) -> _Room:
    """The whole path before a camera far enough away to see all of it."""
    assert take.root is not None
    turned = (take.xyz + take.root[:, None]) @ rotation(azimuth_deg, 0.0).T
    tree = skeletons.get(take.skeleton)
    ankles = turned[:, [tree.index("left_ankle"), tree.index("right_ankle")], 1]
    turned -= np.array([turned[..., 0].mean(), np.quantile(ankles, 0.02), turned[..., 2].max()])
    width, height = IMAGE_SIZE
    focal = width / 2 / np.tan(np.radians(FOV_DEG) / 2)
    half = np.abs(turned[..., 0]).max()
    distance = max(NEAREST_MM, half / (0.9 * width / 2 / focal))
    position = turned - np.array([0.0, CAMERA_HEIGHT_MM, distance])
    centre = np.array([(width - 1) / 2, -(height - 1) / 2])
    xy = centre + focal * position[..., :2] / -position[..., 2:]
    observed = Observed(
        xy=xy,
        confidence=np.ones(xy.shape[:2]),
        time_s=np.arange(len(xy)) / take.rate_hz,
        skeleton=take.skeleton,
        image_size=IMAGE_SIZE,
        camera="perspective",
        fov_deg=FOV_DEG,
    )
    return _Room(turned, observed)


def path_table(takes: Sequence[Take], settings: EvaluationSettings, progress: Progress) -> Table:
    """Foot-slide and error of the path: the truth, frame by frame, and the default lifter."""
    names = ("truth", "frame by frame", "default")
    slides: dict[str, list[float]] = {name: [] for name in names}
    errors: dict[str, list[float]] = {name: [] for name in names}
    with_path = [take for take in takes if take.root is not None]
    for number, take in enumerate(
        progress.track(with_path, "path", total=len(with_path), unit="take")
    ):
        azimuth = np.random.default_rng((settings.seed, number)).uniform(0, 360)
        at_rate = resample(take, settings.rate_hz) if take.rate_hz > settings.rate_hz else take
        room = _room(at_rate, azimuth)
        tree = skeletons.get(take.skeleton)
        feet = [tree.index("left_ankle"), tree.index("right_ankle")]
        contact = true_contacts(room.world[:, feet], at_rate.rate_hz)
        for name in names:
            world = room.world
            if name != "truth":
                alone = name == "frame by frame"
                found = DEFAULT.lift(replace(room.observed, independent=alone))
                assert found.root is not None
                world = found.xyz + found.root[:, None]
            slides[name].append(foot_slide(world[:, feet], contact))
            off = (world[:, 0] - room.world[:, 0])[:, [0, 2]]
            errors[name].append(float(np.nanmean(np.linalg.norm(off - np.nanmean(off, 0), axis=1))))
    rows: list[list[Cell]] = [
        [
            name,
            float(mean_over(np.array(slides[name]))),
            float(mean_over(np.array(errors[name]))),
        ]
        for name in names
    ]
    return Table(
        "path",
        "The dancer's path through the room, perspective camera of known field of view",
        ("", "foot-slide, mm a frame of contact", "error of the path on the floor, mm"),
        rows,
        note=(
            f"A level camera {CAMERA_HEIGHT_MM / 1000:g} m above the floor, field of view "
            f"{FOV_DEG:g}°, at a random azimuth, far enough away to see the whole path, at least "
            f"{NEAREST_MM / 1000:g} m; {settings.rate_hz:g} frames a second. Contact is taken from "
            "the true motion (ankle slower than 0.15 m/s and low); the truth slides too, because "
            "ankles roll and retargeted legs do not reach exactly as far. The error is that of "
            "the pelvis after moving the whole path by its mean offset."
        ),
    )
