"""Every executor: this machine's processes, and a real Dask scheduler with two workers."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from archive_stub import QUALITY, STAGE, batch, damage, videos
from dance2pose.archive.executors import Executor, LocalExecutor, run
from dance2pose.archive.jobs import Job
from dance2pose.archive.layout import create_archive
from dance2pose.archive.packages import unpack
from dance2pose.archive.quality import QualityLimits
from dance2pose.archive.recipe import Recipe
from dance2pose.archive.workers import Limits
from dance2pose.errors import Dance2PoseError, UsageError
from dance2pose.options import Settings
from test_batch import errors, package_count, states, wait_for

LIMITS = Limits(seconds=60, memory_bytes=2e9)


class Cluster:
    """A scheduler and workers of the loopback, started as a person would from a shell."""

    def __init__(self, folder: Path) -> None:
        self._file = folder / "scheduler.json"
        self._folder = folder
        self._started: list[subprocess.Popen[bytes]] = []
        self._start("dask", "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        wait_for(self._file.exists, 60)

    @property
    def address(self) -> str:
        return str(json.loads(self._file.read_text())["address"])

    def add_worker(self, *options: str) -> subprocess.Popen[bytes]:
        return self._start(
            *("dask", "worker", "--host", "127.0.0.1", "--nworkers", "1", "--nthreads", "1"),
            *("--no-dashboard", "--memory-limit", "0", "--local-directory", str(self._folder)),
            *options,
        )

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            [sys.executable, "-m", *words, "--scheduler-file", str(self._file)],
            stdout=(self._folder / "log").open("ab"),
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        self._started.append(process)
        return process

    def end(self) -> None:
        for process in reversed(self._started):
            kill(process)


def kill(process: subprocess.Popen[bytes]) -> None:
    """Kill a process with all that it started."""
    with contextlib.suppress(psutil.NoSuchProcess):
        for child in psutil.Process(process.pid).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                child.kill()
    with contextlib.suppress(ProcessLookupError):
        os.kill(process.pid, signal.SIGKILL)
    process.wait()


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    pytest.importorskip("distributed")
    folder = tmp_path_factory.mktemp("cluster")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        started = Cluster(folder)
        started.add_worker()
        started.add_worker("--resources", "GPU=1")
        try:
            yield started
        finally:
            started.end()


@pytest.fixture(params=["local", "cluster"])
def executor(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Executor]:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    made: Executor
    if request.param == "local":
        made = LocalExecutor(2, LIMITS)
    else:
        from dance2pose.archive.cluster import DaskExecutor

        made = DaskExecutor(request.getfixturevalue("cluster").address, LIMITS, {})
    with made:
        yield made


def job(folder: Path, name: str, archive: Path, recipe: Recipe | None = None) -> Job:
    place = create_archive(archive)
    return Job(
        item=name.partition(".")[0],
        version=1,
        source=folder / name,
        sha256=hashlib.sha256(name.encode()).hexdigest(),
        fingerprint="f" * 64,
        recipe=recipe or Recipe(),
        quality=QualityLimits(),
        archive=place.identity(),
        work=place.work,
        names=(name,),
        stage=STAGE,
    )


def test_every_job_comes_back_once_whatever_happens_to_it(
    tmp_path: Path, executor: Executor
) -> None:
    names = ("a.mp4", "abort.mp4", "b.mp4", "broken.mp4", "c.mp4", "full.mp4")
    source = videos(tmp_path / "in", *names)
    jobs = (job(source, name, tmp_path / "archive") for name in names)
    found = {outcome.item: outcome for outcome in run(executor, jobs)}
    assert {item: outcome.failure for item, outcome in found.items()} == {
        **dict.fromkeys("abc", ""),
        "abort": "crash",
        "broken": "input",
        "full": "disk full",
    }
    for item in "abc":
        package = found[item].package
        assert package is not None
        assert (package / "bagit.txt").is_file()
        assert found[item].quality == QUALITY


def test_no_more_jobs_are_drawn_than_the_workers_can_use(
    tmp_path: Path, executor: Executor
) -> None:
    source = videos(tmp_path / "in", *(f"{n}.mp4" for n in range(9)))
    drawn: list[int] = []

    def jobs() -> Iterator[Job]:
        for number in range(9):
            drawn.append(number)
            yield job(source, f"{number}.mp4", tmp_path / "archive")

    for returned, _ in enumerate(run(executor, jobs()), start=1):
        assert len(drawn) - returned <= executor.capacity
    assert len(drawn) == 9


def test_a_package_comes_back_through_the_network_where_the_archive_is_not_seen(
    tmp_path: Path, cluster: Cluster
) -> None:
    from dance2pose.archive.cluster import DaskExecutor

    source = videos(tmp_path / "in", "a.mp4")
    made = job(source, "a.mp4", tmp_path / "archive")
    elsewhere = Job(**{**made.__dict__, "archive": "another"})
    with DaskExecutor(cluster.address, LIMITS, {}) as executor:
        outcome = next(iter(run(executor, iter([elsewhere]))))
    assert outcome.failure == ""
    assert outcome.package is None
    assert outcome.packed is not None
    unpack(outcome.packed, tmp_path / "back")
    assert (tmp_path / "back" / "data" / "poses.csv").is_file()


def test_an_item_that_needs_a_gpu_waits_for_a_worker_that_has_one(
    tmp_path: Path, cluster: Cluster
) -> None:
    source, archive = videos(tmp_path / "in", "a.mp4", "b.mp4", "c.mp4"), tmp_path / "archive"
    batch(source, archive, workers=None, cluster=cluster.address, resources="GPU=1")
    assert set(states(archive).values()) == {"done"}


def test_models_reach_the_workers_by_their_hash(tmp_path: Path, cluster: Cluster) -> None:
    from dance2pose.archive.cluster import DaskExecutor

    source = videos(tmp_path / "in", "a.mp4")
    for folder, content in (("one", b"detector"), ("two", b"keypoints")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "model.onnx").write_bytes(content)
        (tmp_path / folder / "model.toml").write_text(f"name = '{folder}'")
    settings = Settings(
        detector=tmp_path / "one" / "model.onnx", pose=tmp_path / "two" / "model.onnx"
    )
    sent = job(source, "a.mp4", tmp_path / "archive", Recipe(settings=settings))
    sent = Job(**{**sent.__dict__, "stage": "archive_stub:models_item"})
    with DaskExecutor(cluster.address, LIMITS, {}) as executor:
        outcome = next(iter(run(executor, iter([sent]))))
    assert outcome.failure == "", outcome.error
    assert outcome.quality == {
        "detector": ["detector", "name = 'one'", False],
        "pose": ["keypoints", "name = 'two'", False],
    }


def test_a_cluster_that_loses_a_worker_makes_what_this_machine_makes(
    tmp_path: Path, cluster: Cluster, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = [*(f"{n}.mp4" for n in range(10)), "broken.mp4"]
    source = videos(tmp_path / "in", *names)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    monkeypatch.setenv("STUB_SECONDS", "0.4")
    lost = cluster.add_worker()
    code = (
        "import sys\nfrom pathlib import Path\nimport archive_stub\n"
        "archive_stub.batch(Path(sys.argv[1]), Path(sys.argv[2]), workers=None,"
        " cluster=sys.argv[3])"
    )
    far = tmp_path / "far"
    running = subprocess.Popen([sys.executable, "-c", code, str(source), str(far), cluster.address])
    wait_for(lambda: any((far / "packages").glob("*/v1")), 60)
    kill(lost)
    assert running.wait(timeout=120) == 0
    here = tmp_path / "here"
    batch(source, here)
    assert states(far) == states(here)
    assert errors(far) == errors(here)
    assert damage(far) == []
    assert contents(far) == contents(here)
    assert package_count(far) == 10


def contents(archive: Path) -> dict[str, bytes]:
    """What was made of every item, without the times and places of its making."""
    return {
        path.parents[2].name: path.read_bytes()
        for path in (archive / "packages").glob("*/v1/data/poses.csv")
    }


def test_a_scheduler_that_does_not_answer_is_one_clear_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("dance2pose.archive.cluster._CONNECT_S", 1)
    source = videos(tmp_path / "in", "a.mp4")
    with pytest.raises(Dance2PoseError, match="no Dask scheduler answers there"):
        batch(source, tmp_path / "archive", workers=None, cluster="tcp://127.0.0.1:1")
    assert states(tmp_path / "archive") == {"a.mp4": "waiting"}


def test_without_the_extra_the_message_names_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    source = videos(tmp_path / "in", "a.mp4")
    with pytest.raises(UsageError, match=r"dance2pose\[cluster\]"):
        batch(source, tmp_path / "archive", workers=None, cluster="tcp://127.0.0.1:1")


def test_two_jobs_run_in_two_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    monkeypatch.setenv("STUB_SECONDS", "1")
    source = videos(tmp_path / "in", "a.mp4", "b.mp4")
    with LocalExecutor(2, LIMITS) as executor:
        jobs = (job(source, name, tmp_path / "archive") for name in ("a.mp4", "b.mp4"))
        found = list(run(executor, jobs))
    assert len({outcome.worker for outcome in found}) == 2
