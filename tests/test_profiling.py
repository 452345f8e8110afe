"""The account of where the time went."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import pytest

from dance2pose import profiling
from dance2pose.profiling import Profile, stage, stage_of_each


class Clock:
    """A clock that moves only when it is told to."""

    def __init__(self) -> None:
        self.now = 0.0

    def perf_counter(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(profiling, "time", clock)
    return clock


def test_stages_are_counted_over_all_threads(clock: Clock) -> None:
    def work(_: int) -> None:
        with stage("keypoints"):
            clock.now += 0.25

    with Profile() as profile, ThreadPoolExecutor(1) as pool:
        list(pool.map(work, range(7)))
    assert profile.calls == {"keypoints": 7}
    assert profile.seconds == {"keypoints": 1.75}
    assert profile.wall_s == 1.75


def test_making_items_counts_and_using_them_does_not(clock: Clock) -> None:
    def made() -> Iterator[int]:
        for item in range(3):
            clock.now += 0.5
            yield item

    with Profile() as profile:
        for _ in stage_of_each("decode", made()):
            clock.now += 10
    assert profile.seconds == {"decode": 1.5}
    assert profile.calls == {"decode": 3}


def test_the_table_names_every_stage_and_what_to_do() -> None:
    profile = Profile()
    profile.wall_s = 4.0
    for _ in range(5):
        profile.add("keypoints", 1.0)
    profile.add("decode", 2.5)
    profile.add("own", 0.5)
    lines = profile.table(frames=50).splitlines()
    assert [line.split()[0] for line in lines[1:4]] == ["decode", "keypoints", "own"]
    assert lines[2].split() == ["keypoints", "5.00", "62.5%", "5", "1000.00", "100.00"]
    assert "12.5 frames/s" in lines[-2]
    assert "keypoints (62%)" in lines[-1]
    assert "--provider" in lines[-1]


def test_without_a_profile_nothing_is_kept_and_two_at_once_are_refused() -> None:
    with stage("decode"):
        pass
    with Profile() as profile, pytest.raises(RuntimeError, match="another profile"), Profile():
        pass
    assert profile.calls == {}
    assert profile.advice() == "nothing was measured"


def test_a_failing_stage_is_counted_and_its_error_passes() -> None:
    with Profile() as profile, pytest.raises(ValueError, match="x"), stage("lifting"):
        raise ValueError("x")
    assert profile.calls == {"lifting": 1}
