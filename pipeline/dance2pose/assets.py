"""Where the files that come with dance2pose are: learned arrays, the demo's clip and models."""

from __future__ import annotations

from pathlib import Path

from dance2pose.errors import DataError


def models_folder() -> Path:
    """The folder `models/` of a checkout, or its copy inside an installed wheel."""
    package = Path(__file__).resolve().parent
    for folder in (package / "models", package.parent.parent / "models"):
        if folder.is_dir():
            return folder
    raise DataError(f"{package / 'models'}: missing; the installation is damaged, install it again")


def asset(name: str) -> Path:
    """The path of a file in `models/`; DataError where it is missing."""
    path = models_folder() / name
    if not path.is_file():
        raise DataError(f"{path}: missing; the installation is damaged, install it again")
    return path
