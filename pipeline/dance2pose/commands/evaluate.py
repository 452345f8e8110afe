"""`dance2pose evaluate`: the paper's experiments, and every lifter compared."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dance2pose.errors import UsageError
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.progress import for_terminal

_PUBLISHED = ("jointAngleModel.mat", "jointAngleModel_v2.mat")


def evaluate(
    data: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    ablate: bool = EvaluationSettings.ablate,
    only_own_bodies: bool = EvaluationSettings.only_own_bodies,
    window: int = EvaluationSettings.window,
    views: int = EvaluationSettings.views,
    tilt_deg: float = EvaluationSettings.tilt_deg,
    rate_hz: float = EvaluationSettings.rate_hz,
    seed: int = EvaluationSettings.seed,
    authors_limits: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Reproduce the paper's experiments on motion capture.

    Writes REPORT.md, and tables (CSV) and figures (PNG, if matplotlib is installed) in a folder
    report/ beside it.

    Parameters
    ----------
    data
        Folder of BVH files (CMU or Poser rig), or one file.
    output
        Folder to write to; made if it is missing.
    ablate
        Also run the paper's lifter without limits, without its anthropometric constraint, and
        with other numbers of atoms.
    only_own_bodies
        Only the default lifter on performers' own bodies and on drawn ones.
    window
        Window of the temporal models, frames.
    views
        Cameras around every take.
    tilt_deg
        Cameras look up or down by up to this many degrees.
    rate_hz
        Frames a second of the experiments that are not at the takes' own rate.
    seed
        Of all random numbers.
    authors_limits
        Folder of the limits that Akhter and Black published (.mat), to be measured beside ours.
    overwrite
        Replace an earlier report.
    quiet
        Show no progress.
    """
    _check(views=views, window=window, tilt_deg=tilt_deg, rate_hz=rate_hz, seed=seed)
    from dance2pose.evaluation.limits_check import JointLimits
    from dance2pose.evaluation.report import evaluate as run
    from dance2pose.limits.ab15 import read_authors_limits

    published: list[tuple[str, JointLimits]] = []
    if authors_limits is not None:
        pose = authors_limits / "staticPose.mat"
        for name in _PUBLISHED:
            limits = read_authors_limits(authors_limits / name, pose)
            published.append((f"Akhter & Black, {name}", limits))
    settings = EvaluationSettings(
        views=views,
        tilt_deg=tilt_deg,
        seed=seed,
        window=window,
        rate_hz=rate_hz,
        ablate=ablate,
        only_own_bodies=only_own_bodies,
    )
    files = run(
        data,
        output,
        settings,
        progress=for_terminal(quiet=quiet),
        overwrite=overwrite,
        published_limits=published,
    )
    print(f"wrote {files[-1]} and {len(files) - 1} tables and figures")


def _check(*, views: int, window: int, tilt_deg: float, rate_hz: float, seed: int) -> None:
    if not 1 <= views <= 64:
        raise UsageError(f"--views {views}; give 1 to 64 cameras")
    if not 1 <= window <= 59 or window % 2 == 0:
        raise UsageError(f"--window {window}; give an odd number of frames from 1 to 59")
    if not 0 <= tilt_deg <= 90:
        raise UsageError(f"--tilt-deg {tilt_deg:g}; give 0 to 90 degrees")
    if not 10 <= rate_hz <= 240:
        raise UsageError(f"--rate-hz {rate_hz:g}; give 10 to 240 frames a second")
    if seed < 0:
        raise UsageError(f"--seed {seed}; give a number that is not negative")
