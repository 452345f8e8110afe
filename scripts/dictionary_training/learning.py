"""Learning a pose dictionary from motion capture: concatenated bases of clusters of poses.

Ramakrishna, Kanade, Sheikh (ECCV 2012, section 3) join the PCA bases of motion categories into one
over-complete dictionary. Here the categories are found rather than named: clusters of poses
(k-means), each giving the leading directions of its poses about the mean of all.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.cluster.vq import kmeans2
from scipy.spatial import cKDTree

from dance2pose.body import body_bones_mm
from dance2pose.errors import DataError
from dance2pose.lifting.pursuit.alignment import mirrored, to_body_axes
from dance2pose.lifting.pursuit.dictionary import Dictionary
from dance2pose.mocap.corpus import Take
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get


@dataclass(frozen=True)
class LearningSettings:
    """rate_hz: frames taken from every take. apart_mm: poses nearer than this to one already
    taken (root mean square over joints) are left out. clusters, atoms_each: the size of the
    dictionary. alike: an atom whose cosine with an earlier one exceeds this is left out."""

    rate_hz: float = 15.0
    apart_mm: float = 25.0
    clusters: int = 150
    atoms_each: int = 4
    alike: float = 0.98
    seed: int = 20120


def training_poses(takes: Iterable[Take], skeleton: str, settings: LearningSettings) -> FloatArray:
    """Distinct poses (N, J, 3) mm in body axes, each with its mirror image."""
    known = get(skeleton)
    poses = []
    for take in takes:
        step = max(1, round(take.rate_hz / settings.rate_hz))
        poses.append(to_body_axes(take.xyz[::step], known))
    if not poses:
        raise DataError("no take of motion capture to learn from")
    kept = distinct(np.concatenate(poses), settings.apart_mm)
    return np.concatenate([kept, mirrored(kept, known)])


def distinct(poses: FloatArray, apart_mm: float) -> FloatArray:
    """The poses (N, J, 3) that are farther than `apart_mm` rms from every pose kept before."""
    flat = poses.reshape(len(poses), -1)
    tree = cKDTree(flat)
    radius = apart_mm * np.sqrt(poses.shape[1])
    dropped = np.zeros(len(flat), dtype=bool)
    for i in range(len(flat)):
        if not dropped[i]:
            near = np.array(tree.query_ball_point(flat[i], radius))
            dropped[near[near > i]] = True
    kept: FloatArray = poses[~dropped]
    return kept


def learn(poses: FloatArray, skeleton: str, settings: LearningSettings) -> Dictionary:
    """A dictionary from training poses (N, J, 3) mm in body axes."""
    mean = poses.mean(axis=0)
    flat = (poses - mean).reshape(len(poses), -1)
    _, label = kmeans2(flat, settings.clusters, minit="++", seed=settings.seed, iter=30)
    atoms: list[FloatArray] = []
    for cluster in range(settings.clusters):
        members = flat[label == cluster]
        if not len(members):
            continue
        # Not centred on the cluster: its own mean is the first thing its basis must reach.
        _, _, directions = np.linalg.svd(members, full_matrices=False)
        for direction in directions[: settings.atoms_each]:
            if not atoms or np.abs(np.array(atoms) @ direction).max() < settings.alike:
                atoms.append(direction)
    joints = poses.shape[1]
    return Dictionary(
        skeleton, np.array(atoms).reshape(-1, joints, 3), mean, body_bones_mm(skeleton), {}
    )
