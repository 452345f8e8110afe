"""ONNX Runtime behind one small class that turns every failure into a ModelError.

Threads: ONNX Runtime's worker threads spin while they wait for work; beside a video decoder or
another process on the same cores that costs up to half the frame rate, so spinning is switched
off. Small person models gain little from many threads; see `default_threads`.
"""

from __future__ import annotations

import contextlib
import math
import mmap
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose.errors import ModelError
from dance2pose.onnx_models import run_limits
from dance2pose.onnx_models.providers import CPU, choose_provider, what_ran
from dance2pose.onnx_models.resizing import CHANGE, with_products

Array = npt.NDArray[Any]

# A declared tensor larger than this is taken for a mistake in the model, not for work to do.
MAX_TENSOR_BYTES = 2 * 1024**3

_DTYPES: dict[str, type[np.generic]] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
    "tensor(int8)": np.int8,
    "tensor(int32)": np.int32,
    "tensor(int64)": np.int64,
    "tensor(bool)": np.bool_,
}


class NotFiniteError(ModelError):
    """A model answered one picture with NaN; the next may be well."""


@dataclass(frozen=True)
class TensorInfo:
    """An input or output of a graph. shape: None where the graph leaves the length open."""

    name: str
    shape: tuple[int | None, ...]
    dtype: np.dtype[Any]

    def __str__(self) -> str:
        lengths = ", ".join("?" if n is None else str(n) for n in self.shape)
        return f"{self.name} [{lengths}] {self.dtype}"


class Session:
    """A loaded ONNX model.

    inputs, outputs: what the graph declares; metadata: its own strings. runs_with: what ONNX
    Runtime really runs it with, in order, and how the graph was changed for speed, for the
    provenance; note: what was asked for and could not be had, or None.
    """

    def __init__(
        self, path: Path, native: Any, note: str | None = None, change: str | None = None
    ) -> None:
        self.path = path
        self.note = note
        self.runs_with = ", ".join([*native.get_providers(), *([change] if change else [])])
        self._native = native
        self.inputs = tuple(_tensor_info(path, node) for node in native.get_inputs())
        self.outputs = tuple(_tensor_info(path, node) for node in native.get_outputs())
        self.metadata: Mapping[str, str] = native.get_modelmeta().custom_metadata_map
        for tensor in (*self.inputs, *self.outputs):
            _check_size(path, tensor)

    def run(
        self,
        feeds: Mapping[str, Array],
        outputs: Sequence[str],
        *,
        may_hold_nan: bool = False,
        give_back: bool = False,
    ) -> list[Array]:
        """The named outputs for the named inputs. give_back: memory is not kept for another run.

        Raises ModelError where ONNX Runtime fails (out of memory, out of time, shapes that do not
        fit) and NotFiniteError where an output holds NaN, unless it may.
        """
        with run_limits.limited_run(give_back=give_back) as limits:
            try:
                results: list[Array] = self._native.run(list(outputs), dict(feeds), limits)
            except Exception as error:  # ONNX Runtime's own classes share no base but Exception
                reason = _why_failed(error, stopped=limits.terminate)
                raise ModelError(f"{self.path}: the model failed: {reason}") from error
        for name, values in zip(outputs, [] if may_hold_nan else results, strict=not may_hold_nan):
            # The minimum is NaN where any value is, and needs no second array.
            if values.dtype.kind == "f" and values.size and np.isnan(values.min()):
                raise NotFiniteError(
                    f"{self.path}: output {name} holds NaN; the model is damaged or its manifest "
                    f"(mean, std, input type) does not fit it"
                )
        return results

    def mentions(self, *words: str) -> str | None:
        """The first of the words that occurs in the model file, as in the names of weights."""
        with (
            self.path.open("rb") as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
        ):
            return next((word for word in words if content.find(word.encode()) >= 0), None)


