"""Train the bundled demo models on rendered dancers: a person detector and a keypoint model.

    python scripts/train_demo_models.py MOCAP_FOLDER --work FOLDER [--models FOLDER]

MOCAP_FOLDER holds the BVH takes of CMU motion capture. Needs the extra `train`. The same seed gives
the same pool of pictures and the same examples in the same order. An interrupted run goes on.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import torch

from demo_training.augmentation import Source
from demo_training.backgrounds import backgrounds
from demo_training.export import export
from demo_training.networks import DetectorNetwork, PoseNetwork
from demo_training.training import (
    Plan,
    Task,
    detector_batch,
    detector_loss,
    pose_batch,
    pose_loss,
    train,
)
from figure_renderer.pool import open_pool, start_pool

ROWS, BACKGROUNDS, RENDERERS = 4800, 300, 2
CYCLES = {"pose": (7000,), "detector": (3000,)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mocap", type=Path, help="folder of BVH takes")
    parser.add_argument("--work", type=Path, required=True, help="pool and checkpoints go here")
    parser.add_argument("--models", type=Path, help="write the ONNX models and manifests here")
    parser.add_argument("--only", choices=sorted(CYCLES), help="train only this one")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1000)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    pool_folder = arguments.work / "train"
    renderers = []
    if not (pool_folder / "state.npy").exists():
        renderers = start_pool(
            pool_folder, arguments.mocap, ROWS, seed=arguments.seed, workers=RENDERERS
        )
    source = Source(open_pool(pool_folder), _backgrounds(arguments.work, arguments.seed))

    def wait_for(rows: int) -> None:
        while not source.pool.state[:rows].all():
            for process in renderers:
                if process.poll():
                    raise SystemExit("a renderer failed; its message is above")
            time.sleep(2)

    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    for name, cycles in CYCLES.items():
        if arguments.only in (None, name):
            torch.manual_seed(arguments.seed)
            plan = Plan(cycles, ROWS, arguments.seed)
            checkpoint = arguments.work / f"{name}.pt"
            mean = train(_task(name), plan, source, checkpoint, wait_for, device=device)
            if arguments.models is not None:
                export(name, mean.cpu(), arguments.models)
    for process in renderers:
        process.wait()


def _task(name: str) -> Task:
    if name == "pose":
        return Task(name, PoseNetwork(), pose_batch, pose_loss)
    return Task(name, DetectorNetwork(), detector_batch, detector_loss)


def _backgrounds(work: Path, seed: int) -> np.ndarray:
    """The procedural pictures, made once."""
    file = work / "backgrounds.npy"
    if not file.exists():
        np.save(file, backgrounds(seed, BACKGROUNDS, 256))
    return np.load(file, allow_pickle=False)


if __name__ == "__main__":
    main()
