"""A decoded picture -> an upright BGR image of square pixels, in the right colours."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import cv2
import numpy as np
from av.sidedata.sidedata import SideDataContainer
from av.video.format import VideoFormat
from av.video.frame import VideoFrame
from av.video.reformatter import ColorRange, Colorspace, Interpolation, VideoReformatter

from dance2pose.poses import Image, Inner
from dance2pose.small_picture import shrunk, small_size

# Beyond these a sample aspect ratio is a damaged header, not a tape.
MIN_ASPECT, MAX_ASPECT = Fraction(1, 4), Fraction(4)

# Brightness 0..255 from its limited range, 16..235, beyond which it is cut off.
_FULL_OF_LIMITED = np.clip(np.rint((np.arange(256) - 16) * 255 / 219), 0, 255).astype(np.uint8)

# AVColorSpace of ITU-T H.273 (table 4) -> swscale's coefficients.
MATRICES = {
    1: Colorspace.ITU709,
    4: Colorspace.FCC,
    5: Colorspace.ITU601,
    6: Colorspace.ITU601,
    7: Colorspace.SMPTE240M,
    9: Colorspace.BT2020,
    10: Colorspace.BT2020,
}
MATRIX_NAMES = {
    Colorspace.ITU709: "BT.709",
    Colorspace.FCC: "FCC",
    Colorspace.ITU601: "BT.601",
    Colorspace.SMPTE240M: "SMPTE 240M",
    Colorspace.BT2020: "BT.2020",
}
# Transfer characteristics of high dynamic range: PQ and HLG (H.273, table 3).
HDR_TRANSFERS = {16: "PQ", 18: "HLG"}


@dataclass(frozen=True)
class Orientation:
    """How the stored picture is turned to be upright: first mirrored left to right, then turned.

    quarter_turns: clockwise, 0 to 3.
    """

    quarter_turns: int = 0
    mirrored: bool = False

    @property
    def degrees(self) -> int:
        """Clockwise turn in degrees."""
        return 90 * self.quarter_turns

    def size(self, width: int, height: int) -> tuple[int, int]:
        return (height, width) if self.quarter_turns % 2 else (width, height)

    def apply(self, image: Image) -> Image:
        if self.mirrored:
            image = np.asarray(cv2.flip(image, 1), dtype=np.uint8)
        if self.quarter_turns:
            code = (cv2.ROTATE_90_CLOCKWISE, cv2.ROTATE_180, cv2.ROTATE_90_COUNTERCLOCKWISE)
            image = np.asarray(cv2.rotate(image, code[self.quarter_turns - 1]), dtype=np.uint8)
        return image


def orientation(picture: VideoFrame) -> Orientation:
    """What the picture's display matrix (MP4's tkhd, Matroska's projection, an H.264 message) asks.

    The matrix maps stored (x, y) to shown (a x + c y, b x + d y), y down, in 16.16 fixed point
    (ISO/IEC 14496-12, 8.3.2). Turns are taken to the nearest quarter.
    """
    # `picture.side_data` would keep what it returns, which keeps the picture: a circle, so that
    # pictures stay in memory until Python looks for such circles (PyAV 18).
    container: Any = SideDataContainer  # whose stub lacks the picture that it takes
    try:
        data = container(picture).get("DISPLAYMATRIX")
    except ValueError:  # data of another kind that PyAV has no name for, such as EXIF
        return Orientation(round(-picture.rotation / 90) % 4)
    if data is None:
        return Orientation()
    matrix = np.frombuffer(bytes(data), dtype=np.int32)
    a, b, c, d = (float(value) for value in matrix[[0, 1, 3, 4]])
    if a * d - b * c == 0:
        return Orientation()
    mirrored = a * d - b * c < 0
    if mirrored:  # the columns of "mirror, then turn": undo the mirroring of x
        a, b = -a, -b
    turn = math.degrees(math.atan2(b, a))
    return Orientation(round(turn / 90) % 4, mirrored)


def square_size(width: int, height: int, aspect: Fraction) -> tuple[int, int]:
    """The size in square pixels: the picture is widened or heightened, never made smaller."""
    if aspect == 1:
        return width, height
    if aspect > 1:
        return round(width * aspect), height
    return width, round(height / aspect)


def sensible_aspect(aspect: Fraction | None) -> Fraction:
    """The sample aspect ratio, 1 where none is given or it cannot be true."""
    if not aspect or not MIN_ASPECT <= aspect <= MAX_ASPECT:
        return Fraction(1)
    return aspect


def colour_matrix(picture: VideoFrame) -> Colorspace:
    """The stated matrix; if none, BT.709 for high definition and BT.601 below, as players do."""
    stated = MATRICES.get(int(picture.colorspace))
    if stated is not None:
        return stated
    large = picture.width >= 1280 or picture.height > 576
    return Colorspace.ITU709 if large else Colorspace.ITU601


def full_range(picture: VideoFrame) -> bool:
    """Whether luma spans 0..255 rather than 16..235."""
    return int(picture.color_range) == ColorRange.JPEG or picture.format.name.startswith("yuvj")


class PictureMaker:
    """Makes the image of each picture.

    size: (width, height) of every image, upright, in square pixels. A picture of another shape
    (the recording changed its format half-way) is fitted into that size with black borders, so
    that all frames share one coordinate system; `refitted` counts those.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        self.size = size
        self.refitted = 0
        self._reformatter = VideoReformatter()

    def image(
        self, picture: VideoFrame, turned: Orientation, aspect: Fraction
    ) -> tuple[Image, Inner | None]:
        """(H, W, 3) uint8 BGR, and what of it is the picture where there are borders.

        aspect: width over height of the picture's samples.
        """
        upright = turned.size(*square_size(picture.width, picture.height, aspect))
        if upright == self.size:
            return turned.apply(self._bgr(picture, turned.size(*upright))), None
        self.refitted += 1
        scale = min(self.size[0] / upright[0], self.size[1] / upright[1])
        width, height = (
            min(limit, max(1, round(n * scale)))
            for n, limit in zip(upright, self.size, strict=True)
        )
        image: Image = np.zeros((self.size[1], self.size[0], 3), dtype=np.uint8)
        left, top = (self.size[0] - width) // 2, (self.size[1] - height) // 2
        image[top : top + height, left : left + width] = turned.apply(
            self._bgr(picture, turned.size(width, height))
        )
        return image, (left, top, width, height)

    def small(self, picture: VideoFrame, turned: Orientation, aspect: Fraction) -> Image | None:
        """(h, w) uint8, the small grey picture (see `small_picture`) of an image without borders,
        from the stored brightness: no colours are needed for it. None where that is not to be had.
        """
        upright = turned.size(*square_size(picture.width, picture.height, aspect))
        luma = _luma(picture) if upright == self.size else None
        if luma is None:
            return None
        small = shrunk(luma, turned.size(*small_size(*upright)))
        if not full_range(picture):
            small = np.asarray(cv2.LUT(small, _FULL_OF_LIMITED), np.uint8)
        return turned.apply(small)

    def _bgr(self, picture: VideoFrame, size: tuple[int, int]) -> Image:
        scaled = size != (picture.width, picture.height)
        in_yuv = not picture.format.is_rgb
        made = self._reformatter.reformat(
            picture,
            width=size[0],
            height=size[1],
            format="bgr24",
            src_colorspace=colour_matrix(picture) if in_yuv else None,
            src_color_range=ColorRange.JPEG if full_range(picture) else ColorRange.MPEG,
            dst_color_range=ColorRange.JPEG,
            # Unscaled, bilinear takes swscale's fast path; resized, bicubic keeps the detail.
            interpolation=Interpolation.BICUBIC if scaled else Interpolation.BILINEAR,
            # One thread: the other core is the models'.
            threads=1,
        )
        array: Any = made.to_ndarray()
        return np.asarray(array, dtype=np.uint8)


def _luma(picture: VideoFrame) -> Image | None:
    """(H, W) uint8, the plane of brightness, not copied; None where it is no plane of bytes."""
    plane = picture.planes[0]
    if not _has_luma_plane(picture.format.name) or plane.line_size < picture.width:
        return None
    rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)  # type: ignore[call-overload]
    return np.asarray(rows[: picture.height, : picture.width])


@functools.cache
def _has_luma_plane(pixel_format: str) -> bool:
    # Of a single component: places in a palette, or grey that may be of full range and not say so.
    first, *others = VideoFormat(pixel_format).components
    if not others:
        return False
    return first.is_luma and first.bits == 8 and all(other.plane for other in others)
