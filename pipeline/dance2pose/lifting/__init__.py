"""From 2D keypoints to 3D poses: `lift`, and the parts it is made of."""

from dance2pose.lifting.lift import lift, lift_all

__all__ = ["lift", "lift_all"]
