"""The command line as a person meets it: exit status, one clear line, nothing heavy imported."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from dance2pose.cli import main
from dance2pose.commands.reconstruct import default_output
from dance2pose.errors import UsageError
from dance2pose.options import OutputOptions, Settings, SmoothOptions


def run(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "dance2pose", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=120,
    )


def status(*arguments: str) -> int:
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def test_help_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom dance2pose.cli import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "heavy = {'numpy','scipy','cv2','av','onnxruntime','rerun','scenedetect','torch'}\n"
        "print('heavy:', sorted(heavy & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.stdout.endswith("heavy: []\n"), result.stdout[-300:] + result.stderr
    for command in ("demo", "lift", "smooth", "evaluate", "models", "view"):
        assert f"{command}:" in result.stdout


@pytest.mark.parametrize("command", ["demo", "lift", "smooth", "evaluate", "models", "view"])
def test_every_command_has_help(command: str) -> None:
    result = run(command, "--help")
    assert result.returncode == 0, result.stderr
    assert "Usage:" in result.stdout


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["clip.mp4", "--windw", "3"], "--window"),
        (["clip.mp4", "--window", "0"], "window 0: expected a whole number, 1 or more"),
        (["clip.mp4", "--window", "5.5"], "5.5: expected a whole number"),
        (["clip.mp4", "--lifter", "paper", "--camera", "perspective"], "weak-perspective"),
        (["clip.mp4", "-o", "tape"], ".rrd"),
        (["clip.mp4", "-o", "tape.npz"], ".rrd"),
        (["clip.mp4", "--smooth", "median"], "median"),
        (["clip.mp4", "--person", "-1"], "person"),
        (["clip.mp4", "--height", "162"], "metres"),
        (["clip.mp4", "--end", "1", "--start", "2"], "end"),
        (["clip.mp4", "--config", "absent.toml"], "absent.toml"),
        (["clip.mp4", "--every", "1" + "0" * 21], "expected a whole number, 2147483647 at most"),
        (["clip.mp4", "--write-body", "b.toml"], "b.toml: neither an option nor the value of one"),
    ],
)
def test_wrong_usage_is_one_line_and_status_2(
    arguments: list[str], said: str, tmp_path: Path
) -> None:
    result = run(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert said in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("module", ["dance2pose.cli", "dance2pose.commands.reconstruct"])
def test_ctrl_c_is_one_line_and_status_130(module: str) -> None:
    code = (
        "import sys\n"
        "class Interrupt:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {module!r}: raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Interrupt())\n"
        "sys.argv = ['dance2pose', 'clip.mp4']\n"
        "from dance2pose.__main__ import main\nmain()\n"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (result.returncode, result.stdout) == (130, "")
    assert result.stderr == "dance2pose: stopped\n"


@pytest.mark.parametrize("address", ["scheduler", "tcp://scheduler", "tcp://", ":", "a b:1"])
def test_an_address_without_a_host_or_port_is_wrong_usage(address: str, tmp_path: Path) -> None:
    result = run("batch", "tapes", "archive", "--cluster", address, cwd=tmp_path)
    assert result.returncode == 2
    expected = f"cluster {address}: expected a scheduler's address, as tcp://host:8786"
    assert result.stderr == f"dance2pose: {expected}\n"


def test_a_missing_video_is_one_line_and_status_1(tmp_path: Path) -> None:
    result = run("no such video.mp4", cwd=tmp_path)
    assert result.returncode == 1
    assert "no such video.mp4" in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_settings_file_has_the_names_of_the_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[Settings, OutputOptions]] = []
    monkeypatch.setattr(
        "dance2pose.commands.reconstruct.run",
        lambda video, output, settings, outputs, **_: seen.append((settings, outputs)),
    )
    file = tmp_path / "run.toml"
    file.write_text('smooth = "ema"\nwindow = 9\npose = "p.onnx"\nnpz = false\n')
    assert status("clip.mp4", "--config", str(file)) == 0
    assert status("clip.mp4", "--config", str(file), "--window", "4") == 0
    assert seen[0] == (
        Settings.of(model="ema", window=9, pose="p.onnx"),
        OutputOptions(npz=False),
    )
    assert seen[1][0].smooth.window == 4  # the command line wins over the file


def test_unknown_keys_and_broken_settings_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "run.toml"
    file.write_text("windo = 9\n")
    assert status("clip.mp4", "--config", str(file)) == 2
    assert "windo" in capsys.readouterr().err
    file.write_text("window 9")
    assert status("clip.mp4", "--config", str(file)) == 2
    assert "not a TOML file" in capsys.readouterr().err


def test_settings_check_themselves() -> None:
    with pytest.raises(UsageError, match="every"):
        Settings.of(every=0)
    assert SmoothOptions().model_after("default") == "none"
    assert SmoothOptions().model_after("paper") == "mma"


def test_unknown_tables_and_keys_get_the_nearest_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "run.toml"
    file.write_text('[lfit]\ncamera = "auto"\n')
    assert status("clip.mp4", "--config", str(file)) == 2
    assert "[lfit]" in (said := capsys.readouterr().err) and "did you mean 'lift'" in said
    file.write_text("heigth = 1.6\n")
    assert status("clip.mp4", "--config", str(file)) == 2
    assert "did you mean 'height'" in capsys.readouterr().err


def test_a_broken_standing_file_breaks_neither_help_nor_version(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "config.toml"
    file.write_text("broken =")
    monkeypatch.setattr("dance2pose.cli.user_config_path", lambda: file)
    assert status("--version") == 0
    assert status("--help") == 0
    assert status("clip.mp4") == 2
    assert "config.toml" in capsys.readouterr().err


def test_alone_it_shows_help() -> None:
    result = run()
    assert result.returncode == 0
    assert result.stdout.startswith("Usage: dance2pose")


def test_help_has_no_ragged_lines() -> None:
    lines = run("--help").stdout.split("Parameters:")[1].splitlines()
    entries = [line for line in lines if line.strip()]
    assert all(line.startswith(("  -", "  VIDEO", "      ")) for line in entries)
    assert max(map(len, entries)) <= 100


@pytest.mark.parametrize(
    ("video", "output"),
    [("01.mp4", "01.rrd"), ("a/01.mp4", "a_01.rrd"), ("b/01.mp4", "b_01.rrd")],
)
def test_tapes_of_one_name_in_two_folders_are_two_recordings(video: str, output: str) -> None:
    assert default_output(Path(video)) == Path(output)
