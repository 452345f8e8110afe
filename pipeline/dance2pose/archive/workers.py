"""A worker in a process of its own: what goes wrong in it takes down nothing else.

Why not a pool of a library: their workers share one queue and its lock (pebble, multiprocessing),
so that one killed while it waits leaves the lock taken; none watches memory; none can start
processes inside a Dask worker. Here each worker has a pipe of its own and nothing in common.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection, Pipe

import psutil

from dance2pose.archive.jobs import Failure, Job, Outcome, failed

# How often the memory and the clock of a working process are looked at, s.
_LOOK_EVERY_S = 0.1
_LAST_WORDS = 400
# A process that has not begun after this is taken for one that hangs, s.
_START_S = 300.0


@dataclass(frozen=True)
class Limits:
    """What one item may take."""

    seconds: float
    memory_bytes: float


class Worker:
    """One process that does job after job, replaced whenever it ends or is ended.

    Used by one thread at a time. `stop` may be set from any: it ends the job in hand.
    """

    def __init__(self, stop: threading.Event) -> None:
        self._stop = stop
        self._process: subprocess.Popen[bytes] | None = None
        self._pipe: Connection | None = None
        self._words = tempfile.TemporaryFile()  # what it and native libraries say  # noqa: SIM115

    def do(self, job: Job, limits: Limits) -> Outcome:
        """The outcome of a job, whatever happens to the process."""
        started = time.time()
        failure: Failure
        try:
            pipe = self._ready()
            pipe.send(job)
            for seconds in (_START_S, limits.seconds):
                failure = self._wait(pipe, seconds, limits.memory_bytes)
                if failure:
                    break
                answer = pipe.recv()  # first that all is loaded, when the item's clock starts
                if isinstance(answer, Outcome):
                    return answer
            else:
                failure = "internal"
        except (EOFError, OSError):
            failure = "crash"
        error = self._describe(failure, limits)
        self.end()
        seconds = time.time() - started
        return failed(job, failure, error, started=started, seconds=seconds)

    def _ready(self) -> Connection:
        """A running process's pipe."""
        if self._process is None or self._process.poll() is not None or self._pipe is None:
            self.end()
            ours, theirs = Pipe()
            self._words.truncate(0)
            self._process = subprocess.Popen(
                [sys.executable, "-m", "dance2pose.archive.worker_process", str(theirs.fileno())],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=self._words,
                stderr=self._words,
                start_new_session=True,  # Ctrl-C is the parent's to handle
            )
            theirs.close()
            self._pipe = ours
        return self._pipe

    def _wait(self, pipe: Connection, seconds: float, memory_bytes: float) -> Failure:
        """Until the process answers or ends ("" and let the caller read), or must be ended."""
        assert self._process is not None
        end = time.monotonic() + seconds
        while not pipe.poll(_LOOK_EVERY_S):
            if self._stop.is_set():
                return "stopped"
            if time.monotonic() > end:
                return "time"
            if memory_of(self._process.pid) > memory_bytes:
                return "memory"
        return ""

    def _describe(self, failure: str, limits: Limits) -> str:
        """What is known of how a process ended."""
        if failure == "time":
            return f"took longer than the limit of {limits.seconds / 60:g} minutes"
        if failure == "memory":
            return f"took more memory than the limit of {limits.memory_bytes / 1e9:g} GB"
        if failure == "stopped":
            return "the batch was stopped"
        status = None
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                status = self._process.wait(timeout=5)
        words = self._last_words()
        return (
            f"its process ended with {_ending(status)}{f'; last words: {words}' if words else ''}"
        )

    def _last_words(self) -> str:
        size = self._words.seek(0, os.SEEK_END)
        self._words.seek(max(0, size - _LAST_WORDS))
        text = self._words.read().decode("utf-8", "replace")
        return " ".join("".join(c if c.isprintable() else " " for c in text).split())

    def end(self) -> None:
        """Kill the process, if there is one."""
        if self._pipe is not None:
            self._pipe.close()
            self._pipe = None
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(self._process.pid, signal.SIGKILL)
            self._process.wait()
            self._process = None


def memory_of(pid: int) -> int:
    """Resident bytes of a process; 0 once it is gone."""
    try:
        return int(psutil.Process(pid).memory_info().rss)
    except psutil.Error:
        return 0


def _ending(status: int | None) -> str:
    if status is None:
        return "an unknown status"
    if status < 0:
        with contextlib.suppress(ValueError):
            return f"signal {signal.Signals(-status).name}"
    return f"status {status}"
