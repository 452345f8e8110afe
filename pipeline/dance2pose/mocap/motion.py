"""A motion-capture take as its file holds it, and its forward kinematics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from dance2pose.poses import FloatArray


@dataclass(frozen=True)
class Motion:
    """A rigid hierarchy over time, in the file's own length unit.

    names, parents: J nodes, parents before children, -1 for the root; an end site is named after
    its parent with `_end`. offsets: (J, 3) in the parent's axes. rotations: (T, J, 3, 3), the
    parent's axes from the node's. root_position: (T, 3). frame_time_s: seconds between frames.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    offsets: FloatArray
    rotations: FloatArray
    root_position: FloatArray
    frame_time_s: float

    def __len__(self) -> int:
        return len(self.rotations)

    def frames(self, chosen: slice) -> Motion:
        """The same hierarchy with some of the frames."""
        return replace(
            self, rotations=self.rotations[chosen], root_position=self.root_position[chosen]
        )


def forward_kinematics(motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Positions (T, J, 3) of the nodes and rotations (T, J, 3, 3) world-from-node."""
    frames, joints = motion.rotations.shape[:2]
    position: npt.NDArray[np.float64] = np.zeros((frames, joints, 3))
    rotation: npt.NDArray[np.float64] = np.zeros((frames, joints, 3, 3))
    for j, parent in enumerate(motion.parents):
        if parent < 0:
            position[:, j] = motion.root_position
            rotation[:, j] = motion.rotations[:, j]
        else:
            position[:, j] = position[:, parent] + rotation[:, parent] @ motion.offsets[j]
            rotation[:, j] = rotation[:, parent] @ motion.rotations[:, j]
    return position, rotation
