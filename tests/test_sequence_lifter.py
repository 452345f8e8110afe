"""The default lifter: what must hold of its answers whatever the network has learned."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose.body import Body, body_bones_mm
from dance2pose.errors import UsageError
from dance2pose.lifting.lift import lift, lift_with_bodies
from dance2pose.lifting.lifted import Observed
from dance2pose.lifting.temporal import sequence, windows
from dance2pose.lifting.temporal.one_body import SequenceSettings
from dance2pose.lifting.temporal.sequence import lift_frames
from dance2pose.lifting.temporal.track_rows import LONGEST_GAP_S
from dance2pose.limits import model as limits
from dance2pose.mocap.corpus import Take, read_take, resample
from dance2pose.poses import FloatArray, Timeline, Track2D
from dance2pose.skeleton import get

pytestmark = pytest.mark.shared
WIDTH, HEIGHT = 640, 480


def aligned_error(xyz: FloatArray, truth: FloatArray) -> float:
    """PA-MPJPE without reflection, one frame at a time."""
    errors = []
    for x, y in zip(xyz, truth, strict=True):
        x, y = x - x.mean(axis=0), y - y.mean(axis=0)
        rotation, _ = Rotation.align_vectors(y, x)
        turned = rotation.apply(x)
        factor = (turned * y).sum() / np.square(x).sum()
        errors.append(np.linalg.norm(factor * turned - y, axis=1).mean())
    return float(np.mean(errors))


@pytest.fixture(scope="module")
def take(shared: Path) -> Take:
    return seen_from_above(shared, "cmu17")


def seen_from_above(shared: Path, skeleton: str) -> Take:
    """Four seconds of a take of the evaluation set, seen from the side a little above."""
    full = read_take(shared / "mocap" / "eval" / "05_12.bvh", skeleton)
    turn = Rotation.from_euler("yx", [40, 8], degrees=True).as_matrix()
    assert full.root is not None
    return replace(full, xyz=full.xyz[800:1280] @ turn.T, root=full.root[800:1280] @ turn.T)


def observed(xyz: FloatArray, rate_hz: float = 30.0, **changes: object) -> Observed:
    """An orthographic picture of poses (T, J, 3) mm: 0.2 px a mm, somewhere in the picture."""
    xy = xyz[..., :2] * 0.2 + [300.0, -220.0]
    given = Observed(
        xy=xy,
        confidence=np.ones(xy.shape[:2]),
        time_s=2.5 + np.arange(len(xy)) / rate_hz,
        skeleton="cmu17",
        image_size=(WIDTH, HEIGHT),
    )
    return replace(given, **changes)  # type: ignore[arg-type]


def track(given: Observed, skeleton: str = "cmu17") -> Track2D:
    frames = len(given)
    return Track2D(
        person=3,
        timeline=Timeline(np.arange(5, 5 + frames), given.time_s),
        xy=given.xy * [1.0, -1.0],
        confidence=given.confidence,
        skeleton=skeleton,
        interpolated=np.zeros(frames, bool),
        box=np.full((frames, 4), np.nan),
        image_size=given.image_size,
    )


def test_close_to_the_truth_on_motion_it_never_saw(take: Take) -> None:
    truth = resample(take, 30.0).xyz
    lifted = lift_frames(observed(truth))
    # The paper's lifter is beyond 60 mm here; a mirrored or flattened body beyond 100.
    assert aligned_error(lifted.xyz, truth) < 40
    flat = truth * [1.0, 1.0, 0.0]
    assert aligned_error(lifted.xyz, truth) < 0.5 * aligned_error(flat, truth)


def test_depth_points_towards_the_viewer(take: Take) -> None:
    truth = resample(take, 30.0).xyz
    z = lift_frames(observed(truth)).xyz[..., 2]
    assert np.corrcoef(z.ravel(), (truth[..., 2] - truth[:, :1, 2]).ravel())[0, 1] > 0.8


def test_bones_are_constant_and_within_limits(take: Take) -> None:
    truth = resample(take, 30.0).xyz
    noisy = truth + np.random.default_rng(4).normal(0, 10, truth.shape)
    xyz = lift_frames(observed(noisy)).xyz
    parents, children = np.array(get("cmu17").bones).T
    lengths = np.linalg.norm(xyz[:, children] - xyz[:, parents], axis=-1)
    assert np.ptp(lengths, axis=0).max() < 1e-6
    assert lengths[0].sum() == pytest.approx(body_bones_mm("cmu17").sum(), rel=1e-6)
    assert limits.load("cmu17").is_valid(xyz).mean() >= 0.995


def test_same_motion_at_every_frame_rate(take: Take) -> None:
    reference = lift_frames(observed(resample(take, 30.0).xyz)).xyz
    for rate in (10.0, 24.0, 25.0, 29.97, 60.0, 120.0):
        motion = resample(take, rate).xyz
        lifted = lift_frames(observed(motion, rate))
        assert lifted.xyz.shape == motion.shape
        at = np.arange(len(reference)) * rate / 30.0
        at = at[at < len(motion) - 1]
        near = np.rint(at).astype(int)
        off = np.linalg.norm(lifted.xyz[near] - reference[: len(at)], axis=-1).mean()
        assert off < 30, rate
        assert aligned_error(lifted.xyz, motion) < 45, rate


def test_uneven_times_are_taken_as_they_are(take: Take) -> None:
    rows = np.unique(np.cumsum(np.random.default_rng(1).integers(2, 8, 200)))
    rows = rows[rows < len(take.xyz)]
    given = observed(take.xyz[rows], time_s=rows / take.rate_hz)
    assert aligned_error(lift_frames(given).xyz, take.xyz[rows]) < 45


def test_no_lag(take: Take) -> None:
    truth = resample(take, 30.0).xyz
    wrist = get("cmu17").index("left_wrist")
    said = np.diff(lift_frames(observed(truth)).xyz[:, wrist, 0])
    real = np.diff(truth[:, wrist, 0] - truth[:, 0, 0])
    shifts = range(-4, 5)
    match = [np.dot(said[4 + s : len(said) - 4 + s], real[4:-4]) for s in shifts]
    assert shifts[int(np.argmax(match))] == 0


def test_place_and_size_in_the_picture_do_not_matter(take: Take) -> None:
    given = observed(resample(take, 30.0).xyz[:50])
    moved = replace(given, xy=given.xy * 7.5 + [-4000.0, 90.0])
    np.testing.assert_allclose(lift_frames(moved).xyz, lift_frames(given).xyz, atol=0.5)


def test_mirror_image_gives_mirrored_pose(take: Take) -> None:
    given = observed(resample(take, 30.0).xyz[:40])
    order = list(get("cmu17").mirror)
    mirrored = replace(given, xy=given.xy[:, order] * [-1.0, 1.0])
    settings = SequenceSettings(limits=False)  # learned limits are not quite symmetric
    expected = lift_frames(given, settings=settings).xyz[:, order] * [-1.0, 1.0, 1.0]
    np.testing.assert_allclose(lift_frames(mirrored, settings=settings).xyz, expected, atol=0.5)


def test_independent_pictures_do_not_know_each_other(take: Take) -> None:
    truth = resample(take, 30.0).xyz[::9][:7]
    together = lift_frames(observed(truth, independent=True))
    shuffled = lift_frames(observed(truth[::-1], independent=True))
    np.testing.assert_allclose(shuffled.xyz[::-1], together.xyz, atol=1e-3)
    alone = lift_frames(observed(truth[2:3], independent=True))
    np.testing.assert_allclose(alone.xyz[0], together.xyz[2], atol=1e-3)


def test_missing_joints_are_estimated_and_less_sure(take: Take) -> None:
    given = observed(resample(take, 30.0).xyz)
    wrist = get("cmu17").index("right_wrist")
    given.xy[30:45, wrist] = np.nan
    given.confidence[30:45, wrist] = 0
    result = lift(track(given))
    assert result.estimated[30:45, wrist].all() and result.estimated.sum() == 15
    assert np.isfinite(result.xyz).all()
    assert result.sigma is not None
    assert result.sigma[30:45, wrist].mean() > result.sigma[:30, wrist].mean()


def test_short_absence_is_bridged_and_long_one_stays_unknown(take: Take) -> None:
    given = observed(resample(take, 30.0).xyz)
    long = int(30 * LONGEST_GAP_S) + 5
    given.xy[20:26] = np.nan
    given.xy[60 : 60 + long] = np.nan
    given.confidence[np.isnan(given.xy[..., 0])] = 0
    result = lift(track(given))
    assert np.isfinite(result.xyz[:60]).all()
    assert result.estimated[20:26].all()
    assert np.isnan(result.xyz[60 : 60 + long]).all()
    assert np.isfinite(result.xyz[60 + long :]).all()


def test_half_body_gives_the_upper_body_and_says_what_was_not_seen(take: Take) -> None:
    truth = resample(take, 30.0).xyz
    given = observed(truth)
    legs = [
        get("cmu17").index(f"{side}_{j}")
        for side in ("left", "right")
        for j in ("knee", "ankle", "toe")
    ]
    given.xy[:, legs] = np.nan
    given.confidence[:, legs] = 0
    result = lift(track(given))
    upper = [j for j in range(17) if j not in legs]
    assert result.estimated[:, legs].all() and not result.estimated[:, upper].any()
    assert aligned_error(result.xyz[:, upper], truth[:, upper]) < 60
    assert result.sigma is not None
    assert result.sigma[:, legs].mean() > 2 * result.sigma[:, upper].mean()


@pytest.mark.parametrize("skeleton", ["paper15", "coco17", "halpe26"])
def test_other_skeletons(shared: Path, skeleton: str) -> None:
    source = "cmu17" if skeleton == "paper15" else "body17"
    motion = resample(read_take(shared / "mocap" / "eval" / "05_12.bvh", source), 30.0).xyz[:40]
    names = get(skeleton).joints
    aliases = {"pelvis": "root", "neck": "upper_back"} if source == "cmu17" else {}
    aliases |= {
        "left_ear": "head",
        "right_ear": "head",
        "left_big_toe": "left_toe",
        "right_big_toe": "right_toe",
    }
    xy = np.full((len(motion), len(names), 2), np.nan)
    for j, name in enumerate(names):
        known = aliases.get(name, name)
        if known in get(source).joints:
            xy[:, j] = motion[:, get(source).index(known), :2] * 0.2 + [300.0, -220.0]
    given = observed(motion, xy=xy, confidence=np.isfinite(xy[..., 0]).astype(float))
    result = lift(track(given, skeleton))
    kept = "paper15" if skeleton == "paper15" else "body17"
    assert result.skeleton == kept and result.xyz.shape == (40, len(get(kept)), 3)
    if kept == "body17":
        assert np.isfinite(result.xyz).all()
        assert aligned_error(result.xyz * 1650, motion) < 60
        toes = [get("body17").index(f"{s}_toe") for s in ("left", "right")]
        assert result.estimated[:, toes].all() == (skeleton == "coco17")


def test_real_cameras_are_perspective_unless_the_picture_is_not_known(take: Take) -> None:
    given = track(observed(resample(take, 30.0).xyz[:30]))
    assert lift(given).root is not None
    assert lift(given, camera="weak-perspective").root is None
    unknown = replace(given, image_size=(0, 0))
    np.testing.assert_array_equal(lift(unknown).xyz, lift(given, camera="weak-perspective").xyz)
    with pytest.raises(UsageError, match="size of its picture is not known"):
        lift(unknown, camera="perspective")


def test_perspective_footage_is_lifted_better_as_such(take: Take) -> None:
    truth = resample(take, 30.0)
    assert truth.root is not None
    world = truth.xyz + (truth.root - truth.root[:1] + [0.0, -300.0, -3500.0])[:, None]
    focal = WIDTH / 2 / np.tan(np.radians(25.0))
    xy = -focal * world[..., :2] / world[..., 2:] + [(WIDTH - 1) / 2, -(HEIGHT - 1) / 2]
    seen = track(observed(truth.xyz, xy=xy))
    weak = aligned_error(lift(seen, camera="weak-perspective").xyz, truth.xyz)
    assert aligned_error(lift(seen, fov_deg=50.0).xyz, truth.xyz) < weak
    # A field of view that is a third off costs less than an orthographic camera does.
    assert aligned_error(lift(seen, fov_deg=35.0).xyz, truth.xyz) < weak


def test_height_sets_metres(take: Take) -> None:
    given = track(observed(resample(take, 30.0).xyz[:30]))
    heights, metres = lift(given), lift(given, height_m=1.7)
    assert (heights.unit, metres.unit) == ("body heights", "metres")
    np.testing.assert_allclose(metres.xyz, 1.7 * heights.xyz)
    assert metres.sigma is not None and heights.sigma is not None
    np.testing.assert_allclose(metres.sigma, 1.7 * heights.sigma)


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_very_short_tracks(take: Take, frames: int) -> None:
    lifted = lift_frames(observed(take.xyz[:frames]))
    assert np.isfinite(lifted.xyz).all() and lifted.xyz.shape == (frames, 17, 3)


def test_a_body_known_before_is_the_one_that_is_found(take: Take) -> None:
    truth = resample(take, 30.0).xyz[:40]
    usual = body_bones_mm("cmu17")
    lengths = usual * np.where(np.arange(len(usual)) % 3 == 0, 1.15, 0.95)
    lengths *= usual.sum() / lengths.sum()
    known = Body("cmu17", lengths, np.full(len(usual), 0.001))
    lifted = lift_frames(observed(truth, body=known))
    assert lifted.body is not None
    np.testing.assert_allclose(lifted.body.lengths_mm, lengths, rtol=0.01)
    parents, children = np.array(get("cmu17").bones).T
    found = np.linalg.norm(lifted.xyz[:, children] - lifted.xyz[:, parents], axis=-1)
    np.testing.assert_allclose(found.mean(axis=0), lifted.body.lengths_mm, rtol=1e-6)


def test_bodies_found_can_be_given_to_the_next_run(take: Take) -> None:
    given = track(observed(resample(take, 30.0).xyz[:40]))
    tracks, bodies = lift_with_bodies([given])
    (body,) = bodies
    assert body is not None and body.skeleton == "cmu17"
    (again,), (same,) = lift_with_bodies([given], bodies={"3": body})
    assert same is not None
    np.testing.assert_allclose(same.lengths_mm, body.lengths_mm, rtol=0.03)
    assert np.abs(again.xyz - tracks[0].xyz).mean() * 1650 < 15
    other = Body("body17", body_bones_mm("body17"), np.full(16, 0.02))
    with pytest.raises(UsageError, match="bones of the one are not bones of the other"):
        lift_with_bodies([given], bodies={"1": other})
    _, (none,) = lift_with_bodies([given], independent=True)
    assert none is None


def test_limits_turn_no_bone_far_and_move_no_joint_in_the_picture(take: Take) -> None:
    truth = resample(take, 30.0).xyz
    rng = np.random.default_rng(8)
    given = observed(truth + np.cumsum(rng.normal(0, 2.0, truth.shape), axis=0))
    within = lift_frames(given)
    without = lift_frames(given, settings=SequenceSettings(limits=False))
    parents, children = np.array(get("cmu17").bones).T

    def turns_deg(xyz: FloatArray) -> FloatArray:
        bone = xyz[:, children] - xyz[:, parents]
        bone /= np.linalg.norm(bone, axis=-1, keepdims=True)
        return np.degrees(np.arccos(np.clip((bone[1:] * bone[:-1]).sum(axis=-1), -1, 1)))

    assert (turns_deg(within.xyz) <= np.maximum(turns_deg(without.xyz), 40.0) + 1e-6).all()
    np.testing.assert_allclose(within.projected, without.projected, atol=1e-6)


def test_nothing_seen_gives_nothing(take: Take) -> None:
    given = observed(take.xyz[:7])
    given.xy[:] = np.nan
    assert np.isnan(lift_frames(given).xyz).all()


@pytest.mark.parametrize("frames", [1, 2, 7, 40])
@pytest.mark.parametrize("independent", [False, True])
@pytest.mark.parametrize("what", ["one point", "still", "noise", "no legs", "most frames lost"])
def test_odd_keypoints_end_in_poses_or_in_nothing(
    take: Take, what: str, frames: int, independent: bool
) -> None:
    given = observed(resample(take, 30.0).xyz[:frames])
    rng = np.random.default_rng(3)
    if what == "one point":
        given.xy[:] = given.xy[:, :1]
    elif what == "still":
        given.xy[:] = given.xy[:1]
    elif what == "noise":
        given.xy[:] = rng.uniform(0, 400, given.xy.shape)
    elif what == "no legs":
        given.xy[:, 9:] = np.nan
    else:
        given.xy[rng.random(frames) < 0.7] = np.nan
    given.confidence[:] = np.isfinite(given.xy).all(axis=-1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = lift(track(given), independent=independent)
    posed = np.isfinite(result.xyz).all(axis=(1, 2))
    assert posed.any() or what == "most frames lost"
    assert np.isnan(result.xyz[~posed]).all()
    assert result.root is not None and np.isnan(result.root[~posed]).all()
    if what in ("still", "no legs"):
        assert np.isfinite(result.root[posed]).all()


def walked(take: Take, farther: float = 1.0) -> tuple[Observed, FloatArray, FloatArray]:
    """The take as a perspective camera sees it, its poses (T, J, 3) and its path (T, 3) mm.

    farther: how many times as far the dancer goes towards the camera and away.
    """
    truth = resample(take, 30.0)
    assert truth.root is not None
    path = (truth.root - truth.root[:1]) * [1.0, 1.0, farther] + [0.0, -300.0, -4500.0]
    world = truth.xyz + path[:, None]
    focal = WIDTH / 2 / np.tan(np.radians(30.0))
    xy = -focal * world[..., :2] / world[..., 2:] + [(WIDTH - 1) / 2, -(HEIGHT - 1) / 2]
    given = observed(truth.xyz, xy=xy, camera="perspective", fov_deg=60.0, skeleton=take.skeleton)
    return given, truth.xyz, path


def test_a_window_is_lifted_as_the_whole_track_that_told_its_body(
    shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given, _, _ = walked(seen_from_above(shared, "body17"), farther=3.0)
    noise = np.random.default_rng(0).normal(0, 1.5, given.xy.shape)
    given = replace(given, xy=given.xy + noise)
    whole = lift_frames(given)
    monkeypatch.setattr(sequence, "LONGEST_WHOLE", len(given) - 1)
    monkeypatch.setattr(windows, "TELLING", len(given))
    assert len(windows.telling_rows(len(given))) == len(given)
    window = lift_frames(given)
    assert whole.root is not None and window.root is not None
    # Where a window begins with the body rather than ends with it, 4 mm and 9 mm.
    assert np.median(np.linalg.norm(window.xyz - whole.xyz, axis=-1)) < 0.5
    assert np.median(np.linalg.norm(window.root - whole.root, axis=-1)) < 1.0


def test_perspective_gives_the_path(take: Take) -> None:
    given, truth, path = walked(take)
    lifted = lift_frames(given, settings=SequenceSettings())
    assert lifted.root is not None and np.isfinite(lifted.root).all()
    assert aligned_error(lifted.xyz, truth) < 50
    shape = lifted.root - lifted.root.mean(axis=0) - (path - path.mean(axis=0))
    assert np.ptp(path, axis=0).max() > 300  # the dancer does go somewhere
    assert np.abs(shape[:, :2]).mean() < 100
    assert np.abs(shape[:, 2]).mean() < 250  # size tells the distance less well than place
    assert np.nanmax(np.linalg.norm(lifted.projected - given.xy, axis=-1)) < 60