def usable_cores() -> int:
    """The cores that this process may use, where the system says so; else all."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


_most_threads = 4


def limit_threads(most: int) -> None:
    """Let `default_threads` give no more than this: other processes share the cores."""
    global _most_threads
    _most_threads = max(1, most)


def default_threads() -> int:
    """Threads within one operator: the cores this process may use, at most four."""
    return min(_most_threads, usable_cores())


def open_session(path: Path, *, threads: int | None = None, provider: str = "cpu") -> Session:
    """Load an ONNX model. threads: within one operator, default `default_threads()`.

    provider: the hardware, a name of `providers.KNOWN` or auto. Where it cannot be had the model
    runs on the processor, and the session's `note` says so.

    Raises ModelError for a file that is missing, not ONNX, truncated, needs an operator that
    ONNX Runtime lacks or a file of weights that is not there.
    """
    import onnxruntime

    check_model_file(path)
    choice = choose_provider(provider, onnxruntime.get_available_providers())
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads or default_threads()
    options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    run_limits.limit_memory(options)
    options.log_severity_level = 4  # failures arrive as exceptions; nothing is printed besides

    def opened(model: str | bytes, providers: tuple[str, ...]) -> Any:
        return onnxruntime.InferenceSession(model, sess_options=options, providers=list(providers))

    faster = with_products(path) if choice.providers == (CPU,) else None
    if faster is not None:
        # What keeps the changed graph from loading is no concern of the user's: the file is tried.
        with contextlib.suppress(Exception):
            return Session(path, opened(faster, (CPU,)), choice.note, CHANGE)
    try:
        try:
            native = opened(str(path), choice.providers)
        except Exception:
            if choice.providers == (CPU,):
                raise
            native = opened(str(path), (CPU,))
    except Exception as error:  # ONNX Runtime's own classes share no base but Exception
        raise ModelError(_why_not_loaded(path, error)) from error
    return Session(path, native, what_ran(choice, native.get_providers()))


def check_model_file(path: Path) -> None:
    """Raise ModelError unless `path` is a file that can be read and holds something."""
    try:
        if path.is_dir():
            raise ModelError(f"{path}: is a folder, expected an ONNX model file")
        size = path.stat().st_size
        with path.open("rb"):
            pass
    except FileNotFoundError:
        raise ModelError(f"{path}: no such file, expected an ONNX model") from None
    except (OSError, ValueError) as error:  # ValueError: a name with a NUL in it
        reason = getattr(error, "strerror", None) or error
        raise ModelError(f"{path}: cannot be read: {reason}") from error
    if size == 0:
        raise ModelError(f"{path}: is empty (0 bytes), expected an ONNX model")


def _why_not_loaded(path: Path, error: Exception) -> str:
    """One line for a person from what ONNX Runtime says."""
    text = _brief(error)
    lower = text.lower()
    kind = type(error).__name__
    if kind == "InvalidProtobuf":
        return f"{path}: is not an ONNX model, or is truncated; get the file again"
    if "escapes" in lower or "absolute path not allowed" in lower:
        return (
            f"{path}: names a file outside of its own folder for its weights; such a model is not "
            f"opened ({text})"
        )
    if "external" in lower or "model_path must not be empty" in lower:
        return (
            f"{path}: the weights lie in a separate file that is missing or cannot be used; "
            f"put it beside the model under its original name ({text})"
        )
    if kind == "NotImplemented" or "is not a registered function/op" in lower:
        return f"{path}: needs an operator that this ONNX Runtime does not have: {text}"
    if "opset" in lower or "ir_version" in lower or "ir version" in lower:
        return f"{path}: made for a newer ONNX than this ONNX Runtime knows: {text}"
    return f"{path}: ONNX Runtime cannot load it: {text}"


def _why_failed(error: Exception, *, stopped: bool) -> str:
    """Why a run ended early, from what ONNX Runtime says. stopped: it was told to end."""
    if stopped:
        return f"it was stopped after {run_limits.LONGEST_RUN_S:g} s, as its graph may never end"
    text = _brief(error)
    said = str(error)
    short_of_memory = ("allocate memory", "bad_alloc", "bfc_arena", "Available memory")
    if isinstance(error, MemoryError) or any(words in said for words in short_of_memory):
        return "it asks for more memory than there is for models"
    return text


def _brief(error: Exception) -> str:
    """The message on one line, without the status prefix, cut where it grows long."""
    text = " ".join(str(error).split())
    if text.startswith("[ONNXRuntimeError]"):
        text = text.split(" : ", 3)[-1]
    return text if len(text) <= 300 else text[:297] + "..."


def _tensor_info(path: Path, node: Any) -> TensorInfo:
    if node.type not in _DTYPES:
        raise ModelError(
            f"{path}: {node.name} has type {node.type}; known are tensors of {', '.join(_DTYPES)}"
        )
    shape = tuple(length if isinstance(length, int) else None for length in node.shape)
    return TensorInfo(node.name, shape, np.dtype(_DTYPES[node.type]))


def _check_size(path: Path, tensor: TensorInfo) -> None:
    known = [length for length in tensor.shape if length is not None]
    needed = math.prod(known) * tensor.dtype.itemsize
    if needed > MAX_TENSOR_BYTES or any(length < 0 for length in known):
        raise ModelError(
            f"{path}: {tensor} would need {needed / 1024**3:.1f} GiB; "
            f"at most {MAX_TENSOR_BYTES / 1024**3:.0f} GiB a tensor are allowed"
        )
