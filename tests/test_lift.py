"""`lift`: tracks in, tracks out; skeletons, units, what was seen and what was not; faults."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dance2pose import lifting
from dance2pose.body import BODY_HEIGHT_MM
from dance2pose.commands.lift import lift as lift_command
from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import read_poses, write_track
from dance2pose.limits.model import load as load_limits
from dance2pose.options import LiftOptions
from dance2pose.poses import FloatArray, Timeline, Track2D
from dance2pose.skeleton import get
from lifting_examples import pa_mpjpe, posed


def track_of(xy: FloatArray, skeleton: str, **changes: object) -> Track2D:
    frames = len(xy)
    seen = np.isfinite(xy).all(axis=-1)
    track = Track2D(
        person=3,
        timeline=Timeline(np.arange(10, 10 + 2 * frames, 2), 0.4 + np.arange(frames) / 12.5),
        xy=xy.astype(np.float32),
        confidence=np.where(seen, 0.8, 0.0).astype(np.float32),
        skeleton=skeleton,
        interpolated=np.zeros(frames, dtype=bool),
        box=np.full((frames, 4), np.nan, dtype=np.float32),
        image_size=(640, 480),
    )
    return replace(track, **changes)  # type: ignore[arg-type]


def image_of(xyz: FloatArray) -> FloatArray:
    """Pixels (y down) of poses in mm, y up."""
    pixels: FloatArray = np.array([320.0, 240.0]) + 0.2 * xyz[..., :2] * [1, -1]
    return pixels


def coco17_of(body17: FloatArray) -> FloatArray:
    """COCO keypoints (T, 17, 2) around the joints of body17 poses; the face about the head."""
    coco, body = get("coco17"), get("body17")
    out = np.zeros((len(body17), 17, 2))
    image = image_of(body17)
    for i, name in enumerate(coco.joints):
        if name in body.joints:
            out[:, i] = image[:, body.index(name)]
        else:
            side = {"left": 8, "right": -8}.get(name.split("_")[0], 0)
            out[:, i] = image[:, body.index("head")] + [side, 0]
    return out


@pytest.mark.parametrize("skeleton", ["cmu17", "paper15", "body17"])
def test_a_track_comes_back_in_3d(skeleton: str) -> None:
    truth = posed(skeleton)
    track = track_of(image_of(truth), skeleton)
    poses = lifting.lift(track, lifter="paper")
    assert poses.person == 3 and poses.skeleton == skeleton and poses.unit == "body heights"
    np.testing.assert_array_equal(poses.frame, track.frame)
    np.testing.assert_array_equal(poses.time_s, track.time_s)
    assert not poses.xyz[:, 0].any()
    assert pa_mpjpe(poses.xyz * BODY_HEIGHT_MM, truth) < 80
    # y is up: heads are above ankles, as in these poses, though image rows run downwards.
    head, ankle = get(skeleton).index("head"), get(skeleton).index("left_ankle")
    upright = truth[:, head, 1] > truth[:, ankle, 1] + 500
    assert upright.sum() >= 5
    assert (poses.xyz[upright, head, 1] > poses.xyz[upright, ankle, 1]).all()
    np.testing.assert_array_equal(poses.valid, load_limits(skeleton).is_valid(poses.xyz))
    assert not poses.estimated.any()
    assert np.isfinite(poses.reprojection_error).all() and poses.reprojection_error.mean() < 5


def test_height_sets_the_unit_and_nothing_else() -> None:
    track = track_of(image_of(posed("body17")), "body17")
    relative = lifting.lift(track, lifter="paper")
    metres = lifting.lift(track, lifter="paper", height_m=1.7)
    assert metres.unit == "metres"
    np.testing.assert_allclose(metres.xyz, 1.7 * relative.xyz, atol=1e-5)
    np.testing.assert_allclose(metres.reprojection_error, relative.reprojection_error, atol=1e-3)
    assert metres.root is None  # one camera does not tell where the dancer stands


def test_coco_keypoints_are_lifted_as_body17_with_toes_estimated() -> None:
    truth = posed("body17", frames=9)
    poses = lifting.lift(track_of(coco17_of(truth), "coco17"), lifter="paper")
    body = get("body17")
    toes = [body.index("left_toe"), body.index("right_toe")]
    assert poses.skeleton == "body17"
    assert poses.estimated[:, toes].all()
    assert not np.delete(poses.estimated, toes, axis=1).any()
    assert np.isfinite(poses.xyz).all()
    assert np.isnan(poses.reprojection_error[:, toes]).all()
    assert np.isfinite(np.delete(poses.reprojection_error, toes, axis=1)).all()


def test_gaps_stay_gaps_and_holes_are_marked() -> None:
    xy = image_of(posed("body17", frames=9))
    wrist = get("body17").index("left_wrist")
    xy[4] = np.nan
    xy[2:4, wrist] = np.nan
    poses = lifting.lift(track_of(xy, "body17"), lifter="paper")
    assert len(poses) == 9
    assert np.isnan(poses.xyz[4]).all() and np.isnan(poses.reprojection_error[4]).all()
    assert not poses.estimated[4].any()
    assert np.flatnonzero(poses.estimated.any(axis=1)).tolist() == [2, 3]
    assert poses.estimated[2:4, wrist].all() and poses.estimated.sum() == 2
    assert np.isnan(poses.reprojection_error[2:4, wrist]).all()
    assert np.isfinite(poses.xyz[[0, 1, 2, 3, 5]]).all()


def test_one_frame_and_a_joint_that_is_never_seen() -> None:
    xy = image_of(posed("cmu17", frames=1))
    xy[:, 7] = np.nan
    poses = lifting.lift(track_of(xy, "cmu17"), lifter="paper")
    assert poses.xyz.shape == (1, 17, 3) and np.isfinite(poses.xyz).all()
    assert poses.estimated[0].tolist() == [j == 7 for j in range(17)]


def test_a_track_of_nothing_gives_nothing() -> None:
    poses = lifting.lift(track_of(np.full((5, 17, 2), np.nan), "coco17"), lifter="paper")
    assert np.isnan(poses.xyz).all() and poses.xyz.shape == (5, 17, 3)
    assert not poses.estimated.any()


def test_keypoints_without_confidence_are_not_believed() -> None:
    xy = image_of(posed("cmu17"))
    wrong = xy.copy()
    wrong[:, 4] += 100
    confidence = np.full((7, 17), 0.8, dtype=np.float32)
    confidence[:, 4] = 0
    doubted = lifting.lift(track_of(wrong, "cmu17", confidence=confidence), lifter="paper")
    hole = xy.copy()
    hole[:, 4] = np.nan
    unseen = lifting.lift(track_of(hole, "cmu17"), lifter="paper")
    np.testing.assert_allclose(doubted.xyz, unseen.xyz, atol=1e-4)
    assert doubted.estimated[:, 4].all()


@pytest.mark.parametrize(
    ("change", "options", "error", "message"),
    [
        ({}, {"lifter": "magic"}, UsageError, "lifter 'magic': expected default, paper"),
        ({}, {"camera": "fisheye"}, UsageError, "camera 'fisheye': expected"),
        ({}, {"camera": "perspective"}, UsageError, "perspective"),
        ({}, {"height_m": 0.0}, UsageError, "height 0: expected a body height in metres"),
        ({}, {"height_m": float("nan")}, UsageError, "height nan"),
        ({}, {"height_m": 170.0}, UsageError, "height 170: expected a body height"),
        ({"skeleton": "octopus8"}, {}, UsageError, "unknown skeleton 'octopus8'"),
        ({"skeleton": "halpe26"}, {}, DataError, "17 keypoints, halpe26 has 26"),
        ({"confidence": np.full((7, 17), np.nan)}, {}, DataError, "not a number"),
        ({"xy": np.full((7, 17, 2), np.inf)}, {}, DataError, "infinite"),
        (
            {"timeline": Timeline(np.arange(7), np.arange(7) * 4e-8)},
            {},
            DataError,
            "frames are 4e-08 s apart, expected times in seconds",
        ),
    ],
)
def test_faults_are_one_clear_error(
    change: dict[str, object],
    options: dict[str, object],
    error: type[Exception],
    message: str,
) -> None:
    track = replace(track_of(image_of(posed("cmu17")), "cmu17"), **change)  # type: ignore[arg-type]
    with pytest.raises(error, match=message):
        lifting.lift(track, **{"lifter": "paper", **options})  # type: ignore[arg-type]


@pytest.mark.parametrize("least_s", [1e-3, 1e-5, 1e-8])
def test_two_frames_at_nearly_one_time_are_lifted(least_s: float) -> None:
    times = np.arange(7) / 25
    times[4] = times[3] + least_s
    track = replace(
        track_of(image_of(posed("cmu17")), "cmu17"), timeline=Timeline(np.arange(7), times)
    )
    assert np.isfinite(lifting.lift(track).xyz).all()


def test_a_track_without_frames_is_refused() -> None:
    with pytest.raises(DataError, match="person 3: holds no frame"):
        lifting.lift(track_of(np.zeros((0, 17, 2)), "cmu17"), lifter="paper")


def test_the_numerical_core_loads_neither_video_nor_onnx_nor_rerun() -> None:
    """The paper's lifter, mocap and evaluation data need NumPy and SciPy alone."""
    code = """
import sys
import numpy as np
from dance2pose import lifting, smoothing
from dance2pose.limits import model as limits
from dance2pose.mocap import corpus
from dance2pose.poses import Track2D
xy = np.random.default_rng(0).normal(size=(3, 17, 2)) * 100
track = Track2D.from_arrays(xy, time_s=np.arange(3) / 25.0, skeleton="cmu17", image_size=(640, 480))
lifting.lift(track, lifter="paper")
print(" ".join(name for name in ("av", "cv2", "onnxruntime", "rerun", "torch", "cyclopts", "rich")
               if name in sys.modules))
"""
    run = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert run.stdout.strip() == ""


