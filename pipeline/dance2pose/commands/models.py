"""`dance2pose models`: what models there are, what one is, and fetching well-known ones."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, Parameter

from dance2pose.command_line import PARAMETERS, HelpFormatter

if TYPE_CHECKING:
    from dance2pose.onnx_models.recognition import ModelDescription

models = App(
    name="models",
    help="List, inspect and download ONNX models.",
    help_format="plaintext",
    help_formatter=HelpFormatter(),
    default_parameter=PARAMETERS,
)


@models.command(name="list")
def list_models(*, config: Path | None = None) -> None:
    """Show the models that are configured, those in the cache, and those that can be pulled.

    Parameters
    ----------
    config
        The settings file to look into; your own standing one if not given.
    """
    from dance2pose.onnx_models.registry import cache_folder, cached_path, registry
    from dance2pose.settings_file import read_settings_file, user_config_path

    source = config or user_config_path()
    settings = read_settings_file(source) if config or source.is_file() else {}
    print(f"Configured in {source}:")
    for key in ("detector", "pose"):
        print(f"  {key}: {settings.get(key, 'none')}")
    known = registry().values()
    cached = [model for model in known if cached_path(model.name).is_file()]
    print(f"In the cache {cache_folder()}:")
    for model in cached:
        size = cached_path(model.name).stat().st_size
        print(f"  {model.name:18} {size / 1e6:6.1f} MB  {model.description}")
    if not cached:
        print("  none")
    print("Can be fetched with `dance2pose models pull NAME` (input, about how large):")
    for model in known:
        if model not in cached:
            measured = f", AP {model.measured:g}" if model.measured else ""
            print(
                f"  {model.name:18} {model.input_size:>8} {model.about_mb:>4} MB  "
                f"{model.description}{measured}; {model.license}"
            )
    print("Their names work wherever a model is named: --detector yolox-tiny --pose rtmpose-m")


@models.command
def inspect(
    model: Path,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    write: bool = False,
    overwrite: bool = False,
) -> None:
    """Show what an ONNX model is recognised as and why, and write its manifest to start from.

    Parameters
    ----------
    model
        The ONNX file, its manifest, or the name of a pulled model.
    output
        Write the manifest here.
    write
        Write the manifest beside the model, where it is found by itself.
    overwrite
        Replace a manifest that exists.
    """
    import dataclasses

    from dance2pose.onnx_models.manifest import manifest_path, write_manifest
    from dance2pose.onnx_models.recognition import inspect_model

    description = inspect_model(model)
    print("\n".join(description_lines(description)))
    target = output or (manifest_path(description.path) if write else None)
    if target is not None:
        manifest = description.manifest
        if target.with_suffix(description.path.suffix) != description.path:
            # Found by its full path where the manifest does not lie beside the model.
            manifest = dataclasses.replace(manifest, model=str(description.path.resolve()))
        write_manifest(target, manifest, overwrite=overwrite)
        print(f"wrote {target}")


def description_lines(description: ModelDescription) -> list[str]:
    """What was recognised, why, and with which settings."""
    from dance2pose.onnx_models.manifest import settings_of, toml_lines

    return [
        f"{description.path}: {description.kind} model, output form {description.form}",
        f"{description.size_bytes} bytes, sha256 {description.sha256}",
        *(f"input {tensor}" for tensor in description.inputs),
        *(f"output {tensor}" for tensor in description.outputs),
        "Recognised because:",
        *(f"  {reason}" for reason in description.reasons),
        *(["Assumed, check it:"] if description.assumed else []),
        *(f"  {line}" for line in description.assumed),
        f"Manifest{f' (with {description.manifest_file})' if description.manifest_file else ''}:",
        *(f"  {line}" for line in toml_lines(settings_of(description.manifest))),
    ]


@models.command
def pull(name: str, *, quiet: bool = False) -> None:
    """Download a well-known model from its publisher, check it, and keep it for later runs.

    Parameters
    ----------
    name
        A name that `dance2pose models list` shows.
    quiet
        Show no progress.
    """
    from dance2pose.errors import UsageError
    from dance2pose.onnx_models.downloading import pull as pull_model
    from dance2pose.onnx_models.registry import registry
    from dance2pose.options import nearest
    from dance2pose.progress import for_terminal

    known = registry()
    if name not in known:
        raise UsageError(
            f"no model is called {name!r}{nearest(name, known)} (known: {', '.join(known)})"
        )
    pulled = pull_model(known[name], progress=for_terminal(quiet=quiet))
    print(f"{pulled.path}")
    print(f"sha256 {pulled.sha256} of the model; {known[name].license}, from {known[name].url}")
    if pulled.first_download:
        print(
            "The publisher states no hash for this file: that of this first download is recorded, "
            "and from now on the model and every later download must have it."
        )


@models.command
def quantise(
    model: Path,
    *,
    video: Path,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    detector: Path | None = None,
    overwrite: bool = False,
) -> None:
    """Write a model in 8-bit numbers, and say what that costs and gains on your own video.

    Parameters
    ----------
    model
        The ONNX file, its manifest, or the name of a pulled model.
    video
        A video like those that the model is for; what it shows decides the ranges of the numbers.
    output
        The model to write, a name in .onnx; its manifest is written beside it.
    detector
        Person detector, which a keypoint model needs.
    overwrite
        Replace files that exist.
    """
    from dance2pose.quantising import quantise as quantise_model

    loss = quantise_model(model, video, output, detector=detector, overwrite=overwrite)
    print(f"wrote {output}")
    print(f"on other pictures of {video.name}: {loss}")
