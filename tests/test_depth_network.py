"""What the depth network is given: features of clips, of what is known of the dancer."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from dance2pose.body import body_bones_mm
from dance2pose.lifting.temporal import depth
from dance2pose.lifting.temporal.depth import Known
from dance2pose.lifting.temporal.network import (
    BONE_OUTPUTS,
    BONES,
    FEATURES,
    JOINTS,
    OUTPUTS,
    NetworkInput,
    longest_projections,
    mirrored,
    network_input,
)
from dance2pose.mocap.bodies import drawn_bodies
from dance2pose.poses import FloatArray
from dance2pose.skeleton import get

CMU = get("cmu17")
PARENTS, CHILDREN = np.array(CMU.bones).T
# Where features of one kind lie.
AS_KNOWN = slice(84, 84 + BONES)
KNOWN, SIZED, STATED, ERROR = range(84 + BONES, FEATURES)


def posed(lengths: FloatArray, frames: int = 7, seed: int = 0) -> FloatArray:
    """Poses (T, J, 3) with random directions and these bone lengths (J - 1,)."""
    rng = np.random.default_rng(seed)
    xyz = np.zeros((frames, JOINTS, 3))
    for bone, (parent, child) in enumerate(CMU.bones):
        direction = rng.normal(size=(frames, 3))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        xyz[:, child] = xyz[:, parent] + lengths[bone] * direction
    return xyz


def given(xyz: FloatArray, **known: FloatArray) -> NetworkInput:
    clips = len(xyz)
    return network_input(
        xyz[..., :2],
        np.ones(xyz.shape[:3]),
        body_definition=np.zeros(clips, bool),
        **known,  # type: ignore[arg-type]
    )


def test_known_lengths_say_exactly_how_far_apart_in_depth_a_bones_ends_lie() -> None:
    lengths = drawn_bodies(np.random.default_rng(1), 3, "cmu17")
    xyz = np.stack([posed(each, seed=i) for i, each in enumerate(lengths)])
    scale = np.array([0.5, 1.0, 3.0])
    pixels = xyz * scale[:, None, None, None]
    made = given(pixels, longest=lengths * scale[:, None], known=np.ones(3, bool))
    np.testing.assert_allclose(made.scale, scale)  # all bodies have one sum of lengths
    apart = np.abs(xyz[:, :, CHILDREN, 2] - xyz[:, :, PARENTS, 2]) / 250
    np.testing.assert_allclose(made.features[..., AS_KNOWN], apart, atol=1e-3)
    assert (made.features[..., KNOWN] == 1).all() and (made.features[..., SIZED] == 0).all()


def test_nothing_is_said_of_bones_whose_size_alone_is_known() -> None:
    xyz = posed(body_bones_mm("cmu17"))[None] * 2.0
    made = given(xyz, longest=np.full((1, BONES), np.nan), scale=np.array([2.0]))
    np.testing.assert_allclose(made.scale, 2.0)
    assert (made.features[..., SIZED] == 1).all() and (made.features[..., KNOWN] == 0).all()
    assert (made.features[..., AS_KNOWN] == 0).all()
    np.testing.assert_allclose(
        made.features[0, :, : 2 * JOINTS], xyz[0, ..., :2].reshape(7, -1) / 500, rtol=1e-5
    )


def test_a_stated_error_of_keypoints_is_told_and_an_unstated_one_is_not() -> None:
    xyz = np.stack([posed(body_bones_mm("cmu17")), posed(body_bones_mm("cmu17"))])
    made = given(xyz, error_mm=np.array([np.nan, 10.0]))
    assert made.features[0, :, STATED].max() == 0 and made.features[0, :, ERROR].max() == 0
    np.testing.assert_allclose(made.features[1, :, STATED], 1)
    np.testing.assert_allclose(made.features[1, :, ERROR], 0.5)


def planted(monkeypatch: pytest.MonkeyPatch) -> list[npt.NDArray[np.float32]]:
    """A network whose answers are easy to follow: z is a joint's x, bones are their lengths."""
    asked: list[npt.NDArray[np.float32]] = []

    def run(features: npt.NDArray[np.float32]) -> tuple[FloatArray, FloatArray]:
        asked.append(features)
        joints = np.zeros((*features.shape[:2], JOINTS, OUTPUTS))
        joints[..., 2] = features[..., 0 : 2 * JOINTS : 2]
        bones = np.zeros((*features.shape[:2], BONES, BONE_OUTPUTS))
        bones[..., 0] = features[..., 67 : 67 + BONES]
        return joints, bones

    monkeypatch.setattr(depth, "_run", run)
    return asked


