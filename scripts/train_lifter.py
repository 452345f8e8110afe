"""Train the depth network of the default lifter and write it as ONNX.

    python scripts/train_lifter.py SHARED/mocap/train SHARED/mocap/train_positions \
        -o models/lifter.onnx

Takes named by --hold-out are kept for tuning and calibration; the evaluation set is never given.
Needs PyTorch and onnx (`pip install -e .[train]`). The same seed and steps give the same batches in
the same order; the weights then differ by rounding alone (threads, processor).
"""

from __future__ import annotations

import argparse
import copy
import queue
import threading
import time
from pathlib import Path

import numpy as np
import torch

from dance2pose.lifting.temporal.network import network_output
from dance2pose.mocap.corpus import read_takes
from lifter_training.calibration import joint_errors
from lifter_training.model import DepthNetwork, export
from lifter_training.views import TakeStore, Views, random_views

HELD_OUT = (
    "01_14 02_06 05_09 06_08 07_08 08_05 09_05 135_martial_04 60_salsa_10 60_salsa_25 "
    "94_indian_14 walking_extra_walking_50 directing_traffic_directing_traffic_4"
)
UNIT_MM = 250.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("source", nargs="+", type=Path, help="folders of takes")
    parser.add_argument("-o", "--output", type=Path, required=True, help="lifter.onnx")
    parser.add_argument("--hold-out", default=HELD_OUT)
    parser.add_argument("--all", action="store_true", help="train on the held-out takes as well")
    parser.add_argument("--steps", type=int, default=15000)
    parser.add_argument("--width", type=int, default=384)
    parser.add_argument("--blocks", type=int, default=3)
    parser.add_argument("--clips", type=int, default=48)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--clips-from", type=float, default=0.5, help="part of the steps")
    parser.add_argument("--rate", type=float, default=1.2e-3)
    parser.add_argument("--start", type=Path, help="weights (.pt) to start from")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    torch.set_flush_denormal(True)
    bodies = [
        [take for folder in options.source for take in read_takes(folder, skeleton)]
        for skeleton in ("cmu17", "body17")
    ]
    held_out = options.hold_out.split()
    if missing := set(held_out) - {take.name for take in bodies[0]}:
        parser.error(f"no such takes to hold out: {sorted(missing)}")
    train = TakeStore(*([t for t in b if options.all or t.name not in held_out] for b in bodies))
    held = TakeStore(*([t for t in b if t.name in held_out] for b in bodies))
    print(f"{len(train)} training frames, {len(held)} held out, at 60 a second", flush=True)
    model = DepthNetwork(options.width, options.blocks)
    if options.start:
        model.load_state_dict(torch.load(options.start, weights_only=True))
    print(f"{sum(p.numel() for p in model.parameters()) / 1e6:.2f} M weights", flush=True)
    fit(model, train, held, options)


def fit(
    model: DepthNetwork, train: TakeStore, held: TakeStore, options: argparse.Namespace
) -> None:
    average = copy.deepcopy(model).eval()
    optimiser = torch.optim.AdamW(
        model.parameters(), lr=options.rate, betas=(0.9, 0.98), weight_decay=0.02, fused=True
    )
    batches = _in_background(train, options)
    began, total = time.monotonic(), 0.0
    for step in range(1, options.steps + 1):
        warm, done = min(1.0, step / 200), step / options.steps
        for group in optimiser.param_groups:
            group["lr"] = options.rate * warm * (0.5 * (1 + np.cos(np.pi * done)) + 0.003)
        loss = batch_loss(model, batches.get())
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()
        if step % 4 == 0:
            follow(average, model, max(0.01, 10 / (step + 10)))
        total += loss.item()
        if step % 100 == 0:
            minutes = (time.monotonic() - began) / 60
            print(f"{step:6d} {minutes:6.1f} min loss {total / 100:.4f}", flush=True)
            total = 0.0
        if step % 500 == 0:
            report(average, held)
            torch.save(average.state_dict(), options.output.with_suffix(".pt"))
            export(average, options.output)
    report(average, held)
    torch.save(average.state_dict(), options.output.with_suffix(".pt"))
    export(average, options.output)


@torch.no_grad()
def follow(average: DepthNetwork, model: DepthNetwork, part: float) -> None:
    """Move the averaged weights, which are what is kept, a part of the way to the new ones."""
    torch._foreach_lerp_(list(average.parameters()), list(model.parameters()), part)


def _in_background(train: TakeStore, options: argparse.Namespace) -> queue.Queue[Views]:
    """Batches made on another thread.

    Single pictures are many different poses for the same work, so most batches are of them until
    `--clips-from` of the steps have passed, and one in four after that.
    """
    made: queue.Queue[Views] = queue.Queue(maxsize=3)

    def work() -> None:
        rng = np.random.default_rng(options.seed)
        for step in range(options.steps):
            early, kind = step < options.clips_from * options.steps, step % 4
            clips, frames = options.clips, options.frames
            if kind == 0 or (early and kind < 3):
                clips, frames = clips * frames, 1
            made.put(random_views(train, rng, count=clips, length=frames))

    threading.Thread(target=work, daemon=True).start()
    return made


def batch_loss(model: DepthNetwork, views: Views) -> torch.Tensor:
    """Mean joint error (up to translation), of position and velocity, and the two likelihoods."""
    scale = views.given.scale[:, None, None, None] * UNIT_MM
    truth = torch.from_numpy((views.truth / scale).astype(np.float32))
    life = torch.from_numpy((views.given.scale[:, None] / views.per_mm).astype(np.float32))
    features = torch.from_numpy(views.given.features)
    raw = model(features)
    here = features[..., :34].unflatten(-1, (17, 2))
    xyz = torch.cat([here + raw[..., :2], raw[..., 2:3]], dim=-1)
    error = (xyz - truth) * life[..., None, None]  # of life size, in units of 250 mm
    depth = error[..., 2].detach() / life[..., None]
    error = error - error.mean(dim=2, keepdim=True)
    distance = (error.square().sum(-1) + 1e-6).sqrt()
    loss = distance.mean()
    if error.shape[1] > 1:
        speed = error[:, 1:] - error[:, :-1]
        loss = loss + 0.3 * (speed.square().sum(-1) + 1e-6).sqrt().mean()
    # Scales of Laplace (depth) and Rayleigh-like (position) errors; they do not steer the pose.
    log_depth, log_position = raw[..., 3], raw[..., 4]
    own = distance.detach() / life[..., None]
    sure = (log_depth + depth.abs() * (-log_depth).exp()).mean()
    sure = sure + (log_position + own * (-log_position).exp()).mean()
    return loss + 0.02 * sure


@torch.no_grad()
def report(model: torch.nn.Module, held: TakeStore) -> None:
    """PA-MPJPE on the held-out takes, level orthographic cameras, clean keypoints."""
    for length, count in ((32, 150), (1, 2000)):
        views = random_views(held, np.random.default_rng(7), count=count, length=length, plain=True)
        raw = model(torch.from_numpy(views.given.features)).numpy().astype(float)
        xyz, _, _ = network_output(raw, views.given)
        truth = views.truth / views.given.scale[:, None, None, None]
        error = joint_errors(xyz.reshape(-1, 17, 3), truth.reshape(-1, 17, 3)).mean(axis=1)
        error = error * views.given.scale.repeat(length)
        print(f"   held out, clips of {length}: {error.mean():.2f} mm", flush=True)


if __name__ == "__main__":
    main()
