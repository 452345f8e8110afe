"""Calls beside the frames: in order, never too many, their errors not lost."""

from __future__ import annotations

import threading
from functools import partial

import pytest

from dance2pose.beside import Beside


def test_calls_are_made_in_order_in_one_other_thread() -> None:
    done: list[tuple[int, int]] = []

    def note(number: int) -> None:
        done.append((number, threading.get_ident()))

    with Beside("test") as beside:
        for number in range(50):
            beside.call(partial(note, number))
        beside.finish()
    assert [number for number, _ in done] == list(range(50))
    assert {thread for _, thread in done}.isdisjoint({threading.get_ident()})
    assert len({thread for _, thread in done}) == 1


def test_no_more_calls_wait_than_stated() -> None:
    gate, begun = threading.Event(), threading.Event()

    def waiting() -> None:
        begun.set()
        gate.wait()

    with Beside("test", ahead=3) as beside:
        beside.call(waiting)
        begun.wait()
        for _ in range(2):
            beside.call(lambda: None)
        fourth = threading.Thread(target=partial(beside.call, lambda: None))
        fourth.start()
        fourth.join(timeout=0.1)
        assert fourth.is_alive()
        gate.set()
        fourth.join()
        beside.finish()


def test_an_error_is_raised_where_calls_are_made() -> None:
    def failing() -> None:
        raise ValueError("as planned")

    with Beside("test") as beside, pytest.raises(ValueError, match="as planned"):
        beside.call(failing)
        beside.finish()


def test_leaving_early_ends_the_thread() -> None:
    with pytest.raises(KeyError), Beside("unfinished") as beside:
        beside.call(lambda: None)
        raise KeyError
    assert not [t for t in threading.enumerate() if t.name.startswith("unfinished")]
