"""What a skeleton is: names of joints, lines between them, the mirror image."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from dance2pose.errors import UsageError


@dataclass(frozen=True)
class Skeleton:
    """Joint (or keypoint) names and the lines between them.

    edges: pairs of names; in a lifting skeleton these are the bones (parent, child), and bone b
    ends at joint b + 1, so that there is one edge for every joint but the first.
    """

    name: str
    joints: tuple[str, ...]
    edges: tuple[tuple[str, str], ...]

    def __len__(self) -> int:
        return len(self.joints)

    def index(self, joint: str) -> int:
        """Index of a joint by name; UsageError names the known ones."""
        try:
            return self.joints.index(joint)
        except ValueError:
            known = ", ".join(self.joints)
            raise UsageError(f"{self.name} has no joint {joint!r}; it has: {known}") from None

    @cached_property
    def bones(self) -> tuple[tuple[int, int], ...]:
        """The edges as pairs of indices."""
        return tuple((self.joints.index(a), self.joints.index(b)) for a, b in self.edges)

    @cached_property
    def parents(self) -> tuple[int, ...]:
        """Parent index of every joint, -1 for the root; only lifting skeletons are trees."""
        if not self.is_tree:
            raise UsageError(f"skeleton {self.name} is a set of keypoints, not a tree of bones")
        return (-1, *(parent for parent, _ in self.bones))

    @cached_property
    def is_tree(self) -> bool:
        return [child for _, child in self.bones] == list(range(1, len(self.joints)))

    @cached_property
    def mirror(self) -> tuple[int, ...]:
        """Permutation of joint indices that swaps left and right."""

        def swapped(name: str) -> str:
            for side, other in (("left", "right"), ("right", "left")):
                if side in name.split("_"):
                    return "_".join(other if part == side else part for part in name.split("_"))
            return name

        return tuple(self.joints.index(swapped(name)) for name in self.joints)
