"""Cubic resizing in a graph: taken out where a product gives the same, left where it would not."""

from __future__ import annotations

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import helper

from dance2pose.onnx_models.inference import open_session
from dance2pose.onnx_models.providers import CPU
from dance2pose.onnx_models.resizing import CHANGE, MOST_NODES, with_products
from onnx_graphs import save, tensor

CHANNELS, HEIGHT, WIDTH = 5, 7, 11


def resizing(
    path: Path,
    *,
    sizes: list[int] | None = None,
    scales: list[float] | None = None,
    shape: tuple[int | str, ...] = (1, CHANNELS, HEIGHT, WIDTH),
    **attributes: Any,
) -> Path:
    constants: dict[str, Any] = {"region": np.zeros(0, np.float32)}  # as TensorFlow's export has it
    if sizes is not None:
        constants["by"] = np.array(sizes, np.int64)
    else:
        constants["by"] = np.array(scales, np.float32)
    inputs = ["region", "", "by"] if sizes is not None else ["region", "by"]
    attributes = {"mode": "cubic", **attributes}
    nodes = [
        helper.make_node("Relu", ["image"], ["bright"]),
        helper.make_node("Resize", ["bright", *inputs], ["large"], **attributes),
        helper.make_node("Neg", ["large"], ["out"]),
    ]
    open_shape = ("n", "c", "h", "w")
    return save(
        path, nodes, [tensor("image", np.float32, shape)], [tensor("out", np.float32, open_shape)],
        constants,
    )  # fmt: skip


def operators(content: bytes | None) -> list[str]:
    assert content is not None
    return [node.op_type for node in onnx.load_from_string(content).graph.node]


@pytest.mark.parametrize("transform", ["asymmetric", "half_pixel", "align_corners"])
@pytest.mark.parametrize(
    "by",
    [
        {"sizes": [1, CHANNELS, HEIGHT, 8 * WIDTH]},
        {"sizes": [1, CHANNELS, 3 * HEIGHT, 40]},
        {"sizes": [1, CHANNELS, 4, 6]},
        {"scales": [1.0, 1.0, 2.5, 1.7]},
    ],
)
def test_the_products_give_what_the_operator_gives(
    tmp_path: Path, transform: str, by: dict[str, Any]
) -> None:
    path = resizing(tmp_path / "m.onnx", coordinate_transformation_mode=transform, **by)
    assert operators(with_products(path)) == ["Relu", "MatMul", "MatMul", "Neg"]
    image = np.random.default_rng(2).uniform(-1, 1, (1, CHANNELS, HEIGHT, WIDTH))
    feeds = {"image": image.astype(np.float32)}
    usual = onnxruntime.InferenceSession(str(path)).run(None, feeds)[0]
    session = open_session(path)
    assert session.runs_with == f"{CPU}, {CHANGE}"
    found = session.run(feeds, ["out"])[0]
    assert found.shape == usual.shape
    np.testing.assert_allclose(found, usual, atol=1e-5)


def test_any_number_of_pictures_goes_on_being_any_number(tmp_path: Path) -> None:
    path = resizing(
        tmp_path / "m.onnx", scales=[1.0, 1.0, 2.0, 3.0], shape=("n", CHANNELS, HEIGHT, WIDTH)
    )
    image = np.random.default_rng(2).uniform(-1, 1, (3, CHANNELS, HEIGHT, WIDTH))
    feeds = {"image": image.astype(np.float32)}
    usual = onnxruntime.InferenceSession(str(path)).run(None, feeds)[0]
    assert "MatMul" in operators(with_products(path))
    np.testing.assert_allclose(open_session(path).run(feeds, ["out"])[0], usual, atol=1e-5)


@pytest.mark.parametrize(
    "kept",
    [
        {"sizes": [1, CHANNELS, HEIGHT, 8 * WIDTH], "mode": "linear"},
        {"sizes": [1, 2 * CHANNELS, HEIGHT, WIDTH]},
        {"sizes": [1, CHANNELS, HEIGHT, 100_000]},
        {"scales": [1.0, 1.0, float("inf"), 1.0]},
        {"scales": [1.0, 1.0, 2.0, 2.0], "shape": (1, CHANNELS, "h", WIDTH)},
    ],
)
def test_what_is_no_such_product_stays_as_it_is(tmp_path: Path, kept: dict[str, Any]) -> None:
    assert with_products(resizing(tmp_path / "m.onnx", **kept)) is None


