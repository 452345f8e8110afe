"""netCDF in the form of the Python package movement (a dataset of poses).

Dimensions time, space, keypoints, individuals; variables position and confidence. netCDF 3, which
every reader has; times are the frames' own, of all dancers together, NaN where a dancer is not
there. movement asks for a confidence: a joint lifted to 3D has none, so it is NaN.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.io import netcdf_file

from dance2pose.errors import UsageError
from dance2pose.even_rate import frame_rate
from dance2pose.export.scene import AXES, ExportScene

# A classic netCDF file takes no larger variable.
_MAX_BYTES = 2**31 - 4


def write_netcdf(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write all dancers of the scene, who must share one skeleton."""
    skeletons = {p.skeleton.name for p in scene.dancers}
    if len(skeletons) > 1:
        raise UsageError(
            f"{path}: movement has one skeleton, not {' and '.join(sorted(skeletons))}"
        )
    times = np.unique(np.concatenate([p.poses.time_s for p in scene.dancers]))
    joints = scene.dancers[0].skeleton.joints
    position = np.full((len(times), 3, len(joints), len(scene.dancers)), np.nan)
    for i, dancer in enumerate(scene.dancers):
        rows = np.searchsorted(times, dancer.poses.time_s)
        position[rows, :, :, i] = dancer.poses.world_xyz.transpose(0, 2, 1)
    if position.nbytes > _MAX_BYTES:
        raise UsageError(f"{path}: {len(times)} frames are too many for netCDF; use .parquet")
    with netcdf_file(str(path), "w", version=2) as file:
        _attributes(file, scene, times)
        _coordinate(file, "time", times)
        _texts(file, "space", ("x", "y", "z"))
        _texts(file, "keypoints", joints)
        _texts(file, "individuals", [p.name for p in scene.dancers])
        place = file.createVariable("position", "d", ("time", "space", "keypoints", "individuals"))
        place[:] = position
        place.units = scene.unit
        sure = file.createVariable("confidence", "d", ("time", "keypoints", "individuals"))
        sure[:] = np.nan
        for variable in (place, sure):
            variable._FillValue = np.nan
    return ()


def _attributes(file: netcdf_file, scene: ExportScene, times: npt.NDArray[np.float64]) -> None:
    attributes = {
        "ds_type": "poses",
        "source_software": "dance2pose",
        "source_file": scene.video.name if scene.video else "",
        "time_unit": "seconds",
        "fps": frame_rate(times),
        "unit": scene.unit,
        "axes": AXES,
        "provenance": scene.provenance_json(),
    }
    for name, value in attributes.items():
        setattr(file, name, value)


def _coordinate(file: netcdf_file, name: str, values: npt.NDArray[np.float64]) -> None:
    file.createDimension(name, len(values))
    variable = file.createVariable(name, "d", (name,))
    variable[:] = values


def _texts(file: netcdf_file, name: str, texts: tuple[str, ...] | list[str]) -> None:
    """A coordinate of texts, as characters in the way that xarray reads them."""
    characters = np.array([text.encode() for text in texts])
    width = characters.dtype.itemsize
    file.createDimension(name, len(texts))
    file.createDimension(f"{name}_length", width)
    variable = file.createVariable(name, "c", (name, f"{name}_length"))
    variable[:] = characters.view("S1").reshape(len(texts), width)
    variable._Encoding = "utf-8"
