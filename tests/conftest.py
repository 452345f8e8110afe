"""Fixtures for all tests."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

# What only training and benchmarks need is in scripts/, outside the package; it is tested too.
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "scripts"))


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of real motion capture, models and video beside the checkout."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not folder.is_dir():
        if os.environ.get("CI") == "true":
            pytest.fail(f"{folder} is missing, and under CI the tests that need it must run")
        pytest.skip(f"needs {folder}")
    return folder
