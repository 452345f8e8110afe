"""The experiments: scenes, averages, and a report written from start to end."""

from __future__ import annotations

import builtins
import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dance2pose.body import body_bones_mm, retarget
from dance2pose.commands.evaluate import evaluate as evaluate_command
from dance2pose.errors import DataError, OutputError, UsageError
from dance2pose.evaluation import plots, report
from dance2pose.evaluation.cameras import (
    Scene,
    rotation,
    scenes,
    with_missing,
    with_noise,
    with_snr,
)
from dance2pose.evaluation.lifters import LifterEntry
from dance2pose.evaluation.paper_experiments import (
    PAPER_AVERAGE,
    PAPER_TABLE,
    paper_variants,
    run_smoothed,
    table_1,
)
from dance2pose.evaluation.report import evaluate
from dance2pose.evaluation.scoring import average, perturbed, run, score
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.evaluation.tables import Table
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.mocap.corpus import Take
from dance2pose.poses import FloatArray
from dance2pose.progress import Silent
from dance2pose.skeleton import get

CMU = get("cmu17")


def swinging(name: str = "swing", frames: int = 130, rate_hz: float = 30.0, seed: int = 0) -> Take:
    """A synthetic take: every bone swings slowly about a direction of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None] / rate_hz
    xyz = np.zeros((frames, len(CMU), 3))
    for parent, child in CMU.bones:
        rest = rng.normal(size=3) + np.array([0, -1.5, 0])
        bone = rest + rng.normal(0, 0.4, 3) * np.sin(2 * np.pi * t / rng.uniform(1.5, 4))
        xyz[:, child] = xyz[:, parent] + bone
    root = np.stack([300 * np.sin(t[:, 0]), 900 + 0 * t[:, 0], 200 * t[:, 0]], axis=1)
    return Take(name, retarget(xyz, CMU, body_bones_mm("cmu17")), root, rate_hz)


def perfect(truths: Sequence[Scene], off: FloatArray | float = 0.0) -> LifterEntry:
    """A lifter that knows the scenes, in order, and errs by what it is told."""
    remaining = iter(truths)

    def lift(observed: Observed) -> Lifted:
        truth = next(remaining).truth
        return Lifted(truth + off, observed.xy, np.full(truth.shape[:2], 10.0))

    return LifterEntry("planted", lift)


def test_views_stand_evenly_around_a_take_and_see_it_as_it_is() -> None:
    take = swinging()
    made = scenes([take, swinging("other", seed=1)], views=3, tilt_deg=20, seed=4)
    assert [scene.take for scene in made] == ["swing"] * 3 + ["other"] * 3
    azimuths = np.array([scene.azimuth_deg for scene in made[:3]])
    np.testing.assert_allclose(np.diff(azimuths), 120)
    assert made[0].azimuth_deg != made[3].azimuth_deg
    for scene in made:
        assert abs(scene.tilt_deg) <= 20
        np.testing.assert_array_equal(scene.xy, scene.truth[..., :2])
        assert np.abs(scene.truth[:, 0]).max() == 0
    turned = take.xyz @ rotation(made[1].azimuth_deg, made[1].tilt_deg).T
    np.testing.assert_allclose(made[1].truth, turned - turned[:, :1], atol=1e-9)
    again = scenes([take], views=3, tilt_deg=20, seed=4)
    np.testing.assert_array_equal(again[2].xy, made[2].xy)
    assert scenes([take], views=3, tilt_deg=20, seed=5)[0].azimuth_deg != made[0].azimuth_deg


def test_a_camera_that_looks_down_sees_the_front_lower() -> None:
    x, y, z = rotation(0, 30) @ np.array([0.0, 0.0, 1.0])
    assert x == 0 and y < 0 and z > 0
    x, y, z = rotation(90, 0) @ np.array([0.0, 0.0, 1.0])
    assert x == pytest.approx(1) and z == pytest.approx(0)


def test_scenes_change_rate_but_never_upwards() -> None:
    take = swinging(frames=121, rate_hz=60.0)
    assert len(scenes([take], views=1, tilt_deg=0, seed=0, rate_hz=30)[0].xy) == 61
    kept = scenes([take], views=1, tilt_deg=0, seed=0, rate_hz=120)[0]
    assert kept.rate_hz == 60 and len(kept.xy) == 121


def test_what_a_lifter_is_given_has_pixels_times_and_missing_joints() -> None:
    scene = scenes([swinging()], views=1, tilt_deg=0, seed=0)[0]
    xy = scene.xy.copy()
    xy[3, 5] = np.nan
    observed = replace(scene, xy=xy).observed()
    assert observed.confidence[3, 5] == 0 and observed.confidence.sum() == 130 * 17 - 1
    np.testing.assert_allclose(np.diff(observed.time_s), 1 / 30)
    width, height = observed.image_size
    np.testing.assert_allclose(observed.xy[:, 0], [[width / 2, -height / 2]] * 130)
    # As in any picture: inside it, y up counted from its top edge downwards.
    seen = observed.xy[np.isfinite(observed.xy).all(axis=-1)]
    assert (seen[:, 0] > 0).all() and (seen[:, 1] < 0).all() and (seen[:, 1] > -height).all()


def test_noise_and_missing_joints_come_as_asked_for_and_from_the_seed() -> None:
    scene = scenes([swinging(frames=3000)], views=1, tilt_deg=0, seed=0)[0]
    noisy = with_noise(scene, np.random.default_rng(1), sigma_mm=10)
    assert np.std(noisy.xy - scene.xy) == pytest.approx(10, rel=0.02)
    loud = with_snr(scene, np.random.default_rng(1), snr_db=10)
    ratio = np.mean(scene.xy[:, 1:] ** 2) / np.var(loud.xy - scene.xy)
    assert 10 * np.log10(ratio) == pytest.approx(10, abs=0.1)
    cut = with_missing(scene, np.random.default_rng(2), share=0.15)
    gone = np.isnan(cut.xy).all(axis=-1)
    assert gone.mean() == pytest.approx(0.15, abs=0.02)
    np.testing.assert_array_equal(cut.xy[~gone], scene.xy[~gone])
    edges = np.flatnonzero(np.diff(np.r_[False, gone[:, 4], False]))
    runs = (edges[1::2] - edges[::2])[1:-1]
    assert runs.min() >= 5 and np.median(runs) <= 20
    first, second = (
        perturbed([scene], lambda s, rng: with_noise(s, rng, sigma_mm=1), 3)[0].xy,
    ) * 2
    np.testing.assert_array_equal(first, second)


def test_a_perfect_lifter_has_no_error_and_a_shifted_joint_its_own() -> None:
    made = scenes([swinging()], views=2, tilt_deg=20, seed=0)
    exact = run(perfect(made), made, made, Silent(), "test").mean
    assert exact.pa_mean < 1e-9 and exact.mpjpe == 0 and exact.acceleration == 0
    assert exact.lag == pytest.approx(0, abs=0.02)
    assert exact.bone_range < 1e-9
    assert exact.within_1 == 1
    off = np.zeros((len(CMU), 3))
    off[4] = [30.0, 0, 0]
    wrong = run(perfect(made, off), made, made, Silent(), "test").mean
    assert wrong.mpjpe == pytest.approx(30 / 17)
    assert wrong.pa.argmax() == 4
    assert wrong.within_1 == pytest.approx(15 / 16)


def test_a_long_take_counts_no_more_than_a_short_one() -> None:
    made = scenes([swinging("a", 200), swinging("b", 100, seed=1)], views=1, tilt_deg=0, seed=0)
    scores = []
    for scene, error in zip(made, (10.0, 40.0), strict=True):
        off = np.zeros((len(CMU), 3))
        off[8, 2] = error
        scores.append((scene.take, score(scene, scene.truth + off)))
    both = average([*scores, scores[0]])  # the first take seen by two cameras
    assert both.mpjpe == pytest.approx((10 + 40) / 2 / 17)


def test_frames_that_are_not_lifted_are_counted() -> None:
    scene = scenes([swinging()], views=1, tilt_deg=0, seed=0)[0]
    estimate = scene.truth.copy()
    estimate[:13] = np.nan
    found = score(scene, estimate)
    assert found.lifted == pytest.approx(0.9)
    assert found.pa_mean < 1e-9
    nothing = score(scene, np.full_like(estimate, np.nan))
    assert nothing.lifted == 0 and np.isnan(nothing.pa_mean) and np.isnan(nothing.valid)


def test_table_1_shows_the_papers_numbers_and_a_planted_gain() -> None:
    """Noise that is independent from frame to frame is what averages remove."""
    made = scenes([swinging(frames=600, rate_hz=120.0)], views=1, tilt_deg=0, seed=0)
    jitter = np.random.default_rng(0).normal(0, 40, made[0].truth.shape)
    entry = perfect(made, jitter)
    result = run_smoothed(entry, made, made, paper_variants([5]), Silent(), "test")
    table = table_1(result, 5, "a test")
    assert len(table.rows) == 16 and table.rows[0][0] == "root"
    assert [row[5] for row in table.rows[:15]] == [row[1] for row in PAPER_TABLE.values()]
    assert tuple(table.rows[-1][3::2]) == PAPER_AVERAGE
    ours = [float(cell) for cell in table.rows[-1][2::2]]
    assert max(ours) < 70  # all four models remove much of it


def test_the_papers_average_is_that_of_its_rows() -> None:
    """Guards the transcription: each column of 15 numbers against the printed average."""
    for column, printed in zip(zip(*PAPER_TABLE.values(), strict=True), PAPER_AVERAGE, strict=True):
        assert np.mean(column) == pytest.approx(printed, abs=0.02)


def test_tables_as_markdown_and_csv(tmp_path: Path) -> None:
    table = Table("t", "Title", ("", "a", "b"), [["x", 1.234, float("nan")], ["y", 2, "z"]], 2, "n")
    assert table.markdown().splitlines() == [
        "**Title**",
        "",
        "|  | a | b |",
        "| --- | ---: | ---: |",
        "| x | 1.23 | – |",
        "| y | 2 | z |",
        "",
        "n",
    ]
    path = table.write_csv(tmp_path, overwrite=False)
    with path.open(encoding="utf-8") as file:
        assert list(csv.reader(file)) == [["", "a", "b"], ["x", "1.234", ""], ["y", "2", "z"]]


def test_figures_are_pictures_and_the_same_every_time(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    x = np.arange(5.0)
    for name in ("a", "b"):
        plots.lines(
            tmp_path / f"{name}.png",
            [plots.Series("one", x, x**2), plots.Series("two", x, x)],
            title="t",
            x_label="x",
            y_label="y",
        )
    assert (tmp_path / "a.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    groups: Mapping[str, FloatArray] = {"one": np.array([90.0, 80, 70]), "two": np.ones(3)}
    plots.bars(tmp_path / "c.png", ["p", "q", "r"], groups, title="t", y_label="y", line_at=100)
    assert (tmp_path / "c.png").stat().st_size > 5000


@pytest.fixture
def short_take(shared: Path, tmp_path: Path) -> Path:
    """The first 2.3 s of a real take."""
    lines = (shared / "mocap" / "eval" / "07_05.bvh").read_text().splitlines()
    motion = lines.index("MOTION")
    lines[motion + 1] = "Frames: 280"
    path = tmp_path / "takes" / "07_05.bvh"
    path.parent.mkdir()
    path.write_text("\n".join(lines[: motion + 3 + 280]) + "\n")
    return path.parent


SHORT = EvaluationSettings(views=1, snr_db=(17,))


@pytest.mark.shared
def test_a_whole_report(short_take: Path, tmp_path: Path) -> None:
    files = evaluate(short_take, tmp_path / "out", SHORT, progress=Silent())
    names = {path.name for path in files}
    assert {"REPORT.md", "table_1_native_rate.csv", "lifters.csv", "noise.csv"} <= names
    assert {"figure_2.png", "figure_3.png", "figures_4_5.png"} <= names
    assert all(path.stat().st_size > 0 for path in files)
    text = (tmp_path / "out" / "REPORT.md").read_text(encoding="utf-8")
    assert "seed = 0" in text and "07_05 (279 at 120 Hz)" in text and "±20°" in text
    assert "Where this differs from the paper" in text
    assert "nan" not in text.lower().replace("dominant", "")
    with (tmp_path / "out" / "report" / "lifters.csv").open(encoding="utf-8") as file:
        rows = {row[0]: row[1:] for row in csv.reader(file)}
    assert float(rows["default"][0]) < 0.6 * float(rows["paper, as written"][0])
    for picture in ("figure_2.png", "figure_3.png", "figures_4_5.png"):
        assert f"report/{picture}" in text
    # Once more into the same folder: refused, and nothing is lost.
    before = text
    with pytest.raises(OutputError, match="exists already"):
        evaluate(short_take, tmp_path / "out", SHORT, progress=Silent())
    assert (tmp_path / "out" / "REPORT.md").read_text(encoding="utf-8") == before


@pytest.mark.shared
def test_without_matplotlib_the_report_says_so(
    short_take: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real_import: Callable[..., Any] = builtins.__import__

    def no_plots(name: str, *args: Any, **kwargs: Any) -> Any:
        if name.split(".")[0] == "matplotlib":
            raise ImportError(name)
        return real_import(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", no_plots)
    # The comparison of lifters has no figures; it is left out to save time.
    monkeypatch.setattr(report, "lifter_tables", lambda *_: [])
    files = evaluate(short_take, tmp_path / "out", SHORT, progress=Silent())
    assert not any(path.suffix == ".png" for path in files)
    assert "matplotlib is not installed" in (tmp_path / "out" / "REPORT.md").read_text()


def test_wrong_use_is_refused_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="--views 0"):
        evaluate_command(tmp_path, output=tmp_path / "o", views=0)
    with pytest.raises(UsageError, match="--window 4"):
        evaluate_command(tmp_path, output=tmp_path / "o", window=4)
    with pytest.raises(UsageError, match="--rate-hz"):
        evaluate_command(tmp_path, output=tmp_path / "o", rate_hz=float("nan"))
    with pytest.raises(DataError, match="holds no"):
        evaluate_command(tmp_path, output=tmp_path / "o", quiet=True)
    with pytest.raises(DataError, match=r"jointAngleModel\.mat"):
        evaluate_command(tmp_path, output=tmp_path / "o", authors_limits=tmp_path, quiet=True)
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="file"):
        evaluate_command(tmp_path, output=tmp_path / "file", quiet=True)


@pytest.mark.shared
def test_a_take_that_is_too_short_is_named(short_take: Path, tmp_path: Path) -> None:
    path = short_take / "07_05.bvh"
    lines = path.read_text().splitlines()
    motion = lines.index("MOTION")
    lines[motion + 1] = "Frames: 100"
    path.write_text("\n".join(lines[: motion + 3 + 100]) + "\n")
    with pytest.raises(DataError, match=r"07_05 is 0\.8 s long"):
        evaluate(short_take, tmp_path / "out", SHORT, progress=Silent())
    assert not (tmp_path / "out" / "REPORT.md").exists()
