"""What a run can be told: every option once, with its default, its range and what it means.

Each group of options checks itself and its combinations when it is made, so that wrong usage is
found before any work is done, in words that fit Python and the command line alike. The command
line derives its options from these fields (`--height` from `height_m`: units are dropped).
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, Self, TypeVar, get_args, get_type_hints

from dance2pose.errors import UsageError

Lifter = Literal["default", "paper"]
Camera = Literal["auto", "weak-perspective", "perspective"]
Deinterlace = Literal["auto", "off"]
Picture = Literal["auto", "video", "frames", "none"]
Provider = Literal["auto", "cpu", "cuda", "tensorrt", "openvino", "coreml", "directml"]
SmoothModel = Literal[
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
]
# Whose poses, beside a number from 1.
PERSONS = ("auto", "all", "largest", "central")

T = TypeVar("T")

HEIGHT_RANGE_M = (0.3, 3.0)
FOV_RANGE_DEG = (5.0, 170.0)
LONGEST_DETECT_EVERY = 60
# The largest whole number that every file can hold.
LARGEST_WHOLE = 2**31 - 1


@dataclass(frozen=True, kw_only=True)
class VideoOptions:
    """Which part of a video is read, and how."""

    start_s: float | None = None
    """First second of the video to process."""
    end_s: float | None = None
    """Last second of the video to process."""
    every: int = 1
    """Process every N-th frame."""
    deinterlace: Deinterlace = "auto"
    """Whether interlaced material is deinterlaced."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_whole("every", self.every, at_least=1)
        start = check_number("start", self.start_s) or 0.0
        end = check_number("end", self.end_s)
        require(start >= 0, f"start {start:g}: expected 0 or more seconds")
        if end is not None:
            require(end > start, f"end {end:g}: expected more seconds than start, {start:g}")


@dataclass(frozen=True, kw_only=True)
class LiftOptions:
    """How 2D keypoints become 3D joints."""

    lifter: Lifter = "default"
    """How 2D becomes 3D: the whole sequence at once, or the paper's pursuit frame by frame."""
    height_m: float | None = None
    """Body height of the dancer in metres; without it, lengths are in body heights."""
    camera: Camera = "auto"
    """Camera model; perspective, which auto is but for the paper's lifter, also solves the path of
    the dancer through the room."""
    fov_deg: float | None = None
    """Field of view across the longer side of the picture in degrees, for the perspective camera;
    told by upright dancers or assumed if not given."""
    body: Path | None = None
    """Bone lengths of the dancers, as an earlier run wrote them with --write-body."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_within("height", self.height_m, HEIGHT_RANGE_M, "a body height in metres")
        check_within("fov", self.fov_deg, FOV_RANGE_DEG, "a field of view in degrees")
        require(
            not (self.lifter == "paper" and self.camera == "perspective"),
            "the paper's lifter knows no perspective camera; take camera weak-perspective, or "
            "the default lifter",
        )
        require(
            not (self.body is not None and self.lifter == "paper"),
            "the paper's lifter has bone lengths of its own; a body file is for the default lifter",
        )
        require(
            not (self.fov_deg is not None and self.camera_model == "weak-perspective"),
            f"fov {self.fov_deg}: only the perspective camera has a field of view",
        )

    @property
    def camera_model(self) -> Literal["weak-perspective", "perspective"]:
        """What `camera` stands for: perspective, as real cameras are, where the lifter can.

        Video lifted as if it were orthographic has half as large an error again, and a field of
        view that is assumed wrongly by a third costs far less (models/README.md).
        """
        if self.camera != "auto":
            return self.camera
        return "weak-perspective" if self.lifter == "paper" else "perspective"


@dataclass(frozen=True, kw_only=True)
class SmoothOptions:
    """Which temporal model runs over the joints."""

    model: SmoothModel = "auto"
    """Temporal model over the joints; auto: mma after the paper's lifter, else none."""
    window: int = 5
    """Window of the temporal model, in frames."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_whole("window", self.window, at_least=1)
        require(
            not (self.model == "savitzky-golay" and self.window % 2 == 0),
            f"savitzky-golay needs an odd window, not {self.window}; "
            f"give {self.window - 1} or {self.window + 1}",
        )

    def model_after(self, lifter: Lifter) -> str:
        """The temporal model that runs, with `auto` resolved."""
        if self.model != "auto":
            return self.model
        return "mma" if lifter == "paper" else "none"


@dataclass(frozen=True, kw_only=True)
class SpeedOptions:
    """How thoroughly people are looked for, and which hardware does it.

    Only `detect_every` can change a result; other hardware rounds a little differently.
    """

    detect_every: int = 10
    """Look for people in every N-th frame, at least twice a second, and follow them in between;
    1: look in every frame."""
    threads: int | None = None
    """Frames worked on at once; as many as there are cores if not given."""
    batch: int = 16
    """People in one call of the keypoint model at most, where the model takes several."""
    provider: Provider = "auto"
    """Hardware that runs the models; auto: the fastest that the installed ONNX Runtime offers."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_whole("detect-every", self.detect_every, at_least=1)
        require(
            self.detect_every <= LONGEST_DETECT_EVERY,
            f"detect-every {self.detect_every}: expected at most {LONGEST_DETECT_EVERY} frames, "
            "which are held in memory",
        )
        if self.threads is not None:
            check_whole("threads", self.threads, at_least=1)
        check_whole("batch", self.batch, at_least=1)


