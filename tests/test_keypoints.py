"""Pose models: each output form, fed with planted keypoints, gives those keypoints back."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from dance2pose import skeleton as skeletons
from dance2pose.detection import load_detector
from dance2pose.errors import ModelError
from dance2pose.keypoints import (
    LARGEST_BATCH,
    KeypointEstimator,
    OneStageEstimator,
    load_pose_model,
)
from dance2pose.onnx_models.pose_forms import dark_shift, quarter_pixel_shift
from dance2pose.onnx_models.recognition import FORMS
from dance2pose.poses import Boxes, Poses2D
from onnx_graphs import emitting, emitting_per_crop, heatmaps_of_colours
from test_detection import CELLS, HEIGHT, IMAGE, PEOPLE, SCORES, WIDTH, frame_of, spread

Array = npt.NDArray[Any]

# Crops are 96 x 128 px. Two people; the first box has the crop's aspect, the second is wider.
CROP = (96, 128)
BOXES = Boxes(np.array([[20.0, 30, 92, 126], [150, 200, 270, 280]]), np.array([0.9, 0.8]))


def planted(joints: int, *, step: float) -> tuple[Array, Array]:
    """Places (1, J, 2) in the crop on multiples of `step` px, and scores (1, J)."""
    rng = np.random.default_rng(joints)
    cells = rng.integers([3, 3], [CROP[0] / step - 3, CROP[1] / step - 3], (1, joints, 2))
    scores = rng.uniform(0.3, 0.95, (1, joints)).astype(np.float32)
    return (cells * step).astype(np.float32), scores


def in_picture(network_xy: Array, box: Array) -> Array:
    """Places in the crop as places in the picture, from the definition of the crop.

    The box's centre is the crop's centre, (width - 1) / 2 from the first pixel's; the box, grown
    to 3:4 and by a quarter, is as wide as the crop's `width` pixels.
    """
    extent = box[2:] - box[:2]
    crop_width = 1.25 * max(extent[0], extent[1] * 3 / 4)
    centre = (box[:2] + box[2:]) / 2
    return np.asarray(centre + (network_xy - (np.array(CROP) - 1) / 2) * crop_width / CROP[0])


def check(poses: Poses2D, network_xy: Array, scores: Array, *, atol: float = 1e-3) -> None:
    assert len(poses) == len(BOXES)
    for pose, confidence, box in zip(poses.xy, poses.confidence, BOXES.xyxy, strict=True):
        np.testing.assert_allclose(pose, in_picture(network_xy[0], box), atol=atol)
        np.testing.assert_allclose(confidence, scores[0], atol=1e-5)


def gaussians(centres: Array, scores: Array, *, sigma: float = 2.0) -> Array:
    """Heatmaps (1, J, 32, 24) with a Gaussian of that height at each centre (heatmap px)."""
    y, x = np.mgrid[0 : CROP[1] // 4, 0 : CROP[0] // 4]
    squared = (x - centres[..., 0, None, None]) ** 2 + (y - centres[..., 1, None, None]) ** 2
    return (scores[..., None, None] * np.exp(-squared / (2 * sigma**2))).astype(np.float32)


# Top-down forms -------------------------------------------------------------------------------


def heatmap_graph(path: Path, joints: int) -> tuple[Path, Array, Array]:
    xy, scores = planted(joints, step=4)
    # A shade more weight to the right and below: a quarter of a heatmap pixel.
    heatmaps = gaussians(xy / 4 + 0.1, scores)
    path.with_suffix(".toml").write_text('refinement = "quarter"\n')
    emitting_per_crop(path, {"heatmap": heatmaps}, input_shape=["batch", 3, CROP[1], CROP[0]])
    return path, xy + 1.0, heatmaps.max(axis=(2, 3))


def simcc_graph(path: Path, joints: int) -> tuple[Path, Array, Array]:
    xy, scores = planted(joints, step=0.5)
    along = [np.zeros((1, joints, 2 * side), np.float32) for side in CROP]
    for axis, classes in enumerate(along):
        bins = np.rint(xy[0, :, axis] * 2).astype(int)
        classes[0, np.arange(joints), bins] = scores[0] + np.float32(0.05 * axis)
    emitting_per_crop(
        path,
        {"simcc_x": along[0], "simcc_y": along[1]},
        input_shape=["batch", 3, CROP[1], CROP[0]],
    )
    return path, xy, scores


COUNTS = {"mpii16": 16, "coco17": 17, "coco23": 23, "body25": 25, "halpe26": 26, "blazepose33": 33}


@pytest.mark.parametrize("graph", [heatmap_graph, simcc_graph])
@pytest.mark.parametrize("skeleton", COUNTS)
def test_planted_keypoints_come_back(
    graph: Callable[[Path, int], tuple[Path, Array, Array]], skeleton: str, tmp_path: Path
) -> None:
    path, xy, scores = graph(tmp_path / "m.onnx", COUNTS[skeleton])
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator) and not isinstance(model, OneStageEstimator)
    assert model.skeleton == skeleton
    assert len(skeletons.get(skeleton)) == COUNTS[skeleton]
    check(model.estimate(IMAGE, BOXES), xy, scores)


def test_seventeen_keypoints_are_what_the_manifest_says(tmp_path: Path) -> None:
    path, xy, scores = simcc_graph(tmp_path / "m.onnx", 17)
    assert load_pose_model(path).skeleton == "coco17"
    (tmp_path / "m.toml").write_text('skeleton = "h36m17"\n')
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    assert model.skeleton == "h36m17"
    poses = model.estimate(IMAGE, BOXES)
    assert poses.skeleton == "h36m17"
    check(poses, xy, scores)


def test_whole_body_models_give_hands_and_face_too(tmp_path: Path) -> None:
    path, xy, scores = simcc_graph(tmp_path / "m.onnx", 133)
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    assert model.skeleton == "wholebody133"
    check(model.estimate(IMAGE, BOXES), xy, scores)


def test_a_manifest_can_ask_a_whole_body_model_for_body_and_feet(tmp_path: Path) -> None:
    path, xy, scores = simcc_graph(tmp_path / "m.onnx", 133)
    (tmp_path / "m.toml").write_text('skeleton = "coco23"\n')
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    assert model.skeleton == "coco23"
    check(model.estimate(IMAGE, BOXES), xy[:, :23], scores[:, :23])


def test_a_skeleton_of_another_size_is_refused(tmp_path: Path) -> None:
    path, _, _ = simcc_graph(tmp_path / "m.onnx", 17)
    (tmp_path / "m.toml").write_text('skeleton = "halpe26"\n')
    with pytest.raises(ModelError, match="gives 17 keypoints, but halpe26 has 26"):
        load_pose_model(path)


def test_simcc_with_the_axes_in_the_other_order(tmp_path: Path) -> None:
    path, xy, scores = simcc_graph(tmp_path / "m.onnx", 17)
    import onnx

    model = onnx.load(str(path))
    model.graph.output.reverse()
    onnx.save(model, str(path))
    estimator = load_pose_model(path)
    assert isinstance(estimator, KeypointEstimator)
    check(estimator.estimate(IMAGE, BOXES), xy, scores)


def test_extra_argmax_output_is_not_used(tmp_path: Path) -> None:
    xy, scores = planted(17, step=4)
    heatmaps = gaussians(xy / 4 + 0.1, scores)
    (tmp_path / "m.toml").write_text('refinement = "quarter"\n')
    path = emitting(
        tmp_path / "m.onnx",
        {"heatmap": heatmaps, "argmax": np.zeros((1, 17), np.int64)},
        input_shape=[1, 3, CROP[1], CROP[0]],
    )
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    check(model.estimate(IMAGE, BOXES), xy + 1.0, heatmaps.max(axis=(2, 3)))


@pytest.mark.parametrize("alignment", ["stride", "corners"])
def test_dark_refinement_finds_the_top_between_pixels(alignment: str, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    # Not beside the border, where the smoothing that belongs to the method pulls inwards.
    centres = rng.uniform([6, 6], [17, 25], (1, 17, 2)).astype(np.float32)
    scores = rng.uniform(0.3, 0.95, (1, 17)).astype(np.float32)
    path = tmp_path / "m.onnx"
    emitting_per_crop(
        path,
        {"heatmap": gaussians(centres, scores)},
        input_shape=["batch", 3, CROP[1], CROP[0]],
    )
    (tmp_path / "m.toml").write_text(f'heatmap_alignment = "{alignment}"\n')
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    stride = 4 if alignment == "stride" else np.array([95 / 23, 127 / 31])
    found = model.estimate(IMAGE, BOXES)
    for pose, box in zip(found.xy, BOXES.xyxy, strict=True):
        np.testing.assert_allclose(pose, in_picture(centres[0] * stride, box), atol=0.12)


def test_refinements_against_a_slow_reference() -> None:
    rng = np.random.default_rng(1)
    heatmap = rng.uniform(0, 1, (3, 5, 11, 7)).astype(np.float32)
    best = heatmap.reshape(3, 5, -1).argmax(axis=2)
    y, x = np.divmod(best, 7)
    shift = quarter_pixel_shift(heatmap, x, y)
    for n in range(3):
        for k in range(5):
            i, j, plane = y[n, k], x[n, k], heatmap[n, k]
            expected = np.zeros(2)
            if 0 < i < 10 and 0 < j < 6:
                expected = 0.25 * np.sign(
                    [plane[i, j + 1] - plane[i, j - 1], plane[i + 1, j] - plane[i - 1, j]]
                )
            np.testing.assert_array_equal(shift[n, k], expected)
    flat = np.ones((1, 1, 11, 7), np.float32)
    middle = np.full((1, 1), 3)
    assert (dark_shift(flat, middle, middle) == 0).all()
    assert (np.abs(dark_shift(heatmap, x, y)) <= 1).all()


@pytest.mark.parametrize("dtype", [np.float32, np.int32, np.uint8])
def test_movenet(dtype: type, tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    values = rng.uniform(0.1, 0.9, (1, 1, 17, 3)).astype(np.float32)
    path = emitting(
        tmp_path / "m.onnx", {"output_0": values}, input_shape=[1, 192, 192, 3], input_dtype=dtype
    )
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    assert (model.description.manifest.layout, model.skeleton) == ("NHWC", "coco17")
    poses = model.estimate(IMAGE, BOXES)
    for pose, box in zip(poses.xy, BOXES.xyxy, strict=True):
        # Fractions of a square crop, whose edges are the box's longer side, grown by a quarter.
        side = 1.25 * max(box[2:] - box[:2])
        corner = (box[:2] + box[2:]) / 2 - side / 2
        np.testing.assert_allclose(pose, corner + values[0, 0, :, 1::-1] * side, atol=1e-3)
    np.testing.assert_allclose(poses.confidence[1], values[0, 0, :, 2], atol=1e-6)


def test_blazepose(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    landmarks = rng.uniform(20, 230, (1, 39, 5)).astype(np.float32)
    landmarks[..., 3:] = rng.uniform(-3, 3, (1, 39, 2))
    path = emitting(
        tmp_path / "m.onnx",
        {
            "Identity": landmarks.reshape(1, 195),
            "Identity_1": np.ones((1, 1), np.float32),
            "Identity_2": np.zeros((1, 256, 256, 1), np.float32),
            "Identity_3": np.zeros((1, 64, 64, 39), np.float32),
            "Identity_4": np.zeros((1, 117), np.float32),
        },
        input_shape=[1, 256, 256, 3],
    )
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    assert model.skeleton == "blazepose33"
    poses = model.estimate(IMAGE, BOXES)
    for pose, box in zip(poses.xy, BOXES.xyxy, strict=True):
        side = 1.25 * max(box[2:] - box[:2])
        corner = (box[:2] + box[2:]) / 2 - side / 2
        np.testing.assert_allclose(pose, corner + landmarks[0, :33, :2] / 256 * side, atol=1e-3)
    expected = 1 / (1 + np.exp(-landmarks[0, :33, 3:].min(axis=1)))
    np.testing.assert_allclose(poses.confidence[0], expected, atol=1e-5)


@pytest.mark.parametrize("dtype", [np.float32, np.float16, np.uint8])
@pytest.mark.parametrize("batch", [1, 2, 4])
@pytest.mark.parametrize("layout", ["NCHW", "NHWC"])
def test_layouts_types_and_fixed_batches(
    dtype: type, batch: int, layout: str, tmp_path: Path
) -> None:
    xy, scores = planted(17, step=4)
    heatmaps = gaussians(xy / 4 + 0.1, scores)
    (tmp_path / "m.toml").write_text('refinement = "quarter"\n')
    shape = [3, CROP[1], CROP[0]]
    if layout == "NHWC":
        heatmaps, shape = heatmaps.transpose(0, 2, 3, 1), [*shape[1:], 3]
    path = emitting(
        tmp_path / "m.onnx",
        {"heatmap": np.repeat(heatmaps, batch, axis=0)},
        input_shape=[batch, *shape],
        input_dtype=dtype,
    )
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    axes = (2, 3) if layout == "NCHW" else (1, 2)
    check(model.estimate(IMAGE, BOXES), xy + 1.0, heatmaps.max(axis=axes))


# The whole way, with a model that looks -----------------------------------------------------


@pytest.mark.parametrize("batch", [1, "batch"])
@pytest.mark.parametrize("order", ["RGB", "BGR"])
def test_a_model_that_looks_sees_each_dancer_where_he_is(
    batch: int | str, order: str, tmp_path: Path
) -> None:
    """Soft spots of pure red, green and blue in two boxes are found to a fraction of a pixel."""
    path = heatmaps_of_colours(tmp_path / "m.onnx", width=CROP[0], height=CROP[1], batch=batch)
    (tmp_path / "m.toml").write_text(
        f'refinement = "dark"\nmean = [0, 0, 0]\nstd = [255, 255, 255]\ncolour_order = "{order}"\n'
    )
    spots = {  # channel of the BGR picture -> place within each box
        2: [(50.3, 61.8), (190.0, 231.5)],
        1: [(60.0, 100.4), (221.7, 262.2)],
        0: [(45.6, 80.5), (240.4, 240.9)],
    }
    y, x = np.mgrid[0 : IMAGE.shape[0], 0 : IMAGE.shape[1]]
    image = np.zeros_like(IMAGE)
    for channel, places in spots.items():
        light = sum(np.exp(-((x - px) ** 2 + (y - py) ** 2) / (2 * 8.0**2)) for px, py in places)
        image[..., channel] = np.rint(255 * np.minimum(light, 1)).astype(np.uint8)
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    poses = model.estimate(image, BOXES)
    first = (2, 1, 0) if order == "RGB" else (0, 1, 2)
    for person in range(2):
        for k in range(17):
            # A 4x4 average lies 1.5 network pixels after its first pixel; the crops are 1.04 and
            # 1.67 picture pixels to one of the network's.
            late = 1.5 * (1.25 * 72 / 96 if person == 0 else 1.25 * 120 / 96)
            np.testing.assert_allclose(
                poses.xy[person, k] + late, spots[first[k % 3]][person], atol=0.35
            )


@pytest.mark.parametrize("fixed", [False, True])
def test_many_dancers_are_each_seen_once(fixed: bool, tmp_path: Path) -> None:
    """More boxes than a batch holds, with degenerate ones between, keep their order."""
    batch: int | str = 4 if fixed else "batch"
    path = heatmaps_of_colours(tmp_path / "m.onnx", width=CROP[0], height=CROP[1], batch=batch)
    count = LARGEST_BATCH + 5
    rng = np.random.default_rng(0)
    corners = rng.uniform(0, 250, (count, 2))
    xyxy = np.concatenate([corners, corners + rng.uniform(30, 80, (count, 2))], axis=1)
    xyxy[3, 2:] = xyxy[3, :2]
    image = rng.integers(0, 255, IMAGE.shape).astype(np.uint8)
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    together = model.estimate(image, Boxes(xyxy, np.ones(count)))
    assert np.isnan(together.xy[3]).all() and (together.confidence[3] == 0).all()
    for n in [0, 2, 4, LARGEST_BATCH - 1, LARGEST_BATCH, count - 1]:
        alone = model.estimate(image, Boxes(xyxy[n : n + 1], np.ones(1)))
        np.testing.assert_array_equal(together.xy[n], alone.xy[0])


def test_one_model_serves_several_threads(tmp_path: Path) -> None:
    path = heatmaps_of_colours(tmp_path / "m.onnx", width=CROP[0], height=CROP[1])
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    rng = np.random.default_rng(2)
    pictures = [rng.integers(0, 255, IMAGE.shape).astype(np.uint8) for _ in range(40)]
    expected = [model.estimate(picture, BOXES).xy for picture in pictures]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda picture: model.estimate(picture, BOXES).xy, pictures))
    np.testing.assert_array_equal(found, expected)


def test_a_graph_that_fails_on_batches_says_what_to_state(tmp_path: Path) -> None:
    path = heatmaps_of_colours(
        tmp_path / "m.onnx", width=CROP[0], height=CROP[1], fails_above_one=True
    )
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    one = Boxes(BOXES.xyxy[:1], BOXES.confidence[:1])
    assert len(model.estimate(IMAGE, one)) == 1
    with pytest.raises(ModelError, match=r"the model failed: .*; .* max_batch = 1"):
        model.estimate(IMAGE, BOXES)


def test_a_graph_that_only_pretends_to_take_batches(tmp_path: Path) -> None:
    """Its batch is open, but it gives one pose whatever it is given."""
    along = [np.ones((1, 17, 2 * side), np.float32) for side in CROP]
    path = emitting(
        tmp_path / "m.onnx",
        {"simcc_x": along[0], "simcc_y": along[1]},
        input_shape=["batch", 3, CROP[1], CROP[0]],
    )
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    with pytest.raises(ModelError, match=r"gave 1 poses for 2 crops; .* max_batch = 1"):
        model.estimate(IMAGE, BOXES)
    (tmp_path / "m.toml").write_text("max_batch = 1\n")
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    assert np.isfinite(model.estimate(IMAGE, BOXES).xy).all()


def test_no_box_no_pose(tmp_path: Path) -> None:
    path, _, _ = simcc_graph(tmp_path / "m.onnx", 26)
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    poses = model.estimate(IMAGE, Boxes(np.zeros((0, 4)), np.zeros(0)))
    assert poses.xy.shape == (0, 26, 2)


def test_scores_are_clipped_and_a_score_of_zero_is_missing(tmp_path: Path) -> None:
    along = [np.zeros((1, 17, 2 * side), np.float32) for side in CROP]
    for classes in along:
        classes[0, 0, 10] = 1.07
        classes[0, 1, 10] = -0.2
    path = emitting(
        tmp_path / "m.onnx",
        {"simcc_x": along[0], "simcc_y": along[1]},
        input_shape=[1, 3, CROP[1], CROP[0]],
    )
    model = load_pose_model(path)
    assert isinstance(model, KeypointEstimator)
    poses = model.estimate(IMAGE, BOXES)
    assert (poses.confidence[:, 0] == 1).all()
    assert np.isfinite(poses.xy[:, 0]).all()
    assert np.isnan(poses.xy[:, 1:]).all() and (poses.confidence[:, 1:] == 0).all()


# One-stage forms ------------------------------------------------------------------------------


def keypoints_of_people(joints: int = 17) -> tuple[Array, Array]:
    """(3, J, 2) places in the picture, at pixel centres, and (3, J) scores."""
    rng = np.random.default_rng(7)
    places = PEOPLE[:, None, :2] + rng.uniform(0.1, 0.9, (3, joints, 2)) * (
        PEOPLE[:, None, 2:] - PEOPLE[:, None, :2]
    )
    return places.astype(np.float32), rng.uniform(0.2, 1, (3, joints)).astype(np.float32)


def boxes_and_keypoints(*, left: float, centres: bool) -> tuple[Array, Array]:
    """Half-size letterbox: boxes (3, 4) from the edge, keypoints (3, 17, 3).

    centres: whether the form measures keypoints from the first pixel's centre, or its edge.
    """
    places, scores = keypoints_of_people()
    boxes = PEOPLE * 0.5 + np.array([left, 0, left, 0], np.float32)
    network = (places + 0.5) * 0.5 + np.array([left, 0]) - (0.5 if centres else 0)
    return boxes, np.concatenate([network, scores[..., None]], axis=2).astype(np.float32)


def rtmo(path: Path) -> Path:
    boxes, keypoints = boxes_and_keypoints(left=0, centres=True)
    return emitting(
        path,
        {
            "dets": np.concatenate([boxes, SCORES[:, None]], axis=1)[None],
            "keypoints": keypoints[None],
        },
        input_shape=["batch", 3, HEIGHT, WIDTH],
        declared={"dets": ["batch", "n", 5], "keypoints": ["batch", "n", 17, 3]},
    )


def yolov8_pose(path: Path) -> Path:
    boxes, keypoints = boxes_and_keypoints(left=32, centres=False)
    values = np.concatenate(
        [(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2], SCORES[:, None],
         keypoints.reshape(3, 51)],
        axis=1,
    )  # fmt: skip
    values = np.concatenate([values, values[:1] * [1, 1, 1, 1, 0.9, *[1] * 51]])
    columns = np.zeros((56, CELLS), np.float32)
    columns[:, spread(4, CELLS)] = values.T
    return emitting(path, {"output0": columns[None]}, input_shape=[1, 3, HEIGHT, WIDTH])


def yolo_pose_rows(path: Path) -> Path:
    boxes, keypoints = boxes_and_keypoints(left=32, centres=False)
    rows = np.zeros((1, 300, 57), np.float32)
    rows[0, :3] = np.concatenate(
        [boxes, SCORES[:, None], np.zeros((3, 1)), keypoints.reshape(3, 51)], axis=1
    )
    return emitting(
        path,
        {"output0": rows},
        input_shape=[1, 3, HEIGHT, WIDTH],
        metadata={"task": "pose", "kpt_shape": "[17, 3]"},
    )


def movenet_multipose(path: Path) -> Path:
    boxes, keypoints = boxes_and_keypoints(left=0, centres=False)
    size = np.array([WIDTH, HEIGHT], np.float32)
    rows = np.zeros((1, 6, 56), np.float32)
    values = keypoints[..., [1, 0, 2]] / np.array([HEIGHT, WIDTH, 1])
    rows[0, :3, :51] = values.reshape(3, 51)
    rows[0, :3, 51:55] = (boxes / np.tile(size, 2))[:, [1, 0, 3, 2]]
    rows[0, :3, 55] = SCORES
    return emitting(
        path,
        {"output_0": rows},
        input_shape=[1, "h", "w", 3],
        input_dtype=np.int32,
    )


ONE_STAGE = {
    "rtmo": rtmo,
    "yolov8-pose": yolov8_pose,
    "rows-xyxy-score-class-keypoints": yolo_pose_rows,
    "movenet-multipose": movenet_multipose,
}


@pytest.mark.parametrize("form", ONE_STAGE)
def test_one_stage_models(form: str, tmp_path: Path) -> None:
    if form == "movenet-multipose":
        (tmp_path / "m.toml").write_text(f"input_width = {WIDTH}\ninput_height = {HEIGHT}\n")
    model = load_pose_model(ONE_STAGE[form](tmp_path / "m.onnx"))
    assert isinstance(model, OneStageEstimator)
    assert (model.description.form, model.description.kind) == (form, "one-stage")
    boxes, poses = model.find(IMAGE)
    order = np.argsort(-SCORES)
    places, scores = keypoints_of_people()
    np.testing.assert_allclose(boxes.xyxy, PEOPLE[order] - 0.5, atol=2e-3)
    np.testing.assert_allclose(boxes.confidence, SCORES[order], atol=1e-5)
    np.testing.assert_allclose(poses.xy, places[order], atol=2e-3)
    np.testing.assert_allclose(poses.confidence, scores[order], atol=1e-5)
    with pytest.raises(ModelError, match=r"m\.onnx: is a one-stage model .*expected a person det"):
        load_detector(tmp_path / "m.onnx")


def test_every_pose_form_has_a_graph() -> None:
    tested = {"heatmap", "simcc", "movenet", "blazepose", *ONE_STAGE}
    assert tested == {form.name for form in FORMS.values() if form.kind != "detector"}


def test_a_detector_is_refused_by_name(tmp_path: Path) -> None:
    path = emitting(
        tmp_path / "rtmdet.onnx",
        {"dets": np.zeros((1, 3, 5), np.float32), "labels": np.zeros((1, 3), np.int64)},
        input_shape=[1, 3, HEIGHT, WIDTH],
    )
    with pytest.raises(ModelError, match=r"rtmdet\.onnx: is a person detector .*expected a pose"):
        load_pose_model(path)


# Real models ----------------------------------------------------------------------------------

# Marked by hand on frame 200 of contemporary_dance.mp4, to a few pixels.
BY_HAND = {
    "left_ear": (157, 96),
    "left_wrist": (207, 187),
    "right_wrist": (140, 224),
    "left_ankle": (234, 403),
    "right_ankle": (181, 368),
}


@pytest.mark.shared
@pytest.mark.parametrize(
    "name",
    ["pp_tinypose_256x192", "pp_tinypose_128x96", "simcc_adapter_tinypose_256x192"],
)
def test_real_pose_models_on_a_real_dancer(name: str, shared: Path) -> None:
    model = load_pose_model(shared / "models" / f"{name}.onnx")
    detector = load_detector(shared / "models" / "picodet_s_320_pedestrian.onnx")
    assert isinstance(model, KeypointEstimator)
    image = frame_of(shared / "videos" / "contemporary_dance.mp4", 200)
    boxes = detector.detect(image)
    poses = model.estimate(image, boxes)
    assert poses.confidence.mean() > 0.7
    coco = skeletons.get("coco17")
    for joint, place in BY_HAND.items():
        np.testing.assert_allclose(poses.xy[0, coco.index(joint)], place, atol=14, err_msg=joint)
    # A mirrored picture has the mirrored pose, with left and right exchanged.
    mirrored = np.ascontiguousarray(image[:, ::-1])
    other = model.estimate(mirrored, detector.detect(mirrored))
    back = other.xy[0, list(coco.mirror)]
    back[:, 0] = image.shape[1] - 1 - back[:, 0]
    assert np.median(np.linalg.norm(back - poses.xy[0], axis=1)) < 10
    # Half the size, half the coordinates: no offset hides in the resizing.
    small = np.asarray(cv2.resize(image, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA))
    half = Boxes((boxes.xyxy + 0.5) / 2 - 0.5, boxes.confidence)
    again = (model.estimate(small, half).xy + 0.5) * 2 - 0.5
    assert np.abs(np.median(again - poses.xy, axis=1)).max() < 1.0


@pytest.mark.shared
def test_nobody_is_seen_where_nobody_is(shared: Path) -> None:
    """PicoDet reports a person in a black picture; the keypoints there are not to be trusted."""
    detector = load_detector(shared / "models" / "picodet_s_320_pedestrian.onnx")
    model = load_pose_model(shared / "models" / "pp_tinypose_256x192.onnx")
    assert isinstance(model, KeypointEstimator)
    noise = np.random.default_rng(0).integers(0, 255, (496, 384, 3))
    for image in (np.zeros((496, 384, 3)), np.full((496, 384, 3), 255), noise):
        picture = image.astype(np.uint8)
        poses = model.estimate(picture, detector.detect(picture))
        assert (poses.confidence.mean(axis=1) < 0.1).all()
