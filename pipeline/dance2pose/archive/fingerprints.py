"""What makes two runs over a video the same: its content, the models' content, every setting."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from dance2pose.archive.recipe import Recipe
from dance2pose.errors import UsageError
from dance2pose.file_hash import sha256_now
from dance2pose.onnx_models.manifest import manifest_path, read_manifest
from dance2pose.onnx_models.registry import located

# Raised when packages hold something else than before, so that earlier ones count as changed.
PACKAGE_FORM = 1


def model_files(recipe: Recipe) -> tuple[Path, ...]:
    """Every file of the models that a recipe names: the models, manifests, outside weights."""
    found: dict[Path, None] = {}
    for model in recipe.models().values():
        for path in _with_companions(model):
            found[path] = None
    return tuple(found)


def _with_companions(model: Path) -> tuple[Path, ...]:
    """A named model file and what belongs to it: manifest and model of one name, weights."""
    model = located(model)
    if not model.is_file():
        raise UsageError(f"{model}: no such file")
    beside = [
        manifest_path(model),
        model.with_suffix(".onnx"),
        model.with_name(f"{model.name}.data"),
    ]
    if model.suffix.lower() == ".toml" and (name := read_manifest(model).get("model")):
        beside.append(model.parent / name)
    return (model, *(path for path in beside if path != model and path.is_file()))


class Fingerprints:
    """Fingerprints of items under recipes; every model file is read once."""

    def __init__(self) -> None:
        self._hashes: dict[Path, str] = {}

    def of(self, source_sha256: str, recipe: Recipe) -> str:
        """Hex SHA-256 over everything that decides what comes out for a video.

        The version of dance2pose is not part of it: an archive is not made again because the
        program was updated (each package says in its provenance what made it).
        """
        chosen = {
            name: [self.file(path) for path in _with_companions(value)]
            if isinstance(value, Path)
            else value
            for name, value in recipe.values().items()
        }
        text = json.dumps([PACKAGE_FORM, source_sha256, chosen], sort_keys=True, default=str)
        return hashlib.sha256(text.encode()).hexdigest()

    def file(self, path: Path) -> str:
        if path not in self._hashes:
            self._hashes[path] = sha256_now(path)
        return self._hashes[path]
