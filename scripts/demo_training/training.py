"""Training loops of the two networks."""

from __future__ import annotations

import copy
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn
from torch.nn import functional

from demo_training.augmentation import Source, detector_example, pose_example
from demo_training.networks import (
    DETECTOR_INPUT,
    DETECTOR_STRIDE,
    MEAN,
    POSE_HEATMAP,
    SPREAD,
    STD,
    boxes_of,
)

BATCH = 32
FIRST_ROWS, ROWS_PER_STEP = 800, 4
WARM_UP_STEPS, DECAY_PART, RESTART_PART = 60, 0.3, 0.6
ABSENT_WEIGHT = 0.1


@dataclass(frozen=True)
class Plan:
    """cycles: steps of BATCH examples, each cycle ending with a learning rate of zero. rows: of
    the pool. seed: of the examples and the first weights."""

    cycles: tuple[int, ...]
    rows: int
    seed: int
    learning_rate: float = 2e-3

    @property
    def steps(self) -> int:
        return sum(self.cycles)

    def rows_at(self, step: int) -> int:
        """Rows that examples are drawn from: more and more, so that training can begin while the
        pool still grows and the same seed still gives the same examples."""
        return min(self.rows, FIRST_ROWS + ROWS_PER_STEP * step)

    def rate_at(self, step: int) -> float:
        """Warm-up, a plateau, and a linear decay over the last part; then, where there are more
        cycles, a lower start and a linear decay over all of each."""
        first = self.cycles[0]
        if step < first:
            left = (first - step) / (first * DECAY_PART)
            return self.learning_rate * min(1.0, (step + 1) / WARM_UP_STEPS, left)
        step -= first
        for cycle in self.cycles[1:]:
            if step < cycle:
                return self.learning_rate * RESTART_PART * (cycle - step) / cycle
            step -= cycle
        return 0.0


def to_tensor(images: list[npt.NDArray[np.uint8]], device: torch.device) -> Tensor:
    """RGB pictures to normalised (N, 3, H, W)."""
    batch = torch.from_numpy(np.stack(images)).to(device).permute(0, 3, 1, 2).float() / 255
    mean = torch.tensor(MEAN, device=device).view(1, 3, 1, 1)
    std = torch.tensor(STD, device=device).view(1, 3, 1, 1)
    return ((batch - mean) / std).contiguous(memory_format=torch.channels_last)


def pose_batch(
    rng: np.random.Generator, source: Source, rows: int, device: torch.device
) -> tuple[Tensor, Tensor, Tensor]:
    """Pictures, keypoints in heatmap cells (N, 23, 2), and whether each is in the picture."""
    examples = [pose_example(rng, source, rows) for _ in range(BATCH)]
    cells = np.stack([points for _, points, _ in examples]) / 4  # the heatmap's stride
    inside = np.stack([inside for _, _, inside in examples])
    images = to_tensor([image for image, _, _ in examples], device)
    return images, torch.from_numpy(cells).float().to(device), torch.from_numpy(inside).to(device)


def pose_loss(logits: Tensor, cells: Tensor, inside: Tensor) -> Tensor:
    """Cross entropy between each map's softmax and a Gaussian about the keypoint; a keypoint out
    of the picture should be nowhere, a flat map."""
    height, width = POSE_HEATMAP
    y = torch.arange(height, device=logits.device).view(1, 1, height, 1)
    x = torch.arange(width, device=logits.device).view(1, 1, 1, width)
    cx, cy = cells[..., 0, None, None], cells[..., 1, None, None]
    target = torch.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * SPREAD**2)).flatten(2)
    flat = torch.full_like(target, 1 / (height * width))
    target = torch.where(inside[..., None], target / target.sum(2, keepdim=True).clamp(1e-6), flat)
    entropy = -(target * functional.log_softmax(logits.flatten(2), dim=2)).sum(2)
    weight = torch.where(inside, 1.0, ABSENT_WEIGHT)
    return (entropy * weight).sum() / weight.sum()


