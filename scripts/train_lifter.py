"""Train the depth network of the default lifter and write it as ONNX.

    python scripts/train_lifter.py SHARED/mocap/train SHARED/mocap/train_positions \
        -o models/lifter.onnx

Every clip is on a body of its own (see lifter_training/bodies.py). Takes named by --hold-out are
kept for tuning and calibration; the evaluation set is never given. Needs PyTorch and onnx (`pip
install -e .[train]`). The same seed gives the same batches in the same order; the weights then
differ by rounding (half precision, threads, processor) and, with --minutes, by when time ran out.
"""

from __future__ import annotations

import argparse
import copy
import itertools
import queue
import threading
import time
from pathlib import Path

import numpy as np
import torch

from dance2pose.body import BODY17_BONES_MM, BODY_BONES_MM
from dance2pose.evaluation.metrics import pa_errors
from dance2pose.lifting.temporal.network import DEFINITION, network_output
from dance2pose.mocap.corpus import read_takes
from dance2pose.skeleton import get
from lifter_training.held_out import HELD_OUT
from lifter_training.model import DepthNetwork, export, weights_of
from lifter_training.takes import TakeStore
from lifter_training.views import Mixture, Views, random_views

UNIT_MM = 250.0
_PARENTS, _CHILDREN = np.array(get("cmu17").bones).T
# What is reported of held-out takes: name, frames of a clip, clips, and the views.
_REPORTED = (
    ("one body", 32, 100, Mixture(training=False, body="one", body17=0.0)),
    ("own bodies", 32, 150, Mixture(training=False, body="own", body17=0.0)),
    ("own, slow 15 mm", 32, 150, Mixture(training=False, body="own", slow_mm=15, body17=0.0)),
    ("own, single", 1, 2000, Mixture(training=False, body="own", body17=0.0)),
    ("drawn bodies", 32, 100, Mixture(training=False, body="drawn", body17=0.5)),
    ("drawn, single", 1, 2000, Mixture(training=False, body="drawn", body17=0.5)),
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("source", nargs="+", type=Path, help="folders of takes")
    parser.add_argument("-o", "--output", type=Path, required=True, help="lifter.onnx")
    parser.add_argument("--hold-out", default=HELD_OUT)
    parser.add_argument("--all", action="store_true", help="train on the held-out takes as well")
    parser.add_argument("--steps", type=int, default=40000)
    parser.add_argument("--width", type=int, default=384)
    parser.add_argument("--minutes", type=float, help="end by the clock, whatever --steps says")
    parser.add_argument("--blocks", type=int, default=4)
    parser.add_argument("--clips", type=int, default=64)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--clips-from", type=float, default=0.55, help="part of the training")
    parser.add_argument("--rate", type=float, default=1e-3)
    parser.add_argument("--start", type=Path, help="weights (.pt or .onnx) to start from")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    torch.set_flush_denormal(True)
    bodies = [
        [t for folder in options.source for t in read_takes(folder, skeleton, own_bones=True)]
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
        model.start_from(weights_of(options.start))
    print(f"{sum(p.numel() for p in model.parameters()) / 1e6:.2f} M weights", flush=True)
    fit(model, train, held, options)


def fit(
    model: DepthNetwork, train: TakeStore, held: TakeStore, options: argparse.Namespace
) -> None:
    average = copy.deepcopy(model).eval()
    optimiser = torch.optim.AdamW(
        model.parameters(), lr=options.rate, betas=(0.9, 0.98), weight_decay=0.02, fused=True
    )
    began, total, step, done = time.monotonic(), 0.0, 0, 0.0
    batches = _in_background(train, options, began)
    while done < 1.0:
        step += 1
        minutes = (time.monotonic() - began) / 60
        done = _done(step, began, options)
        warm = min(1.0, step / 300)
        for group in optimiser.param_groups:
            group["lr"] = options.rate * warm * (0.5 * (1 + np.cos(np.pi * min(done, 1.0))) + 0.003)
        loss = batch_loss(model, batches.get())
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 1.0)
        optimiser.step()
        if step % 4 == 0:
            follow(average, model, max(0.01, 10 / (step + 10)))
        total += loss.item()
        if step % 300 == 0:
            print(f"{step:6d} {minutes:6.1f} min loss {total / 300:.4f}", flush=True)
            total = 0.0
        if step % 1500 == 0:
            report(average, held)
            torch.save(average.state_dict(), options.output.with_suffix(".pt"))
            export(average, options.output, train.names)
    report(average, held)
    torch.save(average.state_dict(), options.output.with_suffix(".pt"))
    export(average, options.output, train.names)


@torch.no_grad()
def follow(average: DepthNetwork, model: DepthNetwork, part: float) -> None:
    """Move the averaged weights, which are what is kept, a part of the way to the new ones."""
    torch._foreach_lerp_(list(average.parameters()), list(model.parameters()), part)


def _done(step: int, began: float, options: argparse.Namespace) -> float:
    """The part of the training that is behind."""
    if options.minutes:
        return float((time.monotonic() - began) / 60 / options.minutes)
    return float(step / options.steps)


def _in_background(
    train: TakeStore, options: argparse.Namespace, began: float
) -> queue.Queue[Views]:
    """Batches made on another thread.

    Single pictures are many different poses for the same work, so most batches are of them until
    `--clips-from` of the training has passed, and one in three after that.
    """
    made: queue.Queue[Views] = queue.Queue(maxsize=3)

    def work() -> None:
        rng = np.random.default_rng(options.seed)
        for step in itertools.count():
            early = _done(step, began, options) < options.clips_from
            clips, frames = options.clips, options.frames
            if step % 4 < 3 if early else step % 3 == 0:
                clips, frames = clips * frames, 1
            made.put(random_views(train, rng, count=clips, length=frames))

    threading.Thread(target=work, daemon=True).start()
    return made


def batch_loss(model: DepthNetwork, views: Views) -> torch.Tensor:
    """Mean joint error (up to translation), of position, velocity and bones, and the likelihoods.

    An error that a bone's ends share leaves the angles right; one that they do not, bends limbs.
    """
    scale = views.given.scale[:, None, None, None] * UNIT_MM
    truth = torch.from_numpy((views.truth / scale).astype(np.float32))
    life = torch.from_numpy((views.given.scale[:, None] / views.per_mm).astype(np.float32))
    features = torch.from_numpy(views.given.features)
    raw, bones = model(features)
    here = features[..., :34].unflatten(-1, (17, 2))
    xyz = torch.cat([here + raw[..., :2], raw[..., 2:3]], dim=-1)
    error = (xyz - truth) * life[..., None, None]  # of life size, in units of 250 mm
    depth = error[..., 2].detach() / life[..., None]
    error = error - error.mean(dim=2, keepdim=True)
    distance = (error.square().sum(-1) + 1e-6).sqrt()
    loss = distance.mean()
    bent = error[:, :, _CHILDREN] - error[:, :, _PARENTS]
    loss = loss + 0.25 * (bent.square().sum(-1) + 1e-6).sqrt().mean()
    if error.shape[1] > 1:
        speed = error[:, 1:] - error[:, :-1]
        loss = loss + 0.3 * (speed.square().sum(-1) + 1e-6).sqrt().mean()
    # Scales of Laplace (depth) and Rayleigh-like (position) errors; they do not steer the pose.
    log_depth, log_position = raw[..., 3], raw[..., 4]
    own = distance.detach() / life[..., None]
    sure = (log_depth + depth.abs() * (-log_depth).exp()).mean()
    sure = sure + (log_position + own * (-log_position).exp()).mean()
    return loss + 0.02 * sure + 0.1 * bone_loss(bones, views)


def bone_loss(bones: torch.Tensor, views: Views) -> torch.Tensor:
    """Negative log likelihood (Laplace) of the logarithms of bone lengths beside the one body's."""
    xyz = views.truth / views.given.scale[:, None, None, None]
    true = np.linalg.norm(xyz[:, :, _CHILDREN] - xyz[:, :, _PARENTS], axis=-1)
    body17 = views.given.features[:, :1, DEFINITION] > 0
    usual = np.where(body17[..., None], BODY17_BONES_MM, BODY_BONES_MM)
    off = bones[..., 0] - torch.from_numpy(np.log(true / usual).astype(np.float32))
    return (bones[..., 1] + off.abs() * (-bones[..., 1]).exp()).mean()


@torch.no_grad()
def report(model: torch.nn.Module, held: TakeStore) -> None:
    """PA-MPJPE of the network alone on the held-out takes, level orthographic cameras."""
    said = []
    for name, length, count, mixture in _REPORTED:
        rng = np.random.default_rng(7)
        views = random_views(held, rng, count=count, length=length, mixture=mixture)
        raw, bones = (
            o.numpy().astype(float) for o in model(torch.from_numpy(views.given.features))
        )
        xyz, _, _ = network_output(raw, views.given)
        truth = views.truth / views.given.scale[:, None, None, None]
        error = pa_errors(xyz.reshape(-1, 17, 3), truth.reshape(-1, 17, 3)).mean(axis=1)
        error = error * (views.given.scale.repeat(length) / views.per_mm.ravel())
        usual = np.where(
            views.given.features[..., DEFINITION, None] > 0, BODY17_BONES_MM, BODY_BONES_MM
        )
        true = np.linalg.norm(truth[:, :, _CHILDREN] - truth[:, :, _PARENTS], axis=-1)
        off = np.abs(bones[..., 0] - np.log(true / usual)).mean()
        said.append(f"{name} {error.mean():.2f} mm (bones {100 * off:.1f} %)")
    print("   held out: " + ", ".join(said), flush=True)


if __name__ == "__main__":
    main()
