"""One conformance suite over every form of export, and what each form holds by other readers."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from dance2pose import export
from dance2pose.errors import DataError, OutputError, UsageError, VideoError
from dance2pose.even_rate import even
from dance2pose.exchange import read_track, write_poses, write_track
from dance2pose.export import FORMS, ExportScene
from dance2pose.export.scene import SceneDancer
from dance2pose.poses import Timeline, Track2D, Track3D
from dance2pose.skeleton import get
from export_making import NTSC, SCENES, TIMES, make_poses, make_scene, variable_times, with_gap
from video_making import numbered_video, read_number

pytest.importorskip("ezc3d")
pytest.importorskip("pygltflib")
from export_reading import (
    MARKERS,
    SKELETON,
    Gltf,
    Read,
    c3d_provenance,
    read_bvh,
    read_c3d,
    read_trc,
)

MM = 0.001
PLAIN_FORMS = [suffix for suffix, form in FORMS.items() if not form.needs_video]


def places(poses: Track3D) -> np.ndarray:
    return poses.xyz if poses.root is None else poses.xyz + poses.root[:, None]


def farthest(found: np.ndarray, truth: np.ndarray) -> float:
    """Largest distance; missing in one and not the other counts as infinite."""
    assert found.shape == truth.shape
    np.testing.assert_array_equal(np.isnan(found), np.isnan(truth))
    return float(np.nanmax(np.linalg.norm(found - truth, axis=-1)))


def at_true_times(read: Read, poses: Track3D) -> np.ndarray:
    """What a reader found at even times, at the times of the frames (linear: short steps)."""
    flat = read.xyz.reshape(len(read.xyz), -1)
    columns = [np.interp(poses.time_s, read.time_s, column) for column in flat.T]
    return np.stack(columns, axis=1).reshape(len(poses), -1, 3)


@pytest.mark.parametrize("suffix", PLAIN_FORMS)
@pytest.mark.parametrize("name", SCENES)
def test_every_form_takes_every_scene_and_leaves_only_its_files(
    tmp_path: Path, suffix: str, name: str
) -> None:
    scene, form = SCENES[name](), FORMS[suffix]
    output = tmp_path / f"out{suffix}"
    export.write(scene, output)
    expected = {output.name}
    if not form.several_dancers:
        expected |= {f"out.dancer_{p.person}{suffix}" for p in scene.dancers[1:]}
    assert {path.name for path in tmp_path.iterdir()} == expected
    assert all(path.stat().st_size > 50 for path in tmp_path.iterdir())
    with pytest.raises(OutputError, match=r"exists already"):
        export.write(scene, output)


@pytest.mark.parametrize("suffix", PLAIN_FORMS)
def test_every_form_takes_a_dancer_of_one_frame_and_one_never_lifted(
    tmp_path: Path, suffix: str
) -> None:
    export.write(make_scene(make_poses(TIMES[5:6])), tmp_path / f"one{suffix}")
    never = with_gap(make_poses(TIMES), slice(0, len(TIMES)))
    export.write(make_scene(never), tmp_path / f"never{suffix}")


@pytest.mark.parametrize("suffix", PLAIN_FORMS)
def test_every_form_takes_a_joint_that_is_never_known(tmp_path: Path, suffix: str) -> None:
    poses = make_poses(TIMES)
    poses.xyz[:, SKELETON.index("left_toe")] = np.nan
    poses.xyz[3:9, SKELETON.index("head")] = np.nan
    export.write(make_scene(poses), tmp_path / f"out{suffix}")


def test_a_fault_in_the_second_file_leaves_none(tmp_path: Path) -> None:
    scene = SCENES["two dancers"]()
    (tmp_path / "out.dancer_3.bvh").mkdir()
    with pytest.raises(OutputError, match=r"dancer_3\.bvh: is a folder"):
        export.write(scene, tmp_path / "out.bvh")
    assert [path.name for path in tmp_path.iterdir()] == ["out.dancer_3.bvh"]


def test_the_longest_suffix_names_the_form() -> None:
    assert export.find_form("a.long.csv").suffix == ".long.csv"
    assert export.find_form("A.CSV").suffix == ".csv"
    assert export.find_form("phrases.csv").suffix == ".phrases.csv"
    assert export.find_form("bvh").suffix == ".bvh"
    with pytest.raises(UsageError, match=r"out\.fbx.*known: bvh, glb"):
        export.find_form("out.fbx")


def test_a_missing_package_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(UsageError, match=r"ezc3d.*dance2pose\[c3d\]"):
        export.write(SCENES["metres"](), tmp_path / "out.c3d")
    assert not list(tmp_path.iterdir())


def test_what_a_form_needs_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"no video is known; give it with --video"):
        export.write(SCENES["metres"](), tmp_path / "out.mp4")
    elsewhere = make_scene(make_poses(TIMES), source={"file_name": "dance.mp4"})
    with pytest.raises(UsageError, match=r"its video, dance\.mp4, is not beside .* --video"):
        export.write(elsewhere, tmp_path / "out.mp4")
    with pytest.raises(UsageError, match=r"no keypoints"):
        export.write(make_poses(TIMES), tmp_path / "out.keypoints.csv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", [".bvh", ".eaf", ".phrases.csv"])
def test_frames_hours_apart_have_a_rate(tmp_path: Path, suffix: str) -> None:
    times = np.arange(8) * 33_333.3
    export.write(make_poses(times), tmp_path / f"slow{suffix}")
    assert even(times, np.zeros((8, 1, 3))).rate == pytest.approx(1 / 33_333.3, rel=1e-3)


def test_dancers_in_different_units_make_no_scene() -> None:
    with pytest.raises(UsageError, match="body heights and metres"):
        make_scene(make_poses(TIMES), make_poses(TIMES, person=2, unit="body heights"))
    with pytest.raises(UsageError, match="no dancer"):
        ExportScene(())


# BVH


@pytest.mark.parametrize("name", ["metres", "body heights, path not known"])
def test_bvh_gives_the_joints_back(tmp_path: Path, name: str) -> None:
    scene = SCENES[name]()
    poses = scene.dancers[0].poses
    _, notes = export.write(scene, tmp_path / "out.bvh")
    read = read_bvh(tmp_path / "out.bvh")
    np.testing.assert_allclose(read.time_s, TIMES, atol=1e-6)
    assert farthest(read.xyz, places(poses)) < 0.01 * MM
    unit = "cm" if name == "metres" else "hundredths of a body height"
    assert f"lengths in {unit}" in notes[0]


def test_bvh_of_variable_times_is_at_its_stated_rate(tmp_path: Path) -> None:
    poses = make_poses(variable_times(121))
    export.write(make_scene(poses), tmp_path / "out.bvh")
    read = read_bvh(tmp_path / "out.bvh")
    start = float(np.ceil(poses.time_s[0] * NTSC - 0.01)) / NTSC
    inside = make_poses(read.time_s + start)
    assert farthest(read.xyz, places(inside)) < 1 * MM


def test_bvh_bridges_a_gap_and_says_so(tmp_path: Path) -> None:
    scene = SCENES["a gap"]()
    _, notes = export.write(scene, tmp_path / "out.bvh")
    assert "11 frames without a pose are bridged by straight lines" in notes
    read = read_bvh(tmp_path / "out.bvh")
    truth = places(scene.dancers[0].poses)
    assert len(read.xyz) == len(truth)
    assert farthest(np.where(np.isnan(truth), np.nan, read.xyz), truth) < 0.01 * MM


def test_bvh_says_how_far_one_length_a_bone_moved_the_joints(tmp_path: Path) -> None:
    poses = make_poses(TIMES)
    poses.xyz[:, SKELETON.index("head")] *= 1 + 0.05 * np.sin(TIMES * 9)[:, None]
    _, notes = export.write(make_scene(poses), tmp_path / "out.bvh")
    (moved,) = [note for note in notes if note.startswith("one length a bone")]
    most = float(moved.split(" to ")[1].split()[0])
    read = read_bvh(tmp_path / "out.bvh")
    assert most == pytest.approx(100 * farthest(read.xyz, places(poses)), abs=0.006)


def test_bones_do_not_spin_about_themselves(tmp_path: Path) -> None:
    """A leg that swings past straight up, where the shortest turn from rest would flip by 180°."""
    times = np.arange(200) / 50
    poses = make_poses(times)
    knee, ankle, toe = (SKELETON.index(f"left_{j}") for j in ("knee", "ankle", "toe"))
    hip = SKELETON.index("left_hip")
    angle = np.linspace(0, 1.2 * np.pi, 200)
    leg = np.stack([0.05 + 0 * angle, -np.cos(angle), np.sin(angle)], axis=1)
    leg /= np.linalg.norm(leg, axis=1, keepdims=True)
    poses.xyz[:, hip:] = poses.xyz[:1, hip:]
    poses.xyz[:, :hip] = poses.xyz[:1, :hip]
    for joint, length in ((knee, 0.4), (ankle, 0.8), (toe, 0.95)):
        poses.xyz[:, joint] = poses.xyz[:, hip] + length * leg
    export.write(make_scene(poses), tmp_path / "out.glb")
    gltf = Gltf(tmp_path / "out.glb")
    _, turns, _ = gltf.channel(gltf.names["dancer_1 LeftUpLeg"], "rotation") or (0, [], 0)
    step = np.degrees(
        np.abs(np.arccos(np.clip(np.abs((turns[1:] * turns[:-1]).sum(axis=1)), 0, 1)) * 2)
    )
    swing = np.degrees(np.arccos(np.clip((leg[1:] * leg[:-1]).sum(axis=1), -1, 1)))
    assert (step < 2.5 * swing.max()).all()


# glTF


@pytest.mark.parametrize("name", SCENES)
def test_gltf_gives_the_joints_back_at_their_true_times(tmp_path: Path, name: str) -> None:
    scene = SCENES[name]()
    export.write(scene, tmp_path / "out.glb")
    gltf = Gltf(tmp_path / "out.glb")
    start = gltf.extras["time 0 is at (s of the video)"]
    assert gltf.extras["unit"] == scene.unit
    assert gltf.extras["provenance"]["note"] == "planted"
    for dancer in scene.dancers:
        poses = dancer.poses
        found = gltf.joints(dancer.name, (poses.time_s - start).astype(np.float32))
        assert farthest(found, places(poses)) < 0.01 * MM


def test_gltf_hides_the_dancer_who_is_not_there(tmp_path: Path) -> None:
    scene = SCENES["two dancers"]()
    export.write(scene, tmp_path / "out.glb")
    hidden = np.isnan(Gltf(tmp_path / "out.glb").joints("dancer_3", TIMES)).all(axis=(1, 2))
    np.testing.assert_array_equal(hidden, (np.arange(61) < 10) | (np.arange(61) >= 50))


def test_the_mannequin_is_bound_to_its_bones_and_closed(tmp_path: Path) -> None:
    export.write(SCENES["metres"](), tmp_path / "out.glb")
    gltf = Gltf(tmp_path / "out.glb")
    (mesh,) = gltf.gltf.meshes
    attributes = mesh.primitives[0].attributes
    weights, nodes = gltf.array(attributes.WEIGHTS_0), gltf.array(attributes.JOINTS_0)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
    assert nodes.max() < len(gltf.gltf.skins[0].joints)
    assert (nodes[weights == 0] == 0).all()
    points, normals = gltf.array(attributes.POSITION), gltf.array(attributes.NORMAL)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    height = np.ptp(points[:, 1])
    assert 1.5 < height < 1.9  # of a body of 1.65 m
    for primitive in mesh.primitives:
        faces = gltf.array(primitive.indices)[:, 0].astype(int).reshape(-1, 3)
        a, b, c = (points[faces[:, i]] for i in range(3))
        outward = np.cross(b - a, c - a)
        assert ((outward * normals[faces[:, 0]]).sum(axis=1) > -1e-9).mean() > 0.98


# C3D and OpenSim


@pytest.mark.parametrize("name", SCENES)
def test_c3d_gives_the_joints_back(tmp_path: Path, name: str) -> None:
    import ezc3d

    scene = SCENES[name]()
    export.write(scene, tmp_path / "out.c3d")
    file = ezc3d.c3d(str(tmp_path / "out.c3d"))
    unit = file["parameters"]["POINT"]["UNITS"]["value"]
    assert unit == [{"metres": "mm", "body heights": "mBH"}[scene.unit]]
    assert c3d_provenance(tmp_path / "out.c3d")["note"] == "planted"
    for dancer in scene.dancers:
        label = f"{dancer.name}:" if len(scene.dancers) > 1 else ""
        read = read_c3d(tmp_path / "out.c3d", label)
        _check_even(read, dancer)


@pytest.mark.parametrize("name", SCENES)
def test_trc_gives_the_joints_back(tmp_path: Path, name: str) -> None:
    scene = SCENES[name]()
    export.write(scene, tmp_path / "out.trc")
    lines = (tmp_path / "out.trc").read_text().splitlines()
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=True))
    unit = {"metres": ("mm", 0.001), "body heights": ("bh", 1.0)}[scene.unit]
    assert header["Units"] == unit[0]
    assert int(header["NumFrames"]) == len(lines) - 6
    assert int(header["NumMarkers"]) == len(MARKERS) * len(scene.dancers)
    for dancer in scene.dancers:
        label = f"{dancer.name}:" if len(scene.dancers) > 1 else ""
        read = read_trc(tmp_path / "out.trc", label, unit[1])
        assert float(header["DataRate"]) == pytest.approx(1 / np.diff(read.time_s).mean(), rel=1e-5)
        _check_even(read, dancer)


def _check_even(read: Read, dancer: SceneDancer) -> None:
    """Joints at an even rate are those of the planted motion at these times; gaps are gaps."""
    poses = dancer.poses
    truth = make_poses(
        read.time_s, person=poses.person, unit=poses.unit, rooted=poses.root is not None
    )
    expected = places(truth)
    known = np.interp(read.time_s, poses.time_s, ~np.isnan(poses.xyz[:, 0, 0]), left=0, right=0)
    outside = (read.time_s < poses.time_s[0] - 1e-4) | (read.time_s > poses.time_s[-1] + 1e-4)
    expected[(known < 1 - 1e-3) | outside] = np.nan
    there = ~np.isnan(read.xyz[:, 0, 0])
    assert abs(int(there.sum()) - int((~np.isnan(expected[:, 0, 0])).sum())) <= 1
    both = there & ~np.isnan(expected[:, 0, 0])
    assert both.sum() > 20
    assert farthest(read.xyz[both], expected[both]) < 1 * MM


def test_c3d_refuses_what_its_frame_numbers_cannot_hold(tmp_path: Path) -> None:
    poses = make_poses(np.array([0.0, 0.01, 0.02, 700.0]))
    with pytest.raises(UsageError, match="65535 at most"):
        export.write(make_scene(poses), tmp_path / "out.c3d")


def test_mot_has_opensims_coordinates_in_degrees_at_true_times(tmp_path: Path) -> None:
    import pandas as pd

    from dance2pose.angles import track_angles

    poses = make_poses(variable_times(61))
    export.write(make_scene(poses), tmp_path / "out.mot")
    lines = (tmp_path / "out.mot").read_text().splitlines()
    end = lines.index("endheader")
    assert "inDegrees=yes" in lines[:end] and "nRows=61" in lines[:end]
    table = pd.read_csv(tmp_path / "out.mot", sep="\t", skiprows=end + 1)
    assert f"nColumns={len(table.columns)}" in lines[:end]
    np.testing.assert_allclose(table["time"], poses.time_s, atol=1e-6)
    angles = track_angles(poses)
    for column, name, sign in (
        ("knee_angle_r", "right_knee_flexion", 1),
        ("hip_adduction_l", "left_hip_abduction", -1),
        ("arm_add_r", "right_shoulder_abduction", -1),
    ):
        np.testing.assert_allclose(table[column], sign * angles[name].degrees, atol=1e-5)
    assert poses.root is not None
    np.testing.assert_allclose(table["pelvis_ty"], poses.root[:, 1], atol=1e-6)


# Tables


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.parametrize("name", SCENES)
def test_wide_tables_hold_joints_and_angles_at_true_times(
    tmp_path: Path, suffix: str, name: str
) -> None:
    import pandas as pd

    from dance2pose.angles import track_angles

    scene = SCENES[name]()
    path = tmp_path / f"out{suffix}"
    export.write(scene, path)
    table = pd.read_csv(path) if suffix == ".csv" else pd.read_parquet(path)
    unit = {"metres": "m", "body heights": "bh"}[scene.unit]
    for dancer in scene.dancers:
        poses = dancer.poses
        rows = table[table["dancer"] == dancer.person]
        np.testing.assert_array_equal(rows["frame"], poses.frame)
        np.testing.assert_array_equal(rows["time_s"], poses.time_s)
        columns = [f"{j}_{axis}_{unit}" for j in SKELETON.joints for axis in "xyz"]
        found = rows[columns].to_numpy().reshape(len(poses), -1, 3)
        np.testing.assert_array_equal(found, places(poses))
        knee = track_angles(poses)["left_knee_flexion"]
        np.testing.assert_array_equal(rows["left_knee_flexion_deg"], knee.degrees)
        np.testing.assert_array_equal(rows["left_knee_flexion_sigma_deg"], knee.sigma_deg)


def test_parquet_carries_unit_axes_and_provenance(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    export.write(SCENES["metres"](), tmp_path / "out.parquet")
    metadata = pq.read_schema(tmp_path / "out.parquet").metadata
    assert metadata[b"unit"] == b"metres" and b"y up" in metadata[b"axes"]
    assert json.loads(metadata[b"dance2pose"])["note"] == "planted"


def test_long_table_has_a_row_a_joint_and_empty_cells_in_a_gap(tmp_path: Path) -> None:
    import pandas as pd

    scene = SCENES["a gap"]()
    poses = scene.dancers[0].poses
    export.write(scene, tmp_path / "out.long.csv")
    text = (tmp_path / "out.long.csv").read_text()
    assert "nan" not in text.lower()
    table = pd.read_csv(tmp_path / "out.long.csv")
    assert len(table) == 61 * 17
    head = table[table["joint"] == "head"]
    found = head[["x_m", "y_m", "z_m"]].to_numpy()
    np.testing.assert_array_equal(found, places(poses)[:, SKELETON.index("head")])
    assert head["x_m"].isna().sum() == 11


def test_keypoint_table_has_a_row_a_keypoint(tmp_path: Path) -> None:
    import pandas as pd

    scene = SCENES["two dancers"]()
    export.write(scene, tmp_path / "out.keypoints.csv")
    table = pd.read_csv(tmp_path / "out.keypoints.csv")
    track = scene.dancers[1].keypoints
    assert track is not None
    rows = table[table["dancer"] == 3]
    np.testing.assert_array_equal(rows[["x_px", "y_px"]].to_numpy(), track.xy.reshape(-1, 2))
    assert rows["confidence"].to_numpy()[3] == 0
    assert list(rows["keypoint"][:3]) == ["nose", "left_eye", "right_eye"]


def test_json_holds_everything_and_null_where_nothing_is_known(tmp_path: Path) -> None:
    scene = SCENES["a gap"]()
    poses = scene.dancers[0].poses
    export.write(scene, tmp_path / "out.json")
    content = json.loads((tmp_path / "out.json").read_text(), parse_constant=pytest.fail)
    (dancer,) = content["dancers"]
    assert (content["unit"], content["provenance"]["note"]) == ("metres", "planted")
    assert dancer["xyz"][25][3] == [None, None, None]
    np.testing.assert_array_equal(np.array(dancer["xyz"], float), poses.xyz)
    assert dancer["time_s"] == poses.time_s.tolist()
    assert dancer["joints"] == list(SKELETON.joints)


# movement


@pytest.mark.parametrize("name", SCENES)
def test_netcdf_has_the_form_of_movements_datasets(tmp_path: Path, name: str) -> None:
    xarray = pytest.importorskip("xarray")
    scene = SCENES[name]()
    export.write(scene, tmp_path / "out.nc")
    with xarray.open_dataset(tmp_path / "out.nc") as data:
        assert data["position"].dims == ("time", "space", "keypoints", "individuals")
        assert data["confidence"].dims == ("time", "keypoints", "individuals")
        assert list(data["keypoints"].values) == list(SKELETON.joints)
        assert data.attrs["ds_type"] == "poses" and data.attrs["time_unit"] == "seconds"
        assert data.attrs["unit"] == scene.unit
        for dancer in scene.dancers:
            poses = dancer.poses
            one = data["position"].sel(individuals=dancer.name, time=poses.time_s)
            np.testing.assert_array_equal(
                one.transpose("time", "keypoints", "space"), places(poses)
            )


# ELAN


def test_elan_file_is_valid_and_its_tiers_are_read_by_pympi(tmp_path: Path) -> None:
    import pympi
    import xmlschema

    from elan_making import EAF_SCHEMA

    video = tmp_path / "a dance.mp4"
    video.write_bytes(b"no picture is needed")
    scene = make_scene(
        moving_and_resting(1), moving_and_resting(2), video=video, artist="Ânia & <Co>"
    )
    export.write(scene, tmp_path / "out.eaf")
    xmlschema.XMLSchema(EAF_SCHEMA).validate(str(tmp_path / "out.eaf"))
    file = pympi.Elan.Eaf(str(tmp_path / "out.eaf"))
    assert set(file.get_tier_names()) == {
        *("dancer_1", "dancer_1 key poses", "dancer_2", "dancer_2 key poses")
    }
    phrases = file.get_annotation_data_for_tier("dancer_1")
    assert [value for _, _, value in phrases] == ["phrase 1", "phrase 2", "phrase 3"]
    assert [round(start / 1000) for start, _, _ in phrases] == [0, 3, 6]
    (media,) = file.get_linked_files()
    assert media["RELATIVE_MEDIA_URL"] == "./a dance.mp4" and media["MIME_TYPE"] == "video/mp4"
    property_ = ET.parse(tmp_path / "out.eaf").find("HEADER/PROPERTY")
    assert property_ is not None and json.loads(property_.text or "")["artist"] == "Ânia & <Co>"


def moving_and_resting(person: int) -> Track3D:
    """Nine seconds of motion that comes to rest at 3 and 6 s."""
    times = np.arange(0, 9, 1 / 50)
    slow = times - np.sin(2 * np.pi * times / 3) * 3 / (2 * np.pi)  # speed 1 - cos
    poses = make_poses(slow * 2, person=person, rooted=False)
    return make_poses_at(poses, times)


def make_poses_at(poses: Track3D, times: np.ndarray) -> Track3D:
    import dataclasses

    return dataclasses.replace(poses, timeline=Timeline(poses.frame, times))


def test_phrase_table_has_the_same_phrases(tmp_path: Path) -> None:
    import pandas as pd

    export.write(make_scene(moving_and_resting(1)), tmp_path / "out.phrases.csv")
    table = pd.read_csv(tmp_path / "out.phrases.csv")
    phrases = table[table["kind"] == "phrase"]
    np.testing.assert_allclose(phrases["start_s"], [0, 3, 6], atol=0.1)
    np.testing.assert_allclose(phrases["end_s"], [3, 6, 8.98], atol=0.1)
    rests = table[table["kind"] == "key pose"]["start_s"].to_numpy()
    for rest in (3.0, 6.0):
        assert np.abs(rests - rest).min() < 0.1


# Reading a result


def test_a_result_is_read_with_its_other_dancers_and_keypoints(tmp_path: Path) -> None:
    scene = SCENES["two dancers"]()
    for stem, dancer in zip(("out", "out.dancer_3"), scene.dancers, strict=True):
        write_poses(tmp_path / f"{stem}.npz", dancer.poses)
        assert dancer.keypoints is not None
        write_track(tmp_path / f"{stem}.track.npz", dancer.keypoints)
    for name in ("out.npz", "out.rrd"):
        found = export.load_scene(tmp_path / name)
        assert [p.person for p in found.dancers] == [1, 3]
        assert all(p.keypoints is not None for p in found.dancers)
        np.testing.assert_array_equal(
            found.dancers[1].poses.world_xyz, scene.dancers[1].poses.world_xyz
        )


# The even clock


def test_a_hole_in_time_stays_a_hole() -> None:
    times = np.concatenate([np.arange(20), np.arange(60, 80)]) / 25
    motion = even(times, make_poses(times).xyz)
    assert motion.rate == 25 and len(motion.xyz) == 80
    known = ~np.isnan(motion.xyz).any(axis=(1, 2))
    np.testing.assert_array_equal(known, (np.arange(80) < 20) | (np.arange(80) >= 60))


def test_times_that_are_no_seconds_are_refused_before_memory_is_taken() -> None:
    times = np.array([0, 0.04, 0.08, 0.12, 4e9])
    with pytest.raises(DataError, match="are the times seconds"):
        even(times, make_poses(times).xyz)


@pytest.mark.parametrize("rate", [24000 / 1001, 25.0, 30000 / 1001, 30.0, 60000 / 1001, 17.3])
def test_the_rate_is_found_from_times_rounded_to_milliseconds(rate: float) -> None:
    times = np.round(np.arange(200) / rate, 3)
    motion = even(times, make_poses(times).xyz)
    assert motion.rate == pytest.approx(rate, rel=3e-4)
    assert motion.time_s[-1] == pytest.approx(times[-1], abs=1.01 / rate)


# Film


@pytest.fixture
def filmed(tmp_path: Path) -> ExportScene:
    """Two dancers in a small film of variable frame rate; the second is there for some frames."""
    times_ms = [0, 30, 75, 100, 150, 180, 230, 260, 300, 345]
    video = numbered_video(tmp_path / "film.mp4", count=10, times_ms=times_ms)
    times = np.array(times_ms) / 1000
    rows = np.arange(3, 8)
    return make_scene(make_poses(times), make_poses(times[rows], person=2, frame=rows), video=video)


def test_the_film_keeps_every_frame_and_its_time(tmp_path: Path, filmed: ExportScene) -> None:
    export.write(filmed, tmp_path / "over.mp4")
    with av.open(str(tmp_path / "over.mp4")) as container:
        frames = list(container.decode(video=0))
        assert "dance2pose" in container.metadata["comment"]
    found = [float(f.pts * f.time_base) for f in frames if f.pts is not None]
    np.testing.assert_allclose(found, filmed.dancers[0].poses.time_s, atol=1 / 90_000)
    height = frames[0].height
    for number, frame in enumerate(frames):
        image = frame.to_ndarray(format="bgr24")
        film = cv2.resize(image[:, : round(128 * height / 96)], (128, 96))
        assert read_number(film) == number


def test_the_film_shows_keypoints_and_joints_of_those_who_are_there(
    tmp_path: Path, filmed: ExportScene
) -> None:
    export.write(filmed, tmp_path / "over.mp4")
    with av.open(str(tmp_path / "over.mp4")) as container:
        pictures = [f.to_ndarray(format="bgr24").astype(int) for f in container.decode(video=0)]
    width = round(128 * pictures[0].shape[0] / 96)
    coloured = [int((np.ptp(picture[:, width:], axis=2) > 60).sum()) for picture in pictures]
    assert min(coloured) > 200
    alone, both = [0, 1, 2, 8, 9], [3, 4, 5, 6, 7]
    assert np.mean([coloured[i] for i in both]) > 1.4 * np.mean([coloured[i] for i in alone])


def test_a_film_of_other_frames_is_refused(tmp_path: Path, filmed: ExportScene) -> None:
    late = make_poses(np.array([8.0, 8.04]), frame=np.array([200, 201]))
    with pytest.raises((UsageError, VideoError), match=r"film\.mp4"):
        export.write(make_scene(late, video=filmed.video), tmp_path / "over.mp4")
    assert not (tmp_path / "over.mp4").exists()


@pytest.mark.parametrize("suffix", FORMS)
def test_every_form_that_can_hold_it_names_its_maker(
    tmp_path: Path, filmed: ExportScene, suffix: str
) -> None:
    """So that an output is told from a file of someone else's before it is replaced."""
    export.write(filmed, tmp_path / f"out{suffix}")
    said = b"dance2pose" in (tmp_path / f"out{suffix}").read_bytes()
    assert said != (suffix in (".bvh", ".csv", ".long.csv", ".keypoints.csv", ".phrases.csv"))


