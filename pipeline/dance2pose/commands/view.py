"""`dance2pose view`: open a recording in the Rerun viewer that was installed with dance2pose."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

from dance2pose import progress as progress_display
from dance2pose.errors import Dance2PoseError, DataError
from dance2pose.recording.file import check_recording


def view(recording: Path, *, browser: bool = False, quiet: bool = False) -> None:
    """Open a recording in the Rerun viewer; ends when the viewer is closed.

    Parameters
    ----------
    recording
        The .rrd file to open.
    browser
        Open it in the web browser, which plays H.264 without ffmpeg, instead of a window.
    quiet
        Say nothing about what is opened.
    """
    check_recording(recording)
    command = [str(viewer_program()), "--bind", "127.0.0.1", "--port", "auto"]
    if browser:
        command += ["--web-viewer", "--web-viewer-port", "0"]
    say = progress_display.for_terminal(quiet=quiet).say
    say(f"opening {recording} in the Rerun viewer")
    if not browser:
        _warn_without_ffmpeg(say)
    try:
        # The full path: no file name can be taken for an option or an address.
        status = subprocess.run([*command, str(recording.resolve())], check=False).returncode
    except OSError as error:
        raise Dance2PoseError(f"{command[0]}: cannot be started: {error.strerror}") from error
    if status:
        raise Dance2PoseError(
            f"the Rerun viewer ended with status {status}; without a screen or a graphics driver "
            "try --browser"
        )


def _warn_without_ffmpeg(say: Callable[[str], None]) -> None:
    from dance2pose.recording.picture import ffmpeg_plays

    if not ffmpeg_plays():
        say(
            "no ffmpeg 5.1 or later is on PATH: a picture recorded as H.264, H.265 or VP9 stays "
            "black; install ffmpeg, or use --browser"
        )


def viewer_program() -> Path:
    """The viewer that belongs to the installed Rerun SDK, so that their versions fit."""
    spec = find_spec("rerun_cli")
    if spec is not None and spec.origin is not None:
        folder = Path(spec.origin).parent
        for name in ("Rerun.app/Contents/MacOS/Rerun", "rerun", "rerun.exe"):
            if (folder / name).is_file():
                return folder / name
    found = shutil.which("rerun")
    if found is None:
        raise DataError(
            "the Rerun viewer is missing; install dance2pose again, or rerun-sdk on its own"
        )
    return Path(found)
