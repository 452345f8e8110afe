"""Cubic resizing within a graph, done as the matrix products that it is.

ONNX Runtime works out a cubic `Resize` value by value: enlarging 17 heatmaps' maxima to SimCC's
bins takes a quarter of a small model's time. Along each axis it is a product with a matrix of
constants, which takes next to none and gives the same to float32's rounding. The matrices are what
ONNX Runtime itself makes of unit vectors, and each is tried on random values before it is used.

Needs the package onnx (`pip install 'dance2pose[fast]'`); without it, or where anything is unclear,
a model runs as it is.
"""

from __future__ import annotations

import functools
import mmap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Float32Array = npt.NDArray[np.float32]

# What a changed graph is said to run with.
CHANGE = "cubic resizing as matrix products"

# A larger file is not read a second time, a larger matrix not made.
MOST_BYTES = 256 * 1024**2
MOST_VALUES = 2**20
_MOST_AXES = 8
# Each is run by itself when a model is loaded; a graph of more is left as it is.
MOST_NODES = 32
# Rounding of float32, for values about 1.
_SAME = 1e-5


def with_products(path: Path) -> bytes | None:
    """The model with its cubic resizing as products, None where it has none that can be."""
    if not _mentions_cubic(path):
        return None
    try:
        import onnx
    except ImportError:
        return None
    try:
        model = onnx.load(str(path), load_external_data=False)
        if not _is_plain(model):
            return None
        return bytes(model.SerializeToString()) if _replace(model) else None
    except Exception:  # onnx raises whatever it meets; what is wrong, loading the model will tell
        return None


def _mentions_cubic(path: Path) -> bool:
    if not 0 < path.stat().st_size <= MOST_BYTES:
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return content.find(b"cubic") >= 0


def _is_plain(model: Any) -> bool:
    """Whether it has no graphs within its graph, and no numbers in files beside its own: these
    are looked for from where the file is, which bytes are not."""
    graph = model.graph
    attributes = [attribute for node in graph.node for attribute in node.attribute]
    if model.functions or graph.sparse_initializer:
        return False
    if any(attribute.HasField("g") or attribute.graphs for attribute in attributes):
        return False
    tensors = [*graph.initializer, *(attribute.t for attribute in attributes)]
    tensors += [tensor for attribute in attributes for tensor in attribute.tensors]
    return not any(tensor.external_data for tensor in tensors)


def _replace(model: Any) -> bool:
    """Put products in the place of cubic resizing; whether there was any."""
    from onnx import helper, numpy_helper, shape_inference

    graph = model.graph
    cubic = [(at, node) for at, node in enumerate(graph.node) if _is_cubic(node)]
    if len(cubic) > MOST_NODES:
        return False
    del graph.value_info[:]  # what the file says of shapes may be of an earlier form of its graph
    inferred = shape_inference.infer_shapes(model).graph
    described = [*inferred.input, *inferred.value_info]
    shapes = {value.name: _shape(value) for value in described}
    constants = {
        tensor.name: numpy_helper.to_array(tensor)
        for tensor in graph.initializer
        if len(tensor.dims) == 1 and tensor.dims[0] <= _MOST_AXES
    }
    changed = False
    for at, node in reversed(cubic):
        resize = _Resize.of(model, node, shapes.get(node.input[0], ()), constants)
        if resize is None or not resize.agrees():
            continue
        name = f"{node.output[0]}/resized"
        for matrix, side in ((resize.left, "left"), (resize.right, "right")):
            graph.initializer.append(numpy_helper.from_array(matrix, f"{name}/{side}"))
        graph.node.remove(node)
        graph.node.insert(at, helper.make_node("MatMul", [f"{name}/left", name], node.output))
        inner = helper.make_node("MatMul", [node.input[0], f"{name}/right"], [name])
        graph.node.insert(at, inner)
        changed = True
    return changed


def _is_cubic(node: Any) -> bool:
    modes = [attribute.s for attribute in node.attribute if attribute.name == "mode"]
    return node.op_type == "Resize" and modes == [b"cubic"]


