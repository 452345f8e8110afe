"""The output forms of person detectors, the more particular before the more general."""

from __future__ import annotations

from dance2pose.onnx_models.box_forms import BOX_FORMS
from dance2pose.onnx_models.row_forms import ROW_FORMS
from dance2pose.onnx_models.yolo_forms import YOLO_FORMS

DETECTOR_FORMS = (*BOX_FORMS, *ROW_FORMS, *YOLO_FORMS)
