"""Exports read back by readers that are not ours: times and joints in our axes and unit."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from dance2pose.skeleton import get

SKELETON = get("body17")
# The node of BVH and glTF that sits at each joint, written out by hand.
NODES = dict(
    zip(
        SKELETON.joints,
        "Hips Neck LeftArm LeftForeArm LeftHand RightArm RightForeArm RightHand Head LeftUpLeg "
        "LeftLeg LeftFoot LeftToeBase RightUpLeg RightLeg RightFoot RightToeBase".split(),
        strict=True,
    )
)
MARKERS = (
    "CHip Neck LShoulder LElbow LWrist RShoulder RElbow RWrist Head LHip LKnee LAnkle LBigToe "
    "RHip RKnee RAnkle RBigToe"
).split()


@dataclass
class Read:
    """What a reader found of one dancer: time_s (T,), xyz (T, J, 3); NaN where nothing."""

    time_s: np.ndarray
    xyz: np.ndarray


def read_bvh(path: Path, unit: float = 0.01) -> Read:
    """By the `bvh` package, with forward kinematics of our own. Times count from 0."""
    from bvh import Bvh

    file = Bvh(path.read_text())
    names = file.get_joints_names()
    turns, places = {}, {}
    for name in names:
        local = file.frames_joint_channels(name, ["Zrotation", "Xrotation", "Yrotation"])
        turn = Rotation.from_euler("ZXY", np.array(local, float), degrees=True)
        parent = file.joint_parent(name)
        if parent is None:
            channels = ["Xposition", "Yposition", "Zposition"]
            places[name] = np.array(file.frames_joint_channels(name, channels), float)
            turns[name] = turn
        else:
            offset = np.array(file.joint_offset(name))
            places[name] = places[parent.name] + turns[parent.name].apply(offset)
            turns[name] = turns[parent.name] * turn
    xyz = np.stack([places[NODES[joint]] for joint in SKELETON.joints], axis=1) * unit
    return Read(np.arange(file.nframes) * file.frame_time, xyz)


class Gltf:
    """A .glb by pygltflib, sampled as the glTF specification says."""

    def __init__(self, path: Path) -> None:
        from pygltflib import GLTF2

        self.gltf = GLTF2().load_binary(str(path))
        self.blob = self.gltf.binary_blob()
        self.extras = self.gltf.asset.extras
        self.names = {node.name: i for i, node in enumerate(self.gltf.nodes)}
        self.parent = {c: i for i, n in enumerate(self.gltf.nodes) for c in n.children or []}

    def array(self, index: int) -> np.ndarray:
        accessor = self.gltf.accessors[index]
        view = self.gltf.bufferViews[accessor.bufferView]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}[accessor.type]
        dtype = {5126: "<f4", 5121: "u1", 5125: "<u4"}[accessor.componentType]
        count = accessor.count * width
        values = np.frombuffer(self.blob, dtype, count, view.byteOffset)
        return values.reshape(accessor.count, width).astype(float)

    def channel(self, node: int, path: str) -> tuple[np.ndarray, np.ndarray, str] | None:
        animation = self.gltf.animations[0]
        for channel in animation.channels:
            if channel.target.node == node and channel.target.path == path:
                sampler = animation.samplers[channel.sampler]
                times = self.array(sampler.input)[:, 0]
                return times, self.array(sampler.output), sampler.interpolation
        return None

    def value(self, node: int, path: str, at: np.ndarray, rest: list[float]) -> np.ndarray:
        found = self.channel(node, path)
        if found is None:
            return np.tile(rest, (len(at), 1))
        times, values, how = found
        if how == "STEP":
            return values[np.clip(np.searchsorted(times, at, side="right") - 1, 0, None)]
        at = np.clip(at, times[0], times[-1])
        if path == "rotation":
            return Slerp(times, Rotation.from_quat(values))(at).as_quat()
        return np.stack([np.interp(at, times, column) for column in values.T], axis=1)

    def world(self, node: int, at: np.ndarray) -> tuple[np.ndarray, Rotation]:
        rest = self.gltf.nodes[node]
        place = self.value(node, "translation", at, rest.translation or [0, 0, 0])
        turn = Rotation.from_quat(self.value(node, "rotation", at, rest.rotation or [0, 0, 0, 1]))
        if node not in self.parent:
            return place, turn
        before, about = self.world(self.parent[node], at)
        return before + about.apply(place), about * turn

    def joints(self, dancer: str, at: np.ndarray) -> np.ndarray:
        """(T, J, 3) joints at times of the animation, NaN while the dancer is hidden."""
        top = self.names[dancer]
        nodes = [self.names[f"{dancer} {NODES[joint]}"] for joint in SKELETON.joints]
        xyz = np.stack([self.world(node, at)[0] for node in nodes], axis=1)
        xyz -= np.array(self.gltf.nodes[top].translation or [0, 0, 0])
        xyz[self.value(top, "scale", at, [1, 1, 1])[:, 0] == 0] = np.nan
        return xyz


def read_c3d(path: Path, dancer: str = "", unit: float = 0.001) -> Read:
    import ezc3d

    file = ezc3d.c3d(str(path))
    labels = file["parameters"]["POINT"]["LABELS"]["value"]
    columns = [labels.index(f"{dancer}{name}") for name in MARKERS]
    points = file["data"]["points"][:3, columns].transpose(2, 1, 0)
    points[file["data"]["meta_points"]["residuals"][0][columns].T < 0] = np.nan
    rate = file["parameters"]["POINT"]["RATE"]["value"][0]
    first = file["header"]["points"]["first_frame"]
    xyz = np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1) * unit
    return Read((first + np.arange(len(points))) / rate, xyz)


def read_trc(path: Path, dancer: str = "", unit: float = 0.001) -> Read:
    import pandas as pd

    names = path.read_text().splitlines()[3].split("\t")
    table = pd.read_csv(path, sep="\t", skiprows=6, header=None)
    columns = [names.index(f"{dancer}{name}") for name in MARKERS]
    values = table.to_numpy()
    xyz = np.stack([values[:, c : c + 3] for c in columns], axis=1) * unit
    return Read(values[:, 1], xyz)


def c3d_provenance(path: Path) -> dict[str, object]:
    import ezc3d

    pieces = ezc3d.c3d(str(path))["parameters"]["DANCE2POSE"]["PROVENANCE"]["value"]
    content: dict[str, object] = json.loads("".join(pieces))
    return content
