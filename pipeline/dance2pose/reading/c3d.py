"""C3D files through ezc3d (an extra): marker positions, and the same file with other positions."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose.errors import DataError, UsageError
from dance2pose.output_files import written_whole

_LARGEST = 1024**3


class C3dFile:
    """A recording of marker positions.

    names: of the markers. points: (T, N, 3) in `unit`, NaN where a marker was not seen.
    time_s: (T,) seconds from the first frame of the recording. frame: (T,) its numbers.
    """

    def __init__(self, path: Path) -> None:
        """Raises DataError for what is no C3D file, UsageError where ezc3d is not installed."""
        self._content = _load(path)
        data = self._content["data"]["points"]
        parameters = self._content["parameters"]["POINT"]
        rate = float(self._content["header"]["points"]["frame_rate"])
        if data.ndim != 3 or 0 in data.shape:
            raise DataError(f"{path}: holds no marker, or no frame")
        if not rate > 0:
            raise DataError(f"{path}: its frame rate is {rate}")
        self.points = np.moveaxis(np.asarray(data[:3], np.float64), (2, 1, 0), (0, 1, 2))
        self.names = _labels(parameters, self.points.shape[1])
        units = parameters.get("UNITS", {}).get("value") or [""]
        self.unit = str(units[0]).strip()
        first = int(self._content["header"]["points"]["first_frame"])
        self.frame = first + np.arange(len(self.points), dtype=np.int64)
        self.time_s = np.arange(len(self.points)) / rate

    def write(self, path: Path, points: npt.NDArray[Any], *, overwrite: bool = False) -> None:
        """The same file with other positions (T, N, 3); all else stays. Raises OutputError."""
        self._content["data"]["points"][:3] = np.moveaxis(points, (0, 1, 2), (2, 1, 0))
        with written_whole(path, overwrite=overwrite) as temporary:
            self._content.write(str(temporary))


def _load(path: Path) -> Any:
    try:
        import ezc3d
    except ImportError as error:
        raise UsageError(f"{path}: C3D needs ezc3d; install dance2pose[c3d]") from error
    try:
        size = path.stat().st_size
        if size > _LARGEST:
            raise DataError(f"{path}: {size / 1e9:.1f} GB are too much for one C3D file")
        with path.open("rb") as file:
            if file.read(2)[1:] != b"\x50":
                raise DataError(f"{path}: not a C3D file (its second byte is not 50 hex)")
        return ezc3d.c3d(str(path))
    except OSError as error:
        reason = error.strerror or str(error)
        raise DataError(f"{path}: not a C3D file that can be read: {reason}") from error
    except (RuntimeError, ValueError, KeyError, IndexError, MemoryError) as error:
        raise DataError(f"{path}: not a C3D file that can be read: {error}") from error


def _labels(parameters: Any, count: int) -> tuple[str, ...]:
    """LABELS and, for more than 255 markers, LABELS2 and so on; numbers where they run out."""
    names: list[str] = []
    for n in range(1, 10):
        entry = parameters.get("LABELS" if n == 1 else f"LABELS{n}")
        names += [str(name).strip() for name in entry["value"]] if entry else []
    return tuple(names[n] if n < len(names) else f"marker {n + 1}" for n in range(count))
