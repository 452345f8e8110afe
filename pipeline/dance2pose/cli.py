"""The command line: which commands there are, and how their failures reach the terminal.

Commands live in `dance2pose.commands` and are imported only when they are called, so that
`dance2pose --help` answers at once. Nothing below this module and those knows the library that
parses the command line: options are plain dataclasses (`dance2pose.options`), flattened here.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, NoReturn

from cyclopts import (
    App,
    ArgumentCollection,
    CycloptsError,
    Parameter,
    Token,
    UnusedCliTokensError,
)

from dance2pose import __version__
from dance2pose.command_line import (
    FLAT,
    PARAMETERS,
    SMOOTH_FLAT,
    SWITCHES_FLAT,
    HelpFormatter,
)
from dance2pose.errors import Dance2PoseError, OutputExistsError, UsageError
from dance2pose.options import (
    LiftOptions,
    OutputOptions,
    Settings,
    SmoothOptions,
    SpeedOptions,
    VideoOptions,
    nearest,
)
from dance2pose.settings_file import read_settings_file, user_config_path

COMMANDS = {
    "demo": "Run the bundled clip through the bundled models.",
    "lift": "Lift 2D keypoints of any tool to 3D poses.",
    "smooth": "Smooth a sequence of poses of any tool over time.",
    "batch": "Turn a whole collection into an archive of packages; again: go on.",
    "status": "Show how far an archive has come.",
    "verify": "Check that every package of an archive is whole.",
    "report": "Write a page about an archive to look through.",
    "export": "Write a result in the form of another program: BVH, glTF, C3D, CSV ...",
    "compare": "Lay two performances beside each other.",
    "evaluate": "Reproduce the paper's experiments on motion capture.",
    "models": "List, inspect and download ONNX models.",
    "view": "Open a recording in the Rerun viewer.",
}
# The exit status of wrong usage, of any other failure, of a run that was stopped, and of one whose
# reader went away (as the shell says it: 128 and the number of the signal).
_USAGE, _FAILURE, _STOPPED, _NO_READER = 2, 1, 130, 141

app = App(
    name="dance2pose",
    help="From a single-camera dance video to 3D motion that can be reviewed, exported and kept.",
    version=__version__,
    help_format="plaintext",
    help_formatter=HelpFormatter(),
    default_parameter=PARAMETERS,
    suppress_keyboard_interrupt=False,
)
for _command, _summary in COMMANDS.items():
    app.command(f"dance2pose.commands.{_command}:{_command}", name=_command, help=_summary)


@app.default
def reconstruct(
    video: Path,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    detector: Path | None = None,
    pose: Path | None = None,
    person: str = Settings.person,
    min_confidence: float | None = Settings.min_confidence,
    lift: Annotated[LiftOptions | None, FLAT] = None,
    smooth: Annotated[SmoothOptions | None, SMOOTH_FLAT] = None,
    part: Annotated[VideoOptions | None, FLAT] = None,
    speed: Annotated[SpeedOptions | None, FLAT] = None,
    outputs: Annotated[OutputOptions | None, SWITCHES_FLAT] = None,
    profile: bool = False,
    config: Path | None = None,
    overwrite: bool = False,
    quiet: bool = False,
) -> None:
    """Turn a video into a recording of its dancers in 2D and 3D.

    Parameters
    ----------
    video
        The video file to process.
    output
        The recording to write, a name in .rrd; after the video, in this folder, if not given.
    detector
        ONNX person detector, or the TOML manifest beside it.
    pose
        ONNX keypoint model, or its TOML manifest; a one-stage model needs no detector.
    person
        Whose poses: auto (one dancer, or all where several dance), all, largest, central, or N.
    profile
        Say at the end where the time went.
    min_confidence
        Score, 0 to 1, from which people and keypoints count; as is usual for each model if not
        given.
    config
        TOML file of settings, named as the options are.
    overwrite
        Replace files that dance2pose wrote.
    quiet
        Show no progress and no summary.
    """
    del config  # read before the command line is parsed, see main()
    from dance2pose.commands.reconstruct import run

    settings = Settings(
        detector=detector,
        pose=pose,
        person=person,
        min_confidence=min_confidence,
        video=part or VideoOptions(),
        lift=lift or LiftOptions(),
        smooth=smooth or SmoothOptions(),
        speed=speed or SpeedOptions(),
    )
    run(
        video,
        output,
        settings,
        outputs or OutputOptions(),
        overwrite=overwrite,
        quiet=quiet,
        profiled=profile,
    )


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit: 0 all was written, 2 wrong usage, 1 everything else."""
    signal.signal(signal.SIGTERM, _stop)
    sys.exit(_exit_status(list(sys.argv[1:] if arguments is None else arguments)))


