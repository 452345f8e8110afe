"""A recording is whole or absent, whatever happens while it is written."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from dance2pose.commands.view import view
from dance2pose.errors import Dance2PoseError, DataError, OutputError, VideoError
from dance2pose.recording.writer import RecordingWriter
from dance2pose.video import VideoInfo, open_video
from recording_making import NO_FRAMES, Recording, make_provenance
from video_making import numbered_video

# Records pictures without end, until something stops it.
_ENDLESS = """
import sys
from pathlib import Path
import numpy as np
from dance2pose.errors import OutputError
from dance2pose.poses import Frame
from dance2pose.recording.writer import RecordingWriter
from dance2pose.video import open_video
with open_video(Path(sys.argv[1])) as frames:
    info = frames.info
rng = np.random.default_rng(0)
try:
    with RecordingWriter(Path(sys.argv[2]), recording_id="id", picture="frames", video=info) as out:
        for number in range(100_000):
            image = rng.integers(0, 255, (200, 300, 3), np.uint8)
            out.picture_frame(Frame(number, number / 25, image))
            if number == 100:
                print("recording", flush=True)
except OutputError as error:
    print(error, file=sys.stderr)
    sys.exit(1)
except KeyboardInterrupt:
    sys.exit(130)
"""


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return numbered_video(tmp_path_factory.mktemp("video") / "a.mp4", count=5)


@pytest.fixture(scope="module")
def info(video: Path) -> VideoInfo:
    with open_video(video) as frames:
        return frames.info


def files(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("error", [ValueError("mistake"), KeyboardInterrupt()])
@pytest.mark.parametrize("picture", ["frames", "video"])
def test_nothing_is_left_after_an_error(
    tmp_path: Path, video: Path, info: VideoInfo, picture: str, error: BaseException
) -> None:
    with (
        pytest.raises(type(error)),
        open_video(video) as frames,
        RecordingWriter(
            tmp_path / "out.rrd",
            recording_id="id",
            picture=picture,
            video=info,  # type: ignore[arg-type]
        ) as out,
    ):
        for frame in frames:
            out.picture_frame(frame)
            assert len(files(tmp_path)) == 1
            raise error
    assert files(tmp_path) == []


def test_a_recording_that_was_not_finished_is_not_kept(tmp_path: Path, info: VideoInfo) -> None:
    with (
        pytest.raises(RuntimeError, match="write was not called"),
        RecordingWriter(tmp_path / "out.rrd", recording_id="id", picture="none", video=info),
    ):
        pass
    assert files(tmp_path) == []


def test_an_older_recording_is_kept_until_the_new_one_is_whole(
    tmp_path: Path, info: VideoInfo
) -> None:
    path = tmp_path / "out.rrd"
    path.write_bytes(b"older")
    with (
        pytest.raises(OutputError, match="exists already"),
        RecordingWriter(path, recording_id="id", picture="none", video=info),
    ):
        pass
    arguments = {"recording_id": "id", "picture": "none", "video": info, "overwrite": True}
    with pytest.raises(ValueError, match="mistake"), RecordingWriter(path, **arguments):  # type: ignore[arg-type]
        raise ValueError("mistake")
    assert path.read_bytes() == b"older"
    with RecordingWriter(path, **arguments) as out:  # type: ignore[arg-type]
        out.write([], make_provenance(), NO_FRAMES)
    assert path.read_bytes().startswith(b"RRF2")
    assert files(tmp_path) == ["out.rrd"]


def test_a_folder_that_does_not_exist_is_named(tmp_path: Path, info: VideoInfo) -> None:
    path = tmp_path / "nowhere" / "out.rrd"
    with (
        pytest.raises(OutputError, match="nowhere does not exist"),
        RecordingWriter(path, recording_id="id", picture="none", video=info),
    ):
        pass


def test_a_video_that_went_away_is_named(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "b.mp4", count=3)
    with open_video(path) as frames:
        info = frames.info
    path.write_bytes(b"no longer a video")
    with (
        pytest.raises(VideoError, match=r"cannot be (read|opened)"),
        RecordingWriter(tmp_path / "out.rrd", recording_id="id", picture="video", video=info),
    ):
        pass
    assert files(tmp_path) == ["b.mp4"]


def test_a_full_disk_ends_in_one_line_and_nothing_left(tmp_path: Path, video: Path) -> None:
    limited = "import resource, signal; signal.signal(signal.SIGXFSZ, signal.SIG_IGN);"
    limited += "resource.setrlimit(resource.RLIMIT_FSIZE, (9_000_000, 9_000_000))\n"
    done = subprocess.run(
        [sys.executable, "-c", limited + _ENDLESS, str(video), str(tmp_path / "out.rrd")],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1, done.stderr
    assert "out.rrd: cannot be written: File too large" in done.stderr
    assert files(tmp_path) == []


@pytest.mark.parametrize("room", [0, 50, 3000])
def test_a_disk_that_fills_up_at_the_very_end_is_noticed(
    tmp_path: Path, info: VideoInfo, room: int
) -> None:
    """Even where only the table of contents no longer fits."""
    path = tmp_path / "out.rrd"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        with (
            pytest.raises(OutputError, match="too large"),
            RecordingWriter(path, recording_id="id", picture="none", video=info) as out,
        ):
            out.write([], make_provenance(), NO_FRAMES)
            (part,) = tmp_path.iterdir()
            resource.setrlimit(resource.RLIMIT_FSIZE, (part.stat().st_size + room, hard))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, ignored)
    assert files(tmp_path) == []


def test_where_there_are_no_pipes_rerun_writes_the_file(
    tmp_path: Path, info: VideoInfo, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dance2pose.recording.stream._PIPES", tmp_path / "none")
    path = tmp_path / "out.rrd"
    with RecordingWriter(path, recording_id="id", picture="none", video=info) as out:
        out.write([], make_provenance(), NO_FRAMES)
    assert "/provenance" in Recording(path).entities


def test_ctrl_c_leaves_nothing(tmp_path: Path, video: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _ENDLESS, str(video), str(tmp_path / "out.rrd")],
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"recording\n"
        assert len(files(tmp_path)) == 1
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130  # a hang; two seconds on an idle machine
    assert files(tmp_path) == []


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("gone.rrd", None, "no such file"),
        ("empty.rrd", b"", "is empty"),
        ("text.rrd", b"not a recording", "expected a Rerun recording"),
        ("cut.rrd", "cut", "cut short"),
        ("name.txt", "whole", "ends in .rrd"),
    ],
)
def test_view_refuses_what_is_no_whole_recording(
    tmp_path: Path, info: VideoInfo, name: str, content: bytes | str | None, says: str
) -> None:
    path = tmp_path / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content:
        whole = tmp_path / "whole.rrd"
        with RecordingWriter(whole, recording_id="id", picture="none", video=info) as out:
            out.write([], make_provenance(), NO_FRAMES)
        data = whole.read_bytes()
        path.write_bytes(data if content == "whole" else data[: len(data) // 2])
    with pytest.raises(DataError, match=says) as caught:
        view(path, quiet=True)
    assert str(path) in str(caught.value)


def test_view_refuses_a_folder(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="is a folder"):
        view(tmp_path, quiet=True)


@pytest.mark.skipif(os.name == "nt", reason="the stand-in for the viewer is a shell script")
def test_view_starts_the_viewer_for_this_machine_only(
    tmp_path: Path, info: VideoInfo, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = Path("--serve-web; touch x.rrd")
    with RecordingWriter(path, recording_id="id", picture="none", video=info) as out:
        out.write([], make_provenance(), NO_FRAMES)
    stand_in = tmp_path / "viewer"
    stand_in.write_text('#!/bin/sh\nprintf "%s\\n" "$@" > arguments\nexit ${STATUS:-0}\n')
    stand_in.chmod(0o755)
    monkeypatch.setattr("dance2pose.commands.view.viewer_program", lambda: stand_in)
    view(path, quiet=True)
    arguments = (tmp_path / "arguments").read_text().splitlines()
    assert arguments[arguments.index("--bind") + 1] == "127.0.0.1"
    assert arguments[-1] == str(tmp_path / path)
    monkeypatch.setenv("STATUS", "3")
    with pytest.raises(Dance2PoseError, match="status 3"):
        view(path, quiet=True)
