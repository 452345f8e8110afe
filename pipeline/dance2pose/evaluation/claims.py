"""What a report may claim of its takes: whether any of them was learned from."""

from __future__ import annotations

from collections.abc import Iterable

from dance2pose.lifting.pursuit import dictionary
from dance2pose.lifting.temporal import depth
from dance2pose.limits import model as limits

_SKELETONS = ("cmu17", "body17")


def learned_from() -> dict[str, frozenset[str]]:
    """The takes that each file of this installation says it was learned from."""
    found = {}
    for skeleton in _SKELETONS:
        found[f"dictionary_{skeleton}.npz"] = dictionary.load(skeleton).metadata
        found[f"limits_{skeleton}.npz"] = limits.load(skeleton).metadata
    sources = {file: frozenset(data.get("sources", ())) for file, data in found.items()}
    return sources | {"lifter.onnx": depth.trained_takes()}


def overlap_sentence(takes: Iterable[str], learned: dict[str, frozenset[str]]) -> str:
    """Which of the takes are among those that files were learned from, as the report says it.

    Examples
    --------
    >>> overlap_sentence(["01_06"], {"a.npz": frozenset({"02_01"})})
    'none of them is named among the takes that a.npz was learned from'
    >>> overlap_sentence(["01_06", "02_01"], {"a.npz": frozenset({"02_01"})})
    '**1 of them was learned from, so that its figures are too good** (a.npz: 02_01)'
    >>> overlap_sentence(["01_06"], {"a.npz": frozenset()})
    'a.npz does not say what it was learned from'
    """
    named = {file: sorted(set(takes) & known) for file, known in learned.items()}
    both = {take for names in named.values() for take in names}
    if both:
        where = "; ".join(f"{file}: {', '.join(names)}" for file, names in named.items() if names)
        was, its = ("was", "its") if len(both) == 1 else ("were", "their")
        return (
            f"**{len(both)} of them {was} learned from, so that {its} figures are too good** "
            f"({where})"
        )
    silent = [file for file, known in learned.items() if not known]
    told = [file for file in learned if file not in silent]
    sentences = []
    if told:
        sentences.append(
            f"none of them is named among the takes that {', '.join(told)} "
            f"{'was' if len(told) == 1 else 'were'} learned from"
        )
    if silent:
        does = "does" if len(silent) == 1 else "do"
        it = "it was" if len(silent) == 1 else "they were"
        sentences.append(f"{', '.join(silent)} {does} not say what {it} learned from")
    return "; ".join(sentences)