def detector_batch(
    rng: np.random.Generator, source: Source, rows: int, device: torch.device
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Pictures; heat (N, 28, 28) of people's middles; boxes (N, 28, 28, 4) xyxy px of the person
    whose middle is near a cell, and the cell's weight in the box loss."""
    cells = DETECTOR_INPUT // DETECTOR_STRIDE
    images, heat = [], np.zeros((BATCH, cells, cells), np.float32)
    boxes = np.zeros((BATCH, cells, cells, 4), np.float32)
    grid = (np.arange(cells) + 0.5) * DETECTOR_STRIDE
    for n in range(BATCH):
        image, people = detector_example(rng, source, rows)
        images.append(image)
        for x0, y0, x1, y1 in people:
            sx, sy = max((x1 - x0) * 0.1, 5.0), max((y1 - y0) * 0.1, 5.0)
            across = (grid - (x0 + x1) / 2) / sx
            down = (grid - (y0 + y1) / 2) / sy
            bump = np.exp(-(down[:, None] ** 2 + across[None, :] ** 2) / 2)
            peak = np.unravel_index(bump.argmax(), bump.shape)
            bump[peak] = 1.0
            nearer = bump > heat[n]
            heat[n][nearer] = bump[nearer]
            boxes[n][nearer] = (x0, y0, x1, y1)
    weight = np.where(heat > 0.3, heat, 0)
    return (
        to_tensor(images, device),
        torch.from_numpy(heat).to(device),
        torch.from_numpy(boxes).to(device),
        torch.from_numpy(weight).to(device),
    )


def detector_loss(output: Tensor, heat: Tensor, boxes: Tensor, weight: Tensor) -> Tensor:
    """CenterNet's focal loss for the middles and the generalised IoU for the boxes."""
    score = torch.sigmoid(output[:, 0]).clamp(1e-4, 1 - 1e-4)
    positive = heat == 1
    found = -torch.log(score) * (1 - score) ** 2 * positive
    missed = -torch.log(1 - score) * score**2 * (1 - heat) ** 4 * ~positive
    people = positive.sum().clamp(min=1)
    apart = (1 - _giou(boxes_of(output), boxes)) * weight
    return (found.sum() + missed.sum()) / people + 2 * apart.sum() / weight.sum().clamp(min=1)


def _giou(a: Tensor, b: Tensor) -> Tensor:
    def area(box: Tensor) -> Tensor:
        return (box[..., 2:] - box[..., :2]).clamp(min=0).prod(-1)

    inner = torch.cat([torch.max(a[..., :2], b[..., :2]), torch.min(a[..., 2:], b[..., 2:])], -1)
    outer = torch.cat([torch.min(a[..., :2], b[..., :2]), torch.max(a[..., 2:], b[..., 2:])], -1)
    both = area(inner)
    either = area(a) + area(b) - both
    hull = area(outer)
    return both / either.clamp(min=1) - (hull - either) / hull.clamp(min=1)


@dataclass(frozen=True)
class Task:
    """One network to train. make_batch(rng, source, rows, device) gives pictures and targets;
    loss_of(output, *targets) their loss."""

    name: str
    network: nn.Module
    make_batch: Callable[..., tuple[Tensor, ...]]
    loss_of: Callable[..., Tensor]


def train(
    task: Task,
    plan: Plan,
    source: Source,
    checkpoint: Path,
    wait_for: Callable[[int], None],
    *,
    device: torch.device,
) -> nn.Module:
    """Train with AdamW; the result is the running mean of the weights.

    wait_for(rows) returns once the pool holds that many rows. The whole state is kept in
    `checkpoint` now and then, and an interrupted run goes on from there as if it had not been.
    """
    rng = np.random.default_rng(plan.seed)
    network = task.network.to(device, memory_format=torch.channels_last).train()
    mean = copy.deepcopy(network).eval()
    optimiser = torch.optim.AdamW(network.parameters(), lr=plan.learning_rate, weight_decay=0.02)
    first, spent = 0, 0.0
    if checkpoint.exists():
        state = torch.load(checkpoint, weights_only=True, map_location=device)
        first, spent = state["step"], state["seconds"]
        network.load_state_dict(state["network"])
        mean.load_state_dict(state["mean"])
        optimiser.load_state_dict(state["optimiser"])
        rng.bit_generator.state = json.loads(state["rng"])
    started, recent = time.monotonic() - spent, float("nan")
    for step in range(first, plan.steps):
        for group in optimiser.param_groups:
            group["lr"] = plan.rate_at(step)
        rows = plan.rows_at(step)
        wait_for(rows)
        images, *targets = task.make_batch(rng, source, rows, device)
        loss = task.loss_of(network(images), *targets)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 5.0)
        optimiser.step()
        _average(mean, network, min(0.99, 1 - 1 / (1 + step / 5)))
        recent = loss.item() if math.isnan(recent) else 0.97 * recent + 0.03 * loss.item()
        done, seconds = step + 1, time.monotonic() - started
        if done % 25 == 0:
            print(f"{task.name} {done}/{plan.steps} loss {recent:.3f} {seconds:.0f} s", flush=True)
        if done % 100 == 0 or done == plan.steps:
            state = {"step": done, "seconds": seconds, "network": network.state_dict()}
            state |= {"mean": mean.state_dict(), "optimiser": optimiser.state_dict()}
            state["rng"] = json.dumps(rng.bit_generator.state)
            torch.save(state, checkpoint.with_suffix(".part"))
            checkpoint.with_suffix(".part").replace(checkpoint)
    return mean


@torch.no_grad()
def _average(mean: nn.Module, network: nn.Module, keep: float) -> None:
    for a, b in zip(mean.state_dict().values(), network.state_dict().values(), strict=True):
        if a.dtype.is_floating_point:
            a.lerp_(b, 1 - keep)
        else:
            a.copy_(b)
