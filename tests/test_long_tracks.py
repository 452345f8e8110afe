"""Tracks of hours: lifted in windows with one body, in memory that does not grow with them."""

from __future__ import annotations

import gc
import os
import subprocess
import sys
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import av
import numpy as np
import pytest
from av.video.frame import VideoFrame

from dance2pose import findings, portions
from dance2pose.body import Body, body_bones_mm
from dance2pose.lifting.error_calibration import ErrorParts
from dance2pose.lifting.lift import lift
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.temporal import sequence, windows
from dance2pose.lifting.temporal.body_of_track import Found
from dance2pose.poses import Timeline, Track2D
from dance2pose.tracking.candidates import Sights
from dance2pose.video import open_video

BODY = Body("body17", body_bones_mm("body17"), np.full(16, 0.02))


@pytest.fixture
def small_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(windows, "WINDOW", 300)
    monkeypatch.setattr(windows, "TELLING", 300)
    monkeypatch.setattr(windows, "_OVERLAP_S", 4.0)
    monkeypatch.setattr(sequence, "LONGEST_WHOLE", 400)


def seen(frames: int, rate_hz: float = 25.0) -> Observed:
    rng = np.random.default_rng(3)
    return Observed(
        xy=rng.normal(0, 100, (frames, 17, 2)),
        confidence=np.ones((frames, 17)),
        time_s=1.5 + np.arange(frames) / rate_hz,
        skeleton="body17",
        image_size=(640, 480),
    )


def find(observed: Observed, found: Found | None) -> Lifted:
    """Poses that follow from each frame alone, and the body that was found before."""
    frames = len(observed)
    assert found is None or found.body is BODY
    xyz = np.concatenate([observed.xy, observed.xy[..., :1]], axis=2)
    errors = ErrorParts(np.ones((frames, 17)), np.ones((frames, 17)), 7.0)
    root = observed.time_s[:, None] * [1.0, 2.0, 3.0]
    return Lifted(xyz, observed.xy, observed.confidence, root, BODY, errors)


@pytest.mark.usefixtures("small_windows")
def test_what_each_frame_tells_alone_is_the_same_in_windows() -> None:
    observed = seen(1007)
    whole, parts = find(observed, None), windows.lift_in_windows(observed, find)
    np.testing.assert_array_equal(parts.root, whole.root)
    for name in ("xyz", "projected", "sigma"):
        np.testing.assert_allclose(getattr(parts, name), getattr(whole, name), rtol=1e-6)
    assert parts.body is BODY


@pytest.mark.usefixtures("small_windows")
def test_windows_overlap_and_cover_the_track() -> None:
    rows = list(windows.windows(seen(1007).time_s))
    assert len(rows) == 4
    assert (rows[0].start, rows[-1].stop) == (0, 1007)
    for before, after in pairwise(rows):
        assert before.stop - after.start == 100  # 4 s at 25 Hz


@pytest.mark.usefixtures("small_windows")
def test_windows_meet_where_they_agree_best() -> None:
    def drifting(observed: Observed, found: Found | None) -> Lifted:
        """Every window errs, but for one moment of what it shares with the next."""
        lifted = find(observed, found)
        off = 50.0 * np.abs((observed.time_s % 8.0) - 6.0) * observed.time_s[0]
        return replace(lifted, xyz=lifted.xyz + off[:, None, None])

    observed = seen(600)
    first, second = windows.windows(observed.time_s)
    parts = windows.lift_in_windows(observed, drifting)
    shared = slice(second.start, first.stop)
    steps = np.abs(np.diff((parts.xyz - find(observed, None).xyz)[:, 0, 0]))
    assert steps[shared].max() < 50.0 * observed.time_s[-1] / 25 + 1


@pytest.mark.usefixtures("small_windows")
def test_a_dancer_who_is_away_where_windows_meet_stays_away() -> None:
    observed = seen(600)
    observed.xy[280:320] = np.nan
    parts = windows.lift_in_windows(observed, find)
    assert np.isnan(parts.xyz[280:320]).all()
    assert np.isfinite(np.delete(parts.xyz, np.s_[280:320], axis=0)).all()