# --- the command ---

PAPER = LiftOptions(lifter="paper")


def test_the_command_lifts_a_track(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    track = track_of(image_of(posed("body17")), "body17")
    write_track(tmp_path / "track.npz", track)
    output = tmp_path / "poses.npz"
    lift_command(
        tmp_path / "track.npz",
        output=output,
        options=LiftOptions(lifter="paper", height_m=1.6),
    )
    back = read_poses(output)
    expected = lifting.lift(track, lifter="paper", height_m=1.6)
    np.testing.assert_allclose(back.xyz, expected.xyz, atol=1e-3)
    np.testing.assert_array_equal(back.valid, expected.valid)
    assert back.unit == "metres" and back.skeleton == "body17"
    printed = capsys.readouterr()
    assert f"wrote {output}" in printed.out
    assert "7 of 7 frames lifted (body17, metres)" in printed.err


def test_the_command_reads_openpose_folders(tmp_path: Path) -> None:
    folder = tmp_path / "openpose"
    folder.mkdir()
    truth = posed("body17", frames=5, seed=2)
    keypoints = coco17_of(truth)
    for t, frame in enumerate(keypoints):
        numbers = np.column_stack([frame, np.full(17, 0.9)]).ravel().tolist()
        document = {"version": 1.3, "people": [{"pose_keypoints_2d": numbers}]}
        (folder / f"clip_{t:012d}_keypoints.json").write_text(json.dumps(document))
    output = tmp_path / "poses.npz"
    lift_command(
        folder, output=output, options=PAPER, skeleton="coco17", independent=True, quiet=True
    )
    assert read_poses(output).xyz.shape == (5, 17, 3)


def test_the_command_refuses_and_leaves_nothing(tmp_path: Path) -> None:
    write_track(tmp_path / "empty.npz", track_of(np.full((4, 17, 2), np.nan), "coco17"))
    output = tmp_path / "out.npz"
    with pytest.raises(DataError, match="enough keypoints"):
        lift_command(tmp_path / "empty.npz", output=output, options=PAPER)
    with pytest.raises(UsageError, match=r"ends in \.npz"):
        lift_command(tmp_path / "empty.npz", output=tmp_path / "out.csv", options=PAPER)
    with pytest.raises(DataError, match=r"gone\.npz"):
        lift_command(tmp_path / "gone.npz", output=output, options=PAPER)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["empty.npz"]
