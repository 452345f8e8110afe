"""Motion-capture readers, the two formats against each other, and takes on the one body."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose.body import BODY_HEIGHT_MM, body_bones_mm, bone_lengths, retarget
from dance2pose.errors import DataError, UsageError
from dance2pose.mocap.asf_amc import read_asf_amc
from dance2pose.mocap.bvh import read_bvh
from dance2pose.mocap.corpus import (
    Take,
    cmu17_positions,
    read_asf_amc_take,
    read_take,
    read_takes,
    resample,
)
from dance2pose.mocap.motion import forward_kinematics
from dance2pose.skeleton import get

BVH = """HIERARCHY
ROOT hip
{
  OFFSET 1 2 3
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT knee
  {
    OFFSET 0 -4 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 0 5
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.02
0 0 0 0 0 0 0 0 0
10 20 30 90 20 -30 0 90 0
"""

ASF = """# made by hand
:version 1.10
:units
  mass 1.0
  length 0.45
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name thigh
     direction 0 -1 0
     length 4
     axis 0 0 20 XYZ
    dof rx rz
    limits (-160.0 20.0)
           (-70.0 70.0)
  end
  begin
     id 2
     name foot
     direction 0 0 1
     length 5
     axis 0 0 0 XYZ
  end
:hierarchy
  begin
    root thigh
    thigh foot
  end
"""
AMC = """:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 0 0 0
thigh 0 0
2
root 1 2 3 0 90 0
thigh 30 -40
"""


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def test_bvh_forward_kinematics_by_hand(tmp_path: Path) -> None:
    motion = read_bvh(written(tmp_path, "a.bvh", BVH))
    position, _ = forward_kinematics(motion)
    assert motion.names == ("hip", "knee", "knee_end")
    assert motion.frame_time_s == 0.02
    np.testing.assert_allclose(position[0], [[0, 0, 0], [0, -4, 0], [0, -4, 5]], atol=1e-12)
    hip = Rotation.from_euler("ZYX", [90, 20, -30], degrees=True)
    knee = Rotation.from_euler("X", 90, degrees=True)
    at_knee = np.array([10, 20, 30]) + hip.apply([0, -4, 0])
    expected = [[10, 20, 30], at_knee, at_knee + (hip * knee).apply([0, 0, 5])]
    np.testing.assert_allclose(position[1], expected, atol=1e-12)


def test_asf_amc_forward_kinematics_by_hand(tmp_path: Path) -> None:
    motion = read_asf_amc(written(tmp_path, "a.asf", ASF), written(tmp_path, "a.amc", AMC))
    position, _ = forward_kinematics(motion)
    assert motion.names == ("root", "thigh", "foot", "foot_end")
    assert motion.frame_time_s == 1 / 120
    np.testing.assert_allclose(position[0, 2:], [[1, -2, 3], [1, -2, 8]], atol=1e-12)
    root = Rotation.from_euler("y", 90, degrees=True)
    axes = Rotation.from_euler("z", 20, degrees=True)
    # Extrinsic: first about the bone's x, then about its z.
    turn = Rotation.from_euler("z", -40, degrees=True) * Rotation.from_euler("x", 30, degrees=True)
    thigh = root * axes * turn * axes.inv()
    foot = np.array([1, 2, 3]) + thigh.apply([0, -4, 0])
    np.testing.assert_allclose(position[1, 2], foot, atol=1e-12)
    np.testing.assert_allclose(position[1, 3], foot + thigh.apply([0, 0, 5]), atol=1e-12)


@pytest.mark.shared
@pytest.mark.parametrize("take", ["02_01", "02_03", "03_01"])
def test_both_formats_of_one_take_agree(shared: Path, take: str) -> None:
    """The BVH files lack the thorax bone, which `cmu17_positions` gives no length; then all joints
    agree to 0.01 mm, which is what the rounding of the BVH numbers leaves."""
    mocap = shared / "mocap"
    asf, amc = mocap / "asfamc" / f"{take[:2]}.asf", mocap / "asfamc" / f"{take}.amc"
    bvh = mocap / "train" / f"{take}.bvh"
    if not bvh.exists():
        bvh = mocap / "eval" / f"{take}.bvh"
    if not bvh.exists():
        pytest.skip(f"{take} exists in one format only")
    from_asf = cmu17_positions(read_asf_amc(asf, amc))
    from_bvh = cmu17_positions(read_bvh(bvh))[1:]  # without the inserted rest pose
    unit_mm = 25.4 / 0.45
    apart = np.linalg.norm(from_asf - from_bvh, axis=-1) * unit_mm
    assert apart.max(axis=0).max() < 0.01
    as_takes = read_asf_amc_take(asf, amc).xyz, read_take(bvh).xyz
    assert np.abs(as_takes[0] - as_takes[1]).max() < 0.05


@pytest.mark.shared
@pytest.mark.parametrize("skeleton", ["cmu17", "paper15", "body17"])
@pytest.mark.parametrize("take", ["02_01", "60_salsa_01"])
def test_takes_of_both_rigs_stand_on_the_one_body(shared: Path, take: str, skeleton: str) -> None:
    read = read_take(shared / "mocap" / "train" / f"{take}.bvh", skeleton)
    known = get(skeleton)
    bones = np.array(known.bones)
    lengths = np.linalg.norm(read.xyz[:, bones[:, 1]] - read.xyz[:, bones[:, 0]], axis=-1)
    np.testing.assert_allclose(lengths, np.broadcast_to(body_bones_mm(skeleton), lengths.shape))
    assert read.rate_hz == (60 if "salsa" in take else pytest.approx(120))
    assert not read.xyz[:, 0].any()
    joint = {name: read.xyz[:, i] for i, name in enumerate(known.joints)}
    # People walk and dance upright here: head over shoulders over knees over ankles.
    heights = [np.median(joint[j][:, 1]) for j in ("left_ankle", "left_knee", "head")]
    assert heights[0] < heights[1] < 0 < heights[2]
    # The body's left is to the left of where it faces: toes and knees bend that way.
    across = joint["left_hip"] - joint["right_hip"]
    front = np.cross(across, [0.0, 1.0, 0.0])
    thigh = joint["left_knee"] - joint["left_hip"]
    shin = joint["left_ankle"] - joint["left_knee"]
    bend = (front * (thigh / 400 - shin / 400)).sum(axis=-1)
    assert np.median(bend) > 0


@pytest.mark.shared
def test_positions_of_the_actions_corpus_become_takes(shared: Path) -> None:
    folder = shared / "mocap" / "train_positions"
    cmu = next(iter(read_takes(folder)))
    body = next(iter(read_takes(folder, "body17")))
    assert cmu.name == body.name and cmu.xyz.shape == body.xyz.shape
    np.testing.assert_allclose(bone_lengths(body.xyz, get("body17")), body_bones_mm("body17"))
    # The same skull: the base of it and the point between the ears lie in one direction.
    neck = cmu.xyz[:, 8] - cmu.xyz[:, 1]
    head = body.xyz[:, 8] - body.xyz[:, 1]
    cosine = (neck * head).sum(-1) / np.linalg.norm(neck, axis=-1) / np.linalg.norm(head, axis=-1)
    assert cosine.min() > 0.8


def test_bodies_are_about_as_tall_as_they_are_said_to_be() -> None:
    for skeleton in ("cmu17", "body17", "paper15"):
        known = get(skeleton)
        bones = {child: body_bones_mm(skeleton)[i] for i, (_, child) in enumerate(known.edges)}
        leg = bones["left_knee"] + bones["left_ankle"]
        assert 0.45 < leg / BODY_HEIGHT_MM < 0.55


def test_retargeting_sets_lengths_and_keeps_directions() -> None:
    rng = np.random.default_rng(0)
    known = get("paper15")
    xyz = rng.normal(size=(7, 15, 3))
    lengths = rng.uniform(1, 2, 14)
    out = retarget(xyz, known, lengths)
    for bone, (parent, child) in enumerate(known.bones):
        before, after = xyz[:, child] - xyz[:, parent], out[:, child] - out[:, parent]
        np.testing.assert_allclose(np.linalg.norm(after, axis=1), lengths[bone])
        assert np.abs(np.cross(before, after)).max() < 1e-9
        assert ((before * after).sum(axis=1) > 0).all()


def swinging(frames: int, rate_hz: float) -> Take:
    """A made-up take: the whole body turning about the vertical at 0.5 turns a second."""
    t = np.arange(frames) / rate_hz
    pose = retarget(
        np.random.default_rng(1).normal(size=(1, 17, 3)), get("cmu17"), body_bones_mm("cmu17")
    )
    turn = Rotation.from_euler("y", (np.pi * t)[:, None]).as_matrix()
    root = np.stack([1000 * t, 0 * t, 0 * t], axis=1)
    return Take("swinging", pose @ turn.transpose(0, 2, 1), root, rate_hz)


@pytest.mark.parametrize("rate_hz", [25.0, 60.0, 144.0, 240.0])
def test_rate_conversion_follows_the_motion(rate_hz: float) -> None:
    take = resample(swinging(121, 120.0), rate_hz)
    expected = swinging(len(take.xyz), rate_hz)
    assert len(take.xyz) == int(rate_hz) + 1
    assert take.rate_hz == rate_hz
    np.testing.assert_allclose(take.xyz, expected.xyz, atol=0.1)
    assert take.root is not None and expected.root is not None
    np.testing.assert_allclose(take.root, expected.root, atol=1e-6)


def test_rate_conversion_keeps_bone_lengths_and_whole_frames() -> None:
    take = swinging(31, 30.0)
    np.testing.assert_allclose(
        bone_lengths(resample(take, 25.0).xyz, get("cmu17")), body_bones_mm("cmu17")
    )
    np.testing.assert_allclose(resample(take, 15.0).xyz, take.xyz[::2])
    one = resample(Take("one", take.xyz[:1], None, 30.0), 60.0)
    np.testing.assert_allclose(one.xyz, take.xyz[:1])


@pytest.mark.parametrize("rate_hz", [0.0, -25.0, float("nan"), float("inf")])
def test_impossible_rates_are_refused(rate_hz: float) -> None:
    with pytest.raises(UsageError, match="positive"):
        resample(swinging(5, 30.0), rate_hz)


def without(text: str, line: str) -> str:
    assert line in text
    return text.replace(line, "", 1)


BROKEN_BVH = {
    "empty": ("", ":1: expected HIERARCHY"),
    "no motion section": (BVH.split("MOTION")[0], "no MOTION"),
    "fewer rows than the header says": (BVH.rsplit("10 20", 1)[0], "1 rows of motion"),
    "cut in a row": (BVH.rsplit("90 0\n", 1)[0], ":20: 7 values, expected 9"),
    "cut in the hierarchy": (BVH.replace("}\n}\nMOTION", "}\nMOTION"), "not closed"),
    "wrong channel count": (BVH.replace("CHANNELS 3", "CHANNELS 4"), ":9: not understood"),
    "unknown channel": (BVH.replace("Zrotation Xr", "Wrotation Xr"), ":9: unknown channel"),
    "second root": (BVH.replace("MOTION", "ROOT b\n{\n}\nMOTION"), ":16: not understood"),
    "word for a number": (BVH.replace("10 20 30", "10 x 30"), ":20: not a number"),
    "not finite": (BVH.replace("10 20 30", "10 nan 30"), "not finite"),
    "offset of a word": (BVH.replace("OFFSET 0 -4 0", "OFFSET 0 b 0"), ":8: not understood"),
    "no frames": (BVH.replace("Frames: 2", "Frames: 0"), "0 frames"),
    "frame time of zero": (BVH.replace("0.02", "0.0"), "of 0.0 s"),
    "no frame count": (BVH.replace("Frames: 2", "Frames: many"), "expected 'Frames: N'"),
}


@pytest.mark.parametrize("fault", BROKEN_BVH)
def test_broken_bvh_is_one_clear_error(tmp_path: Path, fault: str) -> None:
    text, message = BROKEN_BVH[fault]
    path = written(tmp_path, "broken.bvh", text)
    with pytest.raises(DataError) as caught:
        read_bvh(path)
    assert str(caught.value).startswith(str(path)) and message in str(caught.value)


BROKEN_ASF = {
    "empty": ("", "no :hierarchy"),
    "truncated": (ASF.split(":hierarchy")[0], "no :hierarchy"),
    "radians": (ASF.replace("angle deg", "angle rad"), ":6: not understood: angles in radians"),
    "bone without a length": (without(ASF, "     length 4\n"), "a bone without 'length'"),
    "bone without a parent": (without(ASF, "    thigh foot\n"), "foot"),
    "unknown bone": (ASF.replace("thigh foot", "thigh toe"), "'toe' is not in :bonedata"),
    "unknown freedom": (ASF.replace("dof rx rz", "dof rx lz"), "'lz'"),
    "two values for a direction": (ASF.replace("0 -1 0", "0 -1"), "2 values, expected 3"),
    "not finite": (ASF.replace("length 4", "length inf"), "not finite"),
}
BROKEN_AMC = {
    "empty": ("", "holds no frame"),
    "no frame number": ("root 1 2 3 0 0 0\n", ":1: 'root' before the first frame"),
    "truncated": (AMC.replace("thigh 30 -40\n", ""), "frame 2 ends without thigh"),
    "wrong channel count": (AMC.replace("30 -40", "30"), ":8: thigh: 1 values, expected 2"),
    "unknown bone": (AMC.replace("thigh 30", "toe 30"), ":8: 'toe' does not move"),
    "word for a number": (AMC.replace("30 -40", "30 x"), ":8: thigh:"),
    "radians": (AMC.replace(":DEGREES", ":RADIANS"), ":2: angles in radians"),
}


@pytest.mark.parametrize("fault", BROKEN_ASF)
def test_broken_asf_is_one_clear_error(tmp_path: Path, fault: str) -> None:
    text, message = BROKEN_ASF[fault]
    asf, amc = written(tmp_path, "a.asf", text), written(tmp_path, "a.amc", AMC)
    with pytest.raises(DataError) as caught:
        read_asf_amc(asf, amc)
    assert str(caught.value).startswith(str(asf)) and message in str(caught.value)


@pytest.mark.parametrize("fault", BROKEN_AMC)
def test_broken_amc_is_one_clear_error(tmp_path: Path, fault: str) -> None:
    text, message = BROKEN_AMC[fault]
    asf, amc = written(tmp_path, "a.asf", ASF), written(tmp_path, "a.amc", text)
    with pytest.raises(DataError) as caught:
        read_asf_amc(asf, amc)
    assert str(caught.value).startswith(str(amc)) and message in str(caught.value)


def test_files_that_are_not_there_or_of_no_known_rig(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    with pytest.raises(DataError, match="gone"):
        read_bvh(gone)
    with pytest.raises(DataError, match="gone"):
        read_asf_amc(gone, gone)
    with pytest.raises(DataError, match="no known rig"):
        read_take(written(tmp_path, "a.bvh", BVH))
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match=r"no \.bvh"):
        list(read_takes(tmp_path / "empty"))
    with pytest.raises(UsageError, match="coco17"):
        body_bones_mm("coco17")


def test_positions_of_the_wrong_shape_or_pickled_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", take=np.zeros((7, 15, 3)))
    with pytest.raises(DataError, match=r"take is float64 \(7, 15, 3\)"):
        list(read_takes(tmp_path / "a.npz"))
    np.savez(tmp_path / "b.npz", take=np.array([{"x": 1}], dtype=object))
    with pytest.raises(DataError, match=r"b\.npz"):
        list(read_takes(tmp_path / "b.npz"))
    (tmp_path / "c.npz").write_bytes(b"PK\x03\x04 truncated")
    with pytest.raises(DataError, match=r"c\.npz"):
        list(read_takes(tmp_path / "c.npz"))
