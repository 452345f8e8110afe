"""The demo is the end-to-end regression test: a rendered clip whose true 3D joints are known."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose import demo
from dance2pose.assets import asset
from dance2pose.errors import DataError, OutputError
from dance2pose.exchange import read_poses, read_track
from dance2pose.poses import Timeline, Track2D, Track3D
from dance2pose.skeleton import convert
from dance2pose.video import open_video

# Measured when the models were made, with some room (see models/README.md).
PCK_AT_LEAST = 0.95
PA_MPJPE_MM_AT_MOST = 70.0

# No network, whatever the code under test tries: any connection fails at once.
OFFLINE = """
import socket, sys
def refuse(*arguments, **named): raise OSError("the demo must not use the network")
socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse
from dance2pose.cli import main
main(sys.argv[1:])
"""


@dataclass(frozen=True)
class Run:
    folder: Path
    finished: subprocess.CompletedProcess[str]


def offline(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", OFFLINE, *arguments],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    where = tmp_path_factory.mktemp("demo")
    return Run(where / "dance2pose-demo", offline("demo", cwd=where))


def test_it_runs_offline_and_leaves_the_recording_and_the_arrays(run: Run) -> None:
    assert run.finished.returncode == 0, run.finished.stderr
    files = sorted(path.name for path in run.folder.iterdir())
    assert files == ["demo.npz", "demo.rrd", "demo.track.npz"]
    assert (run.folder / "demo.rrd").stat().st_size > 100_000  # the picture is in it


def test_it_says_how_to_open_it_and_how_far_off_it_is(run: Run) -> None:
    said = run.finished.stdout
    assert "dance2pose view dance2pose-demo/demo.rrd" in said
    assert "mm PA-MPJPE" in said
    assert "real videos" in said


def test_the_chain_is_as_accurate_as_it_was(run: Run) -> None:
    truth = demo.read_truth()
    found = demo.accuracy(
        read_track(run.folder / "demo.track.npz"), read_poses(run.folder / "demo.npz"), truth
    )
    assert found.frames == len(truth.time_s)
    assert found.frames_with_pose >= 0.99 * found.frames
    assert found.pck >= PCK_AT_LEAST
    assert found.pa_mpjpe_mm <= PA_MPJPE_MM_AT_MOST
    assert f"{found.pa_mpjpe_mm:.0f} mm" in run.finished.stdout


def test_a_second_run_does_not_replace_the_first_unless_told(run: Run) -> None:
    before = (run.folder / "demo.rrd").read_bytes()
    again = offline("demo", cwd=run.folder.parent)
    assert again.returncode == 2
    assert "--overwrite" in again.stderr
    assert again.stderr.count("\n") == 1
    assert (run.folder / "demo.rrd").read_bytes() == before


def test_a_folder_that_cannot_be_made_is_an_error_of_ours(tmp_path: Path) -> None:
    file = tmp_path / "taken"
    file.write_text("a file")
    with pytest.raises(OutputError, match="taken: is a file"):
        demo.run_demo(file)
    with pytest.raises(OutputError, match="cannot be made"):
        demo.run_demo(tmp_path / "missing" / "folder")
    assert [path.name for path in tmp_path.iterdir()] == ["taken"]


def test_a_truth_without_joints_is_an_error_of_ours(tmp_path: Path) -> None:
    np.savez(tmp_path / "truth.npz", time_s=np.arange(7.0))
    with pytest.raises(DataError, match=r"truth\.npz"):
        demo.read_truth(tmp_path / "truth.npz")


def test_the_clip_is_small_and_decodes_with_opencv_too() -> None:
    clip = asset(demo.CLIP)
    assert clip.stat().st_size < 2_000_000
    capture = cv2.VideoCapture(str(clip))
    frames = 0
    while capture.read()[0]:
        frames += 1
    truth = demo.read_truth()
    assert frames == len(truth.time_s)
    with open_video(clip, every=50) as ours:
        for frame in ours:
            assert frame.image.shape == (800, 640, 3)
            assert frame.time_s == pytest.approx(truth.time_s[frame.index], abs=1e-3)


def test_the_truth_fits_the_picture_and_itself() -> None:
    truth = demo.read_truth()
    visible = truth.keypoints
    assert ((visible > 0) & (visible < (640, 800))).all()
    # The joints were made of the same keypoints: their projections belong together.
    xy, _ = convert(visible, np.ones(visible.shape[:2]), source="coco23", target="body17")
    head_above_pelvis = truth.joints[:, 8, 1] > truth.joints[:, 0, 1]
    assert (head_above_pelvis == (xy[:, 8, 1] < xy[:, 0, 1])).all()
    thigh = np.linalg.norm(truth.joints[:, 10] - truth.joints[:, 9], axis=-1)
    assert thigh.std() < 1e-3
    assert 0.2 < thigh.mean() / truth.stature_m < 0.3


def perfect(truth: demo.Truth) -> tuple[Track2D, Track3D]:
    """A reconstruction without error, seen from elsewhere and in another size."""
    length = len(truth.time_s)
    turn = Rotation.from_euler("yxz", [0.4, -0.2, 0.1]).as_matrix()
    xyz = 1.3 * truth.joints @ turn.T
    frame = np.arange(length)
    track = Track2D(
        person=1,
        timeline=Timeline(frame, truth.time_s),
        xy=truth.keypoints.copy(),
        confidence=np.ones(truth.keypoints.shape[:2]),
        skeleton="coco23",
        interpolated=np.zeros(length, bool),
        box=np.full((length, 4), np.nan),
        image_size=(640, 800),
    )
    poses = Track3D(
        person=1,
        timeline=Timeline(frame, truth.time_s),
        xyz=xyz - xyz[:, :1],
        unit="metres",
        skeleton="body17",
        reprojection_error=np.zeros((length, 17)),
        valid=np.ones((length, 16), bool),
        estimated=np.zeros((length, 17), bool),
    )
    return track, poses


def test_no_error_measures_as_none() -> None:
    truth = demo.read_truth()
    found = demo.accuracy(*perfect(truth), truth)
    assert found.pck == 1
    assert found.frames_with_pose == len(truth.time_s)
    assert found.pa_mpjpe_mm == pytest.approx(0, abs=1e-6)


def test_planted_errors_measure_as_planted() -> None:
    truth = demo.read_truth()
    track, poses = perfect(truth)
    track.xy[:, 0] += 1000  # one keypoint of the body's seventeen
    track.xy[5] = np.nan
    xyz = poses.xyz.copy()
    xyz[7] = np.nan
    found = demo.accuracy(track, replace(poses, xyz=xyz), truth)
    length = len(truth.time_s)
    assert found.pck == pytest.approx(16 / 17 * (length - 1) / length)
    assert found.frames_with_pose == length - 1


def test_a_mirrored_pose_is_not_aligned_away() -> None:
    truth = demo.read_truth()
    track, poses = perfect(truth)
    mirrored = poses.xyz * np.array([-1.0, 1.0, 1.0])
    found = demo.accuracy(track, replace(poses, xyz=mirrored), truth)
    assert found.pa_mpjpe_mm > 50


def test_rows_are_compared_by_their_times() -> None:
    truth = demo.read_truth()
    track, poses = perfect(truth)
    odd = slice(1, None, 2)
    some = replace(
        track,
        **{name: getattr(track, name)[odd] for name in
           ("xy", "confidence", "interpolated", "box")},
        timeline=Timeline(track.frame[odd], track.time_s[odd]),
    )  # fmt: skip
    some_poses = replace(
        poses,
        **{name: getattr(poses, name)[odd] for name in
           ("xyz", "reprojection_error", "valid", "estimated")},
        timeline=Timeline(track.frame[odd], track.time_s[odd]),
    )  # fmt: skip
    found = demo.accuracy(some, some_poses, truth)
    assert found.pa_mpjpe_mm == pytest.approx(0, abs=1e-6)
    assert found.frames_with_pose == len(truth.time_s) // 2
    assert found.pck == pytest.approx(0.5)
