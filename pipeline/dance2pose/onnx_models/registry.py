"""Well-known models by name: what can be pulled (models/registry.toml) and what is in the cache."""

from __future__ import annotations

import functools
import json
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dance2pose.assets import asset
from dance2pose.errors import ModelError, UsageError
from dance2pose.file_hash import file_sha256
from dance2pose.onnx_models.manifest import checked_settings
from dance2pose.output_files import written_whole

_NAME = re.compile(r"[a-z0-9][a-z0-9-]*")
_RECORD = "hashes.json"


@dataclass(frozen=True)
class RegisteredModel:
    """A model at its publisher's address.

    parameters_millions: as published. archive_member: name of the file inside a zip, None where
    the address is the model itself.
    measured: average precision as published. sha256: of the download, where it is known.
    manifest: the settings that its manifest will state.
    """

    name: str
    description: str
    url: str
    license: str
    parameters_millions: float
    manifest: Mapping[str, Any]
    archive_member: str | None = None
    measured: float | None = None
    sha256: str | None = None

    @property
    def about_mb(self) -> int:
        """Size of the model's file in megabytes, of four bytes for each parameter."""
        return max(1, round(4 * self.parameters_millions))

    @property
    def input_size(self) -> str:
        return f"{self.manifest['input_width']}x{self.manifest['input_height']}"


@functools.cache
def registry(path: Path | None = None) -> Mapping[str, RegisteredModel]:
    """The models that can be pulled, by name; of the bundled registry unless `path` is given."""
    source = path or asset("registry.toml")
    try:
        entries = tomllib.loads(source.read_text(encoding="utf-8"))["model"]
        models = [RegisteredModel(**entry) for entry in entries]
    except (OSError, tomllib.TOMLDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise ModelError(f"{source}: is not a registry of models: {error}") from error
    for model in models:
        if not _NAME.fullmatch(model.name):
            raise ModelError(f"{source}: {model.name!r}: a name is of a-z, 0-9 and hyphens")
        checked_settings(dict(model.manifest), where=f"{source}: {model.name}")
    return {model.name: model for model in models}


def cache_folder() -> Path:
    """Where pulled models lie; made when the first one is pulled."""
    from platformdirs import user_cache_path

    return user_cache_path("dance2pose") / "models"


def cached_path(name: str) -> Path:
    """Where the ONNX file of a pulled model lies, or will."""
    return cache_folder() / f"{name}.onnx"


def known_hashes() -> dict[str, dict[str, str]]:
    """What was recorded at the first download of each model: sha256 of download and of model."""
    path = cache_folder() / _RECORD
    try:
        recorded = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ModelError(f"{path}: the record of hashes cannot be read: {error}") from error
    if not isinstance(recorded, dict):
        raise ModelError(f"{path}: is not the record of hashes of pulled models")
    return recorded


def record_hashes(name: str, *, download: str, model: str) -> None:
    """Remember the hashes of a first download."""
    recorded = known_hashes() | {name: {"download": download, "model": model}}
    with written_whole(cache_folder() / _RECORD, overwrite=True) as temporary:
        temporary.write_text(json.dumps(recorded, indent=1, sort_keys=True), encoding="utf-8")


def located(path: Path) -> Path:
    """`path` itself, or the pulled model where `path` is the name of one.

    Raises UsageError for the name of a model that is not pulled yet, ModelError for a pulled one
    whose file is no longer what was downloaded.
    """
    name = str(path)
    if not _NAME.fullmatch(name) or name not in registry() or path.exists():
        return path
    cached = cached_path(name)
    if not cached.is_file():
        raise UsageError(
            f"{name}: no such file, and the model of that name is not here yet; "
            f"fetch it with: dance2pose models pull {name}"
        )
    expected = known_hashes().get(name, {}).get("model")
    found = file_sha256(cached)
    if expected not in (None, found):
        raise ModelError(
            f"{cached}: has changed since it was downloaded: sha256 {found}, expected {expected}; "
            f"fetch it again with: dance2pose models pull {name}"
        )
    return cached