def test_shapes_that_a_file_states_of_an_earlier_graph_are_not_believed(tmp_path: Path) -> None:
    path = resizing(tmp_path / "m.onnx", scales=[1.0, 1.0, 2.0, 3.0], shape=("n", "c", "h", "w"))
    model = onnx.load(path)
    stale = helper.make_tensor_value_info("bright", 1, (1, CHANNELS, HEIGHT, WIDTH))
    model.graph.value_info.append(stale)
    onnx.save(model, path)
    assert with_products(path) is None
    image = np.ones((1, CHANNELS, HEIGHT + 2, WIDTH + 2), np.float32)
    (found,) = open_session(path).run({"image": image}, ["out"])
    assert found.shape == (1, CHANNELS, 2 * (HEIGHT + 2), 3 * (WIDTH + 2))


def test_a_graph_with_numbers_in_another_file_or_graphs_within_is_left_alone(
    tmp_path: Path,
) -> None:
    path = resizing(tmp_path / "m.onnx", sizes=[1, CHANNELS, HEIGHT, 88])
    outside = onnx.TensorProto(name="much", data_type=1, dims=[2], data_location=1)
    for key, value in (("location", "much.bin"), ("offset", "0"), ("length", "8")):
        entry = outside.external_data.add()
        entry.key, entry.value = key, value
    within = helper.make_graph([], "branch", [], [tensor("much", np.float32, (2,))], [outside])
    for node in (
        helper.make_node("Constant", [], ["much"], value=outside),
        helper.make_node("If", ["flag"], ["much"], then_branch=within, else_branch=within),
    ):
        model = onnx.load(path)
        model.graph.node.append(node)
        (tmp_path / "more.onnx").write_bytes(model.SerializeToString())
        assert with_products(tmp_path / "more.onnx") is None


def test_where_the_changed_graph_does_not_load_the_file_is_run(tmp_path: Path) -> None:
    path = resizing(tmp_path / "m.onnx", sizes=[1, CHANNELS, HEIGHT, 88])
    model = onnx.load(path)
    # The name that a product would have is taken by another value of the graph.
    model.graph.node.append(helper.make_node("Abs", ["bright"], ["large/resized"]))
    onnx.save(model, path)
    assert with_products(path) is not None
    session = open_session(path)
    assert session.runs_with == CPU
    image = np.random.default_rng(2).uniform(-1, 1, (1, CHANNELS, HEIGHT, WIDTH))
    (found,) = session.run({"image": image.astype(np.float32)}, ["out"])
    assert found.shape == (1, CHANNELS, HEIGHT, 88)


def test_a_graph_of_nothing_but_resizing_does_not_take_long_to_load(tmp_path: Path) -> None:
    path = resizing(tmp_path / "m.onnx", sizes=[1, CHANNELS, HEIGHT, 88])
    model = onnx.load(path)
    resize = model.graph.node[1]
    for number in range(MOST_NODES):
        more = onnx.NodeProto()
        more.CopyFrom(resize)
        more.output[0] = f"more_{number}"
        model.graph.node.append(more)
    onnx.save(model, path)
    assert with_products(path) is None
    assert open_session(path).runs_with == CPU


@pytest.mark.parametrize("content", [b"", b"cubic", b"\x08\x08cubic" * 99])
def test_what_is_no_model_is_left_for_the_loader_to_refuse(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "m.onnx"
    path.write_bytes(content)
    assert with_products(path) is None


def test_without_the_package_onnx_models_run_as_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name.split(".")[0] == "onnx":
            raise ImportError(name)
        return usual(name, *rest)

    path = resizing(tmp_path / "m.onnx", sizes=[1, CHANNELS, HEIGHT, 88])
    monkeypatch.setattr(builtins, "__import__", without)
    assert with_products(path) is None


@pytest.mark.shared
def test_a_real_model_gives_the_same_with_products(shared: Path) -> None:
    path = shared / "models" / "simcc_adapter_tinypose_256x192.onnx"
    image = np.random.default_rng(0).normal(0, 1, (1, 3, 256, 192)).astype(np.float32)
    usual = onnxruntime.InferenceSession(str(path)).run(None, {"input": image})
    found = open_session(path).run({"input": image}, ["simcc_x", "simcc_y"])
    assert "Resize" in operators(path.read_bytes())
    assert operators(with_products(path)).count("MatMul") == 4
    for one, other in zip(usual, found, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)
