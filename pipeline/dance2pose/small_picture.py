"""A frame made small and grey, once, for all that looks at the whole picture and not at people."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

Grey = npt.NDArray[np.uint8]

# The longer side of the small picture, px; smaller pictures stay as they are.
SIZE = 256


def small_size(width: int, height: int) -> tuple[int, int]:
    """(width, height) px of the small picture of one of this size."""
    scale = min(1.0, SIZE / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def small_grey(image: npt.NDArray[np.uint8]) -> Grey:
    """(H, W, 3) BGR -> (h, w) grey, its longer side `SIZE`."""
    height, width = image.shape[:2]
    step = max(1, max(width, height) // (2 * SIZE))
    if step > 1:  # colours of every pixel take long
        thinned = (max(1, width // step), max(1, height // step))
        image = np.asarray(cv2.resize(image, thinned, interpolation=cv2.INTER_NEAREST), np.uint8)
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    return shrunk(grey, small_size(width, height))


def shrunk(grey: Grey, size: tuple[int, int]) -> Grey:
    """(H, W) grey at another (width, height); each pixel is the mean of 4 or of 16.

    The mean of all under it would take ten times as long.
    """
    if max(grey.shape) > 2 * max(size):
        twice = (2 * size[0], 2 * size[1])
        grey = np.asarray(cv2.resize(grey, twice, interpolation=cv2.INTER_LINEAR), np.uint8)
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_LINEAR), np.uint8)
