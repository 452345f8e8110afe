"""Settings of a run: the one place for their defaults, and the TOML files they can come from."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from dance2pose.errors import UsageError

# A settings file is a page of text; anything larger is some other file.
_LARGEST_SETTINGS_FILE = 1_000_000


@Parameter(name="*", negative=())
@dataclass(frozen=True, kw_only=True)
class Settings:
    """What `dance2pose VIDEO` can be told, beyond where to read and write."""

    detector: Path | None = None
    """ONNX person detector, or the TOML manifest beside it."""
    pose: Path | None = None
    """ONNX keypoint model, or its TOML manifest; a one-stage model needs no detector."""
    person: str = "auto"
    """Whose poses: auto (one dancer, or all where several dance), all, largest, central, or N."""
    smooth: Literal[
        "auto",
        "none",
        "sma",
        "ema",
        "wma",
        "mma",
        "sma-zero-phase",
        "ema-zero-phase",
        "wma-zero-phase",
        "mma-zero-phase",
        "one-euro",
        "savitzky-golay",
        "butterworth",
    ] = "auto"
    """Temporal model over the joints; auto: mma after the paper's lifter, else none."""
    window: int = 5
    """Window of the temporal model, in frames."""
    lifter: Literal["default", "paper"] = "default"
    """How 2D becomes 3D: the whole sequence at once, or the paper's pursuit frame by frame."""
    height: float | None = None
    """Body height of the dancer in metres; without it, lengths are in body heights."""
    camera: Literal["auto", "weak-perspective", "perspective"] = "auto"
    """Camera model; perspective, which auto is but for the paper's lifter, also solves the path of
    the dancer through the room."""
    fov: float | None = None
    """Horizontal field of view in degrees, for the perspective camera; assumed if not given."""
    start: float | None = None
    """First second of the video to process."""
    end: float | None = None
    """Last second of the video to process."""
    every: int = 1
    """Process every N-th frame."""
    deinterlace: Literal["auto", "off"] = "auto"
    """Whether interlaced material is deinterlaced."""
    picture: Literal["auto", "video", "frames", "none"] = "auto"
    """The picture in the recording: the video file itself, its frames as JPEG, or none."""
    npz: Annotated[bool, Parameter(negative="--no-npz")] = True
    """Also write the poses as OUT.npz and the keypoints as OUT.track.npz."""

    @property
    def temporal_model(self) -> str:
        """The temporal model that runs, with `auto` resolved."""
        if self.smooth != "auto":
            return self.smooth
        return "mma" if self.lifter == "paper" else "none"

    def __post_init__(self) -> None:
        _require(self.window >= 1, f"--window {self.window}: expected 1 or more frames")
        _require(self.every >= 1, f"--every {self.every}: expected 1 or more")
        _require(
            self.height is None or 0.3 <= self.height <= 3,
            f"--height {self.height}: expected a body height in metres, 0.3 to 3",
        )
        _require(
            self.fov is None or 5 <= self.fov <= 170,
            f"--fov {self.fov}: expected degrees, 5 to 170",
        )
        _require(
            self.person in ("auto", "all", "largest", "central")
            or (self.person.isdecimal() and int(self.person) >= 1),
            f"--person {self.person}: expected auto, all, largest, central or a number from 1",
        )
        _require(self.start is None or self.start >= 0, f"--start {self.start}: expected 0 or more")
        _require(
            self.end is None or self.end > (self.start or 0),
            f"--end {self.end}: expected more than --start {self.start or 0}",
        )


def _require(holds: bool, message: str) -> None:
    if not holds:
        raise UsageError(message)


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
