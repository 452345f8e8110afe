"""Which skeleton keypoints are of: named by the person, by the file, or told by their number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dance2pose import skeleton as skeletons
from dance2pose.errors import DataError
from dance2pose.reading.content import Content, Float64Array, Picture, Sighting
from dance2pose.reading.joint_names import best_skeleton, columns_of
from dance2pose.skeleton import SKELETONS_BY_COUNT, Skeleton

# Fewer known names than this do not make a body.
_FEWEST_NAMES = 4
# Edges of the right layout are a sixth of the figure long; of a wrong one a third and more.
_LONG_EDGES = 0.3
# A layout fits better than the one assumed where its edges are shorter by this factor.
_SHORTER = 0.85
_LOOKED_AT = 500
_BODY_JOINTS = {
    joint
    for name in ("coco23", "halpe26", "body25", "body25b", "mpii16", "h36m17", "body17", "cmu17")
    for joint in skeletons.get(name).joints
}


def in_layout(
    pictures: list[Picture], content: Content, where: str, named: str | None
) -> tuple[str, list[Picture], list[str]]:
    """The skeleton, the pictures with the keypoints in its order, and what is to be said.

    named: the skeleton that the person says. Raises DataError for a number of keypoints that no
    skeleton has, or people of different ones.
    """
    people = [person for picture in pictures for person in picture.people]
    if named is not None:
        skeletons.get(named)
    if not people:
        if named is None:
            raise DataError(f"{where}: holds no person in any of {len(pictures)} pictures")
        return named, pictures, []
    if content.joints is not None:
        return _by_names(pictures, people, content.joints, where, named)
    count = len(people[0].keypoints)
    name = named or content.skeleton or SKELETONS_BY_COUNT.get(count, (None,))[0]
    if name is None:
        known = ", ".join(f"{n} ({', '.join(names)})" for n, names in SKELETONS_BY_COUNT.items())
        raise DataError(f"{people[0].where} has {count} keypoints; known numbers: {known}")
    _check_counts(people, skeletons.get(name))
    return name, pictures, _how_read(count, name, named) + _doubts(people, name)


def _how_read(count: int, name: str, named: str | None) -> list[str]:
    others = [other for other in SKELETONS_BY_COUNT.get(count, ()) if other != name]
    note = f"{count} keypoints read as {name}"
    if others and named is None:
        note += f" (--skeleton, where they are {' or '.join(others)})"
    return [note]


def _check_counts(people: Sequence[Sighting], skeleton: Skeleton) -> None:
    for person in people:
        if len(person.keypoints) != len(skeleton):
            raise DataError(
                f"{person.where} has {len(person.keypoints)} keypoints,"
                f" expected {len(skeleton)} ({skeleton.name})"
            )


def _by_names(
    pictures: list[Picture],
    people: Sequence[Sighting],
    joints: tuple[str, ...],
    where: str,
    named: str | None,
) -> tuple[str, list[Picture], list[str]]:
    for person in people:
        if len(person.keypoints) != len(joints):
            raise DataError(
                f"{person.where} has {len(person.keypoints)} keypoints,"
                f" the file names {len(joints)}"
            )
    if named is not None:
        name, columns = named, columns_of(joints, skeletons.get(named))
        if len(columns) < _FEWEST_NAMES and len(joints) == len(skeletons.get(named)):
            columns = {n: n for n in range(len(joints))}
    else:
        name, columns = best_skeleton(joints, skeletons.names())
    if len(columns) < _FEWEST_NAMES:
        raise DataError(
            f"{where}: the names {', '.join(joints[:12])} are not those of a body that is known;"
            " expected names such as left_shoulder, LKnee or hip_r"
        )
    unused = [joint for n, joint in enumerate(joints) if n not in columns.values()]
    note = f"{len(columns)} of {len(joints)} named keypoints read as {name}"
    if unused:
        note += f" (left out: {', '.join(unused[:8])}{', …' if len(unused) > 8 else ''})"
    moved = [replace(p, people=[_moved(s, columns, name) for s in p.people]) for p in pictures]
    return name, moved, [note]


def _moved(person: Sighting, columns: dict[int, int], name: str) -> Sighting:
    keypoints = np.full((len(skeletons.get(name)), 3), np.nan)
    keypoints[:, 2] = 0
    keypoints[list(columns)] = person.keypoints[list(columns.values())]
    return replace(person, keypoints=keypoints)


def _doubts(people: Sequence[Sighting], name: str) -> list[str]:
    """A word of warning where the lines of the layout join what does not belong together."""
    step = -(-len(people) // _LOOKED_AT)
    points = np.array([person.keypoints[:, :2] for person in people[::step]])
    here = edge_length(points, skeletons.get(name))
    others = [n for n in SKELETONS_BY_COUNT.get(points.shape[1], ()) if n != name]
    lengths = {other: edge_length(points, skeletons.get(other)) for other in others}
    better = min(lengths, key=lambda other: lengths[other], default=None)
    if better is not None and lengths[better] < _SHORTER * here and here > _LONG_EDGES / 2:
        return [
            f"as {name}, bones are implausible ({here:.0%} of the figure's size on average);"
            f" as {better} they are {lengths[better]:.0%}: is it --skeleton {better}?"
        ]
    if here > _LONG_EDGES:
        return [
            f"as {name}, bones are implausible ({here:.0%} of the figure's size on average):"
            " are the keypoints in another order?"
        ]
    return []


def edge_length(points: Float64Array, skeleton: Skeleton) -> float:
    """Mean length of the body's edges over the diagonal of the box around it; nan if not seen.

    points: (N, J, 2), NaN where missing.
    """
    bones = [
        bone
        for bone, ends in zip(skeleton.bones, skeleton.edges, strict=True)
        if set(ends) <= _BODY_JOINTS
    ]
    used = sorted({joint for bone in bones for joint in bone})
    with np.errstate(invalid="ignore"):
        span = np.nanmax(_known(points[:, used]), axis=1) - np.nanmin(
            _known(points[:, used]), axis=1
        )
        size = np.linalg.norm(span, axis=1)
        start, end = np.array(bones).T
        length = np.linalg.norm(points[:, start] - points[:, end], axis=2) / size[:, np.newaxis]
    known = length[np.isfinite(length)]
    return float(known.mean()) if len(known) else float("nan")


def _known(points: Float64Array) -> Float64Array:
    """Rows without any point made one point, so that nanmax has something to find."""
    none = np.isnan(points).all(axis=1, keepdims=True)
    return np.where(none, 0.0, points)
