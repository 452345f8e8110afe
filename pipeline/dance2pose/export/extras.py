"""Packages that only some exports need."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from dance2pose.errors import UsageError


def need(module: str, extra: str) -> Any:
    """The module, or UsageError that names the extra which brings it."""
    try:
        return import_module(module)
    except ImportError:
        raise UsageError(
            f"this form needs the package {module}; install it with: "
            f"pip install 'dance2pose[{extra}]'"
        ) from None
