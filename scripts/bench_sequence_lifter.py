"""Frames a second of the default lifter, and the memory it takes, on synthetic motion.

    python scripts/bench_sequence_lifter.py

The motion is a body that swings and turns, made here: speed does not depend on what is danced.
"""

from __future__ import annotations

import argparse
import resource
import time

import numpy as np

from dance2pose.lifting.lifted import Observed
from dance2pose.lifting.pursuit.dictionary import load
from dance2pose.lifting.temporal.sequence import lift_frames
from dance2pose.poses import FloatArray


def swinging(frames: int, rate_hz: float) -> FloatArray:
    """Keypoints (T, J, 2) px of a cmu17 body whose pose and heading change smoothly."""
    dictionary = load("cmu17")
    time_s = np.arange(frames) / rate_hz
    rng = np.random.default_rng(0)
    sway = np.sin(time_s[:, None] * rng.uniform(2, 6, 8) + rng.uniform(0, 6, 8)) * 150
    body = dictionary.mean + np.einsum("tk,kjd->tjd", sway, dictionary.atoms[:8])
    angle = 0.7 * time_s
    x = body[..., 0] * np.cos(angle)[:, None] + body[..., 2] * np.sin(angle)[:, None]
    return np.stack([x, body[..., 1]], axis=-1) * 0.3 + [600.0, -500.0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--frames", type=int, nargs="+", default=[30, 2000, 8000, 32000])
    parser.add_argument("--rate", type=float, default=30.0)
    options = parser.parse_args()
    for frames in options.frames:
        xy = swinging(frames, options.rate)
        observed = Observed(
            xy=xy,
            confidence=np.ones(xy.shape[:2]),
            time_s=np.arange(frames) / options.rate,
            skeleton="cmu17",
            image_size=(1280, 720),
        )
        lift_frames(observed)  # loads the model and warms the caches
        started = time.perf_counter()
        lift_frames(observed)
        seconds = time.perf_counter() - started
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        print(
            f"{frames:6d} frames: {frames / seconds:7.0f} frames/s, {seconds:.2f} s; "
            f"peak memory of the process so far {peak:.0f} MiB",
            flush=True,
        )


if __name__ == "__main__":
    main()