def dance(frames: int) -> Track2D:
    """A figure that sways, turns its arms and steps, with noise, as keypoints of body17."""
    time_s = np.arange(frames) / 25
    rng = np.random.default_rng(5)
    places = np.array([320.0, 240.0]) + rng.normal(0, 60, (17, 2))
    sway = np.stack([np.sin(time_s * (0.6 + 0.1 * j)) for j in range(17)], axis=1)
    xy = places + 25 * sway[..., None] * [1.0, 0.5] + rng.normal(0, 0.5, (frames, 17, 2))
    return Track2D.from_arrays(xy, skeleton="body17", time_s=time_s, image_size=(640, 480))


@pytest.mark.usefixtures("small_windows")
def test_memory_grows_with_the_poses_and_not_with_the_work(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name, value in (("WINDOW", 150), ("TELLING", 150), ("_OVERLAP_S", 2.0)):
        monkeypatch.setattr(windows, name, value)

    def peak(frames: int) -> tuple[int, int]:
        track = dance(frames)
        tracemalloc.start()
        try:
            poses = lift(track)
            _, most = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        arrays = [a for a in vars(poses).values() if isinstance(a, np.ndarray)]
        return most, sum(array.nbytes for array in arrays)

    lift(dance(50))  # loads what is kept
    (short, little), (long, much) = peak(450), peak(750)
    # Keypoints as lifters take them, poses in the camera's and the world's axes: no more than
    # that. Lifting works with ten times as much a frame.
    assert long - short < 4 * (much - little)


def test_turns_are_the_same_some_frames_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    xyz = np.random.default_rng(0).normal(size=(11, 17, 3))
    timeline = Timeline(np.arange(11), np.array([0, 1, 2, 3, 4, 9, 10, 11, 12, 13, 14]) / 25)
    whole = findings.turns_deg(xyz, timeline, "body17")
    monkeypatch.setattr(portions, "FRAMES", 3)
    np.testing.assert_array_equal(findings.turns_deg(xyz, timeline, "body17"), whole)
    assert np.isnan(whole[4]).all()


def test_sights_are_given_back_as_they_were_added() -> None:
    rng = np.random.default_rng(1)
    rows, xy = [2, 3, 7], rng.normal(size=(3, 11, 2)).astype(np.float32)
    confidence, box = rng.random((3, 11), np.float32), rng.random((3, 4), np.float32)
    xy[1, 4] = np.nan
    sights = Sights()
    for n, row in enumerate(rows):
        sights.add(row, xy[n], confidence[n], box[n])
    for found, given in zip(sights.arrays(), (xy, confidence, box), strict=True):
        np.testing.assert_array_equal(found, given)
    assert list(sights.rows) == rows
    np.testing.assert_array_equal(sights.last_box, box[-1])


def test_no_picture_stays_when_it_is_let_go(tmp_path: Path) -> None:
    """Every picture of this file is a key picture, whose display matrix is looked at."""
    path = tmp_path / "keys.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=25, options={"g": "1"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for shade in range(20):
            picture = VideoFrame.from_ndarray(np.full((48, 64, 3), 9 * shade, np.uint8))
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    gc.collect()
    gc.disable()
    try:
        before = pictures()
        with open_video(path) as frames:
            assert sum(1 for _ in frames) == 20
        assert pictures() - before < 10
    finally:
        gc.enable()


def pictures() -> int:
    return sum(type(thing) is VideoFrame for thing in gc.get_objects())


SENDING = """
import os, sys
from pathlib import Path

before = dict(os.environ)
from dance2pose.recording.quiet_rerun import rr
from dance2pose.recording.stream import open_stream

assert dict(os.environ) == before, "importing Rerun changed the environment"

def resident_kb():
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("RssAnon"))

with open_stream(Path(sys.argv[1]), application_id="a", recording_id="b") as file:
    start = resident_kb()
    for n in range(12):
        blob = rr.EncodedImage(contents=os.urandom(4_000_000), media_type="image/jpeg")
        file.rerun.log(f"/piece/{n}", blob, static=True)
        file.flush()
    print(resident_kb() - start)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")
def test_memory_of_what_was_recorded_goes_back_unless_the_user_says_otherwise(
    tmp_path: Path,
) -> None:
    def kept_mb(**environment: str) -> float:
        command = [sys.executable, "-c", SENDING, str(tmp_path / "sent.rrd")]
        env = {**os.environ, **environment}
        done = subprocess.run(command, env=env, check=True, capture_output=True, text=True)
        return int(done.stdout) / 1e3

    # Measured: 44 and 66 MB.
    assert kept_mb() < kept_mb(MIMALLOC_PURGE_DELAY="100000") - 10
