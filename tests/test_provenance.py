"""What a recording says about where it comes from."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from dance2pose.errors import DataError
from dance2pose.file_hash import file_sha256
from dance2pose.provenance import (
    describe_dancers,
    describe_settings,
    describe_video,
    identity_of,
    library_versions,
)
from dance2pose.video import VideoInfo, open_video
from recording_making import make_dancer, make_provenance
from video_making import numbered_video


@dataclass(frozen=True)
class Settings:
    pose: Path | None = None
    window: int = 5
    height: float | None = None


@dataclass(frozen=True)
class Model:
    sha256: str
    manifest: str


def info_of(path: Path) -> VideoInfo:
    with open_video(path) as frames:
        return frames.info


def test_sha256_of_a_file_and_of_what_it_becomes(tmp_path: Path) -> None:
    path = tmp_path / "a"
    for content in (b"one", b"another", b""):
        path.write_bytes(content)
        assert file_sha256(path) == hashlib.sha256(content).hexdigest()
    with pytest.raises(DataError, match="gone"):
        file_sha256(tmp_path / "gone")


def test_identity_is_of_the_content_the_models_and_the_settings(tmp_path: Path) -> None:
    video = numbered_video(tmp_path / "a.mp4", count=3)
    (tmp_path / "elsewhere").mkdir()
    copy = tmp_path / "elsewhere" / "copy.mp4"
    copy.write_bytes(video.read_bytes())
    other = numbered_video(tmp_path / "b.mp4", count=4)
    model = Model("ab", "raw grid")

    settings = Settings(pose=tmp_path / "m.toml")
    first = identity_of(info_of(video), [model], settings)
    assert first == identity_of(info_of(copy), [model], settings)
    assert first != identity_of(info_of(other), [model], settings)
    assert first != identity_of(info_of(video), [model], replace(settings, window=7))
    moved = replace(settings, pose=tmp_path / "elsewhere" / "m.toml")
    assert first == identity_of(info_of(video), [model], moved)
    # One manifest's name, another model or another way of reading it.
    assert first != identity_of(info_of(video), [Model("cd", "raw grid")], settings)
    assert first != identity_of(info_of(video), [Model("ab", "with NMS")], settings)


def test_page_holds_every_fact() -> None:
    page = make_provenance().to_markdown()
    for fact in ("dance.mp4", "1234", "ab" * 32, "cd" * 32, "1.5", "detector", "window", "numpy"):
        assert fact in page
    assert "The last second is missing." in page
    assert page.index("The last second is missing.") < page.index("numpy")


@pytest.mark.parametrize("name", ["a_b*c|d.mp4", "<b>&`x`.mp4", "[link](x).mp4", "two\nlines.mp4"])
def test_no_file_name_can_break_the_page(name: str) -> None:
    lines = make_provenance(name).to_markdown().splitlines()
    row = next(line for line in lines if line.startswith("| file name"))
    unescaped = row.replace("\\\\", "").replace("\\|", "").count("|")
    assert unescaped == 3
    assert "<b>" not in row
    assert lines[0].startswith("# ")


def test_properties_hold_every_value() -> None:
    properties = make_provenance().to_properties()
    assert properties["source"]["sha256"] == "ab" * 32
    assert properties["source"]["duration_s"] == 1.5
    assert properties["model_detector"]["kind"] == "detector"
    assert properties["settings"] == {"setting_window": 5, "setting_npz": True}
    assert properties["warnings"] == {"1": "The last second is missing."}


def test_video_described(tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "tänzer.mp4", count=6)
    source = describe_video(info_of(path), frames_read=4)
    assert (source.name, source.size_bytes) == ("tänzer.mp4", path.stat().st_size)
    assert source.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    assert source.details["frame count"] == 6
    assert source.details["frames processed"] == 4
    assert source.details["codec"] == "h264"


def test_settings_name_files_without_their_folder(tmp_path: Path) -> None:
    described = describe_settings(Settings(pose=tmp_path / "m.onnx"))
    assert described == {"pose": "m.onnx", "window": 5, "height": "not given"}


def test_dancers_described() -> None:
    dancer = make_dancer(2, frame=[4, 5, 6, 7], time_s=[0.1, 0.2, 0.3, 0.4])
    assert "frames 4 to 7 (4)" in describe_dancers([dancer])["dancer 2"]
    assert describe_dancers([])["dancers"] == "0: no person was found"


def test_versions_are_those_installed() -> None:
    import numpy

    assert library_versions()["numpy"] == numpy.__version__
    assert "not installed" not in library_versions().values()
