"""Calibrate the standard deviations of the default lifter on takes that it was not trained on.

    python scripts/calibrate_lifter.py SHARED/mocap/train SHARED/mocap/train_positions

Run after scripts/train_lifter.py has written models/lifter.onnx, and after any change to the
lifter that changes its errors. The factors are kept in the model's own metadata.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import onnx

from dance2pose.assets import asset
from dance2pose.lifting.temporal import depth
from dance2pose.mocap.corpus import read_takes
from lifter_training.calibration import sigma_factors
from train_lifter import HELD_OUT


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("source", nargs="+", type=Path, help="folders of takes")
    parser.add_argument("--hold-out", default=HELD_OUT, help="the takes that training left out")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    names = options.hold_out.split()
    takes = [t for folder in options.source for t in read_takes(folder) if t.name in names]
    before = depth.sigma_factors()
    factors = before * sigma_factors(takes, np.random.default_rng(options.seed))
    path = asset("lifter.onnx")
    model = onnx.load(str(path))
    kept = {item.key: item.value for item in model.metadata_props}
    kept["sigma_factors"] = json.dumps([round(float(f), 4) for f in factors])
    kept["held_out_takes"] = " ".join(names)
    onnx.helper.set_model_props(model, kept)
    onnx.save(model, str(path))
    print("sigma factors, joint by joint:", kept["sigma_factors"])


if __name__ == "__main__":
    main()
