"""Pictures of a recording at given times, made by the real Rerun viewer without a screen.

    python scripts/screenshot.py OUT.rrd --times 1 5.5 9 --output folder

Writes folder/OUT_1.00s.png ... and prints what any view could not show, one line each. Exit
status: 0 all views show everything, 1 a view reported something, 3 the viewer cannot draw here
(it needs a graphics driver; a software one such as Mesa's lavapipe will do).
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rerun.experimental import ViewerClient

NO_GRAPHICS = 3
# What the viewer says as it ends without a Vulkan driver, and without any.
_NO_GRAPHICS_WORDS = ("Failed to get render context", "No graphics adapter was found")
_START_S = 60.0
_TRIES = 6
_LOOKS = 15

T = TypeVar("T")


class NoGraphicsError(Exception):
    """The viewer found no graphics driver."""


@contextlib.contextmanager
def headless_viewer(window_size: str) -> Iterator[ViewerClient]:
    """The viewer of this environment, drawing into memory, reachable from this machine only."""
    from rerun.experimental import ViewerClient

    port = _free_port()
    command = [sys.executable, "-m", "rerun_cli", "--headless", "--hide-welcome-screen"]
    command += ["--bind", "127.0.0.1", "--port", str(port), "--window-size", window_size]
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            command,
            stdout=log,
            stderr=log,
            start_new_session=True,
            # The picture is of the recording, not of the notices of a first start.
            env={**os.environ, "RERUN_APP_ONLY": "true"},
        )
        try:
            _wait_for(port, process)
            yield ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        except (RuntimeError, ConnectionError, TimeoutError) as error:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout=5)
            log.seek(0)
            said = log.read().decode(errors="replace")
            if any(words in said for words in _NO_GRAPHICS_WORDS):
                raise NoGraphicsError(said) from error
            raise RuntimeError(f"{error}\n{said[-3000:]}") from error
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _wait_for(port: int, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + _START_S
    while time.monotonic() < end:
        if process.poll() is not None:
            raise ConnectionError(f"the viewer ended with status {process.returncode}")
        with socket.socket() as probe:
            probe.settimeout(1)
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise TimeoutError(f"the viewer did not answer within {_START_S:.0f} s")


def _patiently(call: Callable[[], T]) -> T:
    """Ask the viewer again where a software driver on a busy machine missed its time."""
    for _ in range(_TRIES - 1):
        with contextlib.suppress(RuntimeError, TimeoutError):
            return call()
    return call()


def _settled_picture(viewer: ViewerClient, view_id: str | None) -> bytes:
    """A picture once two in a row are the same: the video decoder needs a moment."""
    last = b""
    for _ in range(_LOOKS):
        picture = _patiently(lambda: viewer.take_screenshot(view_id))
        if picture == last:
            break
        last = picture
        time.sleep(0.7)
    return last


def _wait_until_loaded(viewer: ViewerClient) -> None:
    end = time.monotonic() + _START_S
    while time.monotonic() < end:
        state = _patiently(viewer.get_state)
        if state.views and not state.loading:
            break
        time.sleep(0.2)
    time.sleep(2)


def take_pictures(
    recording: Path, times_s: list[float], folder: Path, *, window_size: str, view: str | None
) -> list[str]:
    """Write one picture for each time; returns what the views reported."""
    reports: list[str] = []
    with headless_viewer(window_size) as viewer:
        _patiently(lambda: viewer.open(str(recording.resolve())))
        _wait_until_loaded(viewer)
        for time_s in times_s:
            _patiently(partial(viewer.set_time, "video_time", duration=time_s, play_state="paused"))
            time.sleep(1)
            views = _patiently(viewer.get_state).views
            chosen = next((v.view_id for v in views if v.name == view), None)
            picture = _settled_picture(viewer, chosen)
            (folder / f"{recording.stem}_{time_s:.2f}s.png").write_bytes(picture)
            reports += [
                f"{time_s:.2f} s, view {v.name!r} ({v.origin}): {r.severity}: {r.summary}"
                + (f" ({r.details})" if r.details else "")
                for v in _patiently(viewer.get_state).views
                for r in v.reports
            ]
        reports += [
            f"log: {entry.level}: {entry.message}"
            for entry in _patiently(viewer.get_logs)
            if entry.level in ("WARN", "ERROR") and "rasterizer" not in entry.message
        ]
    return reports


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recording", type=Path)
    parser.add_argument("--times", type=float, nargs="+", default=[0.0], help="seconds")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the pictures")
    parser.add_argument("--window-size", default="1600x1000")
    parser.add_argument("--view", help="name of one view, instead of the whole window")
    arguments = parser.parse_args()
    if not arguments.recording.is_file():
        parser.error(f"{arguments.recording}: no such file")
    if not arguments.output.is_dir():
        parser.error(f"{arguments.output}: no such folder")
    try:
        reports = take_pictures(
            arguments.recording,
            arguments.times,
            arguments.output,
            window_size=arguments.window_size,
            view=arguments.view,
        )
    except NoGraphicsError as error:
        print(f"the viewer cannot draw here, it found no graphics driver\n{error}")
        return NO_GRAPHICS
    print("\n".join(reports) if reports else "every view shows everything")
    return 1 if reports else 0


if __name__ == "__main__":
    sys.exit(main())
