"""Training views: bodies, detectors and what the network is told, from takes made here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dance2pose.body import body_bones_mm, bone_lengths, retarget
from dance2pose.lifting.temporal.network import BONES, FEATURES, JOINTS
from dance2pose.mocap.bodies import drawn_bodies
from dance2pose.mocap.corpus import Take
from dance2pose.skeleton import get
from lifter_training.bodies import bodies, limbs_stretched, limbs_turned, posed
from lifter_training.detections import noise
from lifter_training.takes import TakeStore
from lifter_training.views import Mixture, random_views

CMU = get("cmu17")
PARENTS, CHILDREN = np.array(CMU.bones).T
SIDES = np.array(CMU.mirror[1:]) - 1


def takes(skeleton: str) -> list[Take]:
    """Three takes of 60 to 150 frames on bodies of their own, the last on positions alone."""
    out = []
    for number, frames in enumerate((60, 90, 150)):
        rng = np.random.default_rng(number)
        t = np.arange(frames)[:, None] / 60.0
        xyz = np.zeros((frames, JOINTS, 3))
        for parent, child in CMU.bones:
            rest = rng.normal(size=3) + np.array([0, 1.5 if child < 9 else -1.5, 0])
            swing = rng.normal(0, 0.4, 3) * np.sin(2 * np.pi * t / rng.uniform(1, 3))
            xyz[:, child] = xyz[:, parent] + rest + swing
        lengths = drawn_bodies(rng, 1, skeleton)[0]
        root = np.cumsum(np.full((frames, 3), 5.0), axis=0) if number < 2 else None
        xyz = retarget(xyz, get(skeleton), lengths)
        out.append(Take(f"take{number}", xyz, root, 60.0, skeleton))
    return out


@pytest.fixture(scope="module")
def store() -> TakeStore:
    return TakeStore(takes("cmu17"), takes("body17"))


def test_a_store_knows_each_takes_performer_and_gives_clips_of_one_take(store: TakeStore) -> None:
    assert len(store) == 300 and list(store.of_performer) == [0, 1]
    assert store.names == ["take0", "take1", "take2"]
    for kind, skeleton in enumerate(("cmu17", "body17")):
        for number, take in enumerate(takes(skeleton)):
            wanted = bone_lengths(take.xyz, get(skeleton))
            np.testing.assert_allclose(store.lengths[kind, number], wanted)
    body17 = np.array([False, True] * 20)
    clips = store.clips(np.random.default_rng(0), body17, 9, 4)
    assert clips.bones.shape == (40, 13, BONES, 3) and clips.root.shape == (40, 9, 3)
    lengths = np.linalg.norm(clips.bones, axis=-1)
    expected = store.lengths[body17.astype(int), clips.take][:, None]
    np.testing.assert_allclose(lengths, np.broadcast_to(expected, lengths.shape), rtol=1e-4)


def test_bodies_are_what_is_asked_for_and_of_one_size(store: TakeStore) -> None:
    rng = np.random.default_rng(1)
    body17 = rng.random(300) < 0.5
    clips = store.clips(rng, body17, 1, 0)
    made = {
        which: bodies(store, clips, body17, rng, which)
        for which in ("one", "own", "drawn", "mixed")
    }
    for skeleton, rows in (("cmu17", ~body17), ("body17", body17)):
        usual = body_bones_mm(skeleton)
        for lengths in made.values():
            np.testing.assert_allclose(lengths[rows].sum(axis=1), usual.sum())
        np.testing.assert_allclose(made["one"][rows], np.tile(usual, (rows.sum(), 1)))
    own = store.lengths[body17.astype(int), clips.take]
    np.testing.assert_allclose(made["own"], own)
    for which in ("drawn", "mixed"):
        ratio = made[which][~body17] / body_bones_mm("cmu17")
        assert (ratio.std(axis=0) > 0.03).all()
    uneven = np.log(made["mixed"] / made["mixed"][:, SIDES])[:, np.arange(BONES) != SIDES]
    assert 0.005 < uneven.std() < 0.05


def test_poses_have_their_bodies_bones_and_half_are_mirrored(store: TakeStore) -> None:
    rng = np.random.default_rng(2)
    body17 = np.zeros(64, bool)
    clips = store.clips(rng, body17, 5, 0)
    wanted = bodies(store, clips, body17, rng, "mixed")
    lengths = wanted.copy()
    xyz = posed(clips.bones, lengths, rng)
    found = np.linalg.norm(xyz[:, :, CHILDREN] - xyz[:, :, PARENTS], axis=-1)
    np.testing.assert_allclose(found, np.broadcast_to(lengths[:, None], found.shape), rtol=1e-4)
    flipped = np.abs(lengths - wanted).max(axis=1) > 0
    np.testing.assert_allclose(lengths[flipped], wanted[flipped][:, SIDES])
    assert 15 < flipped.sum() < 50


def test_limbs_turn_whole_so_that_elbows_and_knees_stay_as_they_are(store: TakeStore) -> None:
    rng = np.random.default_rng(3)
    clips = store.clips(rng, np.zeros(200, bool), 3, 0)
    turned = limbs_turned(clips.bones, rng)
    moved = np.abs(turned - clips.bones).max(axis=(1, 2, 3)) > 1
    assert 20 < moved.sum() < 65
    for first, second in ((2, 3), (5, 6), (9, 10), (13, 14)):
        before, after = (
            np.einsum("btj,btj->bt", bones[:, :, first], bones[:, :, second])
            for bones in (clips.bones, turned)
        )
        np.testing.assert_allclose(after, before, rtol=1e-3, atol=20)
    np.testing.assert_array_equal(turned[:, :, [0, 1, 7, 8]], clips.bones[:, :, [0, 1, 7, 8]])


def test_stretched_limbs_lose_one_part_of_their_bend_and_nothing_else_changes(
    store: TakeStore,
) -> None:
    rng = np.random.default_rng(4)
    clips = store.clips(rng, np.zeros(300, bool), 3, 0)
    stretched = limbs_stretched(clips.bones, rng)
    moved = np.abs(stretched - clips.bones).max(axis=(1, 2, 3)) > 1
    assert 15 < moved.sum() < 60
    for upper, lower in ((2, 3), (5, 6), (9, 10), (13, 14)):
        some = np.abs(stretched[:, :, lower] - clips.bones[:, :, lower]).max(axis=(1, 2)) > 1
        before, after = (_bend(bones[some], upper, lower) for bones in (clips.bones, stretched))
        part = (after / before).reshape(-1)[before.reshape(-1) > 0.1]
        nearest = np.abs(part[:, None] - [0.5, 0.2, 0.05, 0.0]).min(axis=1)
        assert len(part) and nearest.max() < 0.01
    lengths = (np.linalg.norm(bones, axis=-1) for bones in (clips.bones, stretched))
    np.testing.assert_allclose(*lengths, rtol=1e-4)
    trunk = [0, 1, 2, 4, 5, 7, 8, 9, 12, 13]
    np.testing.assert_array_equal(stretched[:, :, trunk], clips.bones[:, :, trunk])


def _bend(bones: np.ndarray, upper: int, lower: int) -> np.ndarray:
    first, second = bones[:, :, upper], bones[:, :, lower]
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    return np.asarray(np.arctan2(across, (first * second).sum(axis=-1)))


def test_slow_errors_last_and_their_level_is_known() -> None:
    clip, far = 20, 12
    made = noise((4000, clip + far, JOINTS, 2), clip, np.random.default_rng(4))
    clean = np.abs(made.offset).max(axis=(1, 2, 3)) == 0
    assert 0.2 < clean.mean() < 0.5 and (made.level[clean] == 0).all()
    calm = (made.confidence == 1).all(axis=(1, 2)) & (made.level > 5)
    size = np.sqrt(np.square(made.offset[calm]).mean(axis=(1, 2, 3)))
    assert np.corrcoef(size, made.level[calm])[0, 1] > 0.5
    # What the clip's frames have in common is what no average mends.
    common = made.offset[calm][:, :clip].mean(axis=1)
    assert 0.5 < np.sqrt(np.square(common).mean()) / made.level[calm].mean() < 1.1
    alone = noise((4000, 1, JOINTS, 2), 1, np.random.default_rng(5))
    calm = (alone.confidence == 1).all(axis=(1, 2)) & (alone.level > 0)
    off = alone.offset[calm] / alone.level[calm, None, None, None]
    # A few are wholly wrong.
    assert np.quantile(np.abs(off), 0.68) == pytest.approx(1, rel=0.1)


def test_without_imperfections_the_network_is_given_the_truth(store: TakeStore) -> None:
    mixture = Mixture(training=False, body="own", body17=0.0)
    views = random_views(store, np.random.default_rng(6), count=9, length=4, mixture=mixture)
    assert views.given.features.shape == (9, 4, FEATURES)
    scale = views.given.scale[:, None, None, None] * 250
    xy = views.given.features[..., : 2 * JOINTS].reshape(9, 4, JOINTS, 2)
    np.testing.assert_allclose(xy * scale, views.truth[..., :2], atol=0.01)
    found = np.linalg.norm(views.truth[:, :, CHILDREN] - views.truth[:, :, PARENTS], axis=-1)
    np.testing.assert_allclose(found.sum(axis=-1), body_bones_mm("cmu17").sum(), rtol=1e-4)


def test_training_views_are_finite_and_say_different_things(store: TakeStore) -> None:
    known, sized, stated = 84 + BONES, 85 + BONES, 86 + BONES
    for length, shares in ((6, (0.35, 0.0)), (1, (0.25, 0.4))):
        views = random_views(store, np.random.default_rng(7), count=800, length=length)
        features = views.given.features
        assert np.isfinite(features).all() and np.isfinite(views.truth).all()
        assert features[:, 0, known].mean() == pytest.approx(shares[0], abs=0.06)
        assert features[:, 0, sized].mean() == pytest.approx(shares[1], abs=0.06)
        assert features[:, 0, stated].mean() == pytest.approx(0.4, abs=0.06)
    again = random_views(store, np.random.default_rng(7), count=800, length=1)
    np.testing.assert_array_equal(again.given.features, features)


def test_a_network_starts_as_another_with_fewer_features_and_blocks(tmp_path: Path) -> None:
    torch = pytest.importorskip("torch")
    from lifter_training.model import DepthNetwork, export, weights_of

    small = DepthNetwork(16, 2)
    for parameter in small.parameters():  # as after training: no two alike
        torch.nn.init.normal_(parameter, std=0.3)
    wide = DepthNetwork(16, 3)
    weights = {k: v for k, v in small.state_dict().items() if not k.startswith("bones.")}
    weights["enter.weight"] = weights["enter.weight"][:, :84]
    wide.start_from(weights)
    few = torch.randn(2, 5, FEATURES)
    with torch.no_grad():
        small.enter.weight[:, 84:] = 0
        torch.testing.assert_close(wide.eval()(few)[0], small.eval()(few)[0])
    export(small, tmp_path / "small.onnx")
    again = DepthNetwork(16, 2)
    again.start_from(weights_of(tmp_path / "small.onnx"))
    with torch.no_grad():
        for found, expected in zip(again.eval()(few), small(few), strict=True):
            torch.testing.assert_close(found, expected)
