"""The lifters that are compared, each with its parts switched off one at a time.

A lifter is one entry of `lifters()`; the experiments know nothing else of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial

from dance2pose.lifting import paper, sequence
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.pursuit import PursuitSettings
from dance2pose.lifting.sequence import SequenceSettings


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


def lifters() -> tuple[LifterEntry, ...]:
    """The lifters themselves."""
    return (PAPER, DEFAULT, replace(DEFAULT, name="default, frames unrelated", independent=True))


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

    def entry(name: str, settings: PursuitSettings, *, limited: bool = True) -> LifterEntry:
        lift = partial(paper.lift_frames, settings=settings, limited=limited)
        return LifterEntry(name, lift, part_of=PAPER.name)

    return (
        entry("paper without limits", usual, limited=False),
        entry("paper without anthropometric constraint", replace(usual, anthropometric=False)),
        entry("paper without either", replace(usual, anthropometric=False), limited=False),
        *(
            entry(f"paper, K = {atoms}", replace(usual, atoms=atoms))
            for atoms in (3, 6, 15, 25)
            if atoms != usual.atoms
        ),
    )
