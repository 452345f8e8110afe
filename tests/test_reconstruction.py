"""The main job on real video with real models, and what happens when it cannot be done."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from dance2pose.errors import Dance2PoseError, ModelError, OutputError, UsageError, VideoError
from dance2pose.exchange import read_poses, read_track
from dance2pose.options import OutputOptions, Settings
from dance2pose.reconstruction import reconstruct
from dance2pose.summary import Summary
from video_making import numbered_video

pytestmark = pytest.mark.shared

DETECTORS = ("picodet_s_320_pedestrian", "rtmdet_nano", "yolox_nano")
POSE_MODELS = (
    "pp_tinypose_256x192",
    "pp_tinypose_128x96",
    "simcc_adapter_tinypose_256x192",
)


def settings(shared: Path, **changes: object) -> Settings:
    models = shared / "models"
    named = {
        "detector": models / f"{DETECTORS[0]}.onnx",
        "pose": models / f"{POSE_MODELS[0]}.onnx",
        "end_s": 1.0,
    }
    return Settings.of(**(named | changes))


NO_PICTURE = OutputOptions(picture="none")


def run(
    shared: Path,
    out: Path,
    video: str = "contemporary_dance",
    outputs: OutputOptions = NO_PICTURE,
    **changes: object,
) -> Summary:
    return reconstruct(
        shared / "videos" / f"{video}.mp4", out, settings(shared, **changes), outputs=outputs
    )


@pytest.mark.parametrize("pose", POSE_MODELS)
@pytest.mark.parametrize("detector", DETECTORS)
def test_every_pair_of_models_finds_the_dancer_in_every_frame(
    shared: Path, tmp_path: Path, detector: str, pose: str
) -> None:
    models = shared / "models"
    summary = run(
        shared,
        tmp_path / "out.rrd",
        detector=models / f"{detector}.onnx",
        pose=models / f"{pose}.onnx",
    )
    assert summary.dancers == 1
    assert summary.share_with_pose == 1
    assert 0.3 < summary.mean_confidence <= 1


def test_the_files_hold_what_was_seen_with_its_own_times(shared: Path, tmp_path: Path) -> None:
    summary = run(shared, tmp_path / "out.rrd", start_s=1.0, end_s=3.0, every=2, height_m=1.7)
    assert {path.name for path in summary.files} == {"out.rrd", "out.npz", "out.track.npz"}
    track, poses = read_track(tmp_path / "out.track.npz"), read_poses(tmp_path / "out.npz")
    assert len(track) == len(poses) == summary.frames
    assert track.skeleton == "coco17"
    assert poses.skeleton == "body17"
    assert poses.unit == "metres"
    np.testing.assert_array_equal(track.frame, poses.frame)
    assert (np.diff(track.frame) == 2).all()
    assert track.time_s[0] >= 1.0
    assert track.time_s[-1] <= 3.0
    height, width = 1.2 * 1.7, 1.7
    extent = np.nanmax(poses.xyz, axis=1) - np.nanmin(poses.xyz, axis=1)
    assert (extent[:, 1] < height).all()
    assert (extent[:, 1] > 0.2 * width).all()
    head, pelvis = poses.xyz[:, 8, 1], poses.xyz[:, 0, 1]
    assert (head > pelvis).mean() > 0.9  # y is up


def test_two_people_are_two_tracks(shared: Path, tmp_path: Path) -> None:
    summary = run(shared, tmp_path / "out.rrd", video="two_people_cam03", end_s=2.0)
    assert summary.dancers == 2
    assert (tmp_path / "out.dancer_2.npz").is_file()


def test_one_person_of_two_when_asked(shared: Path, tmp_path: Path) -> None:
    summary = run(shared, tmp_path / "out.rrd", video="two_people_cam03", person="largest")
    assert summary.dancers == 1


def test_the_papers_lifter_runs_too(shared: Path, tmp_path: Path) -> None:
    assert run(shared, tmp_path / "out.rrd", lifter="paper").dancers == 1


def test_a_truncated_video_is_used_as_far_as_it_goes(shared: Path, tmp_path: Path) -> None:
    whole = (shared / "videos" / "two_walkers.mp4").read_bytes()
    video = tmp_path / "cut.mp4"
    video.write_bytes(whole[: len(whole) // 2])
    try:
        summary = reconstruct(video, tmp_path / "out.rrd", settings=settings(shared, end_s=None))
    except VideoError as error:  # an MP4 with its index at the end cannot be read at all
        assert str(video) in str(error)
        assert not (tmp_path / "out.rrd").exists()
    else:
        assert summary.notes


def refused(shared: Path, tmp_path: Path, error: type[Dance2PoseError], **changes: object) -> str:
    """Run, expect the error, and check that no file was left."""
    folder = tmp_path / "out"
    folder.mkdir()
    with pytest.raises(error) as raised:
        run(shared, folder / "out.rrd", **changes)
    assert list(folder.iterdir()) == []
    return str(raised.value)


def test_models_in_each_others_place_are_refused_by_name(shared: Path, tmp_path: Path) -> None:
    models = shared / "models"
    pose, detector = models / f"{POSE_MODELS[0]}.onnx", models / f"{DETECTORS[0]}.onnx"
    assert POSE_MODELS[0] in refused(shared, tmp_path, ModelError, detector=pose, pose=pose)
    shutil.rmtree(tmp_path / "out")
    assert DETECTORS[0] in refused(shared, tmp_path, ModelError, detector=detector, pose=detector)


def test_without_a_detector_or_a_pose_model_it_says_what_to_do(
    shared: Path, tmp_path: Path
) -> None:
    assert "--detector" in refused(shared, tmp_path, UsageError, detector=None)


def test_a_video_without_people_writes_nothing(shared: Path, tmp_path: Path) -> None:
    video = tmp_path / "empty_stage.mp4"
    numbered_video(video)
    with pytest.raises(VideoError, match="no person"):
        reconstruct(video, tmp_path / "out.rrd", settings=settings(shared, end_s=None))
    assert list(tmp_path.iterdir()) == [video]


def test_an_existing_output_is_kept(shared: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.rrd"
    out.write_text("mine")
    with pytest.raises(OutputError, match="--overwrite"):
        run(shared, out)
    assert out.read_text() == "mine"
    (tmp_path / "new.npz").write_text("mine too")
    with pytest.raises(OutputError, match=r"new\.npz"):
        run(shared, tmp_path / "new.rrd")
    assert not (tmp_path / "new.rrd").exists()


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_stopping_leaves_nothing_behind(shared: Path, tmp_path: Path, stop: signal.Signals) -> None:
    models = shared / "models"
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "dance2pose"),
            str(shared / "videos" / "contemporary_dance.mp4"),
            *("--detector", str(models / f"{DETECTORS[0]}.onnx")),
            *("--pose", str(models / f"{POSE_MODELS[0]}.onnx")),
            *("--picture", "frames", "-o", "out.rrd"),
        ],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.iterdir()):  # the recording's temporary file: work has begun
        assert process.poll() is None, process.stderr and process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(stop)
    _, said = process.communicate(timeout=60)  # a hang; 2 s on an idle machine
    assert process.returncode == 130
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_said_and_leaves_nothing(shared: Path, tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True).returncode != 0:
        pytest.skip("needs the right to mount a small file system")
    try:
        with pytest.raises(OutputError, match="disk is full"):
            run(shared, disk / "out.rrd", outputs=OutputOptions(picture="frames"), end_s=3.0)
        assert list(disk.iterdir()) == []
    finally:
        subprocess.run(["umount", str(disk)], check=True)
