"""The workers of a Dask cluster: worker loss, rejoin, resources, models sent by their hash.

On every worker each job runs in a process of its own (`workers.Worker`), with the same limits as
on one machine. A worker needs to see the videos; where it sees the archive too, packages are made
there, else they come back through the network.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import secrets
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from dance2pose.archive.executors import Done
from dance2pose.archive.fingerprints import model_files
from dance2pose.archive.jobs import Job, Outcome, failed
from dance2pose.archive.recipe import Recipe
from dance2pose.archive.workers import Limits, Worker
from dance2pose.errors import Dance2PoseError, UsageError
from dance2pose.file_hash import sha256_now
from dance2pose.onnx_models.registry import located

_CONNECT_S = 20


class DaskExecutor:
    """Runs jobs on the workers of the scheduler at `address`.

    Raises UsageError where the extra is not installed or the scheduler does not answer.
    """

    def __init__(self, address: str, limits: Limits, resources: dict[str, float]) -> None:
        self._limits = limits
        self._resources = resources
        self._client = _connect(address)
        self._sent: set[str] = set()
        self._stopped = threading.Event()

    @property
    def capacity(self) -> int:
        threads = sum(int(count) for count in self._client.nthreads().values())
        return max(2, 2 * threads)  # without a worker yet: two wait for the first that comes

    def submit(self, job: Job, done: Done) -> None:
        models = self._send_models(job.recipe)
        future = self._client.submit(
            do_on_worker,
            job,
            models,
            self._limits,
            key=f"dance2pose-{job.item}-v{job.version}-{secrets.token_hex(4)}",
            resources=self._resources or None,
            pure=False,
        )
        future.add_done_callback(lambda finished: done(self._outcome(job, finished)))

    def _send_models(self, recipe: Recipe) -> dict[Path, str]:
        """Have every model file on every worker, also on those that join later."""
        hashes = {path: sha256_now(path) for path in model_files(recipe)}
        for path, sha256 in hashes.items():
            if sha256 not in self._sent:
                self._client.register_plugin(_model_plugin(path.read_bytes(), sha256))
                self._sent.add(sha256)
        return hashes

    def _outcome(self, job: Job, future: Any) -> Outcome:
        if future.status == "finished":
            outcome: Outcome = future.result()
            return outcome
        if self._stopped.is_set() or future.status == "cancelled":
            return failed(job, "stopped", "the cluster was left before the item was done")
        error = future.exception()
        if type(error).__name__ == "KilledWorker":
            return failed(job, "worker lost", "the workers that had it were lost one after another")
        return failed(job, "internal", f"{type(error).__name__}: {error}")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stopped.set()
        with contextlib.suppress(OSError, TimeoutError):
            self._client.close()  # lets go of all futures, which ends their tasks


def _connect(address: str) -> Any:
    try:
        from distributed import Client as _Client
    except ImportError as error:
        raise UsageError(
            "--cluster needs Dask: pip install 'dance2pose[cluster]' (here and on the workers)"
        ) from error
    try:
        connect: Any = _Client
        return connect(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise Dance2PoseError(f"{address}: no Dask scheduler answers there: {error}") from error


def _model_plugin(content: bytes, sha256: str) -> Any:
    """What puts a model file into the cache of every worker, now and whenever one joins."""
    from distributed import WorkerPlugin

    class ModelFile(WorkerPlugin):  # type: ignore[misc, unused-ignore]
        name = f"dance2pose-model-{sha256}"

        def setup(self, worker: Any) -> None:
            del worker
            keep_model(content, sha256)

    return ModelFile()


def model_cache() -> Path:
    """Where a worker keeps the model files that it was sent, by their hash."""
    from platformdirs import user_cache_path

    return user_cache_path("dance2pose") / "cluster-models"


def keep_model(content: bytes, sha256: str) -> None:
    """Put a model file into the cache, whole or not at all."""
    place = model_cache() / sha256
    if place.is_file() and sha256_now(place) == sha256:
        return
    place.parent.mkdir(parents=True, exist_ok=True)
    part = place.with_name(f"{sha256}.{secrets.token_hex(4)}.part")
    part.write_bytes(content)
    part.replace(place)


def with_models(recipe: Recipe, models: dict[Path, str]) -> Recipe:
    """The recipe with models that were sent in the place of the paths on the batch's machine.

    A model's companions (manifest, weights) must lie beside it under their names: the files that
    lay in one folder are linked into one again.
    """
    key = "-".join(sha256[:8] for sha256 in models.values())
    homes = list(dict.fromkeys(path.parent for path in models))
    places = {path: _set_folder(key) / str(homes.index(path.parent)) / path.name for path in models}
    for path, sha256 in models.items():
        _link(model_cache() / sha256, places[path])
    moved = {
        name: places[found]
        for name, model in recipe.models().items()
        if (found := located(model)) in places
    }
    return recipe.changed(**moved)


def _set_folder(key: str) -> Path:
    return model_cache() / f"set-{key}"[:200]


def _link(content: Path, place: Path) -> None:
    """Give a file of the cache a second name, unless it has it."""
    if not place.exists():
        place.parent.mkdir(parents=True, exist_ok=True)
        part = place.with_name(f"{secrets.token_hex(4)}.part")
        os.link(content, part)
        part.replace(place)


_on_this_thread = threading.local()


def do_on_worker(job: Job, models: dict[Path, str], limits: Limits) -> Outcome:
    """Runs on a cluster's worker: the job in a process of its own."""
    import socket

    if not hasattr(_on_this_thread, "worker"):
        _on_this_thread.worker = Worker(threading.Event())
    job = dataclasses.replace(job, recipe=with_models(job.recipe, models))
    outcome: Outcome = _on_this_thread.worker.do(job, limits)
    return dataclasses.replace(outcome, worker=f"{socket.gethostname()} {outcome.worker}")
