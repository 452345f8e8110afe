"""Whether a file holds interlaced fields: what it says, and what its pictures show."""

from __future__ import annotations

from pathlib import Path

from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from dance2pose.video.deinterlace import Interlacing
from dance2pose.video.info import FIELD_ORDERS


def find_interlacing(path: Path, stream: VideoStream, first: VideoFrame) -> Interlacing:
    """Look at the stream's field order, then at the pictures' own marks."""
    del path
    order = FIELD_ORDERS.get(stream.codec_context.field_order, "unknown")
    parity = {"top field first": "tff", "bottom field first": "bff"}.get(order, "auto")
    if first.interlaced_frame:
        return Interlacing(True, "the pictures are marked interlaced", order)
    if parity != "auto":
        return Interlacing(True, f"the stream is marked {order}", order, False, parity)
    return Interlacing(field_order=order)