@dataclass(frozen=True, kw_only=True)
class Settings:
    """All that `analyse` can be told, beyond the video."""

    detector: Path | None = None
    """ONNX person detector, or the TOML manifest beside it."""
    pose: Path | None = None
    """ONNX keypoint model, or its TOML manifest; a one-stage model needs no detector."""
    person: str = "auto"
    """Whose poses: auto (one dancer, or all where several dance), all, largest, central, or N."""
    min_confidence: float | None = None
    """Score from 0 to 1 from which people and keypoints count; as is usual for each model if not
    given."""
    video: VideoOptions = field(default_factory=VideoOptions)
    lift: LiftOptions = field(default_factory=LiftOptions)
    smooth: SmoothOptions = field(default_factory=SmoothOptions)
    speed: SpeedOptions = field(default_factory=SpeedOptions)

    def __post_init__(self) -> None:
        parse_person(self.person)
        check_within("min_confidence", self.min_confidence, (0, 1), "a score")

    @classmethod
    def of(cls, **options: Any) -> Self:
        """Settings from single options, whichever group they belong to.

        Raises UsageError for an option that no group has.

        Examples
        --------
        >>> Settings.of(height_m=1.62, model="mma").smooth.model
        'mma'
        """
        return made_of(cls, options)


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Which files a run writes, and what is in them."""

    picture: Picture = "auto"
    """The picture in the recording: the video file itself, its frames as JPEG, or none."""
    npz: bool = True
    """Also write the poses as OUT.npz and the keypoints as OUT.track.npz."""
    export: str = ""
    """Further forms of the poses, by their suffixes: bvh,csv writes OUT.bvh and OUT.csv."""
    write_body: bool = False
    """Also write the dancers' bone lengths as OUT.body.toml, for other runs to start from."""

    def __post_init__(self) -> None:
        check_choices(self)

    @property
    def forms(self) -> tuple[str, ...]:
        """The names in `export`, without leading dots, in order and once."""
        words = [word.strip().lower().lstrip(".") for word in self.export.split(",")]
        return tuple(dict.fromkeys(word for word in words if word))


def made_of(kind: type[T], options: Mapping[str, Any]) -> T:
    """An options dataclass from options by name; those of groups within it are found there.

    Text becomes a path where a path is expected. Raises UsageError for a name that is not known.
    """
    known = dict(_options(kind))
    for name in options:
        if name not in known and name not in {f.name for f in fields(kind)}:  # type: ignore[arg-type]
            raise UsageError(f"unknown option {name!r}{nearest(name, known)}")
    made: T = _made(kind, options)
    return made


def _made(kind: Any, options: Mapping[str, Any]) -> Any:
    hints = get_type_hints(kind)
    values: dict[str, Any] = {}
    for part in fields(kind):
        name, hint = part.name, hints[part.name]
        if name in options:
            value = options[name]
            path = isinstance(value, str) and Path in (hint, *get_args(hint))
            values[name] = Path(value) if path else value
        elif is_dataclass(hint):
            values[name] = _made(hint, options)
    return kind(**values)


def _options(kind: Any) -> Iterable[tuple[str, Any]]:
    hints = get_type_hints(kind)
    for part in fields(kind):
        hint = hints[part.name]
        if is_dataclass(hint):
            yield from _options(hint)
        else:
            yield part.name, hint


def combined(kind: type[T], given: T | None, named: Mapping[str, Any]) -> T:
    """Options given as an object, as names, or both, where the names decide."""
    if given is None:
        return made_of(kind, named)
    return made_of(kind, {**flat(given), **named})


def flat(settings: Any) -> dict[str, Any]:
    """Every option of nested groups by name."""
    out: dict[str, Any] = {}
    for part in dataclasses.fields(settings):
        value = getattr(settings, part.name)
        out.update(flat(value) if is_dataclass(value) else {part.name: value})
    return out


def parse_person(person: str | int) -> str | int:
    """A choice as a word of `PERSONS` or a number from 1; UsageError for anything else."""
    number = int(person) if isinstance(person, int) or person.isdecimal() else None
    if number is None and person in PERSONS:
        return person
    if number is None or number < 1:
        raise UsageError(f"person {person!r}: expected {', '.join(PERSONS)} or a number from 1")
    return number


def nearest(name: str, known: Iterable[str]) -> str:
    """`; did you mean ...?` for a name that is nearly one of `known`, else an empty text."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def require(holds: bool, message: str) -> None:
    """Raise UsageError with `message` unless it holds."""
    if not holds:
        raise UsageError(message)


def check_choices(options: Any) -> None:
    """Raise UsageError unless every field that is one of several words is one of them."""
    for name, hint in get_type_hints(type(options)).items():
        words = get_args(hint)
        value = getattr(options, name, None)
        if words and all(isinstance(word, str) for word in words) and value not in words:
            raise UsageError(
                f"{name} {value!r}: expected {', '.join(words)}{nearest(str(value), words)}"
            )


def check_whole(name: str, value: object, *, at_least: int) -> None:
    """Raise UsageError unless `value` is a whole number of at least so many that files can hold."""
    whole = isinstance(value, int) and not isinstance(value, bool)
    if not whole or value < at_least:  # type: ignore[operator]
        raise UsageError(f"{name} {value}: expected a whole number, {at_least} or more")
    require(
        value <= LARGEST_WHOLE,  # type: ignore[operator]
        f"{name} {value}: expected a whole number, {LARGEST_WHOLE} at most",
    )


def check_number(name: str, value: float | None) -> float | None:
    """The number, if one is given; UsageError for what is not a finite number."""
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if value is not None and not (number and abs(value) < float("inf")):
        raise UsageError(f"{name} {value}: expected a number")
    return value


def check_within(name: str, value: float | None, bounds: tuple[float, float], what: str) -> None:
    """Raise UsageError unless `value`, if given, lies within the bounds."""
    low, high = bounds
    if check_number(name, value) is not None and not low <= value <= high:  # type: ignore[operator]
        raise UsageError(f"{name} {value:g}: expected {what}, {low:g} to {high:g}")
