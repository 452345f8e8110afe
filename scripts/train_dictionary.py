"""Learn the pose dictionaries of the lifting skeletons from motion capture.

    python scripts/train_dictionary.py SHARED/mocap/train SHARED/mocap/train_positions -o models

Writes dictionary_cmu17.npz, dictionary_paper15.npz and dictionary_body17.npz. The same sources,
settings and NumPy/SciPy versions give the same files. Never give it takes that are evaluated on.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, fields, replace
from pathlib import Path

import numpy as np
import scipy

from dance2pose.lifting.pursuit.dictionary import save
from dance2pose.mocap.corpus import read_takes
from dictionary_training.learning import LearningSettings, learn, training_poses

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
    for field in fields(LearningSettings):
        option = "--" + field.name.replace("_", "-")
        parser.add_argument(option, type=type(field.default), default=field.default)
    options = parser.parse_args()
    settings = LearningSettings(
        **{f.name: getattr(options, f.name) for f in fields(LearningSettings)}
    )
    for skeleton in options.skeleton or SKELETONS:
        takes = [take for source in options.source for take in read_takes(source, skeleton)]
        poses = training_poses(takes, skeleton, settings)
        dictionary = learn(poses, skeleton, settings)
        metadata = {
            "script": f"train_dictionary.py {SCRIPT_VERSION}",
            "settings": asdict(settings),
            "sources": sorted(take.name for take in takes),
            "frames": sum(len(take.xyz) for take in takes),
            "training_poses": len(poses),
            "licence": LICENCE,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
        }
        path = options.output / f"dictionary_{skeleton}.npz"
        save(replace(dictionary, metadata=metadata), path, overwrite=True)
        print(
            f"{path}: {len(dictionary)} atoms from {len(poses)} poses, {path.stat().st_size} bytes"
        )


if __name__ == "__main__":
    main()