# Hands and face


def whole_body_track(poses: Track3D) -> Track2D:
    """Keypoints of a whole-body model whose right hand is not seen in the first half."""
    count = len(get("wholebody133"))
    xy = np.random.default_rng(5).uniform(10, 90, (len(poses), count, 2))
    xy[: len(poses) // 2, -21:] = np.nan
    return Track2D.from_arrays(
        xy,
        time_s=poses.time_s,
        frame=poses.frame,
        skeleton="wholebody133",
        image_size=(128, 96),
    )


def test_hands_and_face_leave_as_keypoints_and_not_as_joints(tmp_path: Path) -> None:
    import pandas as pd

    poses = make_poses(TIMES[:8])
    track = whole_body_track(poses)
    scene = ExportScene((SceneDancer(poses, track),))
    export.write(scene, tmp_path / "out.keypoints.csv")
    table = pd.read_csv(tmp_path / "out.keypoints.csv")
    finger = table[table["keypoint"] == "right_index_finger_4"]
    column = get("wholebody133").index("right_index_finger_4")
    np.testing.assert_array_equal(finger[["x_px", "y_px"]].to_numpy(), track.xy[:, column])
    assert finger["x_px"].isna().sum() == 4
    export.write(scene, tmp_path / "out.csv")
    assert not any("finger" in name for name in pd.read_csv(tmp_path / "out.csv").columns)
    write_track(tmp_path / "out.track.npz", track)
    np.testing.assert_allclose(read_track(tmp_path / "out.track.npz").xy, track.xy, rtol=1e-6)
