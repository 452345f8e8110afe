"""The house: imports point one way, and nothing runs in a circle."""

from __future__ import annotations

import ast
import graphlib
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1] / "pipeline" / "dance2pose"

# From the ground up: a room imports from its own floor's files and from floors below it only.
FLOORS: tuple[tuple[str, ...], ...] = (
    ("errors", "array_records", "assets", "progress", "profiling", "large_blocks", "beside"),
    ("small_picture",),
    ("viewpoint", "poses", "options", "output_files", "leftovers", "holes", "file_hash"),
    ("skeleton_tables",),
    ("skeleton", "npz_files", "body", "settings_file", "tables"),
    ("body_file", "body_variation", "portions"),
    ("angle_formulas",),
    ("video", "shots", "onnx_models", "limits", "temporal_models", "mocap", "angles"),
    ("detection", "keypoints", "tracking", "lifting", "smoothing", "provenance", "exchange"),
    ("expected_boxes", "background_view"),
    ("following",),
    ("people", "results", "reading", "findings", "background_motion", "quantising"),
    ("video_tracks", "summary"),
    ("phrases", "even_rate", "comparison", "recording"),
    ("outputs",),
    ("export",),
    ("saving", "front_door"),
    ("reconstruction",),
    ("evaluation", "archive"),
    ("demo",),
    ("command_line",),
    ("commands",),
    ("cli",),
    ("__main__",),
)
# What parses the command line is known to nobody below it.
COMMAND_LINE = {"command_line", "commands", "cli"}


def modules() -> dict[str, Path]:
    found = {}
    for path in ROOT.rglob("*.py"):
        parts = path.relative_to(ROOT).with_suffix("").parts
        found[".".join(part for part in parts if part != "__init__")] = path
    return found


def imports(path: Path, known: set[str]) -> set[str]:
    """The modules of this package that a file imports when it runs, wherever in the file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    typing_only = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and ast.unparse(block.test).endswith("TYPE_CHECKING")
        for statement in block.body
        for node in ast.walk(statement)
    }
    found = set()
    for node in ast.walk(tree):
        if id(node) in typing_only or not isinstance(node, ast.ImportFrom | ast.Import):
            continue
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        else:
            base = node.module or ""
            names = [f"{base}.{alias.name}" for alias in node.names]
        for name in names:
            if name.split(".")[0] != "dance2pose":
                continue
            inner = name.removeprefix("dance2pose").lstrip(".")
            while inner and inner not in known:
                inner = inner.rpartition(".")[0]
            if inner:
                found.add(inner)
    return found


def graph() -> dict[str, set[str]]:
    files = modules()
    return {name: imports(path, set(files)) - {name} for name, path in files.items() if name != ""}


def floor_of() -> dict[str, int]:
    return {room: level for level, rooms in enumerate(FLOORS) for room in rooms}


def test_every_room_has_a_floor() -> None:
    rooms = {name.split(".")[0] for name in modules() if name}
    assert rooms == set(floor_of())


def test_imports_point_down() -> None:
    floors = floor_of()
    wrong = [
        f"{name} imports {other}"
        for name, others in graph().items()
        for other in others
        if floors[other.split(".")[0]] > floors[name.split(".")[0]]
    ]
    assert wrong == []


def test_no_circle_of_modules() -> None:
    list(graphlib.TopologicalSorter(graph()).static_order())


def test_no_circle_of_rooms() -> None:
    rooms: dict[str, set[str]] = defaultdict(set)
    for name, others in graph().items():
        room = name.split(".")[0]
        rooms[room] |= {other.split(".")[0] for other in others} - {room}
    list(graphlib.TopologicalSorter(rooms).static_order())


def test_nothing_below_the_commands_knows_the_command_line_library() -> None:
    for name, path in modules().items():
        if name.split(".")[0] not in COMMAND_LINE:
            assert "cyclopts" not in path.read_text(encoding="utf-8"), name
