"""A result in the forms of other programs; `FORMS` lists them by suffix.

from dance2pose import export
export.write(export.load_scene(Path("dance.npz")), Path("dance.bvh"))
"""

from dance2pose.export.forms import FORMS, Form, find_form
from dance2pose.export.loading import load_scene
from dance2pose.export.scene import ExportScene, SceneDancer
from dance2pose.export.writing import Written, check, scene_of, write, write_form

__all__ = [
    "FORMS",
    "ExportScene",
    "Form",
    "SceneDancer",
    "Written",
    "check",
    "find_form",
    "load_scene",
    "scene_of",
    "write",
    "write_form",
]
