"""How the families of models were trained: colour order, normalisation, resize.

No graph shows these; a form presets what models of its family are published with, and a manifest
says otherwise where one was trained otherwise.
"""

from __future__ import annotations

from typing import Any

IMAGENET = {"mean": (123.675, 116.28, 103.53), "std": (58.395, 57.12, 57.375)}
UNIT_RANGE = {"std": (255.0, 255.0, 255.0)}

YOLOX_INPUT: dict[str, Any] = {
    "colour_order": "BGR",
    "resize": "letterbox",
    "padding_position": "top-left",
}
RTMDET_INPUT = {
    **YOLOX_INPUT,
    "mean": (103.53, 116.28, 123.675),
    "std": (57.375, 57.12, 58.395),
}
ULTRALYTICS_INPUT: dict[str, Any] = {
    "colour_order": "RGB",
    **UNIT_RANGE,
    "resize": "letterbox",
    "padding_position": "centre",
}
PADDLE_INPUT = {"colour_order": "RGB", **IMAGENET, "resize": "stretch"}
STRETCHED_INPUT = {"colour_order": "RGB", **UNIT_RANGE, "resize": "stretch"}
BYTES_INPUT = {"colour_order": "RGB", "resize": "stretch"}
