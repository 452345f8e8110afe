"""What a recording came from: the source file, the models, the settings, and what was done.

Written into the recording as readable text and, value by value, as recording properties.
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from dance2pose import __version__
from dance2pose.file_hash import file_sha256
from dance2pose.options import flat
from dance2pose.poses import Dancer

if TYPE_CHECKING:
    from dance2pose.video import VideoInfo

Value = str | int | float | bool

# Options that name the models, which count by what they are; and those that change no result.
_MODEL_OPTIONS = ("detector", "pose")
_SPEED_ALONE = ("threads", "batch")

# Distributions whose version can change a result.
_LIBRARIES = (
    "numpy",
    "scipy",
    "opencv-python-headless",
    "av",
    "onnxruntime",
    "rerun-sdk",
)


@dataclass(frozen=True)
class SourceFile:
    """A file that the result was made from."""

    name: str
    size_bytes: int
    sha256: str
    details: Mapping[str, Value] = field(default_factory=dict)


@dataclass(frozen=True)
class Provenance:
    """Everything that is needed to say what a recording is, and to make it again.

    models: by role (detector, keypoints). settings: every setting by name. stages: what each
    stage did, in order. warnings: what a reader of the result must know. identity: what the run is
    made of, see `identity_of`.
    """

    source: SourceFile
    models: Mapping[str, SourceFile] = field(default_factory=dict)
    settings: Mapping[str, Value] = field(default_factory=dict)
    stages: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    made: str = ""
    identity: str = ""

    def to_dict(self) -> dict[str, Any]:
        """The same as JSON can hold it."""
        return {
            "tool": "dance2pose",
            "made": self.made,
            "identity": self.identity,
            **self.to_properties(),
            "warnings": list(self.warnings),
        }

    def to_markdown(self) -> str:
        """A page for a reader."""
        lines = [f"# {_plain(self.source.name)}", ""]
        if self.made:
            lines += [f"Made by dance2pose {__version__} on {self.made}.", ""]
        lines += ["## To know before use", ""]
        lines += [f"- {_plain(text)}" for text in self.warnings] or ["Nothing to report."]
        lines += ["", "## Video", "", *_table(_file_rows(self.source))]
        for role, model in self.models.items():
            lines += ["", f"## Model: {role}", "", *_table(_file_rows(model))]
        lines += ["", "## What was done", "", *_list(self.stages)]
        lines += ["", "## Settings", "", *_table(self.settings)]
        lines += ["", "## Versions", "", *_table(self.versions), ""]
        return "\n".join(lines)

    def to_properties(self) -> dict[str, dict[str, Value]]:
        """The same value by value, in groups: source, model_<role>, settings, stages, ..."""
        groups: dict[str, dict[str, Value]] = {"source": _file_rows(self.source)}
        for role, model in self.models.items():
            groups[f"model_{role}"] = _file_rows(model)
        # The recording gives one type to one name, and the video has a height of its own.
        groups["settings"] = {f"setting_{name}": value for name, value in self.settings.items()}
        groups["stages"] = dict(self.stages)
        groups["versions"] = dict(self.versions)
        groups["warnings"] = {str(i): text for i, text in enumerate(self.warnings, start=1)}
        return {
            group: {key.replace(" ", "_"): value for key, value in rows.items()}
            for group, rows in groups.items()
            if rows
        }


def _file_rows(file: SourceFile) -> dict[str, Value]:
    return {
        "file name": file.name,
        "size bytes": file.size_bytes,
        "sha256": file.sha256,
        **file.details,
    }


def _table(rows: Mapping[str, Value]) -> list[str]:
    if not rows:
        return ["None."]
    body = [f"| {_plain(key)} | {_plain(_text(value))} |" for key, value in rows.items()]
    return ["| property | value |", "|---|---|", *body]


def _list(rows: Mapping[str, str]) -> list[str]:
    """As a list: sentences are wrapped there, in a table they are cut off."""
    return [f"- **{_plain(key)}**: {_plain(text)}" for key, text in rows.items()] or ["Nothing."]


def _text(value: Value) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _plain(text: str) -> str:
    """Text that Markdown shows as it is: a file name may hold any character."""
    one_line = " ".join(text.split())
    return "".join(f"\\{c}" if c in "\\`*_[]<>#|" else c for c in one_line)


def identity_of(video: VideoInfo, models: Sequence[Any], settings: object) -> str:
    """A name for what a run is made of: the same wherever the same work is done.

    Files count by their content and not by their names: the video, every model with the manifest
    that says how it is read (`recognition.ModelDescription`), a body. What changes the speed alone
    does not count.
    """
    options = {
        name: value
        for name, value in flat(settings).items()
        if name not in (*_MODEL_OPTIONS, *_SPEED_ALONE)
    }
    content = {
        name: file_sha256(value) if isinstance(value, Path) else str(value)
        for name, value in options.items()
    }
    read = [(model.sha256, repr(model.manifest)) for model in models]
    text = json.dumps([__version__, file_sha256(video.path), read, content], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def recording_id(identity: str, picture: str) -> str:
    """The id of a recording: the viewer shows only the first of two recordings with one id."""
    return f"dance2pose-{identity}-{picture}"


class _Loaded(Protocol):
    """A loaded model that says what it is."""

    @property
    def description(self) -> Any: ...


class _Models(Protocol):
    """The models of a run."""

    @property
    def detector(self) -> _Loaded | None: ...

    @property
    def estimator(self) -> _Loaded: ...

    @property
    def descriptions(self) -> tuple[Any, ...]: ...


def describe_run(
    video: VideoInfo,
    models: _Models,
    settings: object,
    dancers: Sequence[Dancer],
    *,
    frames_read: int,
    stages: Mapping[str, str],
    warnings: Sequence[str] = (),
) -> Provenance:
    """The provenance of a finished run over a video. stages: what else it did, and how."""
    loaded = {"detector": models.detector, "keypoints": models.estimator}
    return Provenance(
        source=describe_video(video, frames_read=frames_read),
        models={role: describe_model(m.description) for role, m in loaded.items() if m},
        settings=describe_settings(settings),
        stages={**stages, **describe_dancers(dancers)},
        versions=library_versions(),
        warnings=tuple(warnings),
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        identity=identity_of(video, models.descriptions, settings),
    )


def describe_video(info: VideoInfo, *, frames_read: int) -> SourceFile:
    """The video file, and what was read of it."""
    details: dict[str, Value] = {
        "duration s": "unknown" if info.duration_s is None else float(info.duration_s),
        "frame count": "unknown" if info.frame_count is None else info.frame_count,
        "frames processed": frames_read,
        "video track": info.track,
        "starts after the file's start s": info.file_offset_s,
        "width": info.width,
        "height": info.height,
        "container": info.container,
        "codec": info.codec,
        "pixel format": info.pixel_format,
        "rotation degrees": info.rotation_degrees,
        "sample aspect ratio": str(info.sample_aspect_ratio),
        "interlaced": info.interlaced,
        "interlaced because": info.interlaced_because,
        "colour matrix": info.colour_matrix,
    }
    if info.hdr is not None:
        details["high dynamic range"] = info.hdr
    if info.frame_rate is not None:
        details["average frame rate"] = float(info.frame_rate)
    return SourceFile(info.path.name, info.size_bytes, file_sha256(info.path), details)


def describe_model(description: Any) -> SourceFile:
    """A model file and how its outputs are read, from its `recognition.ModelDescription`."""
    path: Path = description.path
    return SourceFile(
        path.name,
        path.stat().st_size,
        file_sha256(path),
        {"kind": str(description.kind), "output form": str(description.form)},
    )


def describe_settings(settings: object) -> dict[str, Value]:
    """Every setting by name; files by their name without the folder."""

    def plain(value: Any) -> Value:
        if isinstance(value, Path):
            return value.name
        if value is None:
            return "not given"
        return value if isinstance(value, bool | int | float | str) else str(value)

    return {name: plain(value) for name, value in flat(settings).items()}


def describe_dancers(dancers: Sequence[Dancer]) -> dict[str, str]:
    """What was found of each dancer, in a sentence each."""
    rows = {"dancers": str(len(dancers)) if dancers else "0: no person was found"}
    for dancer in dancers:
        track, joints = dancer.keypoints, dancer.smoothed
        text = f"frames {track.frame[0]} to {track.frame[-1]}" if len(track) else "no frames"
        rows[f"dancer {dancer.person}"] = (
            f"{text} ({len(track)}), shot {track.shot}, {int(track.interpolated.sum())} frames "
            f"interpolated; keypoints {track.skeleton}, joints {joints.skeleton}, "
            f"lengths in {joints.unit}"
        )
    return rows


def library_versions() -> dict[str, str]:
    """Versions of what the result depends on."""
    versions = {"dance2pose": __version__, "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    return versions
