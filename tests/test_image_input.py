"""Preprocessing: what the network sees at a place is what the picture has where that place is.

The test picture is a ramp, linear in x and y, which bilinear resampling leaves a ramp: so the
value at each pixel of the tensor tells where in the picture it was taken from.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.onnx_models.image_input import ImageInput, crop_affines, to_image
from dance2pose.onnx_models.manifest import Manifest

Array = npt.NDArray[Any]

DETECTOR = Manifest(kind="detector", form="yolox", input_width=96, input_height=64)
POSE = Manifest(
    kind="pose",
    form="simcc",
    input_width=48,
    input_height=64,
    resize="crop",
    skeleton="coco17",
)
FLOAT32 = np.dtype(np.float32)


def ramp(width: int, height: int) -> Array:
    """Blue grows with x, green with y, red is constant; steps small enough for 8 bits."""
    y, x = np.mgrid[0:height, 0:width]
    blue = 20 + 200 * x / width
    green = 230 - 200 * y / height
    return np.stack([blue, green, np.full_like(blue, 77)], axis=2).round().astype(np.uint8)


def check_ramp(tensor: Array, affine: Array, size: tuple[int, int], inside: Array) -> None:
    """tensor: (3, h, w) in BGR; inside: (h, w) of the pixels that must hold the ramp."""
    width, height = size
    v, u = np.nonzero(inside)
    assert len(u) > 50
    places = to_image(np.stack([u, v], axis=1).astype(float), affine)
    # 8 bits, twice rounded, and a 32nd of a pixel in warpAffine.
    tolerance = 1.6 + 200 / min(size) / 16
    np.testing.assert_allclose(tensor[0, v, u], 20 + 200 * places[:, 0] / width, atol=tolerance)
    np.testing.assert_allclose(tensor[1, v, u], 230 - 200 * places[:, 1] / height, atol=tolerance)
    np.testing.assert_array_equal(tensor[2, v, u], 77)


def within(affine: Array, size: tuple[int, int], shape: tuple[int, int]) -> Array:
    """(h, w) True where a network pixel, with its neighbours, lies inside the picture."""
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]]
    places = to_image(np.stack([u, v], axis=2).astype(float), affine)
    return ((places >= 1) & (places <= np.array(size) - 2)).all(axis=2)


@settings(max_examples=60, deadline=None)
@given(
    width=st.integers(40, 300),
    height=st.integers(40, 300),
    resize=st.sampled_from(["letterbox", "stretch"]),
    position=st.sampled_from(["top-left", "centre"]),
)
def test_whole_pictures(width: int, height: int, resize: Any, position: Any) -> None:
    manifest = dataclasses.replace(
        DETECTOR, resize=resize, padding_position=position, colour_order="BGR"
    )
    tensor, affine = ImageInput(manifest, FLOAT32).whole(ramp(width, height))
    assert tensor.shape == (1, 3, 64, 96)
    inside = within(affine, (width, height), (64, 96))
    check_ramp(tensor[0], affine, (width, height), inside)
    # Edges lie on edges: the picture's border half a pixel outside the outer pixel centres.
    corners = to_image(np.array([[-0.5, -0.5], [95.5, 63.5]]), affine)
    if resize == "stretch":
        np.testing.assert_allclose(corners, [[-0.5, -0.5], [width - 0.5, height - 0.5]])
    elif position == "top-left":
        np.testing.assert_allclose(corners[0], [-0.5, -0.5])
        assert abs(affine[0, 0] / affine[1, 1] - 1) < 0.05  # the aspect is kept
    padding = np.abs(to_image(np.mgrid[0:96, 0:64].T.astype(float), affine) - [0, 0])
    outside = (padding[..., 0] > width) | (padding[..., 1] > height)
    if resize == "letterbox" and position == "top-left":
        assert (tensor[0][:, outside] == 114).all()


@settings(max_examples=60, deadline=None)
@given(
    x=st.floats(-20, 150),
    y=st.floats(-20, 100),
    w=st.floats(40, 200),
    h=st.floats(40, 200),
    box_scale=st.floats(1, 1.6),
)
def test_crops(x: float, y: float, w: float, h: float, box_scale: float) -> None:
    manifest = dataclasses.replace(POSE, box_scale=box_scale, colour_order="BGR")
    boxes = np.array([[x, y, x + w, y + h], [30.0, 40, 90, 110]])
    tensor, affines = ImageInput(manifest, FLOAT32).crops(ramp(210, 170), boxes)
    for picture, affine, box in zip(tensor, affines, boxes, strict=True):
        inside = within(affine, (210, 170), (64, 48))
        if inside.sum() > 50:
            check_ramp(picture, affine, (210, 170), inside)
        centre = to_image(np.array([23.5, 31.5]), affine)
        np.testing.assert_allclose(centre, (box[:2] + box[2:]) / 2, atol=1e-9)
        # The whole box is in the crop, and reaches across it (less the margin) on one axis.
        corners = to_image(np.array([[-0.5, -0.5], [47.5, 63.5]]), affine)
        share = (box[2:] - box[:2]) / (corners[1] - corners[0])
        assert max(share) == pytest.approx(1 / box_scale)


def test_many_crops_are_each_cut_from_their_own_box() -> None:
    boxes = np.array([[10.0, 20, 60, 90], [100, 30, 180, 150], [5, 5, 200, 160]])
    source = ImageInput(POSE, FLOAT32)
    together = source.crops(ramp(210, 170), boxes)[0].copy()
    for n in (2, 0, 1):
        np.testing.assert_array_equal(
            source.crops(ramp(210, 170), boxes[n : n + 1])[0][0], together[n]
        )


def test_a_crop_is_the_same_wherever_the_dancer_stands() -> None:
    box = np.array([[20.0, 30, 80, 120]])
    moved = crop_affines(box + np.array([7, -5, 7, -5]), (48, 64), 1.25)
    at_home = crop_affines(box, (48, 64), 1.25)
    np.testing.assert_allclose(moved[0] - at_home[0], [[0, 0, 7], [0, 0, -5]], atol=1e-9)


@pytest.mark.parametrize("layout", ["NCHW", "NHWC"])
@pytest.mark.parametrize("order", ["RGB", "BGR"])
@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.uint8, np.int32])
def test_layout_colour_order_and_normalisation(layout: Any, order: Any, dtype: type) -> None:
    plain = np.issubdtype(dtype, np.integer)
    mean, std = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)) if plain else ((10.0, 20, 30), (2.0, 4, 5))
    manifest = dataclasses.replace(
        DETECTOR, layout=layout, colour_order=order, mean=mean, std=std, resize="stretch"
    )
    image = np.broadcast_to(np.array([50, 100, 200], np.uint8), (80, 120, 3)).copy()
    tensor, _ = ImageInput(manifest, np.dtype(dtype)).whole(image)
    assert tensor.dtype == dtype
    channels = tensor[0] if layout == "NCHW" else tensor[0].transpose(2, 0, 1)
    assert channels.shape == (3, 64, 96)
    colours = np.array([200, 100, 50] if order == "RGB" else [50, 100, 200])
    expected = (colours - np.array(mean)) / np.array(std)
    for channel, value in zip(channels, expected, strict=True):
        np.testing.assert_allclose(channel.astype(float), value, rtol=2e-3)
