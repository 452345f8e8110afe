"""Work that need not hold up the frames: done in order, in one thread beside them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Self

# Calls waiting at most; each may hold a picture.
AHEAD = 8


class Beside:
    """Makes calls one after the other in a thread of its own. Use it as a context manager.

    An error of a call is raised by a later `call`, or by `finish`.

    >>> done = []
    >>> with Beside("example") as beside:
    ...     for number in range(3):
    ...         beside.call(lambda n=number: done.append(n))
    ...     beside.finish()
    >>> done
    [0, 1, 2]
    """

    def __init__(self, name: str, *, ahead: int = AHEAD) -> None:
        self._pool = ThreadPoolExecutor(1, thread_name_prefix=name)
        self._ahead = ahead
        self._waiting: deque[Future[None]] = deque()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._pool.shutdown(wait=True, cancel_futures=True)

    def call(self, function: Callable[[], None]) -> None:
        """Make this call after those before; waits while too many are waiting."""
        while self._waiting and (len(self._waiting) >= self._ahead or self._waiting[0].done()):
            self._waiting.popleft().result()
        self._waiting.append(self._pool.submit(function))

    def finish(self) -> None:
        """Wait until all calls are made."""
        while self._waiting:
            self._waiting.popleft().result()
