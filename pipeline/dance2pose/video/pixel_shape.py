"""The shape of the samples of every picture, which may change in the middle of a file.

Broadcasts go from 4:3 to 16:9 at one coded size. PyAV gives no sample aspect ratio of a decoded
picture, and the decoder's own is ahead of the pictures it gives out, by those that wait to be put
in order. FFmpeg's scale filter knows each picture's: it is asked, at the size of two pixels, from
the moment on at which the decoder's changes.
"""

from __future__ import annotations

from fractions import Fraction

from av.filter import Graph
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from dance2pose.video.filters import buffer_source
from dance2pose.video.picture import sensible_aspect

# Sample aspect ratios are read in steps of one part in so many.
_STEPS = 4096
_LARGEST_DENOMINATOR = 200


class PixelShapes:
    """Gives the sample aspect ratio of each picture in turn.

    What the container says of the whole track wins over the pictures' own, as in every player,
    unless the first picture says the same: then the later ones may change it. Make it when the
    first picture was decoded.
    """

    def __init__(self, stream: VideoStream) -> None:
        self.first = sensible_aspect(stream.sample_aspect_ratio)
        self._context = stream.codec_context
        self._announced = self._context.sample_aspect_ratio
        self._changes = False
        self._fixed = sensible_aspect(self._announced) != self.first
        self._graph: Graph | None = None
        self._made_for: tuple[int, int, str] | None = None

    def follow(self, stream: VideoStream) -> None:
        """Go on with the same track of a file opened anew."""
        self._context = stream.codec_context

    def of(self, picture: VideoFrame) -> Fraction:
        """The sample aspect ratio of a picture. Ask for each, in order."""
        self._changes |= self._context.sample_aspect_ratio != self._announced
        if self._fixed or not self._changes:
            return self.first
        return self._read(picture)

    def _read(self, picture: VideoFrame) -> Fraction:
        kind = picture.width, picture.height, picture.format.name
        if self._graph is None or kind != self._made_for:
            self._graph, self._made_for = _aspect_graph(picture), kind
        pts, time_base = picture.pts, picture.time_base
        picture.pts, picture.time_base = 0, Fraction(1, 1000)
        self._graph.push(picture)
        steps = self._graph.vpull().width
        picture.pts = pts
        if time_base is not None:
            picture.time_base = time_base
        aspect = Fraction(steps, _STEPS).limit_denominator(_LARGEST_DENOMINATOR)
        return sensible_aspect(aspect)


def _aspect_graph(picture: VideoFrame) -> Graph:
    """A filter that turns a picture into one whose width is its sample aspect ratio in _STEPS."""
    graph = Graph()
    graph.threads = 1
    graph.link_nodes(
        buffer_source(graph, picture),
        graph.add("crop", "2:2:0:0"),
        graph.add("scale", w=f"max(1, round(sar * {_STEPS}))", h="2", eval="frame"),
        graph.add("buffersink"),
    ).configure()
    return graph
