"""Two interleaved fields -> one progressive picture, with FFmpeg's bwdif.

bwdif is the adaptive filter of W3FDIF and YADIF combined: it keeps the detail of what stands still
and interpolates what moves. One picture comes out for each that goes in, at the time of the first
field, so that a frame's index and time stay the file's.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from fractions import Fraction

import av.error
from av.filter import Graph
from av.video.frame import VideoFrame

from dance2pose.video.filters import buffer_source
from dance2pose.video.picture import Orientation


@dataclass(frozen=True)
class Timed:
    """A picture with its place in the video, and how it is shown.

    aspect: width over height of its samples.
    """

    index: int
    time_s: float
    picture: VideoFrame
    orientation: Orientation
    aspect: Fraction


@dataclass(frozen=True)
class Interlacing:
    """What is known of a file's fields before it is read.

    found: whether it holds fields. because: how that is known, in words. field_order: in words.
    marked: True where the pictures themselves are marked, so that unmarked ones are left alone;
    False where every picture must be treated. parity: bwdif's word for the field shown first.
    """

    found: bool = False
    because: str = ""
    field_order: str = "unknown"
    marked: bool = True
    parity: str = "auto"


class Deinterlacer:
    """Passes pictures on until the first one with fields, then sends all through bwdif.

    That needs the picture after each, so pictures come out one later; `flush` gives the rest.
    applied: how many pictures went through the filter.
    """

    def __init__(self, interlacing: Interlacing) -> None:
        self._interlacing = interlacing
        self._graph: Graph | None = None
        self._kind: tuple[int, int, str, int] | None = None
        self._waiting: deque[Timed] = deque()
        self.applied = 0

    def push(self, timed: Timed) -> list[Timed]:
        picture = timed.picture
        kind = picture.width, picture.height, picture.format.name, int(picture.color_range)
        ready: list[Timed] = []
        if self._graph is not None and kind != self._kind:
            ready = self.flush()
        if self._graph is None:
            every = self._interlacing.found and not self._interlacing.marked
            if not (every or picture.interlaced_frame):
                return [*ready, timed]
            self._graph, self._kind = self._build(picture), kind
        # The filter's own bookkeeping needs increasing times; the true ones travel in `_waiting`.
        picture.pts = timed.index
        picture.time_base = Fraction(1, 1000)
        self._graph.push(picture)
        self._waiting.append(timed)
        self.applied += 1
        return ready + self._pull()

    def flush(self) -> list[Timed]:
        """The pictures still inside, at the end of the video."""
        if self._graph is None:
            return []
        self._graph.push(None)
        ready = self._pull()
        self._graph = None
        # bwdif gives nothing for a lone picture: there is no neighbour to tell motion by.
        ready += self._waiting
        self._waiting.clear()
        return ready

    def _pull(self) -> list[Timed]:
        assert self._graph is not None
        ready = []
        while self._waiting:
            try:
                picture = self._graph.vpull()
            except (av.error.BlockingIOError, av.error.EOFError):
                break
            ready.append(replace(self._waiting.popleft(), picture=picture))
        return ready

    def _build(self, picture: VideoFrame) -> Graph:
        graph = Graph()
        graph.threads = 1
        source = buffer_source(graph, picture)
        which = "interlaced" if self._interlacing.marked else "all"
        bwdif = graph.add(
            "bwdif", f"mode=send_frame:parity={self._interlacing.parity}:deint={which}"
        )
        graph.link_nodes(source, bwdif, graph.add("buffersink")).configure()
        return graph
