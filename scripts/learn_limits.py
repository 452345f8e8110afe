"""Learn the joint-angle limits of the lifting skeletons from motion capture.

    python scripts/learn_limits.py SHARED/mocap/train -o models

Writes limits_cmu17.npz, limits_paper15.npz and limits_body17.npz. The same source, settings and
NumPy/SciPy versions give the same files. Never give it takes that are evaluated on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import scipy

from dance2pose.lifting import limits
from dance2pose.lifting.limits_learning import (
    Margins,
    ObservationSettings,
    observe,
    training_poses,
    widen,
)
from dance2pose.mocap.corpus import read_takes

SCRIPT_VERSION = "1"
SKELETONS = ("cmu17", "paper15", "body17")
LICENCE = (
    "Learned from the CMU Motion Capture Database (mocap.cs.cmu.edu), which is free for research "
    "and commercial use; created with funding from NSF EIA-0196217. The database itself may not "
    "be resold and is not contained here."
)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("source", nargs="+", type=Path, help="folders of takes, or single takes")
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder to write to")
    parser.add_argument("--skeleton", choices=SKELETONS, action="append")
    parser.add_argument("--occupancy-deg", type=float, default=Margins.occupancy_deg)
    parser.add_argument("--region-deg", type=float, default=Margins.region_deg)
    options = parser.parse_args()
    margins = Margins(options.occupancy_deg, options.region_deg)
    for skeleton in options.skeleton or SKELETONS:
        takes = [take for source in options.source for take in read_takes(source, skeleton)]
        poses = training_poses(takes, ObservationSettings.rate_hz)
        metadata = {
            "script": f"learn_limits.py {SCRIPT_VERSION}",
            "sources": sorted(take.name for take in takes),
            "poses": len(poses),
            "licence": LICENCE,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        }
        learned = widen(observe(poses, skeleton), margins, metadata)
        path = options.output / f"limits_{skeleton}.npz"
        limits.save(learned, path, overwrite=True)
        print(f"{path}: {len(learned.axes)} regions from {len(poses)} poses")


if __name__ == "__main__":
    main()
