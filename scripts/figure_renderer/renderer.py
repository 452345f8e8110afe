"""Draws bodies and meshes with OpenGL: one key light with a shadow map, sky, ground and fill light.

Any OpenGL 3.3 will do; Mesa's software renderer through EGL needs neither screen nor GPU.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import moderngl
import numpy as np
import numpy.typing as npt

from figure_renderer.body import Body

Array = npt.NDArray[np.float64]
NEAR_M, FAR_M = 0.2, 60.0
_SHADERS = Path(__file__).parent / "shaders"


def _source(*names: str) -> str:
    return "\n".join((_SHADERS / name).read_text(encoding="utf-8") for name in names)


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. camera_from_world rotation (3, 3) and position of the eye (3,), m;
    focal length in px of a picture of size (width, height)."""

    rotation: Array
    eye: Array
    focal: float
    size: tuple[int, int]

    @staticmethod
    def looking_at(
        eye: Array, target: Array, focal: float, size: tuple[int, int], roll: float = 0.0
    ) -> Camera:
        forward = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        down = np.cross(forward, right)
        c, s = np.cos(roll), np.sin(roll)
        rotation = np.stack([c * right + s * down, -s * right + c * down, forward])
        return Camera(rotation, eye, focal, size)

    def project(self, points: Array) -> Array:
        """Pixels (..., 2) of world points (..., 3); the centre of the first pixel is (0, 0)."""
        camera = (points - self.eye) @ self.rotation.T
        centre = (np.array(self.size) - 1) / 2
        out: Array = self.focal * camera[..., :2] / camera[..., 2:] + centre
        return out

    def matrix(self) -> Array:
        """View and projection to clip space, first row of the buffer = top row of the picture."""
        width, height = self.size
        a = (FAR_M + NEAR_M) / (FAR_M - NEAR_M)
        projection = np.zeros((4, 4))
        projection[0, 0], projection[1, 1] = 2 * self.focal / width, 2 * self.focal / height
        projection[2, 2], projection[2, 3] = a, -NEAR_M * (1 + a)
        projection[3, 2] = 1
        view = np.eye(4)
        view[:3, :3], view[:3, 3] = self.rotation, -self.rotation @ self.eye
        return projection @ view


@dataclass(frozen=True)
class Light:
    """direction: towards the key light. Colours are linear RGB. pool: (x, z, radius, strength)."""

    direction: Array
    key: Array
    sky: Array
    ground: Array
    fill: Array
    pool: tuple[float, float, float, float] = (0.0, 0.0, 3.0, 0.0)


@dataclass(frozen=True)
class Mesh:
    """A thing in world coordinates. uniforms: those of surface.frag; in_mask: belongs to the
    figure."""

    vertices: Array
    normals: Array
    uv: Array
    faces: npt.NDArray[np.int32]
    uniforms: dict[str, Any]
    in_mask: bool = False
    casts: bool = True


@dataclass(frozen=True)
class Actor:
    """A posed body. rotation, position: (B, 3, 3) and (B, 3) of its bones; uniforms: of
    body.frag."""

    body: Body
    rotation: Array
    position: Array
    uniforms: dict[str, Any]
    in_mask: bool = True


@dataclass
class _Loaded:
    body: Body
    vaos: dict[str, Any] = field(default_factory=dict)
    buffers: tuple[Any, ...] = ()


