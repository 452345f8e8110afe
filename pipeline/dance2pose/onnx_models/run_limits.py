"""What a model may take of the machine: time for one run, and memory for all models together.

A model file may come from anywhere, and a graph can hold a loop that never ends or ask for a
tensor of any size. ONNX Runtime stops a run between two of its operators when it is told to, and
its memory can come from one pool of a stated size.
"""

from __future__ import annotations

import contextlib
import functools
import os
import threading
import time
from collections.abc import Iterator
from typing import Any

# The slowest honest run: the largest published pose models on a crowded picture, on one old core,
# take about a hundred seconds.
LONGEST_RUN_S = 300.0

# Weights and intermediate results of all models of this process; the largest published pairs of
# models need about 2 GiB.
MOST_MEMORY_BYTES = 6 * 1024**3

_LOOK_EVERY_S = 0.25


class _Watch:
    """A thread that stops runs whose time is up. It sleeps while nothing runs."""

    def __init__(self) -> None:
        self._deadlines: dict[int, tuple[float, Any]] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None

    def add(self, options: Any, seconds: float) -> None:
        with self._changed:
            self._deadlines[id(options)] = time.monotonic() + seconds, options
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._look, name="model-watch", daemon=True)
                self._thread.start()
            elif len(self._deadlines) == 1:
                self._changed.notify()

    def remove(self, options: Any) -> None:
        with self._changed:
            del self._deadlines[id(options)]

    def _look(self) -> None:
        while True:
            with self._changed:
                while not self._deadlines:
                    self._changed.wait()
                now = time.monotonic()
                for deadline, options in self._deadlines.values():
                    if now > deadline:
                        options.terminate = True
            time.sleep(_LOOK_EVERY_S)


_watch = _Watch()


@contextlib.contextmanager
def limited_run(*, give_back: bool = False) -> Iterator[Any]:
    """The `onnxruntime.RunOptions` of a run that is stopped after `LONGEST_RUN_S`.

    Their `terminate` is True afterwards if it was. give_back: what the pool does not need after
    the run goes back to the system, rather than being kept for the next run.
    """
    import onnxruntime

    options = onnxruntime.RunOptions()
    if give_back:
        options.add_run_config_entry("memory.enable_memory_arena_shrinkage", "cpu:0")
    _watch.add(options, LONGEST_RUN_S)
    try:
        yield options
    finally:
        _watch.remove(options)


def limit_memory(options: Any) -> None:
    """Let the session of these `onnxruntime.SessionOptions` take its memory from the one pool."""
    _memory_pool()
    options.add_session_config_entry("session.use_env_allocators", "1")


@functools.cache
def _memory_pool() -> None:
    """Register the pool with ONNX Runtime, once in a process."""
    import onnxruntime as ort

    about = ort.OrtMemoryInfo(
        "Cpu", ort.OrtAllocatorType.ORT_ARENA_ALLOCATOR, 0, ort.OrtMemType.DEFAULT
    )
    # -1: ONNX Runtime's own choice (how the pool grows, its first piece, what may lie idle).
    ort.create_and_register_allocator(about, ort.OrtArenaCfg(_most_memory(), -1, -1, -1))


def _most_memory() -> int:
    """The limit in bytes: three quarters of the machine's memory where that is less."""
    try:
        installed = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, OSError, ValueError):  # not known here
        return MOST_MEMORY_BYTES
    return min(MOST_MEMORY_BYTES, installed * 3 // 4)
