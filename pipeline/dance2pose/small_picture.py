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
    """(H, W, 3) BGR -> (h, w) grey, its longer side `SIZE`.

    Averages four pixels or more for each; averaging all of a large picture takes ten times as long.
    """
    height, width = image.shape[:2]
    size = small_size(width, height)
    step = max(1, max(width, height) // (2 * SIZE))
    if step > 1:
        thinned = (width // step, height // step)
        image = np.asarray(cv2.resize(image, thinned, interpolation=cv2.INTER_NEAREST), np.uint8)
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    if max(grey.shape) > 2 * SIZE:
        twice = (2 * size[0], 2 * size[1])
        grey = cv2.resize(grey, twice, interpolation=cv2.INTER_LINEAR)
    # By two or less: each pixel is the mean of four.
    return np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_LINEAR), np.uint8)
