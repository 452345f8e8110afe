"""`dance2pose compare`: two performances aligned in time, and how their joints differ."""

from __future__ import annotations

import csv
import hashlib
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from dance2pose.comparison import Comparison
from dance2pose.errors import UsageError
from dance2pose.export.loading import load_scene, poses_file
from dance2pose.export.scene import UNIT_SUFFIX, SceneDancer
from dance2pose.outputs import plan_outputs


def compare(
    a: Path,
    b: Path,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    dancer_a: int | None = None,
    dancer_b: int | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Align two performances in time and show how they differ.

    Writes a recording with both side by side and one over the other, in the time of the first, and
    beside it a table (.csv) of the differences of every joint in every phrase.

    Parameters
    ----------
    a
        The first performance: the poses .npz of a result, or its .rrd.
    b
        The second; it is aligned to the first.
    output
        The recording to write, a name that ends in .rrd.
    dancer_a
        Number of the dancer of the first; its first if not given.
    dancer_b
        Number of the dancer of the second; its first if not given.
    overwrite
        Replace files that dance2pose wrote.
    quiet
        Say nothing.
    """
    from dance2pose import comparison
    from dance2pose.recording.compared import write_compared

    inputs = (poses_file(a), poses_file(b))
    plan = plan_outputs(
        output, kinds=(".rrd",), beside=(".csv",), inputs=(a, b, *inputs), overwrite=overwrite
    )

    first, second = _dancer(a, dancer_a), _dancer(b, dancer_b)
    found = comparison.compare(first.poses, second.poses)
    names = (f"{a.stem}, {first.name}", f"{b.stem}, {second.name}")
    identity = hashlib.sha256()
    for part in (*(path.read_bytes() for path in inputs), " | ".join(names).encode()):
        identity.update(hashlib.sha256(part).digest())
    with plan.writing() as staged:
        write_compared(
            staged.path(plan.main),
            found,
            recording_id=f"dance2pose-{identity.hexdigest()[:32]}",
            names=names,
            table=_markdown(found, names),
        )
        _write_table(staged.path(plan.name(".csv")), found)
    if not quiet:
        print(_summary(found))
        for path in staged.files:
            print(f"wrote {path}")


def _dancer(path: Path, number: int | None) -> SceneDancer:
    """The dancer of that number in a result; its first for None."""
    dancers = load_scene(path).dancers
    if number is None:
        return dancers[0]
    for dancer in dancers:
        if dancer.person == number:
            return dancer
    there = ", ".join(str(p.person) for p in dancers)
    raise UsageError(f"{path}: has no dancer {number}; it has: {there}")


def _summary(found: Comparison) -> str:
    whole = found.phrases[0]
    overall, *joints = whole.joints
    worst = max(joints, key=lambda d: d.mean)
    count = len(found.phrases) - 1
    return (
        f"joints differ by {overall.mean:.3g} {found.unit} on average, most at the "
        f"{worst.joint.replace('_', ' ')} ({worst.mean:.3g}); the second takes "
        f"{whole.tempo:.2f} times as long; {count} phrase{'' if count == 1 else 's'}"
    )


def _write_table(path: Path, found: Comparison) -> None:
    unit = UNIT_SUFFIX[found.unit]
    with path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(
            [
                *("phrase", "start_a_s", "end_a_s", "start_b_s", "end_b_s", "tempo"),
                *("joint", f"mean_difference_{unit}", f"largest_difference_{unit}"),
            ]
        )
        for phrase in found.phrases:
            name = phrase.number or "whole"
            span = [f"{time:.4f}" for time in (*phrase.a_s, *phrase.b_s)]
            for joint in phrase.joints:
                values = [f"{joint.mean:.6g}", f"{joint.largest:.6g}"]
                table.writerow([name, *span, f"{phrase.tempo:.4f}", joint.joint, *values])


def _markdown(found: Comparison, names: tuple[str, str]) -> str:
    """The table for a reader: a row a joint, a column a phrase."""
    lines = [
        "# Differences",
        "",
        f"A: {names[0]}. B: {names[1]}. Mean distances in {found.unit} between joints about the "
        "pelvis, both bodies facing forward, B scaled to the size of A and aligned in time by "
        "dynamic time warping. Phrases are those of A.",
        "",
    ]
    phrases = found.phrases
    heads = [f"phrase {p.number}" if p.number else "whole" for p in phrases]
    lines += ["| | " + " | ".join(heads) + " |", "|---|" + "---|" * len(phrases)]
    spans = [f"{p.a_s[0]:.1f} to {p.a_s[1]:.1f}" for p in phrases]
    lines.append("| A, s | " + " | ".join(spans) + " |")
    spans = [f"{p.b_s[0]:.1f} to {p.b_s[1]:.1f}" for p in phrases]
    lines.append("| B, s | " + " | ".join(spans) + " |")
    lines.append("| B takes, times | " + " | ".join(f"{p.tempo:.2f}" for p in phrases) + " |")
    for joint in [d.joint for d in phrases[0].joints]:
        cells = []
        for phrase in phrases:
            values = {d.joint: d.mean for d in phrase.joints}
            cells.append(f"{values[joint]:.3f}" if joint in values else "")
        lines.append(f"| {joint.replace('_', ' ')} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
