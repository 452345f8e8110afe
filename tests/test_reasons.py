"""The reason reaches the person: unknown words, readers that go away, nobody found, a codec that
cannot be decoded."""

from __future__ import annotations

import difflib
import subprocess
import sys
from pathlib import Path

import av
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dance2pose.cli import COMMANDS, _check_command, _exit_status
from dance2pose.errors import ModelError, UsageError, VideoError
from dance2pose.onnx_models.registry import registry
from dance2pose.options import Settings
from dance2pose.people import DETECTOR_TO_PULL, POSE_TO_PULL
from dance2pose.reconstruction import analyse
from dance2pose.video import open_video
from onnx_graphs import dividing, emitting, heatmaps_of_colours
from video_making import make_video, numbered_video


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert _exit_status(list(arguments)) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and message.startswith("dance2pose: ")
    return message


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("dmo",), ("dmo: is no command", "did you mean 'demo'?")),
        (("modles", "list"), ("modles: is no command", "did you mean 'models'?")),
        (("smoth", "A", "B"), ("smoth: is no command", "did you mean 'smooth'?")),
        (("quetzal", "A", "B"), ("quetzal: is no command", "commands: demo")),
        (("models", "lst"), ('"lst"', '"list"')),
        (("models", "pull", "rtmpse-m"), ("'rtmpse-m'", "did you mean 'rtmpose-m'?")),
    ],
)
def test_an_unknown_word_is_named_with_the_nearest(
    words: tuple[str, ...], parts: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    message = said(capsys, *words)
    for part in parts:
        assert part in message


def test_a_video_may_have_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                   capsys: pytest.CaptureFixture[str]) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    numbered_video(tmp_path / "demos", 2, container_format="mp4")
    assert _exit_status(["demos", "-o", "a.rrd"]) == 2
    assert "no keypoint model is named" in capsys.readouterr().err
    assert _exit_status(["none.mp4", "--pose", "p.onnx"]) != 0
    assert "no such file" in capsys.readouterr().err


def test_a_pair_to_fetch_is_named_and_there(capsys: pytest.CaptureFixture[str],
                                            tmp_path: Path) -> None:  # fmt: skip
    video = numbered_video(tmp_path / "a.mp4", 2)
    assert _exit_status([str(video), "-o", str(tmp_path / "a.rrd")]) == 2
    message = capsys.readouterr().err
    for name in (DETECTOR_TO_PULL, POSE_TO_PULL):
        assert name in registry() and f"dance2pose models pull {name}" in message


def test_a_reader_that_goes_away_is_no_error() -> None:
    command = f"{sys.executable} -u -m dance2pose models list | head -1; echo ${{PIPESTATUS[0]}}"
    result = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=60)
    assert result.stderr == ""
    lines = result.stdout.splitlines()
    assert len(lines) == 2 and lines[1] in ("141", "0")


def detector(path: Path, score: float) -> Path:
    dets = np.array([[[5, 5, 60, 60, score]]], np.float32)
    outputs = {"dets": dets, "labels": np.zeros((1, 1), np.int64)}
    return emitting(path, outputs, input_shape=[1, 3, 64, 96])


def test_nobody_found_repeats_how_the_models_were_read_and_the_best_score(tmp_path: Path) -> None:
    video = numbered_video(tmp_path / "a.mp4", 4)
    pose = heatmaps_of_colours(tmp_path / "p.onnx", width=48, height=64)
    with pytest.raises(VideoError) as nobody:
        analyse(video, detector=detector(tmp_path / "d.onnx", 0.21), pose=pose)
    for part in (
        "no person was found in any of 4 frames",
        "d.onnx: was read as dets-labels",
        "is 0.21, and from 0.3 on",
        "p.onnx: was read as heatmap",
        "--min-confidence",
    ):
        assert part in str(nobody.value)


def test_the_score_that_counts_is_an_option(tmp_path: Path) -> None:
    video = numbered_video(tmp_path / "a.mp4", 4)
    pose = heatmaps_of_colours(tmp_path / "p.onnx", width=48, height=64)
    weak = detector(tmp_path / "d.onnx", 0.21)
    with pytest.raises(VideoError, match=r"from 0\.25 on they count"):
        analyse(video, detector=weak, pose=pose, min_confidence=0.25)
    with pytest.raises(UsageError, match="min_confidence 2: expected a score, 0 to 1"):
        Settings(min_confidence=2)


def test_a_model_that_answers_nothing_but_nan_is_the_reason(tmp_path: Path) -> None:
    video = make_video(tmp_path / "a.mp4", [np.zeros((96, 128, 3), np.uint8)] * 4)
    pose = dividing(tmp_path / "p.onnx")
    (tmp_path / "p.toml").write_text("mean = [0, 0, 0]\nstd = [255, 255, 255]\n")
    with pytest.raises(ModelError, match=r"holds NaN.* all \d pictures .* from 0\.00 s on"):
        analyse(video, detector=detector(tmp_path / "d.onnx", 0.9), pose=pose)


# What the decoder cannot do ---------------------------------------------------------------------


def test_animated_webp_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.webp"
    with av.open(str(path), "w", format="webp") as container:
        stream = container.add_stream("libwebp_anim", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for number in range(5):
            image = np.full((48, 64, 3), 40 * number, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    with pytest.raises(VideoError, match=r"a\.webp: is an animated WebP, which FFmpeg cannot"):
        open_video(path)


@pytest.mark.parametrize(
    ("letters", "words"), [(b"XYZ9", "'XYZ9'"), (b"encv", "encrypted"), (b"CRAW", "'CRAW'")]
)
def test_a_codec_that_nobody_knows_is_named(letters: bytes, words: str, tmp_path: Path) -> None:
    path = numbered_video(tmp_path / "a.mp4", 3)
    data = path.read_bytes()
    path.write_bytes(data.replace(b"avc1", letters))
    with pytest.raises(VideoError) as refused:
        open_video(path)
    assert "a.mp4: " in str(refused.value) and words in str(refused.value)


@given(
    command=st.sampled_from(sorted(COMMANDS)),
    where=st.integers(0, 7),
    letter=st.sampled_from("aeqxz"),
)
def test_every_mistyped_command_is_named_with_its_nearest(
    command: str, where: int, letter: str
) -> None:
    at = where % len(command)
    typo = command[:at] + letter + command[at + 1 :]
    assume(typo not in COMMANDS)
    with pytest.raises(UsageError) as raised:
        _check_command([typo, "A", "B"])
    text = str(raised.value)
    assert typo in text and "\n" not in text
    (suggested,) = (name for name in COMMANDS if f"did you mean {name!r}" in text)
    # Two commands may be as like what was typed: "eaport" is as near to report as to export.
    assert likeness(typo, suggested) >= likeness(typo, command)


def likeness(one: str, other: str) -> float:
    return difflib.SequenceMatcher(None, other, one).ratio()
