"""TOML files that options can come from, and where a user's standing one lies."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from dance2pose.errors import UsageError

# A settings file is a page of text; anything larger is some other file.
_LARGEST_SETTINGS_FILE = 1_000_000


def user_config_path() -> Path:
    """Where a user's standing settings are looked for."""
    from platformdirs import user_config_path

    return user_config_path("dance2pose") / "config.toml"


def read_settings_file(path: Path) -> dict[str, Any]:
    """A TOML file of settings: same names as the options. Raises UsageError naming the file."""
    try:
        if path.stat().st_size > _LARGEST_SETTINGS_FILE:
            raise UsageError(f"{path}: too large for a settings file")
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: settings file cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: not a TOML file: {error}") from error
