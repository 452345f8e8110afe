"""Kill a batch again and again, and show that nothing is lost and nothing is done twice.

    python scripts/crash_test_batch.py VIDEO... --detector D.onnx --pose P.onnx [--kills 200]

Cuts short clips from the videos and runs `dance2pose batch` over them with real models. At random
moments (seeded) one worker, the batch itself, or all its processes at once are killed with
SIGKILL; a batch that is gone is started again. When every clip is done before the last kill, a
setting is changed, so that all are done again as new versions. At the end a batch runs undisturbed
and everything is checked.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import bagit
import psutil

from short_clips import cut_clips

Command = Callable[[int], list[str]]
"""The command of a batch in a round; the round changes what the batch has to do."""


# All done, or all but clips that hold nobody.
_COMPLETE = (0, 1)


@dataclass
class Crashes:
    """What happened. kills: by what was killed. rounds: times that everything was done."""

    kills: Counter[str] = field(default_factory=Counter)
    starts: int = 0
    rounds: int = 1
    unexpected: list[str] = field(default_factory=list)


def kill_repeatedly(command: Command, *, kills: int, seed: int, longest_s: float) -> Crashes:
    """Run the batch and kill it so many times, at most `longest_s` apart; then let it end."""
    rng = random.Random(seed)
    crashes = Crashes()
    process = _start(command, crashes)
    while crashes.kills.total() < kills:
        if rng.random() < 0.8:  # else it may be hit while it starts
            _wait_for_workers(process)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=rng.uniform(0, longest_s))
        if process.poll() is not None:
            if not _ended_well(process, crashes):
                return crashes
            crashes.rounds += process.returncode in _COMPLETE
            process = _start(command, crashes)
            continue
        crashes.kills[_kill(process, rng)] += 1
        if crashes.kills.total() % 20 == 0:
            print(f"{crashes.kills.total()} kills", flush=True)
    while True:
        process.wait()
        if not _ended_well(process, crashes) or process.returncode in _COMPLETE:
            return crashes
        process = _start(command, crashes)


def _ended_well(process: subprocess.Popen[bytes], crashes: Crashes) -> bool:
    """Whether a batch came to its end or was killed; anything else is noted."""
    if process.returncode in (*_COMPLETE, -signal.SIGKILL):
        return True
    crashes.unexpected.append(f"a batch ended with status {process.returncode}")
    return False


def _wait_for_workers(process: subprocess.Popen[bytes]) -> None:
    """Until the batch has started a worker, or has ended."""
    while process.poll() is None:
        with contextlib.suppress(psutil.NoSuchProcess):
            if psutil.Process(process.pid).children():
                return
        time.sleep(0.1)


def _start(command: Command, crashes: Crashes) -> subprocess.Popen[bytes]:
    crashes.starts += 1
    return subprocess.Popen(
        command(crashes.rounds), stdout=subprocess.DEVNULL, start_new_session=True
    )


def _kill(process: subprocess.Popen[bytes], rng: random.Random) -> str:
    """Kill a worker, the batch, or all of it; what it was."""
    what = rng.choice(("worker", "worker", "batch", "all"))
    try:
        workers = psutil.Process(process.pid).children(recursive=True)
    except psutil.NoSuchProcess:
        workers = []
    if what == "worker" and not workers:
        what = "batch"
    victims = {
        "worker": [rng.choice(workers).pid] if workers else [],
        "batch": [process.pid],
        "all": [process.pid, *(worker.pid for worker in workers)],
    }[what]
    for victim in victims:
        with contextlib.suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
    if what != "worker":
        process.wait()
    return what


def check(archive: Path, *, items: int, rounds: int) -> list[str]:
    """What is wrong with an archive after its crashes: packages, ledger, and work done twice."""
    wrong = []
    folders = sorted((archive / "packages").glob("*/v*"))
    for folder in folders:
        try:
            bagit.Bag(str(folder)).validate()
        except bagit.BagError as error:
            wrong.append(f"{folder.name}: not a valid bag: {error}")
    there = {(folder.parent.name, int(folder.name[1:])) for folder in folders}
    with contextlib.closing(sqlite3.connect(archive / "ledger.sqlite")) as ledger:
        recorded = ledger.execute("SELECT item, version, fingerprint FROM packages").fetchall()
        states = Counter(ledger.execute("SELECT state, failure FROM items").fetchall())
        done_rows = Counter(
            ledger.execute("SELECT item, version FROM attempts WHERE failure = ''").fetchall()
        )
    if {(item, version) for item, version, _ in recorded} != there:
        wrong.append("the ledger and the folders do not agree")
    twice = [key for key, n in Counter((i, f) for i, _, f in recorded).items() if n > 1]
    wrong += [f"{item}: done twice with one fingerprint" for item, _ in twice]
    wrong += [f"{key}: recorded as done {n} times" for key, n in done_rows.items() if n > 1]
    done, empty = states["done", ""], states["failed", "input"]
    if done + empty != items or not done:
        wrong.append(f"states are {dict(states)}, expected {items} in all")
    if len(there) != done * rounds:
        wrong.append(f"{len(there)} packages, expected {done} x {rounds} rounds")
    left = list((archive / "work").iterdir())
    wrong += [f"left in the work folder: {path.name}" for path in left]
    return wrong


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("videos", nargs="+", type=Path)
    parser.add_argument("--detector", required=True)
    parser.add_argument("--pose", required=True)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--clips", type=int, default=30)
    parser.add_argument("--frames", type=int, default=16)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--longest", type=float, default=8.0, help="seconds between two kills")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        clips, archive = Path(folder, "clips"), Path(folder, "archive")
        cut_clips(arguments.videos, clips, count=arguments.clips, frames=arguments.frames)
        models = ["--detector", arguments.detector, "--pose", arguments.pose]

        def command(number: int) -> list[str]:
            batch = [sys.executable, "-m", "dance2pose", "batch", str(clips), str(archive)]
            return [*batch, *models, "--window", str(number), "--attempts", "1000", "--quiet"]

        began = time.monotonic()
        crashes = kill_repeatedly(
            command, kills=arguments.kills, seed=arguments.seed, longest_s=arguments.longest
        )
        wrong = check(archive, items=arguments.clips, rounds=crashes.rounds) + crashes.unexpected
        print(
            f"{crashes.kills.total()} kills ({dict(crashes.kills)}), {crashes.starts} starts, "
            f"{crashes.rounds} rounds of {arguments.clips} clips, "
            f"{len(list(archive.glob('packages/*/v*')))} packages, "
            f"{time.monotonic() - began:.0f} s"
        )
        for line in wrong:
            print(line)
        print("nothing was lost and nothing was done twice" if not wrong else "FAILED")
        sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
