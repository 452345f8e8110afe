"""What values can be: scores, classes, boxes. Forms of one shape are told apart by these.

Each question is answered for what a graph gives for one picture; of nothing at all anything is
true, so that a model that finds nobody on the probe's grey picture is not refused for it.
"""

from __future__ import annotations

import numpy as np

from dance2pose.onnx_models.inference import Array

# Half precision and quantised models round scores to a little outside of 0..1.
SCORE_SLACK = 0.05

# Boxes given as fractions may reach a little beyond the picture.
LARGEST_FRACTION = 1.5

# Boxes of rows that are less sure than this are noise, in any order.
_LEAST_SCORE = 1e-3


def are_scores(values: Array) -> bool:
    """Whether all values lie in 0..1."""
    return _within(values, -SCORE_SLACK, 1 + SCORE_SLACK)


def are_classes(values: Array) -> bool:
    """Whether all values are whole numbers from 0 on; -1 is how some exports say nobody."""
    return _within(values, -1, np.inf) and bool(np.all(values == np.rint(values)))


def are_fractions(boxes: Array) -> bool:
    """Whether boxes (N, 4) are fractions of the picture, not pixels, and not all zero."""
    return bool(np.any(boxes)) and _within(boxes, -LARGEST_FRACTION, LARGEST_FRACTION)


def are_corners(boxes: Array) -> bool:
    """Whether all boxes (N, 4) have their second corner to the right of and below the first."""
    return bool(np.all(boxes[:, 2:] >= boxes[:, :2] - 1e-3))


def sure(boxes: Array, score: Array) -> Array:
    """The boxes (N, 4) whose score (N,) is more than noise."""
    return np.asarray(boxes[score > _LEAST_SCORE])


def _within(values: Array, low: float, high: float) -> bool:
    if not values.size:
        return True
    return bool(low <= values.min() and values.max() <= high)
