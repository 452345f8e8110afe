"""Frames a second of the default lifter, and the memory it takes, on synthetic motion.

    python scripts/bench_sequence_lifter.py

For a weak-perspective camera (cmu17) and a perspective one (body17, with the path through the room
and the floor), by the processor's time and by the clock; whole tracks of keypoints, as
`dance2pose lift` takes them. The motion is a body that swings and turns, made here: speed does not
depend on what is danced.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from dance2pose.body import body_bones_mm, retarget
from dance2pose.lifting import lift_all
from dance2pose.lifting.pursuit.dictionary import load
from dance2pose.lifting.world.perspective import ASSUMED_FOV_DEG, camera_of
from dance2pose.poses import FloatArray, Track2D
from dance2pose.skeleton import get

PICTURE = (1280, 720)


def swinging(time_s: FloatArray) -> FloatArray:
    """Joints (T, J, 3) mm of a cmu17 body whose pose and heading change smoothly, y up."""
    dictionary = load("cmu17")
    rng = np.random.default_rng(0)
    sway = np.sin(time_s[:, None] * rng.uniform(2, 6, 8) + rng.uniform(0, 6, 8)) * 150
    body = dictionary.mean + np.einsum("tk,kjd->tjd", sway, dictionary.atoms[:8])
    angle = 0.7 * time_s
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y, z = np.moveaxis(body, -1, 0)
    return np.stack([x * cos + z * sin, y, z * cos - x * sin], axis=-1)


def weak_perspective(time_s: FloatArray) -> Track2D:
    points = swinging(time_s)[..., :2] * [0.3, -0.3] + [600.0, 500.0]
    return Track2D.from_arrays(points, time_s=time_s, skeleton="cmu17", image_size=PICTURE)


def perspective(time_s: FloatArray) -> Track2D:
    """A body17 that walks to and fro, four metres before a camera at the height of its hips."""
    xyz = retarget(swinging(time_s), get("body17"), body_bones_mm("body17"))
    way = np.stack([np.sin(0.5 * time_s), np.zeros(len(time_s)), np.cos(0.3 * time_s)], axis=1)
    xyz = xyz + 700.0 * way[:, None] - [0.0, 0.0, 4000.0]
    points = camera_of(PICTURE, ASSUMED_FOV_DEG).project(xyz) * [1.0, -1.0]
    return Track2D.from_arrays(points, time_s=time_s, skeleton="body17", image_size=PICTURE)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--frames", type=int, nargs="+", default=[30, 545, 2000, 8000, 32000])
    parser.add_argument("--rate", type=float, default=30.0)
    options = parser.parse_args()
    cameras = {"weak-perspective": weak_perspective, "perspective": perspective}
    for frames in options.frames:
        for camera, made in cameras.items():
            track = made(np.arange(frames) / options.rate)
            if frames == options.frames[0]:
                lift_all([track], camera=camera)  # loads the model and warms the caches
            print(f"{frames:6d} frames, {camera:16s}: {_timed(track, camera)}", flush=True)


def _timed(track: Track2D, camera: str) -> str:
    clock, processor = time.perf_counter(), time.process_time()
    # A field of view that is given is not estimated, which may take a second round.
    lift_all([track], camera=camera, fov_deg=ASSUMED_FOV_DEG if camera == "perspective" else None)
    clock, processor = time.perf_counter() - clock, time.process_time() - processor
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return (
        f"{len(track) / processor:6.0f} frames/s of processor time, {len(track) / clock:6.0f} by "
        f"the clock; peak memory of the process so far {peak:.0f} MiB"
    )


if __name__ == "__main__":
    main()
