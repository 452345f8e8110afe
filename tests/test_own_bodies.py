"""Evaluation on bodies that the lifter does not know: perspective scenes, slow errors, angles."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dance2pose.body import body_bones_mm, bone_lengths, retarget
from dance2pose.body_variation import SPREAD
from dance2pose.evaluation.cameras import IMAGE_SIZE, scenes, with_noise, with_slow_errors
from dance2pose.evaluation.lifters import LifterEntry
from dance2pose.evaluation.metrics import flexion_errors
from dance2pose.evaluation.own_bodies import (
    conditions_table,
    on_drawn_bodies,
    own_bodies_tables,
    spoilings,
)
from dance2pose.evaluation.perspective_scenes import (
    HIGHEST_MM,
    LOWEST_MM,
    NEAREST_MM,
    perspective_scenes,
)
from dance2pose.evaluation.report import evaluate
from dance2pose.evaluation.scoring import run
from dance2pose.evaluation.settings import EvaluationSettings
from dance2pose.lifting.error_calibration import ErrorParts
from dance2pose.lifting.lifted import Lifted, Observed
from dance2pose.lifting.world.perspective import camera_of
from dance2pose.lifting.world.standing_place import place
from dance2pose.mocap.bodies import drawn_bodies, variations
from dance2pose.mocap.corpus import Take, read_take
from dance2pose.progress import Silent
from dance2pose.skeleton import get

CMU = get("cmu17")


def walking(name: str = "walk", frames: int = 90, rig: str = "cmu", seed: int = 0) -> Take:
    """A synthetic take that crosses the room, every bone swinging about a direction of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(frames)[:, None] / 30.0
    xyz = np.zeros((frames, len(CMU), 3))
    for parent, child in CMU.bones:
        rest = rng.normal(size=3) + np.array([0, 1.5 if child < 9 else -1.5, 0])
        bone = rest + rng.normal(0, 0.4, 3) * np.sin(2 * np.pi * t / rng.uniform(1.5, 4))
        xyz[:, child] = xyz[:, parent] + bone
    root = np.stack([900 * t[:, 0], 900 + 0 * t[:, 0], 500 * np.sin(t[:, 0])], axis=1)
    xyz = retarget(xyz, CMU, body_bones_mm("cmu17"))
    return Take(name, xyz, root, 30.0, "cmu17", rig)


def test_a_perspective_scene_is_what_its_camera_sees_of_the_whole_path() -> None:
    take = walking()
    made = perspective_scenes([take, walking("other", seed=1)], views=3, seed=5, rate_hz=30)
    assert [scene.take for scene in made] == ["walk"] * 3 + ["other"] * 3
    for scene in made:
        observed = scene.observed()
        assert observed.camera == "perspective" and observed.fov_deg == scene.fov_deg
        camera = camera_of(IMAGE_SIZE, scene.fov_deg)
        flat = (observed.xy - camera.centre) / camera.focal_px
        exact = ErrorParts(np.zeros(flat.shape[:2]), np.zeros(flat.shape[:2]), 0.0)
        root = place(scene.truth, flat, observed.confidence, exact, CMU).at
        off = camera.project(scene.truth + root[:, None]) - observed.xy
        assert np.abs(off).max() < 1e-6
        assert -(scene.truth + root[:, None])[..., 2].max() > 0.9 * NEAREST_MM
        width, height = IMAGE_SIZE
        assert ((observed.xy > [0, -height]) & (observed.xy < [width, 0])).all()
        # mm of the 2D are mm of the dancer, at the usual distance.
        usual = float(np.median(-root[:, 2]))
        assert scene.mm_per_pixel == pytest.approx(usual / camera.focal_px)
        # The path is the take's own: as far from one end to the other.
        walked = np.linalg.norm(root[-1] - root[0])
        assert take.root is not None
        if scene.take == "walk":
            assert walked == pytest.approx(np.linalg.norm(take.root[-1] - take.root[0]), rel=1e-6)
    assert LOWEST_MM < HIGHEST_MM and len({round(scene.tilt_deg, 3) for scene in made}) == 6
    again = perspective_scenes([take], views=3, seed=5, rate_hz=30)
    np.testing.assert_array_equal(again[2].xy, made[2].xy)


