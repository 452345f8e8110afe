"""The size of all frames of a video whose pictures change their shape on the way.

When a broadcast goes from 4:3 to 16:9 its lines stay: a person is as many lines high as before, and
would seem to walk away from the camera if the wider pictures were made smaller to fit. So the file
is looked through, at a few places, and the frames are made wide enough for all its pictures.
"""

from __future__ import annotations

from collections.abc import Iterator

import av.error

from dance2pose.errors import VideoError
from dance2pose.video.picture import sensible_aspect, square_size
from dance2pose.video.source import Source

Size = tuple[int, int]

# Where the container states size and shape once for the whole track, they hold.
_STATED_ONCE = frozenset({"mov", "matroska", "webm", "avi", "flv", "gif", "webp_pipe"})

# Where to look, as parts of the file: of its bytes, since timestamps may begin again in it.
PLACES = tuple((number + 0.5) / 12 for number in range(12))

# Frames this many times wider than the first picture are a damaged header's.
MOST_WIDENING = 4


def canvas_size(source: Source, first: Size) -> Size:
    """(width, height) px of the frames: the first picture's, wider where later ones are."""
    if _STATED_ONCE & set(source.container.format.name.split(",")):
        return first
    width, height = first
    for other in _sizes(source):
        needed = round(other[0] * height / other[1])
        if needed <= MOST_WIDENING * first[0]:
            width = max(width, needed)
    return width, height


def _sizes(opened: Source) -> Iterator[Size]:
    """Sizes in square pixels of a picture from each of the PLACES."""
    try:
        source = Source(opened.path, track=opened.stream.index)
    except VideoError:
        return
    context = source.stream.codec_context
    size = opened.path.stat().st_size
    try:
        for place in PLACES:
            source.container.seek(round(size * place), unsupported_byte_offset=True)
            picture = next(source.decoded(), None)
            if picture is not None:
                aspect = sensible_aspect(context.sample_aspect_ratio)
                yield square_size(picture.width, picture.height, aspect)
    except av.error.FFmpegError:
        return  # cannot be sought in: what was seen must do
    finally:
        source.close()
