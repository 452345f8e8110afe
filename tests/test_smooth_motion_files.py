"""C3D and BVH: smoothed they are the same form with smoother motion; read they are 3D tracks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose import skeleton
from dance2pose.commands.smooth import smooth as run
from dance2pose.errors import DataError, UsageError
from dance2pose.exchange import write_poses
from dance2pose.mocap.bvh import node_positions, read_bvh, read_bvh_file
from dance2pose.mocap.motion import forward_kinematics
from dance2pose.reading import read_poses
from dance2pose.smoothing import smooth

T = 50
HIERARCHY = """HIERARCHY
ROOT Hips
{
\tOFFSET 0 90 0
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT LeftUpLeg
\t{
\t\tOFFSET 9 -3 0
\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\tJOINT LeftLeg
\t\t{
\t\t\tOFFSET 0 -40 0
\t\t\tCHANNELS 3 Yrotation Zrotation Xrotation
\t\t\tJOINT LeftFoot
\t\t\t{
\t\t\t\tOFFSET 0 -41 0
\t\t\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\t\t\tEnd Site
\t\t\t\t{
\t\t\t\t\tOFFSET 0 0 14
\t\t\t\t}
\t\t\t}
\t\t}
\t}
\tJOINT LeftArm
\t{
\t\tOFFSET 15 45 0
\t\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\t\tJOINT LeftForeArm
\t\t{
\t\t\tOFFSET 25 0 0
\t\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\t\tEnd Site
\t\t\t{
\t\t\t\tOFFSET 24 0 0
\t\t\t}
\t\t}
\t}
}
"""
ORDERS = ("ZXY", "ZXY", "YZX", "ZXY", "ZXY", "ZXY")


def _take(noise_deg: float, seed: int = 3) -> list[list[float]]:
    """Joints that turn all the way round, past 180 degrees, with jitter."""
    rng = np.random.default_rng(seed)
    t = np.arange(T) / 30
    columns: list[np.ndarray] = [10 * t, 90 + np.sin(t), 5 * t]
    for j, order in enumerate(ORDERS):
        turn = Rotation.from_rotvec(np.outer(170 + 70 * t, [0.2 * j, 1, 0.3]), degrees=True)
        jitter = Rotation.from_rotvec(rng.normal(size=(T, 3)) * noise_deg, degrees=True)
        if j == 4:
            columns += [np.full(T, 15.0), np.full(T, 45.0), np.zeros(T)]
        columns += list((turn * jitter).as_euler(order, degrees=True).T)
    return np.array(columns).T.tolist()


def _bvh(path: Path, rows: list[list[float]]) -> Path:
    motion = [f"MOTION\nFrames: {len(rows)}\nFrame Time: 0.0333333"]
    motion += [" ".join(f"{value:.6f}" for value in row) for row in rows]
    path.write_text(HIERARCHY + "\n".join(motion) + "\n")
    return path


def test_bvh_rotations_past_180_degrees_become_smoother_and_bones_stay(tmp_path: Path) -> None:
    source = _bvh(tmp_path / "in.bvh", _take(4.0))
    truth = node_positions(read_bvh_file(_bvh(tmp_path / "true.bvh", _take(0.0))))
    out = tmp_path / "out.bvh"
    run(source, output=out, model="sma-zero-phase", window=5, quiet=True)
    before, after = (node_positions(read_bvh_file(path)) for path in (source, out))
    inside = slice(6, -6)
    errors = [
        float(np.linalg.norm(p[inside] - truth[inside], axis=2).mean()) for p in (before, after)
    ]
    assert errors[1] < 0.6 * errors[0]
    old, new = read_bvh_file(source), read_bvh_file(out)
    assert new.header == old.header
    assert new.frame_time == pytest.approx(old.frame_time)
    np.testing.assert_array_equal(new.offsets, old.offsets)
    # Angles stay near those that were there: no jump by a whole turn is added.
    assert np.abs(new.values - old.values).max() < 90


def test_bvh_that_stands_still_stays_as_it_is(tmp_path: Path) -> None:
    source = _bvh(tmp_path / "in.bvh", [_take(0.0)[7]] * T)
    run(source, output=tmp_path / "out.bvh", model="mma", window=5, quiet=True)
    np.testing.assert_allclose(
        read_bvh_file(tmp_path / "out.bvh").values, read_bvh_file(source).values, atol=1e-5
    )


def test_node_positions_are_those_of_forward_kinematics(tmp_path: Path) -> None:
    source = _bvh(tmp_path / "in.bvh", _take(4.0))
    expected, _ = forward_kinematics(read_bvh(source))
    np.testing.assert_allclose(node_positions(read_bvh_file(source)), expected, atol=1e-9)


def test_bvh_positions_are_read_by_the_joints_that_bones_begin_at(tmp_path: Path) -> None:
    source = _bvh(tmp_path / "in.bvh", _take(0.0))
    with pytest.raises(UsageError, match="the unit of length is not said in the file"):
        read_poses(source)
    (track,) = read_poses(source, unit="cm").tracks
    nodes = node_positions(read_bvh_file(source)) / 100
    joints = skeleton.get(track.skeleton).joints
    for joint, node in (("left_hip", 1), ("left_knee", 2), ("left_ankle", 3), ("left_elbow", 6)):
        np.testing.assert_allclose(
            track.xyz[:, joints.index(joint)], nodes[:, node] - nodes[:, 0], atol=1e-6
        )
    assert track.root is not None
    np.testing.assert_allclose(track.root, nodes[:, 0], atol=1e-6)
    np.testing.assert_allclose(np.diff(track.time_s), 0.0333333, atol=1e-6)


def _c3d(path: Path, points: np.ndarray, *, names: list[str], unit: str = "mm") -> Path:
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["UNITS"]["value"] = [unit]
    file["parameters"]["POINT"]["LABELS"]["value"] = names
    data = np.ones((4, points.shape[1], len(points)))
    data[:3] = np.moveaxis(points, (0, 1, 2), (2, 1, 0))
    file["data"]["points"] = data
    file.write(str(path))
    return path


def test_c3d_markers_are_smoothed_and_gaps_stay(tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    points = np.random.default_rng(0).normal(size=(T, 3, 3)).cumsum(axis=0) * 10
    points[20:24, 1] = np.nan
    source = _c3d(tmp_path / "in.c3d", points, names=["LKnee", "RKnee", "CHip"])
    run(source, output=tmp_path / "out.c3d", model="wma", window=4, quiet=True)
    file = ezc3d.c3d(str(tmp_path / "out.c3d"))
    found = np.moveaxis(file["data"]["points"][:3], (2, 1, 0), (0, 1, 2))
    expected = smooth(points.astype(np.float32), model="wma", window=4)
    np.testing.assert_allclose(found, expected, atol=1e-3)
    assert file["parameters"]["POINT"]["LABELS"]["value"] == ["LKnee", "RKnee", "CHip"]
    assert file["header"]["points"]["frame_rate"] == 100


@pytest.mark.parametrize("content", [b"", b"hello" * 300, b"\x02\x50" + bytes(900)])
def test_what_is_no_c3d_file_is_said(tmp_path: Path, content: bytes) -> None:
    pytest.importorskip("ezc3d")
    (tmp_path / "in.c3d").write_bytes(content)
    with pytest.raises(DataError, match=r"in\.c3d: (not a C3D file|holds no marker)"):
        run(tmp_path / "in.c3d", output=tmp_path / "out.c3d")
    assert [path.name for path in tmp_path.iterdir()] == ["in.c3d"]


NAMES = ["CHip", "Neck", "LShoulder", "RShoulder", "LHip", "RHip", "LKnee", "RBigToe"]
JOINTS = ["pelvis", "neck", "left_shoulder", "right_shoulder", "left_hip", "right_hip"]


def _planted() -> np.ndarray:
    return np.random.default_rng(1).normal(size=(T, len(NAMES), 3)).cumsum(axis=0) / 50


def _check(track: object, planted: np.ndarray) -> None:
    joints = skeleton.get(track.skeleton).joints  # type: ignore[attr-defined]
    where = [joints.index(joint) for joint in JOINTS]
    found = track.xyz[:, where] + track.root[:, np.newaxis]  # type: ignore[attr-defined]
    np.testing.assert_allclose(found, planted[:, : len(JOINTS)], atol=2e-5)


def test_c3d_is_turned_from_z_up_and_millimetres(tmp_path: Path) -> None:
    planted = _planted()
    points = 1000 * np.stack([planted[..., 0], -planted[..., 2], planted[..., 1]], axis=-1)
    found = read_poses(_c3d(tmp_path / "in.c3d", points, names=NAMES))
    assert found.tracks[0].unit == "metres"
    _check(found.tracks[0], planted)
    two = np.concatenate([points, points + 5], axis=1)
    names = [f"{who}:{name}" for who in ("ann", "bo") for name in NAMES]
    found = read_poses(_c3d(tmp_path / "two.c3d", two, names=names))
    assert [track.person for track in found.tracks] == [1, 2]
    assert found.notes[1].startswith("bo: 8 of 8 points read as")


def test_trc_and_csv_are_read_with_unit_names_and_times(tmp_path: Path) -> None:
    planted = _planted()
    times = np.arange(T) / 59.94
    flat = planted.reshape(T, -1)
    head = [
        "PathFileType\t4\t(X/Y/Z)\tin.trc",
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits",
        f"59.94\t59.94\t{T}\t{len(NAMES)}\tmm",
        "Frame#\tTime\t" + "\t\t\t".join(NAMES) + "\t\t",
        "\t\t" + "\t".join(f"{a}{n + 1}" for n in range(len(NAMES)) for a in "XYZ"),
    ]
    rows = [
        f"{n + 1}\t{times[n]:.6f}\t" + "\t".join(f"{1000 * v:.5f}" for v in flat[n])
        for n in range(T)
    ]
    (tmp_path / "in.trc").write_text("\n".join([*head, *rows]) + "\n")
    (track,) = read_poses(tmp_path / "in.trc").tracks
    _check(track, planted)
    np.testing.assert_allclose(track.time_s, times, atol=1e-6)
    for unit in ("_m", ""):
        columns = [f"{name}_{axis}{unit}" for name in NAMES for axis in "xyz"]
        text = ",".join(["frame", "time_s", "person", *columns]) + "\n"
        for who in ("1", "2"):
            for n in range(T):
                cells = ",".join(f"{v:.6f}" for v in flat[n])
                text += f"{n},{times[n]:.6f},{who},{cells}\n"
        (tmp_path / "in.csv").write_text(text)
        found = read_poses(tmp_path / "in.csv", unit=None if unit else "m")
        assert len(found.tracks) == 2
        for track in found.tracks:
            _check(track, planted)
        if not unit:
            with pytest.raises(UsageError, match="the unit of length is not said"):
                read_poses(tmp_path / "in.csv")


def test_what_is_wrong_with_positions_is_said(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("time,a_x,b_x\n0,1,2\n1,2,3\n")
    with pytest.raises(DataError, match="has no columns of x, y and z"):
        read_poses(tmp_path / "a.csv")
    (tmp_path / "b.csv").write_text("time,a_x,a_y,a_z\n0,1,2,1\n1,2,3,1\n")
    with pytest.raises(DataError, match="the names a are not those of a body"):
        read_poses(tmp_path / "b.csv", unit="m")
    with pytest.raises(UsageError, match="unit 'feet' is not known"):
        read_poses(tmp_path / "b.csv", unit="feet")
    with pytest.raises(UsageError, match="up 'x' is not possible"):
        read_poses(tmp_path / "b.csv", up="x")
    with pytest.raises(DataError, match=r"expected \.npz, \.trc, \.csv"):
        read_poses(tmp_path / "b.fbx")


def test_poses_of_this_package_are_read_as_they_are(tmp_path: Path) -> None:
    points = 1000 * _planted()
    (track,) = read_poses(_c3d(tmp_path / "in.c3d", points, names=NAMES)).tracks
    write_poses(tmp_path / "poses.npz", track)
    (again,) = read_poses(tmp_path / "poses.npz").tracks
    np.testing.assert_allclose(again.xyz, track.xyz)
