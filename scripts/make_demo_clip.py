"""Render the bundled clip: a dancer moved by a motion-capture take of Indian dance, on a stage.

    python scripts/make_demo_clip.py MOCAP_FOLDER [-o models] [--still SECONDS]

Writes demo_clip.mp4 (H.264) and demo_truth.npz: time_s (T,), keypoints (T, 23, 2) px of coco23 as
projected, joints (T, 17, 3) of body17 in metres (the clip's world, y up), stature in metres.
Needs moderngl and scikit-image; a software OpenGL is enough (about five minutes on one core).
"""

from __future__ import annotations

import argparse
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from dance2pose.skeleton import convert
from figure_renderer.body import Body, build_body
from figure_renderer.clothes import Outfit, Skirt, lathe
from figure_renderer.outfits import base_uniforms, body_landmarks, crown, gold, hair_surface
from figure_renderer.pool import CLIP_TAKE
from figure_renderer.renderer import Actor, Camera, Light, Mesh, Renderer
from figure_renderer.rig import BONES, Performance, read_performance
from figure_renderer.samples import quad
from figure_renderer.solids import Shape

SIZE = (640, 800)
RATE, START_S, LENGTH_S = 30, 5.0, 10.0
SHAPE = Shape(stature=1.62, girth=1.02, bust=0.6)
RED, GREEN = np.array([0.42, 0.015, 0.05]), np.array([0.01, 0.13, 0.1])


def dancer(body: Body) -> Outfit:
    """A costume after those of Apsara dance: a fitted bodice, a long skirt, a tiered crown."""
    mark = body_landmarks(body)
    values = base_uniforms(body) | {
        "cut": (0.36, mark["ribs"] - 0.012, mark["waist"], 0.7),
        "skin": np.array([0.5, 0.27, 0.16]),
        "top_a": RED,
        "top_b": np.array([0.75, 0.45, 0.08]),
        "bottom_a": GREEN,
        "bottom_b": GREEN,
        "top_pattern": (4.0, 26.0),
        "neckline": (mark["neck"] - 0.04, 0.35),
        "jewels": 1.0,
        "sash": 0.018,
        "lips": np.array([0.45, 0.05, 0.06]),
        "wrinkle": 0.2,
        "thickness": (0.004, 0.004, 0.012, 0.0),
    }
    skirt = Skirt(
        length=0.9,
        flare=0.1,
        pleats=18,
        pleat_depth=0.045,
        uniforms=gold()
        | {
            "kind": 3,
            "colour_a": GREEN,
            "colour_b": np.array([0.6, 0.4, 0.08]),
            "pattern": (4.0, 16.0),
            "finish": (0.25, 0.0),
        },
    )
    hair = hair_surface(np.array([0.02, 0.015, 0.012]))
    bun = (np.array([0.0, 0.06, -0.1]), np.array([0.052, 0.05, 0.042]), hair)
    return Outfit(values, skirt, [(crown(4, 0.2, 0.09), -0.12, gold())], [bun])


def stage() -> list[Mesh]:
    """A boarded floor, a curtain, and two turned columns."""
    plain: dict[str, Any] = gold()
    floor = plain | {
        "kind": 1,
        "colour_a": np.array([0.2, 0.09, 0.035]),
        "colour_b": np.array([0.34, 0.17, 0.075]),
        "finish": (0.3, 0.0),
        "planks": 0.15,
    }
    curtain = plain | {
        "kind": 2,
        "colour_a": np.array([0.17, 0.012, 0.022]),
        "colour_b": np.array([0.045, 0.002, 0.006]),
        "finish": (0.12, 0.0),
        "trim": (9.0, 9.1, 0.0),
    }
    stone = plain | {
        "colour_a": np.array([0.36, 0.29, 0.21]),
        "colour_b": np.array([0.25, 0.19, 0.13]),
        "pattern": (3.0, 9.0),
        "finish": (0.1, 0.0),
    }
    shaft = [(0.0, 0.0), (0.24, 0.0), (0.24, 0.12), (0.2, 0.14), (0.21, 0.2), (0.16, 0.24)]
    shaft += [(0.145, 1.1), (0.165, 1.13), (0.165, 1.18), (0.145, 1.21), (0.135, 2.2)]
    shaft += [(0.2, 2.3), (0.24, 2.32), (0.24, 2.5), (0.3, 2.52), (0.3, 2.7), (0.0, 2.7)]
    meshes = [
        quad([(-9, 0, -9), (9, 0, -9), (9, 0, 9), (-9, 0, 9)], (0, 1, 0), floor),
        quad([(-9, 0, -2.6), (9, 0, -2.6), (9, 7, -2.6), (-9, 7, -2.6)], (0, 0, 1), curtain),
    ]
    for x in (-1.42, 1.42):
        column = lathe(np.array(shaft), stone, sides=41)
        place = np.array([x, 0.0, -1.9])
        meshes.append(
            Mesh(
                column.vertices + place, column.normals, column.uv, column.faces, stone, casts=False
            )
        )
    return meshes


