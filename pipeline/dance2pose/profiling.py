"""Where the time of a run goes: seconds spent in each stage, over all threads.

Stages are marked in the code with `stage(name)`; that costs nothing worth mentioning until a
`Profile` is active.

    with Profile() as profile:
        reconstruct(...)
    print(profile.table())
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self, TypeVar

T = TypeVar("T")

# In the order of the chain. Whatever a stage of another name takes is listed after these.
STAGES = (
    "decode",
    "cuts",
    "detector",
    "keypoints",
    "tracking",
    "camera motion",
    "lifting",
    "smoothing",
    "recording",
)


class Profile:
    """Adds up the stages while it is active (as a context manager); one at a time in a process.

    seconds, calls: by stage. Stages run side by side: their seconds may sum to more than
    `wall_s`, up to wall_s times the cores. A stage within a stage counts to both.
    """

    _active: Profile | None = None

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}
        self.wall_s = 0.0
        self._lock = threading.Lock()
        self._start = 0.0

    def __enter__(self) -> Self:
        if Profile._active is not None:
            raise RuntimeError("another profile is active in this process")
        Profile._active = self
        self._start = time.perf_counter()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.wall_s = time.perf_counter() - self._start
        Profile._active = None

    def add(self, name: str, seconds: float) -> None:
        with self._lock:
            self.seconds[name] = self.seconds.get(name, 0.0) + seconds
            self.calls[name] = self.calls.get(name, 0) + 1

    def share(self, *names: str) -> float:
        """The part that these stages have in all the seconds of all stages, 0..1."""
        total = sum(self.seconds.values())
        return sum(self.seconds.get(name, 0.0) for name in names) / total if total else 0.0

    def table(self, frames: int | None = None) -> str:
        """Seconds, share, calls, and milliseconds a frame of every stage, and what to do about it.

        frames: of the run; the calls of the decoder if not given.
        """
        frames = frames or self.calls.get("decode", 0)
        others = [name for name in self.seconds if name not in STAGES]
        lines = [
            f"{'stage':12} {'seconds':>8} {'share':>6} {'calls':>7} {'ms/call':>8} {'ms/frame':>9}"
        ]
        for name in (*(name for name in STAGES if name in self.seconds), *others):
            seconds, calls = self.seconds[name], self.calls[name]
            a_frame = f"{1e3 * seconds / frames:9.2f}" if frames else f"{'':9}"
            lines.append(
                f"{name:12} {seconds:8.2f} {self.share(name):6.1%} {calls:7} "
                f"{1e3 * seconds / calls:8.2f} {a_frame}"
            )
        busy = sum(self.seconds.values())
        rate = f", {frames / self.wall_s:.1f} frames/s" if frames and self.wall_s else ""
        at_once = busy / self.wall_s if self.wall_s else 0.0
        lines += [
            f"{'all stages':12} {busy:8.2f}",
            f"{'on the clock':12} {self.wall_s:8.2f}  ({at_once:.1f} stages at once{rate})",
            self.advice(),
        ]
        return "\n".join(lines)

    def advice(self) -> str:
        """What would make the run faster, in a sentence."""
        if not self.seconds:
            return "nothing was measured"
        largest = max(self.seconds, key=lambda name: self.seconds[name])
        hints = {
            "decode": "a copy of the video in a smaller size decodes faster",
            "detector": "look for people less often (--detect-every), or use a smaller detector",
            "keypoints": "a smaller keypoint model or a graphics card (--provider) is what helps",
            "recording": "--picture video or none writes less than --picture frames",
            "lifting": "fewer dancers (--person) are lifted faster",
        }
        hint = hints.get(largest, "it is no stage that settings reach")
        return f"most goes into {largest} ({self.share(largest):.0%}): {hint}"


@contextmanager
def stage(name: str) -> Iterator[None]:
    """Count the time of this block to the stage `name` of the active profile, if there is one."""
    profile = Profile._active
    if profile is None:
        yield
        return
    start = time.perf_counter()
    try:
        yield
    finally:
        profile.add(name, time.perf_counter() - start)


def stage_of_each(name: str, items: Iterable[T]) -> Iterator[T]:
    """Pass the items on, counting the time that making each takes to the stage `name`."""
    iterator = iter(items)
    while True:
        start = time.perf_counter()
        try:
            item = next(iterator)
        except StopIteration:
            return
        if Profile._active is not None:
            Profile._active.add(name, time.perf_counter() - start)
        yield item