def _exit_status(arguments: list[str]) -> int:
    try:
        _check_command(arguments)
        app.config = _configuration(arguments)
        app(
            arguments or ["--help"],
            exit_on_error=False,
            print_error=False,
            result_action="return_value",
        )
        sys.stdout.flush()
    except BrokenPipeError:
        return _no_reader()
    except UnusedCliTokensError as error:
        unused = ", ".join(error.unused_tokens or ())
        return _fail(f"{unused}: neither an option nor the value of one (see --help)", _USAGE)
    except CycloptsError as error:
        return _fail(" ".join(str(error).split()), _USAGE)
    except (UsageError, OutputExistsError) as error:
        return _fail(str(error), _USAGE)
    except Dance2PoseError as error:
        return _fail(str(error), _FAILURE)
    except KeyboardInterrupt:
        return _fail("stopped", _STOPPED)
    except MemoryError:
        return _fail("out of memory", _FAILURE)
    except Exception as error:
        # The last resort: whatever it was, the person at the terminal gets one line.
        if os.environ.get("DANCE2POSE_TRACEBACK"):
            raise
        return _fail(
            f"internal error, please report it: {type(error).__name__}: {error} "
            "(DANCE2POSE_TRACEBACK=1 shows where)",
            _FAILURE,
        )
    return 0


def _fail(message: str, status: int) -> int:
    print(f"dance2pose: {message}", file=sys.stderr)
    return status


def _no_reader() -> int:
    """Whoever read the output closed it, as `head` does: that is no failure to speak of."""
    # Python would complain at the end that it cannot write what is left.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return _NO_READER


def _check_command(arguments: list[str]) -> None:
    """Raise UsageError for a first word that is neither a command nor a video."""
    word = arguments[0] if arguments else ""
    if not word.isidentifier() or word in COMMANDS or os.path.lexists(word):
        return
    raise UsageError(
        f"{word}: is no command, and no file of that name is here{nearest(word, COMMANDS)} "
        f"(commands: {', '.join(COMMANDS)}; or name a video)"
    )


def _stop(signal_number: int, frame: FrameType | None) -> NoReturn:
    """SIGTERM ends a run just as Ctrl-C does, so that temporary files are removed."""
    del signal_number, frame
    raise KeyboardInterrupt


def _configuration(arguments: list[str]) -> list[SettingsFile]:
    """The settings file that is named, else the user's own if there is one.

    Who asks for help or the version gets it, whatever the file holds.
    """
    named = _option_value(arguments, "--config")
    if not arguments or {"--help", "-h", "--version"} & set(arguments):
        return []
    path = user_config_path() if named is None else Path(named)
    if named is None and not path.is_file():
        return []
    return [SettingsFile(str(path), read_settings_file(path))]


@dataclass(frozen=True)
class SettingsFile:
    """Gives options that the command line leaves open their values from a settings file.

    Top-level keys are the options of `dance2pose VIDEO`; those of a command stand in a table of
    its name. (The library's own reader skips keys that are also a command's name, as `smooth` is.)
    """

    source: str
    data: dict[str, Any]

    def __post_init__(self) -> None:
        for key, value in self.data.items():
            if isinstance(value, dict) and key not in COMMANDS:
                raise UsageError(
                    f"{self.source}: unknown table [{key}], a table has the name of a command"
                    f"{nearest(key, COMMANDS)}"
                )

    def __call__(self, app: App, commands: tuple[str, ...], arguments: ArgumentCollection) -> None:
        del app
        table = self.data
        for command in commands:
            table = table.get(command, {})
            if not isinstance(table, dict):
                return  # the option of that name, not the command's table
        for key, value in table.items():
            if not isinstance(value, dict):
                self._set(key, value, arguments)

    def _set(self, key: str, value: object, arguments: ArgumentCollection) -> None:
        option = f"--{key.replace('_', '-')}"
        try:
            argument, _, _ = arguments.match(option)
        except ValueError:
            known = [name.lstrip("-") for a in arguments for name in a.names]
            raise UsageError(
                f"{self.source}: unknown setting {key!r}{nearest(key.replace('_', '-'), known)}"
            ) from None
        if isinstance(value, list):
            raise UsageError(f"{self.source}: {key} is a list, expected one value")
        if not argument.tokens:
            argument.append(Token(keyword=key, value=str(value), source=self.source))


def _option_value(arguments: list[str], option: str) -> str | None:
    for i, argument in enumerate(arguments):
        if argument == option and i + 1 < len(arguments):
            return arguments[i + 1]
        if argument.startswith(option + "="):
            return argument.split("=", 1)[1]
    return None


if __name__ == "__main__":
    main()