def _shape(value: Any) -> tuple[int, ...]:
    """The shape of a float32 value, 0 where a length is open; () of any other value."""
    kind = value.type.tensor_type
    return tuple(dim.dim_value for dim in kind.shape.dim) if kind.elem_type == 1 else ()


@dataclass(frozen=True)
class _Resize:
    """A Resize of the last two of four axes. by: what takes the place of its `input` number 2
    (scales) or 3 (sizes), for one picture of one channel. shape: (height, width) that comes in."""

    model: Any
    node: Any
    input: int
    by: npt.NDArray[Any]
    shape: tuple[int, int]

    @classmethod
    def of(
        cls, model: Any, node: Any, shape: tuple[int, ...], constants: Mapping[str, Any]
    ) -> _Resize | None:
        """The Resize of a node, None if it is another kind or its result would be too large."""
        given = {a.name: (a.s or a.ints or a.f or a.i) for a in node.attribute}
        is_known = len(shape) == 4 and all(shape[2:])
        region = constants.get(node.input[1])
        has_region = bool(node.input[1]) and (region is None or region.size > 0)
        of_region = given.get("coordinate_transformation_mode") == b"tf_crop_and_resize"
        if not is_known or "axes" in given or has_region or of_region:
            return None
        which = 3 if len(node.input) > 3 else 2
        by = constants.get(node.input[which])
        if by is None or by.size != 4:
            return None
        kept = by[:2] == (1 if which == 2 else shape[:2])
        enlarged = by[2:] * (shape[2:] if which == 2 else 1)
        sides = np.array([*shape[2:], *enlarged], np.float64)
        fits = np.isfinite(sides).all() and sides.min() >= 1 and sides.max() ** 2 <= MOST_VALUES
        if not (np.all(kept) and fits):
            return None
        return cls(model, node, which, np.array([1, 1, *by[2:]], by.dtype), (shape[2], shape[3]))

    @functools.cached_property
    def left(self) -> Float32Array:
        """(new height, height)."""
        return np.ascontiguousarray(self._of_unit_vectors(2).T)

    @functools.cached_property
    def right(self) -> Float32Array:
        """(width, new width)."""
        return self._of_unit_vectors(3)

    def agrees(self) -> bool:
        """Whether the products give what the node gives."""
        values = np.random.default_rng(0).uniform(-1, 1, (1, 1, *self.shape)).astype(np.float32)
        usual = self._run(values, self.by)
        product = self.left @ (values @ self.right)
        return product.shape == usual.shape and bool(np.abs(product - usual).max() <= _SAME)

    def _of_unit_vectors(self, axis: int) -> Float32Array:
        """What becomes of unit vectors (n, n) along an axis: laid along the last one, n pictures
        of one row each."""
        length = self.shape[axis - 2]
        keep = np.ones(4, self.by.dtype)
        keep[3] = self.by[axis]
        if self.input == 3:
            keep[0] = length
        return self._run(np.eye(length, dtype=np.float32).reshape(length, 1, 1, length), keep)[
            :, 0, 0
        ]

    def _run(self, values: Float32Array, by: npt.NDArray[Any]) -> Float32Array:
        """The node alone, by ONNX Runtime."""
        import onnxruntime
        from onnx import helper, numpy_helper

        node = type(self.node)()
        node.CopyFrom(self.node)
        node.input[:] = ["x", *[""] * (self.input - 1), "by"]
        node.output[:] = ["y"]
        graph = helper.make_graph(
            [node],
            "resize",
            [helper.make_tensor_value_info("x", 1, values.shape)],
            [helper.make_tensor_value_info("y", 1, None)],
            [numpy_helper.from_array(by, "by")],
        )
        alone = helper.make_model(
            graph, opset_imports=self.model.opset_import, ir_version=self.model.ir_version
        )
        session = onnxruntime.InferenceSession(
            alone.SerializeToString(), providers=["CPUExecutionProvider"]
        )
        result: Float32Array = session.run(None, {"x": values})[0]
        return result