class Renderer:
    """Draws scenes into pictures of one size; `supersample` pixels a pixel along each axis."""

    def __init__(
        self,
        size: tuple[int, int],
        *,
        supersample: int = 2,
        shadow_size: int = 1024,
        soft_shadows: bool = True,
    ) -> None:
        self.context = moderngl.create_context(standalone=True, backend="egl", require=330)
        self.context.enable(moderngl.DEPTH_TEST)
        self.size, self.inner = size, (size[0] * supersample, size[1] * supersample)
        depth = self.context.depth_renderbuffer(self.inner)
        self.colour = self.context.renderbuffer(self.inner, 4)
        self.frame = self.context.framebuffer([self.colour], depth)
        self.shadow_map = self.context.depth_texture((shadow_size, shadow_size))
        self.shadow_map.compare_func = "<="
        self.shadow_map.repeat_x = self.shadow_map.repeat_y = False
        self.shadow = self.context.framebuffer(depth_attachment=self.shadow_map)
        self.programs = {
            "body": self._program("skinning.vert", "light.glsl", "body.frag"),
            "body_shadow": self._program("skinning.vert", "shadow.frag"),
            "surface": self._program("placing.vert", "light.glsl", "surface.frag"),
            "surface_shadow": self._program("placing.vert", "shadow.frag"),
        }
        self.loaded: dict[int, _Loaded] = {}
        self.texel, self.soft = 1.0 / shadow_size, int(soft_shadows)

    def _program(self, vertex: str, *fragment: str) -> Any:
        version = "#version 330\n"
        return self.context.program(
            vertex_shader=version + _source(vertex), fragment_shader=version + _source(*fragment)
        )

    def draw(
        self,
        actors: list[Actor],
        meshes: list[Mesh],
        camera: Camera,
        light: Light,
        *,
        shadow_centre: Array,
        shadow_radius: float = 1.8,
    ) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]:
        """The picture (H, W, 3) RGB and the figure's coverage (H, W), 0 to 255."""
        to_light = light.direction / np.linalg.norm(light.direction)
        light_matrix = _light_matrix(to_light, shadow_centre, shadow_radius)
        common: dict[str, Any] = {
            "view_projection": camera.matrix(),
            "light_projection": light_matrix,
            "eye": camera.eye,
            "to_light": to_light,
            "light_colour": light.key,
            "sky": light.sky,
            "ground": light.ground,
            "fill": light.fill,
            "texel": self.texel,
            "soft": self.soft,
            "pool": light.pool,
        }
        temporary = [self._load_mesh(mesh) for mesh in meshes]
        self.shadow.use()
        self.shadow.clear(depth=1.0)
        shadow_view = {**common, "view_projection": light_matrix}
        for actor in actors:
            self._draw_actor(actor, "body_shadow", shadow_view)
        for mesh, loaded in zip(meshes, temporary, strict=True):
            if mesh.casts:
                self._draw_mesh(mesh, loaded, "surface_shadow", shadow_view)
        self.frame.use()
        self.frame.clear(0.0, 0.0, 0.0, 0.0)
        self.shadow_map.use(0)
        for actor in actors:
            self._draw_actor(actor, "body", common)
        for mesh, loaded in zip(meshes, temporary, strict=True):
            self._draw_mesh(mesh, loaded, "surface", common)
        pixels = np.frombuffer(self.frame.read(components=4), np.uint8)
        picture = pixels.reshape(self.inner[1], self.inner[0], 4)
        for loaded in temporary:
            for thing in loaded.values():
                thing.release()
        if self.inner != self.size:
            picture = cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(picture[..., :3]), np.ascontiguousarray(picture[..., 3])

    def forget(self, body: Body) -> None:
        """Free the buffers of a body that will not be drawn again."""
        loaded = self.loaded.pop(id(body), None)
        if loaded is not None:
            for thing in (*loaded.vaos.values(), *loaded.buffers):
                thing.release()

    def _load_mesh(self, mesh: Mesh) -> dict[str, Any]:
        data = np.concatenate([mesh.vertices, mesh.normals, mesh.uv], 1).astype("f4")
        buffer = self.context.buffer(data.tobytes())
        index = self.context.buffer(mesh.faces.astype("i4").tobytes())
        things = {"buffer": buffer, "index": index}
        for name in ("surface", "surface_shadow"):
            things[name] = self.context.vertex_array(
                self.programs[name], _layout(self.programs[name], buffer, data.dtype), index
            )
        return things

    def _draw_mesh(
        self, mesh: Mesh, loaded: dict[str, Any], name: str, common: dict[str, Any]
    ) -> None:
        values = {**common, **mesh.uniforms, "in_mask": 1.0 if mesh.in_mask else 0.0}
        _set_uniforms(self.programs[name], values)
        loaded[name].render()

    def _draw_actor(self, actor: Actor, name: str, common: dict[str, Any]) -> None:
        body = actor.body
        if id(body) not in self.loaded:
            self.loaded[id(body)] = self._load_body(body)
        bones = np.zeros((len(actor.position), 4, 4))
        bones[:, :3, :3] = actor.rotation
        bones[:, :3, 3] = actor.position - np.einsum("bij,bj->bi", actor.rotation, body.joints)
        bones[:, 3, 3] = 1
        values = {**common, **actor.uniforms, "bones": bones, "in_mask": float(actor.in_mask)}
        _set_uniforms(self.programs[name], values)
        self.loaded[id(body)].vaos[name].render()

    def _load_body(self, body: Body) -> _Loaded:
        context = self.context
        floats = np.concatenate(
            [body.vertices, body.normals, body.bone_weight, body.coords], 1
        ).astype("f4")
        geometry = context.buffer(floats.tobytes())
        bones = context.buffer(body.bone_index.astype("i4").tobytes())
        index = context.buffer(body.faces.astype("i4").tobytes())
        loaded = _Loaded(body, buffers=(geometry, bones, index))
        for name in ("body", "body_shadow"):
            program = self.programs[name]
            parts = [
                ("in_position", "3f"),
                ("in_normal", "3f"),
                ("in_weight", "4f"),
                ("in_coord", "4f"),
            ]
            used = [(n, f) if n in program else (None, f"{4 * int(f[0])}x") for n, f in parts]
            loaded.vaos[name] = context.vertex_array(
                program,
                [
                    (geometry, " ".join(f for _, f in used), *(n for n, _ in used if n)),
                    (bones, "4i", "in_bone"),
                ],
                index,
            )
        return loaded


def _layout(program: Any, buffer: Any, dtype: Any) -> list[tuple[Any, ...]]:
    parts = [("in_position", 3), ("in_normal", 3), ("in_uv", 2)]
    formats, names = [], []
    for name, count in parts:
        if name in program:
            formats.append(f"{count}f")
            names.append(name)
        else:
            formats.append(f"{count * 4}x")
    return [(buffer, " ".join(formats), *names)]


def _set_uniforms(program: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        if name not in program:
            continue
        if isinstance(value, int | float):
            program[name].value = value
        else:
            array = np.asarray(value, dtype="f4")
            if array.ndim >= 2:  # matrices go column by column
                array = np.swapaxes(array, -1, -2)
            program[name].write(np.ascontiguousarray(array).tobytes())


def _light_matrix(to_light: Array, centre: Array, radius: float) -> Array:
    """Orthographic view from the light around a ball; depth -1 nearest the light."""
    side = np.cross(to_light, [0.0, 0.0, 1.0] if abs(to_light[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    rotation = np.stack([side, np.cross(to_light, side), -to_light]) / radius
    rotation[2] /= 2.0
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, -rotation @ centre
    return out
