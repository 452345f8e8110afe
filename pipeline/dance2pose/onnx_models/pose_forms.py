"""The output forms of top-down pose models: a crop of one person -> keypoints."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dance2pose.onnx_models.forms import Graph, Match, OutputForm, Outputs
from dance2pose.onnx_models.inference import Array, TensorInfo
from dance2pose.onnx_models.manifest import Manifest
from dance2pose.onnx_models.presets import IMAGENET
from dance2pose.skeleton import SKELETONS_BY_COUNT

Keypoints = tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]

CROP_INPUT = {"colour_order": "RGB", **IMAGENET, "resize": "crop"}
_CROP_ASSUMED = ["RGB with ImageNet's mean and std, as MMPose, PaddleDetection and ViTPose train"]


# Heatmaps -------------------------------------------------------------------------------------


def _match_heatmap(graph: Graph) -> Match | None:
    maps = [t for t in graph.outputs if len(t.shape) == 4 and t.shape[1] not in (None, 1)]
    if len(maps) != 1 or any(t.dtype.kind == "f" and t not in maps for t in graph.outputs):
        return None
    heatmap = maps[0]
    channels, height, width = _channels_first(heatmap, graph)
    if height * graph.width != width * graph.height or not 1 < height <= graph.height:
        return None
    reasons = [
        f"{heatmap}: {channels} heatmaps of {width}x{height}, "
        f"1/{graph.height / height:g} of the input"
    ]
    reasons += [f"{t}: the place of the maximum, not needed" for t in graph.outputs if t != heatmap]
    return Match(
        {"heatmap": heatmap.name},
        reasons,
        {**CROP_INPUT, "refinement": "dark"},
        [*_CROP_ASSUMED, "heatmap pixel i lies at input pixel i * stride (ViTPose: corners)"],
        keypoints=channels,
        default_size=(192, 256),
    )


def _channels_first(heatmap: TensorInfo, graph: Graph) -> tuple[int, int, int]:
    """(keypoints, height, width) of a heatmap output, whichever axis the keypoints are on."""
    _, a, b, c = (length or 0 for length in heatmap.shape)
    keypoints_last = graph.layout == "NHWC" and c in SKELETONS_BY_COUNT
    return (c, a, b) if keypoints_last and b * graph.height == a * graph.width else (a, b, c)


def _decode_heatmap(outputs: Outputs, manifest: Manifest) -> Keypoints:
    heatmap = outputs["heatmap"].astype(np.float32, copy=False)
    width, height = manifest.input_width, manifest.input_height
    if heatmap.shape[2] * width != heatmap.shape[3] * height:  # keypoints on the last axis
        heatmap = np.ascontiguousarray(heatmap.transpose(0, 3, 1, 2))
    people, keypoints, rows, columns = heatmap.shape
    best = heatmap.reshape(people, keypoints, -1).argmax(axis=2)
    y, x = np.divmod(best, columns)
    score = np.take_along_axis(heatmap.reshape(people, keypoints, -1), best[..., None], axis=2)
    xy = np.stack([x, y], axis=2).astype(np.float32)
    if manifest.refinement == "quarter":
        xy += quarter_pixel_shift(heatmap, x, y)
    elif manifest.refinement == "dark":
        xy += dark_shift(heatmap, x, y)
    if manifest.heatmap_alignment == "corners":
        stride = np.array([(width - 1) / (columns - 1), (height - 1) / (rows - 1)], np.float32)
    else:
        stride = np.array([width / columns, height / rows], np.float32)
    return xy * stride, score[..., 0]


def quarter_pixel_shift(heatmap: Array, x: Array, y: Array) -> npt.NDArray[np.float32]:
    """(N, K, 2) shifts of 0.25 px from the maxima (x, y) towards the larger neighbour."""
    rows, columns = heatmap.shape[2:]
    person, keypoint = np.ogrid[: heatmap.shape[0], : heatmap.shape[1]]
    inside = (x > 0) & (x < columns - 1) & (y > 0) & (y < rows - 1)
    x, y = np.clip(x, 1, columns - 2), np.clip(y, 1, rows - 2)
    dx = heatmap[person, keypoint, y, x + 1] - heatmap[person, keypoint, y, x - 1]
    dy = heatmap[person, keypoint, y + 1, x] - heatmap[person, keypoint, y - 1, x]
    shift = 0.25 * np.sign(np.stack([dx, dy], axis=2)) * inside[..., None]
    return np.asarray(shift, np.float32)


# Standard deviation of the Gaussians that published models' heatmaps are trained with, in heatmap
# pixels, where the heatmap is 64 px high; it grows with the height (3 at 96).
_GAUSSIAN_SIGMA, _GAUSSIAN_ROWS = 2.0, 64


def dark_shift(heatmap: Array, x: Array, y: Array) -> npt.NDArray[np.float32]:
    """(N, K, 2) shifts from the maxima (x, y) to the tops of the Gaussians they sample.

    One Newton step on the logarithm of the smoothed heatmap (Zhang et al., CVPR 2020, equations
    8 and 9). Maxima within two pixels of the border, and those where the curvature is not that of
    a top, stay where they are; no shift is longer than a pixel on either axis.
    """
    rows, columns = heatmap.shape[2:]
    sigma = _GAUSSIAN_SIGMA * rows / _GAUSSIAN_ROWS
    reach = max(1, round(2.5 * sigma))
    # Only the 5x5 pixels about each maximum are smoothed: gather what they need, and weigh it.
    offsets = np.arange(-2 - reach, 3 + reach)
    person, keypoint = np.ogrid[: heatmap.shape[0], : heatmap.shape[1]]
    window = heatmap[
        person[..., None, None],
        keypoint[..., None, None],
        _reflected(y[..., None] + offsets, rows)[..., :, None],
        _reflected(x[..., None] + offsets, columns)[..., None, :],
    ]
    kernel = np.exp(-((offsets[None] - np.arange(-2, 3)[:, None]) ** 2) / (2 * sigma**2))
    kernel[np.abs(offsets[None] - np.arange(-2, 3)[:, None]) > reach] = 0
    kernel /= kernel.sum(axis=1, keepdims=True)
    patch = np.log(np.maximum(kernel @ window @ kernel.T, 1e-10))
    inside = (x >= 2) & (x < columns - 2) & (y >= 2) & (y < rows - 2)
    return np.asarray(_newton_step(patch) * inside[..., None], np.float32)


def _reflected(index: Array, length: int) -> Array:
    """Indices beyond either end of an axis, mirrored back about its first or last pixel."""
    index = np.abs(index)
    return np.clip(np.where(index >= length, 2 * (length - 1) - index, index), 0, length - 1)


def _newton_step(patch: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """(..., 2) steps from the centres of patches (..., 5, 5) to the tops of their parabolas."""
    dx = (patch[..., 2, 3] - patch[..., 2, 1]) / 2
    dy = (patch[..., 3, 2] - patch[..., 1, 2]) / 2
    centre = patch[..., 2, 2]
    dxx = (patch[..., 2, 4] - 2 * centre + patch[..., 2, 0]) / 4
    dyy = (patch[..., 4, 2] - 2 * centre + patch[..., 0, 2]) / 4
    dxy = (patch[..., 3, 3] - patch[..., 1, 3] - patch[..., 3, 1] + patch[..., 1, 1]) / 4
    determinant = dxx * dyy - dxy**2
    is_top = (determinant > 1e-12) & (dxx < 0)
    step = np.stack([dxy * dy - dyy * dx, dxy * dx - dxx * dy], axis=-1)
    step = step / np.where(is_top, determinant, 1)[..., None]
    return np.asarray(np.clip(step, -1, 1) * is_top[..., None])


# SimCC ----------------------------------------------------------------------------------------


def _match_simcc(graph: Graph) -> Match | None:
    if len(graph.outputs) != 2 or any(len(t.shape) != 3 for t in graph.outputs):
        return None
    first, second = graph.outputs
    if first.shape[1] != second.shape[1] or first.dtype.kind != "f":
        return None
    pairs = [(first, second), (second, first)]
    if "simcc_x" in second.name.lower():
        pairs.reverse()
    for along_x, along_y in pairs:
        x_bins, y_bins = along_x.shape[2] or 0, along_y.shape[2] or 0
        if x_bins * graph.height == y_bins * graph.width and x_bins >= graph.width:
            return Match(
                {"simcc_x": along_x.name, "simcc_y": along_y.name},
                [
                    f"{along_x}, {along_y}: a classification along x and one along y, "
                    f"{x_bins / graph.width:g} bins a pixel"
                ],
                CROP_INPUT,
                _CROP_ASSUMED,
                keypoints=along_x.shape[1],
            )
    return None


def _decode_simcc(outputs: Outputs, manifest: Manifest) -> Keypoints:
    """SimCC (Li et al., ECCV 2022) as RTMPose emits it; the score is the smaller maximum."""
    along_x, along_y = outputs["simcc_x"], outputs["simcc_y"]
    bins_per_pixel = (
        along_x.shape[2] / manifest.input_width,
        along_y.shape[2] / manifest.input_height,
    )
    places = np.stack([along_x.argmax(axis=2), along_y.argmax(axis=2)], axis=2)
    score = np.minimum(along_x.max(axis=2), along_y.max(axis=2))
    return (places / np.array(bins_per_pixel)).astype(np.float32), score


# MoveNet, one person --------------------------------------------------------------------------


def _match_movenet(graph: Graph) -> Match | None:
    if len(graph.outputs) != 1 or graph.outputs[0].shape[1:] != (1, 17, 3):
        return None
    return Match(
        {"keypoints": graph.outputs[0].name},
        [f"{graph.outputs[0]}: y, x in fractions and a score for 17 keypoints, as MoveNet"],
        {"colour_order": "RGB", "resize": "crop"},
        ["RGB 0-255"],
        keypoints=17,
        default_size=(192, 192),
    )


def _decode_movenet(outputs: Outputs, manifest: Manifest) -> Keypoints:
    values = outputs["keypoints"][:, 0]
    size = np.array([manifest.input_width, manifest.input_height], np.float32)
    return values[..., 1::-1] * size - 0.5, values[..., 2]


# BlazePose ------------------------------------------------------------------------------------

_LANDMARKS, _BLAZEPOSE = 39, 33  # the last six are helpers of its own tracker


def _match_blazepose(graph: Graph) -> Match | None:
    landmarks = [t for t in graph.outputs if t.shape[1:] == (_LANDMARKS * 5,)]
    if len(landmarks) != 1:
        return None
    return Match(
        {"landmarks": landmarks[0].name},
        [f"{landmarks[0]}: 39 landmarks of x, y, z, visibility, presence, as BlazePose"],
        {
            "colour_order": "RGB",
            "std": (255.0, 255.0, 255.0),
            "resize": "crop",
            "skeleton": "blazepose33",
        },
        ["RGB 0-1; crops stay upright (BlazePose's own tracker turns them with the body)"],
        keypoints=_BLAZEPOSE,
    )


def _decode_blazepose(outputs: Outputs, manifest: Manifest) -> Keypoints:
    del manifest
    values = outputs["landmarks"].reshape(-1, _LANDMARKS, 5)[:, :_BLAZEPOSE]
    logit = np.minimum(values[..., 3], values[..., 4]).astype(np.float64)
    return values[..., :2] - np.float32(0.5), (1 / (1 + np.exp(-logit))).astype(np.float32)


POSE_FORMS = (
    OutputForm(
        "movenet",
        "pose",
        "[1, 1, 17, 3] y, x, score (MoveNet single-pose)",
        _match_movenet,
        _decode_movenet,
    ),
    OutputForm(
        "blazepose",
        "pose",
        "[1, 195] landmarks (BlazePose)",
        _match_blazepose,
        _decode_blazepose,
    ),
    OutputForm(
        "heatmap",
        "pose",
        "[B, K, h, w] heatmaps, with or without an integer argmax (HRNet, ViTPose, TinyPose)",
        _match_heatmap,
        _decode_heatmap,
    ),
    OutputForm(
        "simcc",
        "pose",
        "[B, K, bins] twice, along x and along y (RTMPose)",
        _match_simcc,
        _decode_simcc,
    ),
)