def test_slow_errors_have_the_size_and_duration_asked_for() -> None:
    scene = scenes([walking(frames=9000)], views=1, tilt_deg=0, seed=0)[0]
    slow = with_slow_errors(scene, np.random.default_rng(0), sigma_mm=15, correlation_s=1.0)
    off = slow.xy - scene.xy
    assert np.std(off) == pytest.approx(15, rel=0.05)
    assert np.std(off[0]) == pytest.approx(15, rel=0.4)  # from the first frame on
    after_a_second = np.mean(off[30:] * off[:-30]) / np.var(off)
    assert after_a_second == pytest.approx(np.exp(-1), abs=0.08)
    white = with_noise(scene, np.random.default_rng(0), sigma_mm=15).xy - scene.xy
    assert abs(np.mean(white[1:] * white[:-1])) < 0.02 * np.var(white)


def test_drawn_bodies_vary_as_people_do_and_have_one_size() -> None:
    factors = np.log(variations(np.random.default_rng(1), 20000))
    np.testing.assert_allclose(factors.std(axis=0), SPREAD, rtol=0.06)
    sides = np.array(CMU.mirror[1:]) - 1
    uneven = (factors - factors[:, sides])[:, sides != np.arange(16)]
    assert 0.01 < uneven.std() < 0.02  # left and right of one person are nearly alike
    for skeleton in ("cmu17", "body17"):
        lengths = drawn_bodies(np.random.default_rng(2), 7, skeleton)
        assert lengths.shape == (7, 16)
        np.testing.assert_allclose(lengths.sum(axis=1), body_bones_mm(skeleton).sum())
        assert np.ptp(lengths, axis=0).min() > 1


def test_takes_on_drawn_bodies_keep_their_directions_and_differ() -> None:
    takes = [walking(), walking("other", seed=3)]
    drawn = on_drawn_bodies(takes, seed=4)
    for before, after in zip(takes, drawn, strict=True):
        lengths = bone_lengths(after.xyz, CMU)
        assert lengths.sum() == pytest.approx(body_bones_mm("cmu17").sum())
        back = retarget(after.xyz, CMU, body_bones_mm("cmu17"))
        np.testing.assert_allclose(back, before.xyz, atol=1e-6)
    first, second = (bone_lengths(take.xyz, CMU) for take in drawn)
    assert np.abs(first - second).max() > 5


def bent(degrees: float) -> np.ndarray:
    """One pose (1, J, 3) whose limbs are straight but for a left knee bent by so much."""
    xyz = np.zeros((1, len(CMU), 3))
    for parent, child in CMU.bones:
        side = {"l": -1.0, "r": 1.0}.get(CMU.joints[child][0], 0.0) * (parent == 0)
        up = 1.0 if child < 9 else -1.0
        xyz[:, child] = xyz[:, parent] + 300 * np.array([side, up, 0.0])
    knee, ankle = CMU.index("left_knee"), CMU.index("left_ankle")
    angle = np.radians(degrees)
    xyz[:, ankle] = xyz[:, knee] + 300 * np.array([0, -np.cos(angle), -np.sin(angle)])
    return xyz


def test_angles_are_measured_on_knees_and_elbows_and_on_straight_ones() -> None:
    flexion, straight = flexion_errors(bent(20.0), bent(0.0), "cmu17")
    assert flexion == pytest.approx(20 / 4) and straight == pytest.approx(20 / 4)
    # A knee that is bent and seems straight is wrong, but no straight limb that seems bent.
    flexion, straight = flexion_errors(bent(0.0), bent(40.0), "cmu17")
    assert flexion == pytest.approx(40 / 4) and straight == pytest.approx(0)
    flexion, straight = flexion_errors(np.full((1, 17, 3), np.nan), bent(0.0), "cmu17")
    assert np.isnan(flexion) and np.isnan(straight)


def test_a_table_tells_rigs_conditions_and_sigma_apart() -> None:
    """A lifter that knows the truth but for one knee, and that of one rig alone."""
    takes = [walking(), walking("other", rig="poser", seed=3)]
    made = perspective_scenes(takes, views=1, seed=0, rate_hz=30)
    remaining = iter(made)

    def lift(observed: Observed) -> Lifted:
        scene = next(remaining)
        off = np.zeros((len(CMU), 3))
        off[CMU.index("left_knee")] = [0, 0, 170.0 * (scene.take == "other")]
        return Lifted(scene.truth + off, observed.xy, np.full(scene.truth.shape[:2], 100.0))

    found = run(LifterEntry("planted", lift), made, made, Silent(), "test")
    table = conditions_table("t", "T", {"clean": found}, takes)
    assert table.header[1:4] == ("all takes", "cmu rig", "poser rig")
    row = dict(zip(table.header, table.rows[0], strict=True))
    assert row["cmu rig"] == pytest.approx(0, abs=1e-9)
    assert row["all takes"] == pytest.approx(row["poser rig"] / 2)  # type: ignore[operator]
    assert row["MPJPE, mm"] == pytest.approx(170 / 17 / 2)
    assert row["within 1 σ, %"] == pytest.approx(100 * (1 - 1 / 16 / 2))
    assert row["within 2 σ, %"] == pytest.approx(100)
    assert row["knees and elbows, error, degrees"] > 1  # type: ignore[operator]