def framing() -> tuple[Camera, Light]:
    """A camera slightly above the dancer's head, and warm light from the front left."""
    camera = Camera.looking_at(np.array([0.0, 1.95, 5.3]), np.array([0.0, 0.96, 0.0]), 1400.0, SIZE)
    light = Light(
        direction=np.array([-0.55, 1.0, 0.8]),
        key=np.array([2.3, 2.05, 1.7]),
        sky=np.array([0.2, 0.21, 0.28]),
        ground=np.array([0.13, 0.08, 0.05]),
        fill=np.array([0.2, 0.18, 0.2]),
        pool=(0.0, 0.2, 2.6, 0.9),
    )
    return camera, light


def performance(folder: Path) -> Performance:
    """The part of the take that is danced, turned towards the camera and put mid-stage."""
    take = read_performance(folder / f"{CLIP_TAKE}.bvh")
    every = round(take.rate_hz / RATE)
    first = round(START_S * take.rate_hz)
    rows = slice(first, first + round(LENGTH_S * take.rate_hz), every)
    rotation, pelvis = take.rotation[rows], take.pelvis[rows]
    facing = np.median(np.arctan2(rotation[:, 0, 0, 2], rotation[:, 0, 2, 2]))
    c, s = np.cos(-facing), np.sin(-facing)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    pelvis = pelvis @ turn.T
    middle = (pelvis.min(0) + pelvis.max(0)) / 2 * np.array([1, 0, 1])
    return Performance(take.name, turn @ rotation, pelvis - middle, take.rate_hz / every)


def poses(body: Body, take: Performance) -> list[np.ndarray]:
    """Joints (B, 3) of every frame, the take's lowest feet on the floor."""
    posed = [
        body.posed_joints(r, p * body.leg_length)
        for r, p in zip(take.rotation, take.pelvis, strict=True)
    ]
    feet = [
        body.posed_keypoints(r, p)[15:, 1].min() for r, p in zip(take.rotation, posed, strict=True)
    ]
    across = np.array(posed)[..., 0]
    middle, floor = (across.min() + across.max()) / 2, np.percentile(feet, 5) - 0.02
    return [p - np.array([middle, floor, 0.0]) for p in posed]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mocap", type=Path, help="folder of BVH takes")
    parser.add_argument("-o", "--output", type=Path, default=Path("models"))
    parser.add_argument("--still", type=float, nargs="*", help="only pictures at these seconds")
    arguments = parser.parse_args()
    body = build_body(SHAPE, cell_m=0.008)
    take = performance(arguments.mocap)
    position = poses(body, take)
    outfit, camera_and_light, place = dancer(body), framing(), stage()
    camera, light = camera_and_light
    renderer = Renderer(SIZE, supersample=2, shadow_size=2048)

    def picture(frame: int) -> np.ndarray:
        rotation, joints = take.rotation[frame], position[frame]
        actor = Actor(body, rotation, joints, outfit.uniforms)
        worn = outfit.meshes(body, rotation, joints)
        centre = joints[BONES.index("pelvis")]
        return renderer.draw(
            [actor], [*worn, *place], camera, light, shadow_centre=centre, shadow_radius=1.7
        )[0]

    if arguments.still is not None:
        from PIL import Image

        for second in arguments.still:
            Image.fromarray(picture(round(second * RATE))).save(
                arguments.output / f"still_{second:05.2f}.png"
            )
        return
    keypoints = np.array(
        [body.posed_keypoints(r, p) for r, p in zip(take.rotation, position, strict=True)]
    )
    joints, _ = convert(keypoints, np.ones(keypoints.shape[:2]), source="coco23", target="body17")
    np.savez_compressed(
        arguments.output / "demo_truth.npz",
        time_s=np.arange(len(take)) / RATE,
        keypoints=camera.project(keypoints).astype(np.float32),
        joints=joints.astype(np.float32),
        stature_m=np.array(SHAPE.stature),
    )
    write_video(arguments.output / "demo_clip.mp4", (picture(k) for k in range(len(take))))


def write_video(path: Path, pictures: Any) -> None:
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=RATE)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.time_base = Fraction(1, RATE)
        stream.options = {"crf": "21", "preset": "slow"}
        container.metadata["title"] = "dance2pose demo, rendered from motion capture"
        container.metadata["comment"] = f"CMU Motion Capture Database, take {CLIP_TAKE}"
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = number, Fraction(1, RATE)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


if __name__ == "__main__":
    main()
