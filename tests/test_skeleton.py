"""Skeletons are data: their tables must agree with each other and with their publishers."""

from __future__ import annotations

import numpy as np
import pytest

from dance2pose import skeleton
from dance2pose.errors import UsageError

LIFTING = ("cmu17", "paper15", "body17")
KEYPOINT_COUNTS = {
    "coco17": 17,
    "coco18": 18,
    "coco23": 23,
    "halpe26": 26,
    "body25": 25,
    "body25b": 25,
    "wholebody133": 133,
    "halpe136": 136,
    "mpii16": 16,
    "h36m17": 17,
    "blazepose33": 33,
}


@pytest.mark.parametrize("name", skeleton.names())
def test_mirror_is_an_involution_that_keeps_the_edges(name: str) -> None:
    points = skeleton.get(name)
    mirror = np.array(points.mirror)
    assert (mirror[mirror] == np.arange(len(points))).all()
    edges = {frozenset(edge) for edge in points.bones}
    assert {frozenset(mirror[list(edge)].tolist()) for edge in edges} == edges


@pytest.mark.parametrize("name", LIFTING)
def test_lifting_skeletons_are_trees_with_parents_first(name: str) -> None:
    tree = skeleton.get(name)
    assert tree.is_tree
    assert tree.parents[0] == -1
    assert all(parent < joint for joint, parent in enumerate(tree.parents))


@pytest.mark.parametrize(("name", "count"), KEYPOINT_COUNTS.items())
def test_keypoint_skeletons_convert_to_the_body(name: str, count: int) -> None:
    source = skeleton.get(name)
    assert len(source) == count
    assert skeleton.lifting_skeleton(name).name == "body17"
    xy = np.arange(7 * count * 2, dtype=float).reshape(7, count, 2)
    confidence = np.linspace(0.1, 1, 7 * count).reshape(7, count)
    body, body_confidence = skeleton.convert(xy, confidence, source=name, target="body17")
    assert body.shape == (7, 17, 2)
    assert body_confidence.shape == (7, 17)
    has_toes = any("toe" in joint or "foot_index" in joint for joint in source.joints)
    missing = np.isnan(body[0, :, 0])
    names = np.array(skeleton.get("body17").joints)
    assert set(names[missing]) == (set() if has_toes else {"left_toe", "right_toe"})
    assert (body_confidence[:, missing] == 0).all()


def test_a_midpoint_is_the_mean_and_as_sure_as_the_less_sure_part() -> None:
    coco = skeleton.get("coco17")
    xy = np.full((1, 17, 2), np.nan)
    confidence = np.zeros((1, 17))
    for joint, point, sure in (("left_hip", (10, 4), 0.9), ("right_hip", (20, 8), 0.4)):
        xy[0, coco.index(joint)] = point
        confidence[0, coco.index(joint)] = sure
    body, body_confidence = skeleton.convert(xy, confidence, source="coco17", target="body17")
    assert body[0, 0].tolist() == [15, 6]
    assert body_confidence[0, 0] == 0.4
    assert np.isnan(body[0, 1]).all()  # no shoulders, no neck


def test_paper15_is_cmu17_without_toes_in_the_order_of_the_tables() -> None:
    cmu, paper = skeleton.get("cmu17"), skeleton.get("paper15")
    xyz = np.random.default_rng(0).normal(size=(7, 17, 3))
    converted, _ = skeleton.convert(xyz, np.ones((7, 17)), source="cmu17", target="paper15")
    np.testing.assert_array_equal(
        converted[:, paper.index("right_knee")], xyz[:, cmu.index("right_knee")]
    )
    np.testing.assert_array_equal(converted[:, paper.index("pelvis")], xyz[:, 0])


def test_unknown_names_say_what_is_known() -> None:
    with pytest.raises(UsageError, match=r"unknown skeleton 'kinect'.*cmu17"):
        skeleton.get("kinect")
    with pytest.raises(UsageError, match=r"no joint 'tail'.*left_wrist"):
        skeleton.get("coco17").index("tail")


def test_the_body_of_a_whole_body_skeleton_is_without_face_and_hands() -> None:
    body = [skeleton.get("wholebody133").joints[i] for i in skeleton.body_keypoints("wholebody133")]
    assert tuple(body) == skeleton.get("coco23").joints
    assert len(skeleton.body_keypoints("halpe136")) == 26
    assert skeleton.body_keypoints("coco17") == list(range(17))
