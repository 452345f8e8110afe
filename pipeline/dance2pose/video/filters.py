"""FFmpeg filter graphs: their input."""

from __future__ import annotations

from av.filter import Graph
from av.filter.context import FilterContext
from av.video.frame import VideoFrame


def buffer_source(graph: Graph, picture: VideoFrame) -> FilterContext:
    """The input of a filter graph for pictures like this one, in thousandths of a second."""
    return graph.add(
        "buffer",
        video_size=f"{picture.width}x{picture.height}",
        pix_fmt=picture.format.name,
        time_base="1/1000",
        pixel_aspect="1/1",
        colorspace=str(int(picture.colorspace)),
        range=str(int(picture.color_range)),
    )
