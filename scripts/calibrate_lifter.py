"""Calibrate the standard deviations of the default lifter on takes that it was not trained on.

    python scripts/calibrate_lifter.py SHARED/mocap/train

Run after scripts/train_lifter.py has written models/lifter.onnx, and after any change to the
lifter that changes its errors. The factors are kept in the model's own metadata; or, with --into,
in that of a network which was trained on these takes as well, and whose errors on them say nothing.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import onnx

from dance2pose.assets import asset
from dance2pose.lifting import error_calibration
from dance2pose.mocap.corpus import read_take
from lifter_training.calibration import cases, fitted, shares
from lifter_training.held_out import HELD_OUT


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("source", nargs="+", type=Path, help="folders of takes")
    parser.add_argument("--hold-out", default=HELD_OUT, help="the takes that training left out")
    parser.add_argument("--frames", type=int, default=300, help="of each take, at 30 a second")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--into", type=Path, help="another lifter.onnx to keep them in, trained on these takes too"
    )
    options = parser.parse_args()
    names = options.hold_out.split()
    # Takes of positions alone are left out: they are on no body of their own.
    paths = [p for folder in options.source for p in sorted(folder.glob("*.bvh"))]
    takes = [read_take(path, own_bones=True) for path in paths if path.stem in names]
    found = list(cases(takes, options.frames, options.seed))
    of_kind = [[case for case in found if case.pictures == kind] for kind in (False, True)]
    calibrations = [fitted(kind) for kind in of_kind]
    for kind, calibration in zip(of_kind, calibrations, strict=True):
        print(calibration)
        for group, (one, two) in shares(kind, calibration).items():
            print(f"  {group}: {100 * one:.0f} % within one sigma, {100 * two:.0f} % within two")
    path = options.into or asset("lifter.onnx")
    model = onnx.load(str(path))
    kept = {item.key: item.value for item in model.metadata_props if item.key != "sigma_factors"}
    kept[error_calibration.METADATA] = error_calibration.written(*calibrations)
    if options.into is None:
        kept["held_out_takes"] = " ".join(names)
    onnx.helper.set_model_props(model, kept)
    onnx.save(model, str(path))


if __name__ == "__main__":
    main()
