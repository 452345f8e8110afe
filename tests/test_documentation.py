"""What is written for people holds: examples run, arguments are named, pages and links exist."""

from __future__ import annotations

import doctest
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

import dance2pose

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "pipeline" / "dance2pose"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]
FUNCTIONS = [
    name for name in dance2pose.__all__ if inspect.isfunction(getattr(dance2pose, name, None))
]


def modules_with_examples() -> list[str]:
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        lines = path.read_text(encoding="utf-8").splitlines()
        if any(line.strip().startswith(">>> ") and "+SKIP" not in line for line in lines):
            parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
            found.append(".".join(part for part in parts if part != "__init__"))
    return found


@pytest.mark.parametrize("name", modules_with_examples())
def test_examples_in_docstrings_run(name: str) -> None:
    module: ModuleType = importlib.import_module(name)
    result = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.attempted > 0
    assert result.failed == 0


@pytest.mark.parametrize("name", FUNCTIONS)
def test_public_functions_say_what_they_take_return_and_raise(name: str) -> None:
    function = getattr(dance2pose, name)
    text = inspect.getdoc(function) or ""
    for section in ("Returns", "Raises", "Parameters"):
        assert f"\n{section}\n---" in text or "as in `" in text.lower(), f"{name}: no {section}"
    if "\nParameters\n" not in text:
        return
    described = text.split("\nParameters\n")[1].split("\nReturns\n")[0]
    for parameter in inspect.signature(function).parameters:
        assert re.search(rf"(^|[\s,*]){parameter}\b", described), (
            f"{name}: {parameter} not described"
        )


def test_every_public_name_is_there() -> None:
    for name in dance2pose.__all__:
        assert getattr(dance2pose, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'analyze'"):
        dance2pose.analyze  # noqa: B018


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = (
        "import sys, dance2pose\n"
        "heavy = {'numpy', 'scipy', 'cv2', 'av', 'onnxruntime', 'rerun', 'cyclopts'}\n"
        "print(sorted(heavy & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


def test_the_tour_runs() -> None:
    run = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "tour.py"), "1"], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr[-2000:]
    assert "Reconstruction(demo_clip.mp4" in run.stdout
    assert run.stdout.strip().endswith("True")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_between_pages_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), f"{page.name} links to {target}"


def test_the_tour_of_the_files_names_files_that_exist() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    block = text.split("## A tour of the files")[1].split("```")[1]
    for line in block.splitlines():
        if not line.startswith("  "):
            continue
        for word in line[:43].split():
            if word.endswith(("/", ".py")):
                assert (PACKAGE / word).exists(), word


def test_python_in_the_readme_is_what_the_package_offers() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for block in re.findall(r"```python\n(.*?)```", text, flags=re.S):
        compile(block, "README.md", "exec")
        for name in re.findall(r"\bd2p\.(\w+)", block):
            assert name in dance2pose.__all__, name
