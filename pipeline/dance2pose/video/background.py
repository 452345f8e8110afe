"""Decode ahead in a thread, so that the next picture is ready when the models have done the last.

FFmpeg and ONNX Runtime release Python's lock while they work, so the two run side by side.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")

# Pictures waiting at most: enough to even out slow and fast ones, and a few megabytes.
AHEAD = 4


@dataclass(frozen=True)
class _Failed:
    error: BaseException


class _Ended:
    pass


class Background(Generic[T]):
    """Iterates `items` in a thread of its own. Close it: the thread ends before close() returns."""

    def __init__(self, items: Iterable[T], *, ahead: int = AHEAD) -> None:
        self._queue: queue.Queue[T | _Failed | _Ended] = queue.Queue(maxsize=ahead)
        self._stop = threading.Event()
        self._thread = threading.Thread(
            target=_produce, args=(items, self._queue, self._stop), name="decoder", daemon=True
        )
        self._thread.start()

    def __iter__(self) -> Iterator[T]:
        while True:
            item = self._queue.get()
            if isinstance(item, _Ended):
                return
            if isinstance(item, _Failed):
                raise item.error
            yield item

    def close(self) -> None:
        """Stop after the picture in hand, and wait for that."""
        self._stop.set()
        while self._thread.is_alive():
            try:
                self._queue.get_nowait()  # let a waiting put() through
            except queue.Empty:
                self._thread.join(timeout=0.01)


def _produce(
    items: Iterable[T], into: queue.Queue[T | _Failed | _Ended], stop: threading.Event
) -> None:
    last: _Failed | _Ended = _Ended()
    try:
        for item in items:
            into.put(item)
            if stop.is_set():
                return
    except BaseException as error:  # handed to the reader's thread, which raises it
        last = _Failed(error)
    into.put(last)
