"""The forms in which a result leaves, by suffix."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from dance2pose.errors import UsageError
from dance2pose.export.scene import ExportScene

Write = Callable[[Path, ExportScene], tuple[str, ...]]


@dataclass(frozen=True)
class Form:
    """A form of export.

    suffix: the end of its files' names, dot included. several_dancers: whether one file holds all
    dancers; else there is one file a dancer. extra: of the packages that it needs, or None.
    needs_video, needs_keypoints: what the scene must have. writer: "module:function" below
    `dance2pose.export`, imported when it is used.
    """

    suffix: str
    description: str
    several_dancers: bool
    writer: str
    extra: str | None = None
    package: str | None = None
    needs_video: bool = False
    needs_keypoints: bool = False

    @property
    def name(self) -> str:
        """The form as it is asked for: bvh, long.csv."""
        return self.suffix.removeprefix(".")

    def write(self, path: Path, scene: ExportScene) -> tuple[str, ...]:
        """Write to exactly `path`, whose folder exists; a form of one dancer takes a scene of one.

        Returns what a reader of the file must know that it cannot say, in sentences. Raises
        UsageError for what the scene lacks or the form cannot hold.
        """
        module, function = self.writer.split(":")
        write: Write = getattr(import_module(f"dance2pose.export.{module}"), function)
        return write(path, scene)


_FORMS = (
    Form(".bvh", "BVH, for Blender, Maya, MotionBuilder", False, "bvh:write_bvh"),
    Form(
        *(".glb", "glTF binary, a mannequin for any 3D viewer", True, "gltf:write_gltf"),
        *("gltf", "pygltflib"),
    ),
    Form(
        *(".c3d", "C3D, for Mokka, Visual3D, Vicon", True, "c3d:write_c3d"),
        *("c3d", "ezc3d"),
    ),
    Form(".trc", "TRC, places of joints for OpenSim", True, "opensim:write_trc"),
    Form(".mot", "MOT, joint angles for OpenSim", False, "opensim:write_mot"),
    Form(".csv", "table, a row a frame: joints and angles", True, "table:write_wide"),
    Form(".long.csv", "table, a row a joint", True, "table:write_long"),
    Form(
        *(".keypoints.csv", "table, a row a keypoint of the picture", True),
        "table:write_keypoints",
        needs_keypoints=True,
    ),
    Form(".parquet", "Parquet, the table of a row a frame", True, "table:write_parquet"),
    Form(".json", "JSON, everything", True, "json_file:write_json"),
    Form(".nc", "netCDF, for the Python package movement", True, "netcdf:write_netcdf"),
    Form(
        *(".mp4", "film with the skeleton over it, 3D beside it", True, "overlay:write_overlay"),
        needs_video=True,
    ),
    Form(".eaf", "ELAN annotations: phrases and key poses", True, "elan:write_eaf"),
    Form(".phrases.csv", "table of phrases and key poses", True, "elan:write_phrases"),
)
FORMS = {form.suffix: form for form in _FORMS}


def find_form(name: str | Path) -> Form:
    """The form of a file name, or of a name such as `bvh` or `long.csv`.

    The longest suffix that fits counts. Raises UsageError listing the known ones.
    """
    lower = Path(name).name.lower()
    for suffix in sorted(FORMS, key=len, reverse=True):
        if lower.endswith(suffix) or f".{lower}" == suffix:
            return FORMS[suffix]
    known = ", ".join(form.name for form in _FORMS)
    raise UsageError(f"{name}: not a form of export; known: {known}")
