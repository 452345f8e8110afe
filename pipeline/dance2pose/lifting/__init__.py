"""From 2D keypoints to 3D poses: `lift`, and the parts it is made of."""

from dance2pose.lifting.lift import lift

__all__ = ["lift"]
