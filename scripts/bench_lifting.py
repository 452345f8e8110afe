"""How fast the paper's lifter is: all frames together against the same code one frame at a time.

    python scripts/bench_lifting.py [--frames 4096] [--skeleton body17]

Frames are made-up poses (a few atoms of the dictionary each), seen from all around, with limits.
The batched code works on chunks in as many threads as there are cores.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from dance2pose.body import retarget
from dance2pose.lifting.pursuit import dictionary
from dance2pose.lifting.pursuit.camera import fit_camera
from dance2pose.lifting.pursuit.paper import lift_points
from dance2pose.lifting.pursuit.pursue import PursuitSettings, pursue
from dance2pose.limits import model as limits
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--frames", type=int, default=4096)
    parser.add_argument("--one-by-one", type=int, default=48, help="frames lifted one at a time")
    parser.add_argument("--repeats", type=int, default=3, help="the fastest counts")
    parser.add_argument("--skeleton", choices=("cmu17", "paper15", "body17"), default="body17")
    options = parser.parse_args()
    poses, known = dictionary.load(options.skeleton), limits.load(options.skeleton)
    xyz = made_up(options.skeleton, options.frames)
    xy, weights = xyz[..., :2], np.ones(xyz.shape[:2])
    planar = np.repeat(weights[..., None], 3, axis=2) * [1, 1, 0]
    faithful = PursuitSettings(start_atoms=0, closed_form=True)

    stages: dict[str, Callable[[slice], object]] = {
        "camera alone": lambda rows: fit_camera(xyz[rows], xyz[rows], planar[rows]),
        "limits alone": lambda rows: known.is_valid(xyz[rows]),
        "R12's pursuit, no limits": lambda rows: pursue(
            poses, xyz[rows], planar[rows], settings=faithful
        ),
        "the lifter without limits": lambda rows: lift_points(xy[rows], weights[rows], poses, None),
        "the lifter": lambda rows: lift_points(xy[rows], weights[rows], poses, known),
    }
    print(
        f"{options.skeleton}: {len(poses)} atoms, {xyz.shape[1]} joints, {os.cpu_count()} cores, "
        f"{options.frames} frames together, {options.one_by_one} one at a time"
    )
    print(
        f"{'frames a second':28}{'together':>12}{'one by one':>12}{'ratio':>8}{'of one core':>14}"
    )
    singles = [slice(n, n + 1) for n in range(options.one_by_one)]
    for name, stage in stages.items():
        stage(singles[0])
        together, of_one_core = rates([slice(None)], stage, options.frames, options.repeats)
        alone, _ = rates(singles, stage, options.one_by_one, options.repeats)
        print(f"{name:28}{together:12.0f}{alone:12.0f}{together / alone:8.1f}{of_one_core:14.0f}")


def rates(
    parts: list[slice], stage: Callable[[slice], object], frames: int, repeats: int
) -> tuple[float, float]:
    """Frames per second of wall time and of processor time, the best of some repeats.

    The second tells what one core does, also on a machine that is busy with other things.
    """
    wall, processor = [], []
    for _ in range(repeats):
        start, start_processor = time.perf_counter(), time.process_time()
        for part in parts:
            stage(part)
        wall.append(time.perf_counter() - start)
        processor.append(time.process_time() - start_processor)
    return frames / min(wall), frames / min(processor)


def made_up(skeleton: str, frames: int) -> FloatArray:
    """Poses (frames, J, 3) mm of six atoms each, turned about the vertical."""
    poses = dictionary.load(skeleton)
    rng = np.random.default_rng(0)
    active = rng.integers(0, len(poses), (frames, 6))
    body = poses.pose(active, rng.normal(size=(frames, 6)) * 150)
    turn = Rotation.from_euler("y", rng.uniform(0, 360, (frames, 1)), degrees=True).as_matrix()
    return retarget(body @ turn.transpose(0, 2, 1), get(skeleton), poses.bone_lengths)


if __name__ == "__main__":
    main()