def test_tables_of_own_and_drawn_bodies_have_a_row_for_every_condition() -> None:
    settings = EvaluationSettings(views=1)

    def lift(observed: Observed) -> Lifted:
        shape = observed.confidence.shape
        return Lifted(np.full((*shape, 3), np.nan), observed.xy, np.ones(shape))

    tables = own_bodies_tables([walking()], settings, Silent(), LifterEntry("planted", lift))
    assert [table.name for table in tables] == [
        "own_bodies_perspective",
        "own_bodies_takes",
        "own_bodies_orthographic",
        "drawn_bodies_perspective",
        "drawn_bodies_orthographic",
    ]
    assert [row[0] for row in tables[0].rows] == [way.name for way in spoilings(settings)]
    assert np.isnan(tables[0].rows[0][1])  # type: ignore[arg-type]


def test_single_pictures_are_given_as_such_and_spoiled_scenes_stay_apart() -> None:
    settings = EvaluationSettings(views=1)
    scene = perspective_scenes([walking()], views=1, seed=0, rate_hz=30)[0]
    ways = {way.name: way for way in spoilings(settings)}
    assert [way.independent for way in ways.values()] == [False] * 4 + [True]
    rng = np.random.default_rng(0)
    spoiled = {name: way.change(scene, rng).xy - scene.xy for name, way in ways.items()}
    assert np.abs(spoiled["clean"]).max() == 0
    assert np.std(spoiled["white 10 mm"]) == pytest.approx(10, rel=0.1)
    assert np.std(spoiled["slow 15 mm, white 5 mm"]) == pytest.approx(15.8, rel=0.15)
    assert np.isnan(spoiled["15% missing"]).mean() == pytest.approx(0.15, abs=0.05)
    pixels = replace(scene, xy=scene.xy + np.array([scene.mm_per_pixel, 0])).observed().xy
    np.testing.assert_allclose(pixels - scene.observed().xy, [[[1.0, 0.0]] * 17] * 90)


@pytest.mark.shared
def test_a_take_on_its_performers_bones_differs_in_lengths_alone(shared: Path) -> None:
    path = shared / "mocap" / "train" / "135_martial_03.bvh"
    one, own = read_take(path), read_take(path, own_bones=True)
    assert one.rig == own.rig == "poser"
    lengths = bone_lengths(own.xyz, CMU) / body_bones_mm("cmu17")
    assert lengths[0] == pytest.approx(1.35, abs=0.02)  # trunk
    assert lengths[8] == pytest.approx(0.63, abs=0.02)  # hips
    np.testing.assert_allclose(bone_lengths(own.xyz, CMU).sum(), body_bones_mm("cmu17").sum())
    back = retarget(own.xyz, CMU, body_bones_mm("cmu17"))
    np.testing.assert_allclose(back, one.xyz, atol=1e-6)


@pytest.mark.shared
def test_the_report_of_own_bodies_alone(shared: Path, tmp_path: Path) -> None:
    lines = (shared / "mocap" / "eval" / "07_05.bvh").read_text().splitlines()
    motion = lines.index("MOTION")
    lines[motion + 1] = "Frames: 280"
    source = tmp_path / "takes" / "07_05.bvh"
    source.parent.mkdir()
    source.write_text("\n".join(lines[: motion + 3 + 280]) + "\n")
    settings = EvaluationSettings(views=1, only_own_bodies=True)
    files = evaluate(source.parent, tmp_path / "out", settings, progress=Silent())
    text = (tmp_path / "out" / "REPORT.md").read_text(encoding="utf-8")
    assert "--only-own-bodies" in text and "bodies drawn from human variation" in text
    assert {path.name for path in files} >= {"own_bodies_perspective.csv", "REPORT.md"}
    assert "Paper" not in text.split("## ")[1] and text.count("## ") == 1
