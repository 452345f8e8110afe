"""Where jobs run: processes of this machine, or the workers of a Dask cluster. One code path."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType
from typing import Protocol, Self

from dance2pose.archive.jobs import Job, Outcome, failed
from dance2pose.archive.workers import Limits, Worker

Done = Callable[[Outcome], None]


class Executor(Protocol):
    """Runs jobs somewhere. A context manager: leaving it ends what is still running.

    Conformance: `tests/test_executors.py` runs over every executor.
    """

    @property
    def capacity(self) -> int:
        """How many jobs to have in hand, so that no worker waits."""
        ...

    def submit(self, job: Job, done: Done) -> None:
        """Start a job; `done` is called with its outcome, from any thread, exactly once."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...


def run(executor: Executor, jobs: Iterator[Job]) -> Iterator[Outcome]:
    """The outcomes of jobs as they come, drawing no more jobs than the executor can use."""
    done: queue.SimpleQueue[Outcome] = queue.SimpleQueue()
    in_hand = 0
    while True:
        while in_hand < executor.capacity and (job := next(jobs, None)) is not None:
            executor.submit(job, done.put)
            in_hand += 1
        if not in_hand:
            return
        yield done.get()
        in_hand -= 1


class LocalExecutor:
    """Processes of this machine, one job each at a time."""

    def __init__(self, workers: int, limits: Limits) -> None:
        self._count = workers
        self._limits = limits
        self._stop = threading.Event()
        self._threads = ThreadPoolExecutor(workers, thread_name_prefix="worker")
        self._mine = threading.local()
        self._all: list[Worker] = []

    @property
    def capacity(self) -> int:
        return 2 * self._count

    def submit(self, job: Job, done: Done) -> None:
        self._threads.submit(self._do, job, done)

    def _do(self, job: Job, done: Done) -> None:
        try:
            done(self._worker().do(job, self._limits))
        except Exception as error:  # a fault of ours must not leave the batch waiting
            done(failed(job, "internal", f"{type(error).__name__}: {error}"))

    def _worker(self) -> Worker:
        """The worker of this thread."""
        if not hasattr(self._mine, "worker"):
            self._mine.worker = Worker(self._stop)
            self._all.append(self._mine.worker)
        worker: Worker = self._mine.worker
        return worker

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._threads.shutdown(wait=True, cancel_futures=True)
        for worker in self._all:
            worker.end()
