"""A pool of rendered samples on disk, made by several processes and read while it grows."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from figure_renderer.rig import read_performance
from figure_renderer.samples import PICTURE, SampleMaker

# Takes that no model is trained on: that of the bundled clip, and one or two of every kind for
# testing on rendered figures.
CLIP_TAKE = "94_indian_13"
TEST_TAKES = (CLIP_TAKE, "05_18", "05_03", "60_salsa_09", "60_salsa_24", "135_martial_07",
              "06_15", "09_11", "02_06")  # fmt: skip
FRAMES_APART_S = 1 / 15


@dataclass
class Pool:
    """pictures: (N, 224, 224, 4) uint8, RGB and the figure's coverage. keypoints: (N, 23, 2) px.
    state: (N,) uint8, 0 not made yet, 1 figure alone, 2 figure in a place."""

    pictures: npt.NDArray[np.uint8]
    keypoints: npt.NDArray[np.float32]
    state: npt.NDArray[np.uint8]

    def ready(self) -> npt.NDArray[np.int64]:
        return np.flatnonzero(self.state)


def _open(folder: Path, count: int, mode: str) -> Pool:
    def array(name: str, dtype: str, shape: tuple[int, ...]) -> npt.NDArray[np.generic]:
        file = folder / f"{name}.npy"
        if mode == "w+":
            return np.lib.format.open_memmap(file, "w+", dtype, (count, *shape))
        return np.load(file, mmap_mode="r+" if mode == "r+" else "r", allow_pickle=False)

    return Pool(
        array("pictures", "u1", (PICTURE, PICTURE, 4)),
        array("keypoints", "f4", (23, 2)),
        array("state", "u1", ()),
    )


def open_pool(folder: Path) -> Pool:
    return _open(folder, 0, "r")


def start_pool(
    folder: Path, mocap: Path, count: int, *, seed: int, workers: int, test: bool = False
) -> list[subprocess.Popen[bytes]]:
    """Make the files and start processes that fill them: of W workers, number k makes the rows
    k, k + W, ... with its own seed, so that the same call makes the same pool."""
    folder.mkdir(parents=True, exist_ok=True)
    _open(folder, count, "w+")
    return [
        subprocess.Popen(
            [sys.executable, "-m", "figure_renderer.pool", str(folder), str(mocap)]
            + [str(value) for value in (k, workers, seed + k, int(test))],
            cwd=Path(__file__).parents[1],
        )
        for k in range(workers)
    ]


def fill(folder: Path, mocap: Path, first: int, step: int, seed: int, test: bool) -> None:
    """Render samples into every `step`th row of a pool from row `first`."""
    pool = _open(folder, 0, "r+")
    files = [p for p in sorted(mocap.glob("*.bvh")) if (p.stem in TEST_TAKES) == test]
    takes = []
    for path in files:
        rate = 60.0 if "_salsa_" in path.stem else 120.0
        takes.append(read_performance(path, every=max(1, round(rate * FRAMES_APART_S))))
    rows = range(first, len(pool.state), step)
    for row, sample in zip(rows, SampleMaker(takes).samples(seed), strict=False):
        pool.pictures[row] = np.dstack([sample.picture, sample.mask])
        pool.keypoints[row] = sample.keypoints
        pool.state[row] = 2 if sample.in_place else 1


if __name__ == "__main__":
    fill(Path(sys.argv[1]), Path(sys.argv[2]), *map(int, sys.argv[3:6]), bool(int(sys.argv[6])))
