"""Video file -> upright, square-pixel, progressive frames with their own timestamps.

Decoding is PyAV (FFmpeg's libraries) throughout, and OpenCV does image work only. Two decoders
would be two answers to the same questions, and OpenCV's hides the ones an archive asks: it gives
no timestamp of its own for files of variable frame rate, no sample aspect ratio, no field order,
no word of a damaged frame, converts every colour matrix as BT.601, and its wheels have no AV1.
PyAV gives all of these, and FFmpeg's own deinterlacer besides.

    with open_video("dance.mp4") as frames:
        for frame in frames:
            ...
    frames.warnings
"""

from dance2pose.video.info import VideoInfo
from dance2pose.video.reader import Deinterlace, FrameReader, open_video

__all__ = ["Deinterlace", "FrameReader", "VideoInfo", "open_video"]
