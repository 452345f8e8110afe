"""Recordings in the real viewer: what it draws, and what it cannot draw."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from dance2pose.options import Settings
from dance2pose.poses import Dancer, Timeline
from dance2pose.reconstruction import reconstruct
from dance2pose.recording.picture import ffmpeg_plays
from dance2pose.recording.writer import RecordingWriter
from dance2pose.video import open_video
from recording_making import make_dancer, make_provenance, timeline_of
from video_making import make_video, numbered, numbered_video, read_number

pytestmark = pytest.mark.viewer

_SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "screenshot.py"
_NO_GRAPHICS = 3
TIMES_MS = [0, 40, 80, 160, 200, 210, 300, 340, 500, 540, 600, 720]
PICTURE_VIEW, WORLD_VIEW = "Video and keypoints", "3D joints (body heights; balls: one sigma wide)"


def unless_ci(reason: str) -> None:
    """Skip what this machine cannot do, except where it is the place to do it."""
    if os.environ.get("CI") == "true":
        pytest.fail(f"{reason}, and under CI the viewer must run")
    pytest.skip(reason)


def look(recording: Path, times_s: list[float], view: str | None = None) -> list[np.ndarray]:
    """BGR pictures of a recording at three times; fails if any view reports anything."""
    command = [sys.executable, _SCRIPT, recording, "--output", recording.parent, "--times"]
    command += [str(time_s) for time_s in times_s]
    # Small, since it may be a processor that draws it.
    command += ["--window-size", "900x600"]
    command += ["--view", view] if view else []
    done = subprocess.run(command, capture_output=True, text=True, timeout=280)
    if done.returncode == _NO_GRAPHICS:
        unless_ci("the viewer finds no graphics driver (mesa-vulkan-drivers has a software one)")
    assert done.returncode == 0, done.stdout + done.stderr
    paths = [recording.parent / f"{recording.stem}_{time_s:.2f}s.png" for time_s in times_s]
    return [cv2.imread(str(path)) for path in paths]


def only_picture(view: np.ndarray) -> np.ndarray:
    """A numbered picture cut out of a view of it, whose surround is nearly black."""
    bright = view.max(axis=2) > 60
    rows, columns = np.flatnonzero(bright.any(axis=1)), np.flatnonzero(bright.any(axis=0))
    return view[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def record(video: Path, path: Path, picture: str, *, dancers: bool) -> list[Dancer]:
    with (
        open_video(video) as frames,
        RecordingWriter(path, recording_id=path.stem, picture=picture, video=frames.info) as out,  # type: ignore[arg-type]
    ):
        seen = []
        for frame in frames:
            out.picture_frame(frame)
            seen.append(frame)
        rows = {"frame": [f.index for f in seen], "time_s": [f.time_s for f in seen]}
        made = [make_dancer(n, x=30.0 * n, **rows) for n in (1, 2)] if dancers else []  # type: ignore[arg-type]
        # The second leaves after frame 5.
        made[1:] = [_until(d, 6) for d in made[1:]]
        out.write(made, make_provenance(), timeline_of(seen))
    return made


def _until(dancer: Dancer, rows: int) -> Dancer:
    """The first rows of a dancer."""
    per_row = {
        "keypoints": "xy confidence interpolated box",
        "raw": "xyz reprojection_error valid estimated sigma",
        "smoothed": "xyz reprojection_error valid estimated sigma",
    }
    timeline = Timeline(dancer.timeline.frame[:rows], dancer.timeline.time_s[:rows])
    parts = {
        part: replace(
            getattr(dancer, part),
            timeline=timeline,
            **{name: getattr(getattr(dancer, part), name)[:rows] for name in names.split()},
        )
        for part, names in per_row.items()
    }
    return Dancer(**parts)


@pytest.mark.parametrize("picture", ["video", "frames"])
def test_the_viewer_shows_each_picture_at_its_own_time(tmp_path: Path, picture: str) -> None:
    """Uneven times and pictures that are stored out of order, as phones and encoders do."""
    if picture == "video" and not ffmpeg_plays():
        unless_ci("the viewer plays H.264 with an ffmpeg 5.1 or later on PATH only")
    # Numbers from 129, so that the outer blocks are bright and the picture's edges are seen.
    images = [numbered(129 + 2 * n, 256, 192) for n in range(len(TIMES_MS))]
    options = {"bf": "3", "g": "6", "x264-params": "force-cfr=1"}
    video = make_video(tmp_path / "uneven.mp4", images, times_ms=TIMES_MS, options=options)
    path = tmp_path / f"{picture}.rrd"
    record(video, path, picture, dancers=False)
    shown = [3, 5, 8]
    views = look(path, [TIMES_MS[n] / 1000 + 0.002 for n in shown], PICTURE_VIEW)
    assert [read_number(only_picture(view)) for view in views] == [129 + 2 * n for n in shown]


def test_dancers_are_drawn_in_colour_and_go_when_they_are_gone(tmp_path: Path) -> None:
    video = numbered_video(tmp_path / "a.mp4", count=len(TIMES_MS), times_ms=TIMES_MS)
    path = tmp_path / "dancers.rrd"
    record(video, path, "none", dancers=True)

    def pixels(view: np.ndarray, colour: tuple[int, int, int]) -> int:
        return int((np.abs(view.astype(int) - colour[::-1]).max(axis=2) < 40).sum())

    both, one, _ = look(path, [0.081, 0.35, 0.6], WORLD_VIEW)
    yellow, green = (255, 214, 64), (80, 220, 130)
    assert pixels(both, yellow) > 100
    assert pixels(both, green) > 100
    assert pixels(one, yellow) > 100
    assert pixels(one, green) == 0


@pytest.mark.shared
def test_a_real_dancer_is_seen_in_every_view(shared: Path, tmp_path: Path) -> None:
    if not ffmpeg_plays():
        unless_ci("the viewer plays H.264 with an ffmpeg 5.1 or later on PATH only")
    models = shared / "models"
    path = tmp_path / "real.rrd"
    reconstruct(
        shared / "videos" / "contemporary_dance.mp4",
        path,
        Settings.of(
            detector=models / "picodet_s_320_pedestrian.onnx",
            pose=models / "pp_tinypose_256x192.onnx",
            lifter="paper",
            start_s=3.0,
            end_s=4.0,
        ),
    )
    for picture in look(path, [3.1, 3.5, 3.9]):
        assert picture.std() > 20
