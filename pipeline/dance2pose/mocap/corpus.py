"""Takes of motion capture on one body: what learning and evaluation start from.

Retargeting keeps every bone's direction and sets its length (METHOD: equal bone lengths for all
subjects), so that shape is not confused with stature. A take is given as `cmu17`, `paper15` or
`body17` joints, each skeleton with bone lengths of its own.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

from dance2pose.body import body_bones_mm, bone_lengths, retarget
from dance2pose.errors import DataError, UsageError
from dance2pose.mocap.asf_amc import read_asf_amc
from dance2pose.mocap.bvh import read_bvh
from dance2pose.mocap.motion import Motion, forward_kinematics
from dance2pose.npz_files import read_arrays
from dance2pose.poses import FloatArray
from dance2pose.skeleton import convert, get

# The nodes of the three rigs (CMU as BVH, Poser as BVH, CMU as ASF/AMC), in the order of cmu17.
_CMU_RIG = tuple(
    "Hips Spine1 LeftArm LeftForeArm LeftHand RightArm RightForeArm RightHand Head LeftUpLeg "
    "LeftLeg LeftFoot LeftToeBase RightUpLeg RightLeg RightFoot RightToeBase".split()
)
_POSER_RIG = tuple(
    "hip chest lShldr lForeArm lHand rShldr rForeArm rHand neck lThigh lShin lFoot lFoot_end "
    "rThigh rShin rFoot rFoot_end".split()
)
_ASF_RIG = tuple(
    "root thorax lhumerus lradius lwrist rhumerus rradius rwrist head lfemur ltibia lfoot ltoes "
    "rfemur rtibia rfoot rtoes".split()
)

# Takes that come as cmu17 positions alone have no node in the skull: the point between the ears
# lies beyond the base of the skull, on the line from the upper back, by this part of that line
# (0.81 of 3.13 units in the CMU rig).
_EARS_BEYOND_HEAD = 0.26


@dataclass(frozen=True)
class Take:
    """One take, on the one body unless it was read with its performer's bones.

    xyz: (T, J, 3) mm, y up, first joint at the origin. root: (T, 3) mm, the first joint's path
    before that, or None where the source has none. rate_hz: frames per second. rig: "cmu",
    "poser", or "" for positions alone.
    """

    name: str
    xyz: FloatArray
    root: FloatArray | None
    rate_hz: float
    skeleton: str = "cmu17"
    rig: str = ""


def cmu17_positions(motion: Motion, source: str = "motion") -> FloatArray:
    """Positions (T, 17, 3) of the cmu17 joints of any known rig, in the file's unit.

    ASF/AMC takes have a thorax bone that the BVH files of the same database lack; it is given no
    length here, so that one take is the same in both formats.
    """
    position, columns = _rig(motion, source)
    return position[:, columns]


def body17_positions(motion: Motion, source: str = "motion") -> FloatArray:
    """Positions (T, 17, 3) of the body17 joints of any known rig, in the file's unit.

    Pelvis and neck are midway between hips and shoulders. The head is the point between the ears:
    in the CMU rig midway between the skull's base and its end site; in the Poser rig, which has
    eyes but no such end, at the height of the eyes above the base of the skull.
    """
    position, columns = _rig(motion, source)
    return _body17_from(position[:, columns], _between_ears(motion, position))


def _rig(motion: Motion, source: str) -> tuple[FloatArray, list[int]]:
    """Positions of all nodes, and the columns of cmu17's joints."""
    for rig in (_CMU_RIG, _POSER_RIG, _ASF_RIG):
        if all(node in motion.names for node in rig):
            if rig is _ASF_RIG:
                motion = _without_thorax(motion)
            return forward_kinematics(motion)[0], [motion.names.index(node) for node in rig]
    raise DataError(
        f"{source}: its joints are of no known rig; expected all of one of these sets: "
        + "; ".join(" ".join(rig) for rig in (_CMU_RIG, _POSER_RIG, _ASF_RIG))
    )


def _without_thorax(motion: Motion) -> Motion:
    offsets = motion.offsets.copy()
    thorax = motion.names.index("thorax")
    offsets[[i for i, parent in enumerate(motion.parents) if parent == thorax]] = 0
    return replace(motion, offsets=offsets)


def _between_ears(motion: Motion, position: FloatArray) -> FloatArray:
    node = {name: position[:, i] for i, name in enumerate(motion.names)}
    for base, end in (("Head", "Head_end"), ("head", "head_end")):
        if base in node and end in node:
            middle: FloatArray = (node[base] + node[end]) / 2
            return middle
    eyes = motion.offsets[motion.names.index("leftEye")]
    rotation = forward_kinematics(motion)[1][:, motion.names.index("head")]
    ears: FloatArray = node["head"] + rotation @ np.array([0.0, eyes[1], 0.0])
    return ears


def _body17_from(cmu17: FloatArray, ears: FloatArray) -> FloatArray:
    confidence = np.ones(cmu17.shape[:-1])
    xyz = convert(cmu17, confidence, source="cmu17", target="body17")[0]
    xyz[:, get("body17").index("head")] = ears
    return xyz


def body17_from_cmu17(cmu17: FloatArray) -> FloatArray:
    """body17 positions (T, 17, 3) from cmu17 positions alone: the skull continues the neck."""
    skeleton = get("cmu17")
    head = cmu17[:, skeleton.index("head")]
    neck = head - cmu17[:, skeleton.index("upper_back")]
    return _body17_from(cmu17, head + _EARS_BEYOND_HEAD * neck)


