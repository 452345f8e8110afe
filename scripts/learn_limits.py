"""Learn the joint-angle limits of the lifting skeletons from motion capture.

    python scripts/learn_limits.py SHARED/mocap/train SHARED/mocap/train_positions -o models

Writes limits_cmu17.npz, limits_paper15.npz and limits_body17.npz. The same source, settings and
NumPy/SciPy versions give the same files. Never give it takes that are evaluated on.

    python scripts/learn_limits.py SHARED/mocap/train --trade-off models/report \
        --authors SHARED/limits

learns nothing, but measures what the margin costs: limits_trade_off.csv, .md and .png. The
published limits are drawn too where their files are given.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import scipy

from dance2pose.evaluation import plots
from dance2pose.evaluation.limits_check import JointLimits
from dance2pose.evaluation.limits_trade_off import plot_trade_off, trade_off, trade_off_table
from dance2pose.limits import model as limits
from dance2pose.limits.ab15 import read_authors_limits
from dance2pose.limits.learning import (
    Margins,
    ObservationSettings,
    seen_directions,
    training_poses,
    widen,
)
from dance2pose.mocap.corpus import read_takes
from dance2pose.progress import PlainLines

SCRIPT_VERSION = "2"
SKELETONS = ("cmu17", "paper15", "body17")
LICENCE = (
    "Learned from the CMU Motion Capture Database (mocap.cs.cmu.edu), which is free for research "
    "and commercial use; created with funding from NSF EIA-0196217. The database itself may not "
    "be resold and is not contained here."
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("source", nargs="+", type=Path, help="folders of takes, or single takes")
    wanted = parser.add_mutually_exclusive_group(required=True)
    wanted.add_argument("-o", "--output", type=Path, help="folder to write the limits to")
    wanted.add_argument("--trade-off", type=Path, help="folder to write the trade-off to")
    parser.add_argument("--authors", type=Path, help="folder of the published limits (.mat)")
    parser.add_argument("--skeleton", choices=SKELETONS, action="append")
    parser.add_argument("--occupancy-deg", type=float, default=Margins.occupancy_deg)
    parser.add_argument("--region-deg", type=float, default=Margins.region_deg)
    options = parser.parse_args()
    if options.trade_off:
        write_trade_off(options.source, options.trade_off, options.authors)
    else:
        learn(options)


def learn(options: argparse.Namespace) -> None:
    margins = Margins(options.occupancy_deg, options.region_deg)
    for skeleton in options.skeleton or SKELETONS:
        takes = [take for source in options.source for take in read_takes(source, skeleton)]
        poses, take = training_poses(takes, ObservationSettings.rate_hz)
        metadata = {
            "script": f"learn_limits.py {SCRIPT_VERSION}",
            "sources": sorted(take.name for take in takes),
            "poses": len(poses),
            "licence": LICENCE,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        }
        learned = widen(seen_directions(poses, skeleton, take=take), margins, metadata)
        path = options.output / f"limits_{skeleton}.npz"
        limits.save(learned, path, overwrite=True)
        print(f"{path}: {len(learned.axes)} regions from {len(poses)} poses")


def write_trade_off(sources: list[Path], folder: Path, authors: Path | None) -> None:
    takes = [take for source in sources for take in read_takes(source)]
    others: list[tuple[str, JointLimits]] = []
    for file in ("jointAngleModel.mat", "jointAngleModel_v2.mat") if authors else ():
        assert authors is not None
        published = read_authors_limits(authors / file, authors / "staticPose.mat")
        others.append((f"Akhter & Black, {file}", published))
    points = trade_off(takes, others, seed=0, progress=PlainLines())
    table = trade_off_table(points)
    table.write_csv(folder, overwrite=True)
    (folder / "limits_trade_off.md").write_text(
        "# The margin of the joint-angle limits\n\n" + table.markdown() + "\n", encoding="utf-8"
    )
    if plots.available():
        plot_trade_off(points, folder / "limits_trade_off.png")
    print(table.markdown())


if __name__ == "__main__":
    main()
