"""The errors that dance2pose raises on purpose.

A message names the file, what was found, what was expected and what to do. The command line
prints it as one line and never shows a traceback for any of these.
"""


class Dance2PoseError(Exception):
    """Base of every error that bad input, a bad setting or the machine can cause."""


class UsageError(Dance2PoseError):
    """The request itself is wrong: an unknown name, a window of zero (exit status 2)."""


class VideoError(Dance2PoseError):
    """A video cannot be opened, or holds nothing to decode."""


class ModelError(Dance2PoseError):
    """An ONNX model or its manifest cannot be loaded, recognised or run."""


class DataError(Dance2PoseError):
    """A file of poses, motion capture, calibration or results is not what it should be."""


class OutputError(Dance2PoseError):
    """A result cannot be written: folder missing or read-only, disk full, file exists."""


class OutputExistsError(OutputError):
    """A file is there already and may not be replaced (exit status 2)."""