def test_an_answer_is_the_mean_of_a_clips_and_its_mirrors(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = planted(monkeypatch)
    lengths = drawn_bodies(np.random.default_rng(3), 1, "cmu17")[0]
    lengths[2] *= 1.1  # the left upper arm is longer
    xyz = posed(lengths)
    known = Known(longest=lengths, lengths=True, error_mm=15.0)
    found = depth.predict(xyz[..., :2], np.ones((7, JOINTS)), 15.0, body17=False, known=known)
    clip, mirror = np.concatenate(asked)
    # z as planted is odd in x, so that clip and mirror image cancel.
    np.testing.assert_allclose(found.xyz[..., 2], 0, atol=1e-9)
    scale = lengths.sum() / body_bones_mm("cmu17").sum()
    expected = lengths / (scale * body_bones_mm("cmu17"))
    np.testing.assert_allclose(found.bones, np.tile(expected, (7, 1)), rtol=1e-5)
    assert found.bones.shape == found.sigma_bones.shape == (7, BONES)
    assert (clip[:, STATED] == 1).all() and (mirror[:, STATED] == 1).all()


def test_a_mirrored_input_is_that_of_the_mirrored_clip() -> None:
    rng = np.random.default_rng(5)
    xy, confidence = rng.normal(size=(3, 7, JOINTS, 2)), rng.uniform(size=(3, 7, JOINTS))
    xy[1, 2:4, 5] = np.nan
    longest = rng.uniform(0.5, 2, (3, BONES))
    sides = np.array(CMU.mirror)
    known = np.array([True, False, True])
    body17 = np.array([True, False, False])
    error = np.array([np.nan, 10.0, 20.0])
    clip = network_input(
        xy, confidence, body_definition=body17, longest=longest, known=known, error_mm=error
    )
    mirror = network_input(
        xy[:, :, sides] * [-1.0, 1.0],
        confidence[:, :, sides],
        body_definition=body17,
        longest=longest[:, sides[1:] - 1],
        known=known,
        error_mm=error,
    )
    found = mirrored(clip)
    np.testing.assert_allclose(found.features, mirror.features, rtol=1e-6)
    np.testing.assert_allclose(found.centre, mirror.centre)
    np.testing.assert_allclose(found.scale, mirror.scale)
    assert np.ptp(clip.features, axis=(0, 1)).astype(bool).sum() > 100  # nearly all differ


def test_single_pictures_each_have_what_is_known_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    planted(monkeypatch)
    frames = 5
    lengths = drawn_bodies(np.random.default_rng(4), frames, "cmu17")
    xyz = np.stack([posed(each, 1, seed=i)[0] for i, each in enumerate(lengths)])
    size = np.array([1.0, 2.0, 0.5, 1.5, 3.0])
    pixels, seen = xyz[..., :2] * size[:, None, None], np.ones((frames, JOINTS))
    told = Known(longest=lengths * size[:, None], lengths=True)
    found = depth.predict_frames(pixels, seen, body17=False, known=told)
    np.testing.assert_allclose(found.scale, size)
    np.testing.assert_allclose(found.bones, lengths / body_bones_mm("cmu17"), rtol=1e-5)
    one = Known(longest=lengths[0], lengths=True)  # of one dancer, in all pictures
    found = depth.predict_frames(pixels, seen, body17=False, known=one)
    np.testing.assert_allclose(found.scale, np.ones(frames))
    sized = Known(longest=np.full((frames, BONES), np.nan), scale=size)
    found = depth.predict_frames(pixels, seen, body17=False, known=sized)
    np.testing.assert_allclose(found.scale, size)
    alone = depth.predict_frames(pixels, seen, body17=False)
    shown = longest_projections(pixels[:, None]).sum(axis=1) / body_bones_mm("cmu17").sum()
    np.testing.assert_allclose(alone.scale, shown)


def test_answers_depend_neither_on_cores_nor_on_what_is_answered_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lengths = body_bones_mm("body17")
    xy, seen = posed(lengths, 70)[..., :2], np.ones((70, JOINTS))
    found = []
    for cores, together in ((1, 1), (4, 16)):
        monkeypatch.setattr(depth, "default_threads", lambda cores=cores: cores)
        monkeypatch.setattr(depth, "_TOGETHER", together)
        found += [
            depth.predict_frames(xy, seen, body17=True),
            depth.predict(xy, seen, 30.0, body17=True),
        ]
    for one, other in ((found[0], found[2]), (found[1], found[3])):
        np.testing.assert_allclose(one.xyz, other.xyz, rtol=1e-4, atol=1e-2)
        np.testing.assert_allclose(one.sigma, other.sigma, rtol=1e-4)
