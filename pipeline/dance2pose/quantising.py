"""A model in 8-bit numbers: smaller, on some processors faster, and a little less exact.

ONNX Runtime's static quantisation (Jacob et al. 2018, "Quantization and training of neural
networks for efficient integer-arithmetic-only inference", CVPR): weights in int8 for each channel
of a convolution, activations in uint8 whose ranges are measured on pictures of the user's own
video. What that costs and gains is measured on other pictures of the same video, because it
depends on the model, the processor and the pictures: `Loss` says it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dance2pose.detection import Detector, WholePictureModel, load_detector
from dance2pose.errors import ModelError, UsageError
from dance2pose.keypoints import OnnxKeypoints, load_pose_model
from dance2pose.onnx_models.inference import Array
from dance2pose.onnx_models.manifest import manifest_path, write_manifest
from dance2pose.onnx_models.recognition import inspect_model
from dance2pose.output_files import check_output, written_whole
from dance2pose.poses import Boxes, Image
from dance2pose.tracking.matching import box_overlaps
from dance2pose.video import open_video

# Pictures that the ranges are measured on, and as many others that the loss is measured on.
PICTURES = 32
# Keypoints and people less sure than this are not compared; boxes overlap at least this much.
CONFIDENT = 0.3
SAME_BOX = 0.5


@dataclass(frozen=True)
class Loss:
    """What became of a model. moved_px: mean distance of keypoints, or of the corners of boxes,
    in pixels of the video; lost: of the `found` people (or keypoints) that are no longer there;
    ms_before, ms_after: of one run in one thread."""

    moved_px: float
    found: int
    lost: int
    ms_before: float
    ms_after: float

    def __str__(self) -> str:
        faster = self.ms_before / self.ms_after
        verdict = (
            f"{faster:.2f} x as fast" if faster >= 1 else f"SLOWER, {1 / faster:.2f} x as long"
        )
        return (
            f"moved by {self.moved_px:.2f} px on average, {self.lost} of {self.found} lost; "
            f"{self.ms_before:.1f} ms before, {self.ms_after:.1f} ms after: {verdict} here"
        )


def quantise(
    model: Path, video: Path, output: Path, *, detector: Path | None = None, overwrite: bool = False
) -> Loss:
    """Write `model` in 8-bit numbers to `output`, and measure what that does on `video`.

    Beside the model its manifest is written. detector: finds the people for a keypoint model.
    Raises UsageError where the package `onnx` or the detector is missing, ModelError for a model
    that cannot be quantised.
    """
    for path in (output, manifest_path(output)):
        check_output(path, overwrite=overwrite)
    _require_onnx()
    description = inspect_model(model)
    boxes_of: Detector | None = None
    if description.kind == "pose":
        if detector is None:
            raise UsageError(f"{model}: works on people; name a detector as well (--detector)")
        boxes_of = load_detector(detector, threads=1)
    pictures = list(_pictures(video, boxes_of))
    if len(pictures) < 4:
        raise UsageError(f"{video}: shows people in {len(pictures)} pictures only, 4 are needed")
    calibration, test = pictures[::2], pictures[1::2]
    feeds = _feeds(model, calibration)
    with written_whole(output, overwrite=overwrite) as temporary:
        _quantise(description.path, temporary, feeds)
        # Read as the original is: its names and numbers may no longer tell.
        write_manifest(manifest_path(output), description.manifest, overwrite=overwrite)
        try:
            return _loss(model, temporary, manifest_path(output), test)
        except BaseException:
            manifest_path(output).unlink()
            raise


def _require_onnx() -> None:
    try:
        import onnx  # noqa: F401
    except ImportError as error:
        raise UsageError(
            "quantising needs the package onnx; pip install 'dance2pose[quantise]'"
        ) from error


def _pictures(video: Path, detector: Detector | None) -> Iterator[tuple[Image, Boxes]]:
    """Pictures spread over the video, with the people in them."""
    with open_video(video) as reader:
        expected = reader.expected_frames or 2 * PICTURES
    with open_video(video, every=max(1, expected // (2 * PICTURES))) as reader:
        for count, frame in enumerate(reader):
            if count == 2 * PICTURES:
                return
            boxes = (
                detector.detect(frame.image) if detector else Boxes(np.empty((0, 4)), np.empty(0))
            )
            if detector is None or len(boxes):
                yield frame.image, boxes


def _load(path: Path, manifest: Path | None = None) -> WholePictureModel | OnnxKeypoints:
    kind = inspect_model(path, manifest).kind
    load: Any = load_detector if kind == "detector" else load_pose_model
    model = load(path, manifest=manifest, threads=1)
    assert isinstance(model, WholePictureModel | OnnxKeypoints)
    return model


def _feeds(path: Path, pictures: Sequence[tuple[Image, Boxes]]) -> list[dict[str, Array]]:
    """What the model is given for these pictures."""
    model = _load(path)
    seen: list[dict[str, Array]] = []
    run = model.session.run

    def noting(feeds: Any, outputs: Any, **how: Any) -> list[Array]:
        seen.append({name: np.array(value) for name, value in feeds.items()})
        return run(feeds, outputs, **how)

    vars(model.session)["run"] = noting
    for image, boxes in pictures:
        _answer(model, image, boxes)
    return seen


def _quantise(model: Path, output: Path, feeds: Sequence[dict[str, Array]]) -> None:
    import onnx
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType
    from onnxruntime.quantization import quantize_static as quantize
    from onnxruntime.quantization.shape_inference import quant_pre_process

    class Feeds(CalibrationDataReader):  # type: ignore[misc]
        def __init__(self) -> None:
            self._left = iter(feeds)

        def get_next(self) -> dict[str, Array] | None:
            return next(self._left, None)

    try:
        with tempfile.TemporaryDirectory() as name:
            prepared, newer = Path(name) / "prepared.onnx", Path(name) / "newer.onnx"
            graph = onnx.load(str(model))
            # Weights in int8 for each channel need operator set 13.
            opset = next((s.version for s in graph.opset_import if s.domain in ("", "ai.onnx")), 0)
            if opset < 13:
                graph = onnx.version_converter.convert_version(graph, 13)
            onnx.save(graph, str(newer))
            quant_pre_process(str(newer), str(prepared), skip_symbolic_shape=True)
            quantize(
                str(prepared),
                str(output),
                Feeds(),
                quant_format=QuantFormat.QDQ,
                activation_type=QuantType.QUInt8,
                weight_type=QuantType.QInt8,
                per_channel=True,
                op_types_to_quantize=["Conv", "MatMul", "Gemm"],
            )
    except Exception as error:  # onnx and its tools raise whatever they meet
        text = " ".join(str(error).split())[:300]
        raise ModelError(f"{model}: cannot be quantised: {text}") from error


def _loss(
    before: Path, after: Path, manifest: Path | None, pictures: Sequence[tuple[Image, Boxes]]
) -> Loss:
    """Both models on the same pictures, in turns."""
    one, other = _load(before), _load(after, manifest)
    distances: list[float] = []
    found = lost = 0
    seconds: tuple[list[float], list[float]] = ([], [])
    for image, boxes in pictures:
        answers = []
        for model, times in zip((one, other), seconds, strict=True):
            start = time.perf_counter()
            answers.append(_answer(model, image, boxes))
            times.append(time.perf_counter() - start)
        apart, there = _compare(*answers)
        found += len(there)
        lost += int((~there).sum())
        distances += apart.tolist()
    if not distances:
        raise ModelError(
            f"{before}: as 8-bit numbers it finds nothing any more; nothing was written"
        )
    ms_before, ms_after = (1e3 * float(np.median(times)) for times in seconds)
    return Loss(float(np.mean(distances)), found, lost, ms_before, ms_after)


def _answer(model: Any, image: Image, boxes: Boxes) -> tuple[Array, Array]:
    """Points (N, K, 2) of boxes or poses in the picture, and how sure they are (N, K)."""
    if isinstance(model, OnnxKeypoints):
        poses = model.estimate(image, boxes)
        return poses.xy, poses.confidence
    if hasattr(model, "find"):
        _, poses = model.find(image)
        return poses.xy, poses.confidence
    seen = model.detect(image)
    return seen.xyxy.reshape(-1, 2, 2), np.repeat(seen.confidence[:, None], 2, axis=1)


def _compare(before: tuple[Array, Array], after: tuple[Array, Array]) -> tuple[Array, Array]:
    """Distances of what is sure before and still there, and (F,) whether it is there."""
    points, sure = before[0], before[1] > CONFIDENT
    if len(points) != len(after[0]) or points.shape[1] == 2:
        rows = _same(points, after[0])
    else:
        rows = np.arange(len(points))
    there, apart = [], []
    for i, row in enumerate(rows):
        for k in np.flatnonzero(sure[i]):
            far = np.linalg.norm(points[i, k] - after[0][row, k]) if row >= 0 else np.nan
            there.append(bool(np.isfinite(far)))
            apart.append(far)
    distances = np.array(apart)
    return distances[np.isfinite(distances)], np.array(there, np.bool_)


def _same(one: Array, other: Array) -> Array:
    """For each of `one` the row of `other` about the same place, -1 where there is none."""
    if not len(one) or not len(other):
        return np.full(len(one), -1)
    boxes = [
        np.concatenate([np.nanmin(points, axis=1), np.nanmax(points, axis=1)], axis=1)
        for points in (one, other)
    ]
    overlap = box_overlaps(*boxes)
    best = overlap.argmax(axis=1)
    return np.where(overlap[np.arange(len(one)), best] >= SAME_BOX, best, -1)
