"""The lifters that are compared, each with its parts switched off one at a time.

A lifter is one entry of `lifters()`; the experiments know nothing else of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial

from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.pursuit import paper
from dance2pose.lifting.pursuit.pursue import PursuitSettings
from dance2pose.lifting.temporal import sequence
from dance2pose.lifting.temporal.one_body import SequenceSettings


@dataclass(frozen=True)
class LifterEntry:
    """name: as in tables. lift: what is measured. independent: the frames are given as unrelated
    pictures. part_of: for an ablation, the name of the lifter that it takes a part from."""

    name: str
    lift: Callable[[Observed], Lifted]
    independent: bool = False
    part_of: str = ""


PAPER = LifterEntry("paper", paper.lift_frames)
DEFAULT = LifterEntry("default", sequence.lift_frames)


# The pursuit as R12 and AB15 write it down: one start from the mean pose, the constraint on bone
# lengths in closed form on the coefficients (without a penalty on them), the pursuit's own pose.
AS_WRITTEN = LifterEntry(
    "paper, as written",
    partial(
        paper.lift_frames,
        settings=PursuitSettings(closed_form=True, start_atoms=0, ridge=1e-3, atoms=10),
        exact_bones=False,
    ),
)


def lifters() -> tuple[LifterEntry, ...]:
    """The lifters themselves."""
    return (
        PAPER,
        AS_WRITTEN,
        DEFAULT,
        replace(DEFAULT, name="default, frames unrelated", independent=True),
    )


def default_ablations() -> tuple[LifterEntry, ...]:
    """The default lifter with each of its parts switched off, and with all of them."""
    parts = [field.name for field in fields(SequenceSettings)]
    one_off = [
        LifterEntry(
            f"default without {part}",
            partial(sequence.lift_frames, settings=SequenceSettings(**{part: False})),
            part_of=DEFAULT.name,
        )
        for part in parts
    ]
    none = SequenceSettings(**dict.fromkeys(parts, False))
    return (
        *one_off,
        LifterEntry(
            "default, network alone",
            partial(sequence.lift_frames, settings=none),
            part_of=DEFAULT.name,
        ),
    )


def paper_ablations() -> tuple[LifterEntry, ...]:
    """The paper's lifter without limits, without the anthropometric constraint, with other K."""
    usual = PursuitSettings()

    def entry(
        name: str, settings: PursuitSettings, *, limited: bool = True, exact_bones: bool = True
    ) -> LifterEntry:
        lift = partial(
            paper.lift_frames, settings=settings, limited=limited, exact_bones=exact_bones
        )
        return LifterEntry(name, lift, part_of=PAPER.name)

    free = replace(usual, anthropometric=False)
    return (
        AS_WRITTEN,
        entry("paper without limits", usual, limited=False),
        entry("paper without anthropometric constraint", free, exact_bones=False),
        entry("paper without either", free, exact_bones=False, limited=False),
        entry("paper without exact bone lengths", usual, exact_bones=False),
        entry("paper from one start", replace(usual, start_atoms=0)),
        *(
            entry(f"paper, K = {atoms}", replace(usual, atoms=atoms))
            for atoms in (4, 8, 10, 25)
            if atoms != usual.atoms
        ),
    )
