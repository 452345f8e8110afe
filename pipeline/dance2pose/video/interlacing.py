"""Whether a file holds interlaced fields: what it says, and what its pictures show.

Much digitised tape is interlaced without saying so (captured through a converter, or encoded again
as progressive). Where the picture's height is one that video tape or interlaced broadcasting uses,
a few places of the file are looked at with FFmpeg's idet, which compares how well a field continues
its own picture and the next one.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator

import av.error
from av.filter import Graph
from av.video.frame import VideoFrame

from dance2pose.errors import VideoError
from dance2pose.video.deinterlace import Interlacing
from dance2pose.video.filters import buffer_source
from dance2pose.video.source import Source

# Lines of NTSC, PAL (with and without vertical blanking) and 1080i, as stored.
INTERLACED_HEIGHTS = frozenset({480, 486, 512, 576, 608, 1080, 1088})

# Where to look, as parts of the duration (a tape may begin with minutes of still bars), and at how
# many pictures in each place.
PLACES = (0.4, 0.8, 0.2, 0.6, 0.0)
PICTURES = 12

# idet says "undetermined" of pictures in which nothing moves. Of those it can tell, more than half
# must be interlaced, and a few at least. When so many agree, no other place is looked at.
LEAST_SEEN = 4
ENOUGH_SEEN = 16

# AVFieldOrder.
FIELD_ORDERS = {
    0: "unknown",
    1: "progressive",
    2: "top field first",
    3: "bottom field first",
    # Stored in one order, shown in the other; what counts here is the order in time.
    4: "bottom field first",
    5: "top field first",
}

PARITIES = {"top field first": "tff", "bottom field first": "bff"}
ORDERS = {parity: order for order, parity in PARITIES.items()}


def find_interlacing(source: Source, first: VideoFrame) -> Interlacing:
    """Ask the first picture's mark, then the stream's field order, then the pictures.

    source: the opened file, not read further. first: its first picture.
    """
    order = FIELD_ORDERS.get(source.stream.codec_context.field_order, "unknown")
    if first.interlaced_frame:
        return Interlacing(True, "the pictures are marked interlaced", order)
    if order in PARITIES:
        because = f"the stream is marked {order}"
        return Interlacing(True, because, order, marked=False, parity=PARITIES[order])
    if first.height in INTERLACED_HEIGHTS:
        return _look(source, order)
    return Interlacing(field_order=order)


def _look(opened: Source, order: str) -> Interlacing:
    """Judge pictures from several places of the file."""
    seen: Counter[str] = Counter()
    for pictures in _places(opened):
        graph: Graph | None = None
        for picture in pictures:
            if picture.interlaced_frame:
                return Interlacing(True, "pictures are marked interlaced", order)
            try:
                graph = graph or _idet(picture)
                graph.push(picture)
                judged = graph.vpull()
            except av.error.FFmpegError:  # idet looks one picture ahead; or the picture changed
                continue
            seen[judged.metadata.get("lavfi.idet.multiple.current_frame", "undetermined")] += 1
        moving = seen["tff"], seen["bff"], seen["progressive"]
        if sum(moving) >= ENOUGH_SEEN and max(moving) == sum(moving):
            break
    fields = seen["tff"] + seen["bff"]
    if fields < LEAST_SEEN or fields <= seen["progressive"]:
        return Interlacing(field_order=order)
    parity = "tff" if seen["tff"] >= seen["bff"] else "bff"
    because = (
        f"seen in {fields} of {fields + seen['progressive']} moving pictures looked at"
        f" (the stream is marked {order})"
    )
    return Interlacing(True, because, ORDERS[parity], marked=False, parity=parity)


def _places(opened: Source) -> Iterator[Iterator[VideoFrame]]:
    """PICTURES pictures from each of the PLACES."""
    try:
        source = Source(opened.path, track=opened.stream.index)
    except VideoError:
        return
    try:
        duration = source.container.duration
        for place in PLACES:
            if place and not duration:
                continue
            if duration:
                start = source.container.start_time or 0
                source.container.seek(start + round(duration * place))
            yield itertools.islice(source.decoded(), PICTURES)
    except av.error.FFmpegError:
        return  # cannot be sought in: what was seen must do
    finally:
        source.close()


def _idet(picture: VideoFrame) -> Graph:
    graph = Graph()
    graph.threads = 1
    nodes = (buffer_source(graph, picture), graph.add("idet"), graph.add("buffersink"))
    graph.link_nodes(*nodes).configure()
    return graph
