"""From a single-camera dance video to 3D motion that can be reviewed, exported and kept.

    import dance2pose as d2p
    r = d2p.analyse("tape.mp4", detector="detector.onnx", pose="keypoints.onnx")
    r.dancers[0].smoothed.xyz
    r.save("tape.rrd")

Importing the package loads nothing heavy: each name below is imported when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from dance2pose import skeleton as skeletons
    from dance2pose.angles import joint_angles as joint_angles
    from dance2pose.front_door import load as load
    from dance2pose.front_door import smooth as smooth
    from dance2pose.lifting.lift import lift as lift
    from dance2pose.lifting.lift import lift_all as lift_all
    from dance2pose.options import LiftOptions as LiftOptions
    from dance2pose.options import OutputOptions as OutputOptions
    from dance2pose.options import Settings as Settings
    from dance2pose.options import SmoothOptions as SmoothOptions
    from dance2pose.options import VideoOptions as VideoOptions
    from dance2pose.poses import Dancer as Dancer
    from dance2pose.poses import Timeline as Timeline
    from dance2pose.poses import Track2D as Track2D
    from dance2pose.poses import Track3D as Track3D
    from dance2pose.reconstruction import Reconstruction as Reconstruction
    from dance2pose.reconstruction import analyse as analyse
    from dance2pose.reconstruction import reconstruct as reconstruct

# Where each public name lives.
_HOMES = {
    "analyse": "reconstruction",
    "reconstruct": "reconstruction",
    "Reconstruction": "reconstruction",
    "lift": "lifting.lift",
    "lift_all": "lifting.lift",
    "smooth": "front_door",
    "load": "front_door",
    "joint_angles": "angles",
    "Settings": "options",
    "VideoOptions": "options",
    "LiftOptions": "options",
    "SmoothOptions": "options",
    "OutputOptions": "options",
    "Timeline": "poses",
    "Track2D": "poses",
    "Track3D": "poses",
    "Dancer": "poses",
}

__all__ = [*_HOMES, "__version__", "skeletons"]


def __getattr__(name: str) -> Any:
    import importlib

    if name == "skeletons":
        return importlib.import_module(f"{__name__}.skeleton")
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
