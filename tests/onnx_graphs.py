"""Small ONNX graphs for tests: some emit known values in a published output form, some really look
at the picture, and some are broken on purpose."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
from onnx import helper, numpy_helper

Array = npt.NDArray[Any]
Shape = Sequence[int | str]

_OPSET, _IR_VERSION = 17, 9


def save(
    path: Path,
    nodes: list[onnx.NodeProto],
    inputs: list[onnx.ValueInfoProto],
    outputs: list[onnx.ValueInfoProto],
    constants: Mapping[str, Array] | None = None,
    metadata: Mapping[str, str] | None = None,
) -> Path:
    graph = helper.make_graph(
        nodes,
        "test",
        inputs,
        outputs,
        [numpy_helper.from_array(value, name) for name, value in (constants or {}).items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", _OPSET)])
    model.ir_version = _IR_VERSION
    helper.set_model_props(model, dict(metadata or {}))
    onnx.save(model, str(path))
    return path


def tensor(name: str, dtype: Any, shape: Shape) -> onnx.ValueInfoProto:
    return helper.make_tensor_value_info(
        name, helper.np_dtype_to_tensor_dtype(np.dtype(dtype)), list(shape)
    )


def emitting(
    path: Path,
    outputs: Mapping[str, Array],
    *,
    input_shape: Shape,
    input_name: str = "input",
    input_dtype: Any = np.float32,
    declared: Mapping[str, Shape] | None = None,
    extra_inputs: Mapping[str, tuple[Any, Shape]] | None = None,
    metadata: Mapping[str, str] | None = None,
) -> Path:
    """A graph that takes a picture and gives constants, whatever the picture.

    declared: shapes to declare for outputs instead of their own, to leave lengths open.
    """
    constants = {f"{name}_value": value for name, value in outputs.items()}
    nodes = [helper.make_node("Identity", [f"{name}_value"], [name]) for name in outputs]
    inputs = [tensor(input_name, input_dtype, input_shape)]
    inputs += [tensor(name, *about) for name, about in (extra_inputs or {}).items()]
    shapes = {name: value.shape for name, value in outputs.items()} | dict(declared or {})
    infos = [tensor(name, value.dtype, shapes[name]) for name, value in outputs.items()]
    return save(path, nodes, inputs, infos, constants, metadata)


def emitting_per_crop(
    path: Path,
    outputs: Mapping[str, Array],
    *,
    input_shape: Shape,
    input_dtype: Any = np.float32,
    input_name: str = "input",
) -> Path:
    """A graph of any batch: every output (1, ...) repeated once for each picture it is given."""
    nodes = [
        helper.make_node("Shape", [input_name], ["batch"], start=0, end=1),
    ]
    constants: dict[str, Array] = {}
    for name, value in outputs.items():
        constants[f"{name}_value"] = value
        constants[f"{name}_tail"] = np.array(value.shape[1:], np.int64)
        nodes += [
            helper.make_node("Concat", ["batch", f"{name}_tail"], [f"{name}_shape"], axis=0),
            helper.make_node("Expand", [f"{name}_value", f"{name}_shape"], [name]),
        ]
    infos = [tensor(name, v.dtype, ["batch", *v.shape[1:]]) for name, v in outputs.items()]
    return save(path, nodes, [tensor(input_name, input_dtype, input_shape)], infos, constants)


def heatmaps_of_colours(
    path: Path,
    *,
    width: int,
    height: int,
    batch: int | str = "batch",
    fails_above_one: bool = False,
) -> Path:
    """A pose model that really looks: keypoint k of 17 is the brightest place of channel k % 3.

    The heatmap is the picture itself, every 4x4 pixels averaged; NCHW, float32. fails_above_one:
    the batch is written into the graph as 1, as careless exports have it.
    """
    nodes = [
        helper.make_node("Reshape", ["input", "shape"], ["pictures"]),
        helper.make_node(
            "AveragePool", ["pictures"], ["small"], kernel_shape=[4, 4], strides=[4, 4]
        ),
        helper.make_node("Gather", ["small", "channels"], ["heatmaps"], axis=1),
    ]
    channels = np.arange(17, dtype=np.int64) % 3
    return save(
        path,
        nodes,
        [tensor("input", np.float32, [batch, 3, height, width])],
        [tensor("heatmaps", np.float32, [batch, 17, height // 4, width // 4])],
        {
            "channels": channels,
            "shape": np.array([1 if fails_above_one else -1, 3, height, width], np.int64),
        },
    )


def dividing(path: Path) -> Path:
    """A model of the SimCC form that gives NaN for a black crop: 0 / 0."""
    nodes = [
        helper.make_node("ReduceMean", ["input"], ["mean"], axes=[1, 2, 3], keepdims=0),
        helper.make_node("Div", ["mean", "mean"], ["one"]),
        helper.make_node("Reshape", ["one", "to3"], ["column"]),
        helper.make_node("Mul", ["column", "x"], ["simcc_x"]),
        helper.make_node("Mul", ["column", "y"], ["simcc_y"]),
    ]
    constants = {
        "to3": np.array([-1, 1, 1], np.int64),
        "x": np.ones((1, 17, 96), np.float32),
        "y": np.ones((1, 17, 128), np.float32),
    }
    outputs = [
        tensor("simcc_x", np.float32, ["batch", 17, 96]),
        tensor("simcc_y", np.float32, ["batch", 17, 128]),
    ]
    return save(
        path, nodes, [tensor("input", np.float32, ["batch", 3, 64, 48])], outputs, constants
    )


def unknown_operator(path: Path, *, domain: str = "") -> Path:
    nodes = [helper.make_node("Dance", ["input"], ["output"], domain=domain)]
    graph = helper.make_graph(
        nodes,
        "test",
        [tensor("input", np.float32, [1, 3, 8, 8])],
        [tensor("output", np.float32, [1, 3, 8, 8])],
    )
    opsets = [helper.make_opsetid("", _OPSET)]
    if domain:
        opsets.append(helper.make_opsetid(domain, 1))
    model = helper.make_model(graph, opset_imports=opsets)
    model.ir_version = _IR_VERSION
    onnx.save(model, str(path))
    return path


def with_external_data(path: Path) -> Path:
    """A model whose weights lie in `<name>.data` beside it."""
    weights = np.arange(17 * 1 * 32 * 24, dtype=np.float32).reshape(1, 17, 32, 24)
    emitting(path, {"heatmap": weights}, input_shape=[1, 3, 128, 96])
    model = onnx.load(str(path))
    onnx.save_model(
        model,
        str(path),
        save_as_external_data=True,
        location=f"{path.name}.data",
        size_threshold=0,
    )
    return path


def allocating(path: Path, gibibytes: int) -> Path:
    """A detector that asks for that much memory while it runs; its declared shapes are modest."""
    nodes = [
        helper.make_node("ConstantOfShape", ["huge"], ["zeros"]),
        helper.make_node("ReduceSum", ["zeros"], ["zero"], keepdims=0),
        helper.make_node("Add", ["rows_value", "zero"], ["rows"]),
    ]
    constants = {
        "huge": np.array([gibibytes, 1024, 1024, 256], np.int64),
        "rows_value": np.zeros((1, 5, 126), np.float32),  # 126 cells over 96x64, one class
    }
    return save(
        path,
        nodes,
        [tensor("images", np.float32, [1, 3, 64, 96])],
        [tensor("rows", np.float32, [1, 5, 126])],
        constants,
    )
