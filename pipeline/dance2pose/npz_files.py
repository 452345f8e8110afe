"""Reading .npz archives of arrays that may come from anywhere, and writing them whole.

Nothing is unpickled, and what an array would need is read from its header before memory is taken
for it: an archive that claims more than `MAX_BYTES` is refused.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from tokenize import TokenError
from typing import IO, Any

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from dance2pose.errors import DataError
from dance2pose.output_files import written_whole

AnyArray = npt.NDArray[Any]

# All arrays of one file together. Six hours of 26 keypoints at 60 frames/s take 0.7 GB.
MAX_BYTES = 2 * 1024**3
_MAX_ARRAYS = 1000


def read_arrays(path: Path, *, max_bytes: int = MAX_BYTES) -> dict[str, AnyArray]:
    """All arrays of an .npz file by name.

    Raises DataError naming the file and the array: not an .npz file, damaged, holds pickled
    objects, or larger than `max_bytes` when unpacked.
    """
    try:
        if path.stat().st_size > max_bytes:
            raise DataError(f"{path}: is larger than {max_bytes / 1e9:.1f} GB")
        with zipfile.ZipFile(path) as archive:
            members = [info for info in archive.infolist() if not info.is_dir()]
            _check_size(path, members, max_bytes)
            return {
                info.filename.removesuffix(".npy"): _read_array(path, archive, info)
                for info in members
            }
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise DataError(f"{path}: not a whole .npz file: {error}") from error
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error


def write_arrays(path: Path, arrays: Mapping[str, AnyArray], *, overwrite: bool = False) -> None:
    """Write a compressed .npz file, complete or not at all; the same arrays give the same bytes.

    Raises OutputError for what the file system refuses.
    """
    with (
        written_whole(path, overwrite=overwrite) as temporary,
        zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as archive,
    ):
        for name, array in arrays.items():
            member = zipfile.ZipInfo(f"{name}.npy")  # dated 1980: no clock in the bytes
            member.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(member, "w", force_zip64=True) as stream:
                npy.write_array(stream, np.asarray(array), allow_pickle=False)


def _check_size(path: Path, members: list[zipfile.ZipInfo], max_bytes: int) -> None:
    if len(members) > _MAX_ARRAYS:
        raise DataError(f"{path}: holds {len(members)} arrays, expected at most {_MAX_ARRAYS}")
    size = sum(info.file_size for info in members)
    if size > max_bytes:
        raise DataError(
            f"{path}: its arrays take {size / 1e9:.1f} GB unpacked,"
            f" expected at most {max_bytes / 1e9:.1f} GB"
        )


def _read_array(path: Path, archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> AnyArray:
    name = info.filename.removesuffix(".npy")
    with archive.open(info) as stream:
        try:
            shape, fortran_order, dtype = _read_header(stream)
        except (ValueError, SyntaxError, TokenError, RecursionError, MemoryError) as error:
            reason = str(error).partition("\n")[0][:200]
            raise DataError(f"{path}: {info.filename} is not a NumPy array: {reason}") from error
        if dtype.hasobject:
            raise DataError(
                f"{path}: the array {name!r} holds pickled Python objects, which are never read;"
                " save it as numbers or as plain strings"
            )
        count = math.prod(shape)  # Python integers: no overflow
        wanted = count * max(dtype.itemsize, 1)
        # More than the archive says the member holds cannot be in it; zipfile never reads past
        # that size, and `_check_size` has bounded it.
        if wanted > info.file_size:
            raise DataError(
                f"{path}: the array {name!r} of shape {shape} needs {wanted} bytes,"
                f" the file holds {info.file_size}; is it truncated?"
            )
        data = stream.read(wanted)
    if len(data) != wanted:
        raise DataError(f"{path}: the array {name!r} is truncated")
    try:
        if not count:
            return np.zeros(shape, dtype)
        flat = np.frombuffer(data, dtype=dtype, count=count)
        return flat.reshape(shape, order="F" if fortran_order else "C").copy()
    except (ValueError, OverflowError, MemoryError) as error:
        raise DataError(f"{path}: the array {name!r} of shape {shape}: {error}") from error


def _read_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = npy.read_magic(stream)
    if version == (1, 0):
        header = npy.read_array_header_1_0(stream)
    elif version == (2, 0):
        header = npy.read_array_header_2_0(stream)
    else:
        raise ValueError(f"format version {version} is not known")
    shape, fortran_order, dtype = header
    if any(length < 0 for length in shape):
        raise ValueError(f"shape {shape}")
    return shape, fortran_order, dtype
