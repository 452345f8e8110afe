"""Planted scenes for exports: bones of constant length that turn smoothly, and their faults."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from dance2pose.body import body_bones_mm
from dance2pose.export.rig import rest_directions
from dance2pose.export.scene import ExportScene, SceneDancer
from dance2pose.poses import Timeline, Track2D, Track3D, Unit
from dance2pose.skeleton import get

SKELETON = "body17"
KEYPOINTS = "halpe26"
NTSC = 60000 / 1001
UNIT_PER_MM = {"metres": 0.001, "body heights": 1 / 1650}


def planted_places(
    time_s: np.ndarray, seed: int = 0, unit: Unit = "metres", skeleton: str = SKELETON
) -> np.ndarray:
    """(T, J, 3) joints about the pelvis: every bone swings about its rest direction on its own."""
    rng = np.random.default_rng(seed)
    tree = get(skeleton)
    lengths = body_bones_mm(skeleton) * UNIT_PER_MM[unit]
    rest = rest_directions(tree)
    places = np.zeros((len(time_s), len(tree), 3))
    for b, (start, end) in enumerate(tree.bones):
        wave = sum(
            rng.normal(0, 0.35, 3) * np.sin(2 * np.pi * f * time_s + rng.uniform(0, 6))[:, None]
            for f in (0.3, 0.7)
        )
        direction = rest[b] + wave
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        places[:, end] = places[:, start] + lengths[b] * direction
    return places


def make_poses(
    time_s: np.ndarray,
    *,
    person: int = 1,
    unit: Unit = "metres",
    frame: np.ndarray | None = None,
    rooted: bool = True,
    skeleton: str = SKELETON,
) -> Track3D:
    xyz = planted_places(time_s, person, unit, skeleton)
    rows, joints = xyz.shape[:2]
    path = np.stack([0.3 * np.sin(time_s), 0.9 + 0.05 * np.cos(3 * time_s), -0.2 * time_s], axis=1)
    return Track3D(
        person=person,
        timeline=Timeline(
            np.arange(rows, dtype=np.int64) if frame is None else frame,
            np.asarray(time_s, np.float64),
        ),
        xyz=xyz,
        unit=unit,
        skeleton=skeleton,
        reprojection_error=np.full((rows, joints), 1.5),
        valid=np.ones((rows, joints - 1), bool),
        estimated=np.zeros((rows, joints), bool),
        sigma=np.full((rows, joints), 0.01),
        root=path if rooted else None,
    )


def make_keypoints(poses: Track3D, size: tuple[int, int] = (128, 96)) -> Track2D:
    rng = np.random.default_rng(poses.person)
    rows, count = len(poses), len(get(KEYPOINTS))
    # Below the numbers that the pictures of test videos have along the top.
    xy = rng.uniform([10, 45], [110, 90], (rows, count, 2))
    xy[:, 3] = np.nan
    confidence = np.full((rows, count), 0.8)
    confidence[:, 3] = 0
    return Track2D.from_arrays(
        xy,
        confidence=confidence,
        time_s=poses.time_s,
        frame=poses.frame,
        skeleton=KEYPOINTS,
        image_size=size,
        person=poses.person,
    )


def with_gap(poses: Track3D, rows: slice) -> Track3D:
    """The same track with rows in which the dancer is not seen."""
    xyz, root, sigma = poses.xyz.copy(), poses.root, poses.sigma
    xyz[rows] = np.nan
    if root is not None:
        root = root.copy()
        root[rows] = np.nan
    if sigma is not None:
        sigma = sigma.copy()
        sigma[rows] = np.nan
    return dataclasses.replace(poses, xyz=xyz, root=root, sigma=sigma)


def variable_times(count: int, seed: int = 3) -> np.ndarray:
    """Times about 59.94 frames a second that jitter by a fifth of a frame."""
    rng = np.random.default_rng(seed)
    return (np.arange(count) + rng.uniform(-0.1, 0.1, count)) / NTSC


def make_scene(*poses: Track3D, video: Path | None = None, **provenance: Any) -> ExportScene:
    dancers = tuple(SceneDancer(p, make_keypoints(p)) for p in poses)
    return ExportScene(dancers, video, {"note": "planted", **provenance})


TIMES = np.arange(61) / NTSC
SCENES = {
    "metres": lambda: make_scene(make_poses(TIMES)),
    "body heights, path not known": lambda: make_scene(
        make_poses(TIMES, unit="body heights", rooted=False)
    ),
    "a gap": lambda: make_scene(with_gap(make_poses(TIMES), slice(20, 31))),
    "variable times": lambda: make_scene(make_poses(variable_times(61))),
    "two dancers": lambda: make_scene(
        make_poses(TIMES),
        make_poses(TIMES[10:50], person=3, frame=np.arange(10, 50)),
    ),
}
