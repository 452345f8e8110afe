"""What a lifter is given and what it returns; `lift` turns tracks into the one and back.

Image points here have y up, so that image, camera and world axes agree: x right, y up, z towards
the viewer. Lengths are mm on the one body of `mocap.corpus`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from dance2pose.body import Body
from dance2pose.lifting.error_calibration import ErrorParts
from dance2pose.lifting.world.moving_camera import CameraMotion
from dance2pose.poses import FloatArray


@dataclass(frozen=True)
class Observed:
    """A track in its lifting skeleton of J joints.

    xy: (T, J, 2) px, y up, NaN where not seen. confidence: (T, J) of the keypoint model, 0 where
    not seen. time_s: (T,). skeleton: cmu17, paper15 or body17. image_size: (width, height) px.
    independent: the frames are unrelated pictures. camera: the camera model asked for.
    fov_deg: field of view across the longer side of the picture, None where it is not known.
    body: the dancer's bone lengths in that skeleton (cmu17's for paper15), where they are known
    before. motion: how the camera turns and zooms in these T frames, None where it stands still.
    """

    xy: FloatArray
    confidence: FloatArray
    time_s: npt.NDArray[np.float64]
    skeleton: str
    image_size: tuple[int, int]
    independent: bool = False
    camera: str = "weak-perspective"
    fov_deg: float | None = None
    body: Body | None = None
    motion: CameraMotion | None = None

    def __len__(self) -> int:
        return len(self.xy)


@dataclass(frozen=True)
class Lifted:
    """Poses that a lifter found.

    xyz: (T, J, 3) mm as the camera sees them, first joint at the origin, NaN where nothing is
    known. projected: (T, J, 2) px, y up, where the camera found sees those joints. sigma: (T, J)
    mm, or None. root: (T, 3) mm, the first joint as seen from the camera, or None. body: the
    dancer's bone lengths, where the lifter finds them. errors: what sigma is made of.
    """

    xyz: FloatArray
    projected: FloatArray
    sigma: FloatArray | None = None
    root: FloatArray | None = None
    body: Body | None = None
    errors: ErrorParts | None = None


Lifter = Callable[[Observed], Lifted]
