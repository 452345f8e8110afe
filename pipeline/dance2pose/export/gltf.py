"""glTF binary (.glb): mannequins that play in any glTF viewer, at the true times of the frames.

y up, the dancer faces +z. One unit is a metre, or a body height where the height is not known. A
gap hides the mannequin. Time 0 of the animation is the first frame; `asset.extras` says where in
the video that is, the unit and the provenance.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dance2pose import __version__
from dance2pose.even_rate import bridged, is_known, runs, step_s
from dance2pose.export.extras import need
from dance2pose.export.mannequin import SIDES, make_mesh
from dance2pose.export.rig import Rig, make_rig, rest_directions
from dance2pose.export.scene import AXES, ExportScene, SceneDancer
from dance2pose.poses import FloatArray
from dance2pose.recording.placement import SPACING, floor_height

_FLOAT, _UNSIGNED_BYTE, _UNSIGNED_INT = 5126, 5121, 5125
_VERTICES, _INDICES = 34962, 34963
_KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_COLOURS = {
    "middle": (0.86, 0.82, 0.72, 1.0),
    "left": (0.30, 0.55, 0.90, 1.0),
    "right": (0.90, 0.42, 0.32, 1.0),
}


@dataclass
class _Builder:
    """A glTF document under construction: its parts by kind, and its one buffer."""

    gltf: Any
    parts: dict[str, list[Any]] = field(
        default_factory=lambda: {
            kind: []
            for kind in ("accessors", "bufferViews", "nodes", "meshes", "skins", "materials")
        }
    )
    buffer: bytearray = field(default_factory=bytearray)
    channels: list[Any] = field(default_factory=list)
    samplers: list[Any] = field(default_factory=list)

    def add(self, kind: str, part: Any) -> int:
        self.parts[kind].append(part)
        return len(self.parts[kind]) - 1

    def accessor(self, values: npt.NDArray[Any], target: int | None = None) -> int:
        """An array (count, width) in the buffer; its index."""
        kinds = {"f": (_FLOAT, "<f4"), "u": (_UNSIGNED_BYTE, "u1"), "i": (_UNSIGNED_INT, "<u4")}
        component, dtype = kinds[values.dtype.kind]
        array = np.ascontiguousarray(values.reshape(len(values), -1), dtype)
        view = self.gltf.BufferView(
            buffer=0, byteOffset=len(self.buffer), byteLength=array.nbytes, target=target
        )
        self.buffer += array.tobytes()
        self.buffer += bytes(-len(self.buffer) % 4)
        return self.add(
            "accessors",
            self.gltf.Accessor(
                bufferView=self.add("bufferViews", view),
                componentType=component,
                count=len(array),
                type=_KINDS[array.shape[1]],
                min=array.min(axis=0).tolist(),
                max=array.max(axis=0).tolist(),
            ),
        )

    def animate(self, node: int, path: str, times: int, values: FloatArray, how: str) -> None:
        """Give a node an animated translation, rotation or scale."""
        sampler = self.gltf.AnimationSampler(
            input=times, output=self.accessor(values.astype(np.float64)), interpolation=how
        )
        self.samplers.append(sampler)
        target = self.gltf.AnimationChannelTarget(node=node, path=path)
        channel = self.gltf.AnimationChannel(sampler=len(self.samplers) - 1, target=target)
        self.channels.append(channel)


def write_gltf(path: Path, scene: ExportScene) -> tuple[str, ...]:
    """Write all dancers of the scene as one animation; returns what it could not keep."""
    gltf = need("pygltflib", "gltf")
    build = _Builder(gltf)
    for side in SIDES:
        look = gltf.PbrMetallicRoughness(
            baseColorFactor=list(_COLOURS[side]), metallicFactor=0.0, roughnessFactor=0.8
        )
        build.add("materials", gltf.Material(name=side, pbrMetallicRoughness=look))
    start_s = min(float(p.poses.time_s[0]) for p in scene.dancers)
    end_s = max(float(p.poses.time_s[-1]) for p in scene.dancers)
    places, notes = _placed(scene)
    roots = []
    for dancer, place in zip(scene.dancers, places, strict=True):
        roots += _add_dancer(build, dancer, place, start_s, end_s)
    extras = {
        "unit": scene.unit,
        "axes": AXES,
        "time 0 is at (s of the video)": start_s,
        "provenance": json.loads(scene.provenance_json()),
    }
    document = gltf.GLTF2(
        asset=gltf.Asset(generator=f"dance2pose {__version__}", extras=extras),
        scene=0,
        scenes=[gltf.Scene(nodes=roots)],
        animations=[gltf.Animation(name="dance", channels=build.channels, samplers=build.samplers)],
        buffers=[gltf.Buffer(byteLength=len(build.buffer))],
        **build.parts,
    )
    document.set_binary_blob(bytes(build.buffer))
    document.save_binary(str(path))
    return tuple(notes)


def _placed(scene: ExportScene) -> tuple[FloatArray, list[str]]:
    """(N, 3) offsets that put dancers of unknown path side by side on the floor; what was done."""
    places = np.zeros((len(scene.dancers), 3))
    if all(p.poses.root is not None for p in scene.dancers):
        return places, []
    middle = (len(places) - 1) / 2
    places[:, 0] = (np.arange(len(places)) - middle) * SPACING[scene.unit]
    places[:, 1] = [-np.nan_to_num(floor_height(p.poses.world_xyz)) for p in scene.dancers]
    return places, ["dancers stand on the floor side by side: their path is not known"]


def _add_dancer(
    build: _Builder, dancer: SceneDancer, place: FloatArray, start_s: float, end_s: float
) -> list[int]:
    """Nodes, skin, mesh and animation of one dancer; the nodes at the top of the scene."""
    poses, gltf = dancer.poses, build.gltf
    known = is_known(poses.xyz)
    xyz = bridged(poses.time_s, dancer.poses.world_xyz)
    rig = make_rig(poses.time_s, xyz, dancer.skeleton)
    top = build.add("nodes", gltf.Node(name=dancer.name, translation=place.tolist(), children=[]))
    first = top + 1
    for i, node in enumerate(rig.nodes):
        children = [first + c for c, other in enumerate(rig.nodes) if other.parent == i]
        offset = rig.offsets[i] if i else rig.root[np.argmax(known)]
        build.add(
            "nodes",
            gltf.Node(
                name=f"{dancer.name} {node.name}",
                translation=offset.tolist(),
                children=children or None,
            ),
        )
    build.parts["nodes"][top].children = [first]
    body = _add_body(build, dancer, rig, first)
    if known.any():
        _add_motion(build, dancer, rig, xyz, first, start_s)
        _add_presence(build, dancer, top, start_s, end_s)
    return [top, body]


def _add_body(build: _Builder, dancer: SceneDancer, rig: Rig, first: int) -> int:
    """The skinned mesh; the index of its node."""
    gltf, mesh = build.gltf, make_mesh(rig, dancer.skeleton)
    attributes = gltf.Attributes(
        POSITION=build.accessor(mesh.positions, _VERTICES),
        NORMAL=build.accessor(mesh.normals, _VERTICES),
        JOINTS_0=build.accessor(mesh.nodes.astype(np.uint8), _VERTICES),
        WEIGHTS_0=build.accessor(mesh.weights, _VERTICES),
    )
    primitives = [
        gltf.Primitive(
            attributes=attributes,
            indices=build.accessor(faces.reshape(-1, 1), _INDICES),
            material=SIDES.index(side),
        )
        for side, faces in mesh.triangles.items()
    ]
    shape = build.add("meshes", gltf.Mesh(name=dancer.name, primitives=primitives))
    joints = list(range(first, first + len(rig.nodes)))
    skin = gltf.Skin(
        inverseBindMatrices=build.accessor(_unbinding(rig)), joints=joints, skeleton=first
    )
    node = gltf.Node(name=f"{dancer.name} body", mesh=shape, skin=build.add("skins", skin))
    return build.add("nodes", node)


def _unbinding(rig: Rig) -> FloatArray:
    """(N, 16) inverse bind matrices, by columns: at rest no node is turned."""
    places = np.zeros((len(rig.nodes), 3))
    for i, node in enumerate(rig.nodes):
        if node.parent >= 0:
            places[i] = places[node.parent] + rig.offsets[i]
    matrices = np.tile(np.eye(4), (len(places), 1, 1))
    matrices[:, 3, :3] = -places  # transposed: glTF stores columns
    return matrices.reshape(-1, 16)


def _add_motion(
    build: _Builder,
    dancer: SceneDancer,
    rig: Rig,
    xyz: FloatArray,
    first: int,
    start_s: float,
) -> None:
    """Key frames where a pose is known: turns of all nodes, and their true distances."""
    known = is_known(dancer.poses.xyz)
    times = build.accessor(dancer.poses.time_s[known, None] - start_s)
    rest = rest_directions(dancer.skeleton)
    for i, node in enumerate(rig.nodes):
        build.animate(first + i, "rotation", times, rig.turns[known, i], "LINEAR")
        before = rig.nodes[node.parent].bone if node.parent >= 0 else None
        if node.parent < 0:
            build.animate(first + i, "translation", times, rig.root[known], "LINEAR")
        elif before is not None:
            start, end = dancer.skeleton.bones[before]
            length = np.linalg.norm(xyz[known, end] - xyz[known, start], axis=1, keepdims=True)
            path = np.nan_to_num(length, nan=rig.lengths[before]) * rest[before]
            build.animate(first + i, "translation", times, path, "LINEAR")


def _add_presence(
    build: _Builder, dancer: SceneDancer, top: int, start_s: float, end_s: float
) -> None:
    """Hide the mannequin where there is no pose: its size is 0 there."""
    poses = dancer.poses
    pause = step_s(poses.time_s)
    keys: list[tuple[float, float]] = [(0.0, 0.0)]
    for run in runs(poses.time_s, is_known(poses.xyz), poses.frame):
        begin, end = poses.time_s[run[0]] - start_s, poses.time_s[run[-1]] - start_s
        keys = [key for key in keys if key[0] < begin - 1e-6]
        keys.append((float(begin), 1.0))
        if end + pause / 2 < end_s - start_s:
            keys.append((float(end + pause / 2), 0.0))
    if len(keys) > 1:
        moments, sizes = np.array(keys).T
        scale = np.repeat(sizes[:, None], 3, axis=1)
        build.animate(top, "scale", build.accessor(moments[:, None]), scale, "STEP")