def resample(take: Take, rate_hz: float) -> Take:
    """The take at another frame rate, its first frame kept; no filter against aliasing.

    Positions follow a cubic spline through the frames, bones keep their lengths. The last frame
    is the last that lies within the take. Raises UsageError for a rate that is not positive.
    """
    if not (np.isfinite(rate_hz) and rate_hz > 0):
        raise UsageError(f"frame rate of {rate_hz} Hz; expected a positive number")
    frames = len(take.xyz)
    count = int(np.floor((frames - 1) * rate_hz / take.rate_hz + 1e-6)) + 1
    at = np.minimum(np.arange(count) * take.rate_hz / rate_hz, frames - 1)
    xyz = _interpolated(take.xyz, at)
    skeleton = get(take.skeleton)
    xyz = retarget(xyz, skeleton, bone_lengths(take.xyz, skeleton))
    root = None if take.root is None else _interpolated(take.root, at)
    return replace(take, xyz=xyz, root=root, rate_hz=rate_hz)


def _interpolated(values: FloatArray, at: FloatArray) -> FloatArray:
    """Values (T, ...) at fractional frames `at`; exact where those are whole."""
    if np.array_equal(at, np.round(at)):
        taken: FloatArray = values[at.astype(np.int64)]
        return taken
    spline = make_interp_spline(np.arange(len(values)), values, k=min(3, len(values) - 1))
    out: FloatArray = spline(at)
    return out


def read_take(path: Path, skeleton: str = "cmu17", *, own_bones: bool = False) -> Take:
    """A BVH take on the one body, with the corpus's traps undone (rest pose, rates, units).

    own_bones: on its performer's bones instead, scaled to the one body's sum of bone lengths.
    """
    motion = read_bvh(path)
    rate = 60.0 if _is_mislabelled(path.stem, motion) else 1 / motion.frame_time_s
    if "Hips" in motion.names:  # the first frame of these files is an inserted rest pose
        if len(motion) < 2:
            raise DataError(f"{path}: holds the rest pose alone, no frame of motion")
        motion = motion.frames(slice(1, None))
    return _on_body(path.stem, motion, str(path), round(rate, 3), skeleton, own_bones=own_bones)


def _is_mislabelled(name: str, motion: Motion) -> bool:
    """Whether a take is one of those of the CMU database that say 120 Hz and are 60: the salsa of
    subject 60 on the Poser rig. A name alone tells nothing of a rate."""
    says_120 = abs(1 / motion.frame_time_s - 120.0) < 1.0
    return bool(re.fullmatch(r"60_salsa_\d\d", name)) and "hip" in motion.names and says_120


def read_asf_amc_take(
    asf: Path, amc: Path, skeleton: str = "cmu17", *, own_bones: bool = False
) -> Take:
    """An ASF/AMC take of the CMU database (120 Hz) on the one body, or on its performer's bones."""
    motion = read_asf_amc(asf, amc)
    return _on_body(amc.stem, motion, str(asf), 120.0, skeleton, own_bones=own_bones)


def _on_body(
    name: str, motion: Motion, source: str, rate: float, skeleton: str, *, own_bones: bool = False
) -> Take:
    lengths = body_bones_mm(skeleton)
    if skeleton == "body17":
        xyz = body17_positions(motion, source)
    else:
        xyz = cmu17_positions(motion, source)
        xyz = convert(xyz, np.ones(xyz.shape[:-1]), source="cmu17", target=skeleton)[0]
    tree = get(skeleton)
    own = bone_lengths(xyz, tree)
    to_mm = lengths.sum() / own.sum()
    if own_bones:
        lengths = own * to_mm
    rig = "poser" if all(node in motion.names for node in _POSER_RIG) else "cmu"
    return Take(name, retarget(xyz, tree, lengths), xyz[:, 0] * to_mm, rate, skeleton, rig)


def read_takes(source: Path, skeleton: str = "cmu17", *, own_bones: bool = False) -> Iterator[Take]:
    """Every .bvh and .amc of a folder, and every take of a .npz of cmu17 positions, in name order.

    source: a folder or one such file. The skeleton (.asf) of an .amc file lies beside it under the
    name of the subject: 02.asf of 02_01.amc. own_bones: as in `read_take`; takes of a .npz are on
    the one body anyway. Raises DataError for what cannot be read.
    """
    files = [source]
    if source.is_dir():
        files = sorted(p for p in source.iterdir() if p.suffix in (".bvh", ".amc", ".npz"))
        if not files:
            raise DataError(f"{source}: holds no .bvh, no .amc and no .npz")
    for path in files:
        if path.suffix == ".bvh":
            yield read_take(path, skeleton, own_bones=own_bones)
        elif path.suffix == ".amc":
            asf = path.with_name(f"{path.stem.split('_')[0]}.asf")
            yield read_asf_amc_take(asf, path, skeleton, own_bones=own_bones)
        else:
            yield from _takes_of_npz(path, skeleton)


def _takes_of_npz(path: Path, skeleton: str) -> Iterator[Take]:
    """Takes of 120 Hz, one array (T, 17, 3) each, mm, y up, root at the origin."""
    tree, lengths = get(skeleton), body_bones_mm(skeleton)
    for name, xyz in read_arrays(path).items():
        if xyz.dtype.kind != "f" or xyz.ndim != 3 or xyz.shape[1:] != (17, 3):
            raise DataError(
                f"{path}: {name} is {xyz.dtype} {xyz.shape}, expected floats (T, 17, 3)"
            )
        if len(xyz) == 0 or not np.isfinite(xyz).all():
            raise DataError(f"{path}: {name} holds no frame, or values that are not finite")
        xyz = xyz.astype(float)
        if skeleton == "body17":
            xyz = body17_from_cmu17(xyz)
        else:
            xyz = convert(xyz, np.ones(xyz.shape[:-1]), source="cmu17", target=skeleton)[0]
        yield Take(name, retarget(xyz, tree, lengths), None, 120.0, skeleton)
