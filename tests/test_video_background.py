"""Decoding ahead: in order, bounded, and gone when the reader is."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from dance2pose.video import open_video
from dance2pose.video.background import AHEAD, Background
from video_making import numbered_video


def decoders() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "decoder"]


def test_items_come_in_order() -> None:
    background = Background(range(100))
    assert list(background) == list(range(100))
    background.close()


def test_no_more_is_made_than_may_wait() -> None:
    made: list[int] = []

    def items() -> Iterator[int]:
        for number in itertools.count():
            made.append(number)
            yield number

    background = Background(items())
    taken = list(itertools.islice(iter(background), 3))
    while len(made) < 3 + AHEAD:
        time.sleep(0.001)
    time.sleep(0.05)
    assert taken == [0, 1, 2]
    assert len(made) <= 3 + AHEAD + 1
    background.close()
    assert not decoders()


def test_an_error_reaches_the_reader() -> None:
    def items() -> Iterator[int]:
        yield 1
        raise KeyError("here")

    background = Background(items())
    iterator = iter(background)
    assert next(iterator) == 1
    with pytest.raises(KeyError, match="here"):
        next(iterator)
    background.close()
    assert not decoders()


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_the_thread_ends_with_the_reader(error: type[BaseException], tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 60)
    with pytest.raises(error), open_video(path) as video:
        for frame in video:
            assert decoders()
            if frame.index == 3:
                raise error
    assert not decoders()
    video.close()


def test_closing_before_reading_and_reading_twice(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 4)
    open_video(path).close()
    with open_video(path) as video:
        assert len(list(video)) == 4
        with pytest.raises(RuntimeError, match="once"):
            list(video)


def test_pictures_do_not_share_memory(tmp_path: Path) -> None:
    with open_video(numbered_video(tmp_path / "a.mp4", 6)) as video:
        first, *rest = list(video)
    before = first.image.copy()
    for frame in rest:
        frame.image[:] = 0
    assert (first.image == before).all()
