"""Data sets out of HDF5 files from anywhere: sizes checked before they are read, nothing that lies
in other files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose.errors import DataError

LARGEST = 2 * 1024**3


def read_dataset(path: Path, dataset: Any) -> npt.NDArray[Any]:
    """All of a data set; DataError for one that is too large or stored outside the file.

    Data sets of chunks that were never written take no room in the file whatever they claim.
    """
    if getattr(dataset, "external", None) or getattr(dataset, "is_virtual", False):
        raise DataError(f"{path}: {dataset.name} lies in another file, which is not followed")
    if Path(str(dataset.file.filename)) != path:
        raise DataError(f"{path}: a link leads to another file, which is not followed")
    size = dataset.size * dataset.dtype.itemsize
    if size > LARGEST:
        raise DataError(
            f"{path}: {dataset.name} of shape {dataset.shape} would take {size / 1e9:.1f} GB"
        )
    return np.asarray(dataset[()])
