"""ONNX models that the user supplies: what they are, how they are run, and where to get them."""
