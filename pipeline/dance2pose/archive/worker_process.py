"""What runs in a worker's process: jobs come in through a pipe, outcomes go back.

Started by `workers.Worker` as `python -m dance2pose.archive.worker_process FILE_DESCRIPTOR`.
"""

from __future__ import annotations

import importlib
import os
import sys
import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import cast

from dance2pose.archive.jobs import Failure, Job, Outcome, failed
from dance2pose.errors import Dance2PoseError
from dance2pose.output_files import is_disk_full

_PARENT_LOOKED_AT_EVERY_S = 0.5

Stage = Callable[[Job], Outcome]


def main(descriptor: int) -> None:
    """Do the jobs that come through the pipe until it is closed."""
    _end_with_parent()
    with Connection(descriptor) as pipe:
        while True:
            try:
                job: Job = pipe.recv()
            except EOFError:
                return
            pipe.send(do(job, begun=lambda: pipe.send("begun")))


def do(job: Job, *, begun: Callable[[], None]) -> Outcome:
    """Call the job's stage; every failure that leaves the process alive becomes an outcome.

    begun: called when everything is loaded and the work on the video begins.
    """
    started = time.time()
    try:
        stage = stage_of(job)
        begun()
        return stage(job)
    except Exception as error:
        failure, text = _describe(error)
        return failed(job, failure, text, started=started, seconds=time.time() - started)


def stage_of(job: Job) -> Stage:
    """The function that a job names."""
    module, _, name = job.stage.partition(":")
    return cast(Stage, getattr(importlib.import_module(module), name))


def _describe(error: Exception) -> tuple[Failure, str]:
    if is_disk_full(error):
        return "disk full", str(error)
    if isinstance(error, MemoryError):
        return "memory", "there was not enough memory for it"
    if isinstance(error, Dance2PoseError):
        return "input", str(error)
    return "internal", f"{type(error).__name__}: {error}"


def _end_with_parent() -> None:
    """A worker whose batch was killed stops at once, so that the next batch has the machine."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_PARENT_LOOKED_AT_EVERY_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


if __name__ == "__main__":
    main(int(sys.argv[1]))
