"""What is no measurement is missing, rescaled or refused, and it is said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.errors import DataError, UsageError
from dance2pose.reading import ReadTracks, read_tracks
from reading_making import HEIGHT, MADE, RATE, WIDTH, Person, Scene, scene

SIZE = (WIDTH, HEIGHT)


def _people(frames: Scene) -> list[dict[str, Any]]:
    return [
        {"image_id": f"{frame}.jpg", "keypoints": p.keypoints.copy(), "category_id": 1}
        for frame, people in frames.items()
        for p in people
    ]


def _read(folder: Path, entries: list[Any], **options: Any) -> ReadTracks:
    path = folder / "results.json"
    plain = [
        {**e, "keypoints": np.asarray(e["keypoints"]).ravel().tolist()}
        if isinstance(e, dict) and "keypoints" in e
        else e
        for e in entries
    ]
    path.write_text(json.dumps(plain))
    return read_tracks(path, frame_rate=RATE, **({"image_size": SIZE} | options))


@settings(max_examples=20, deadline=None)
@given(data=st.data())
def test_random_zeroed_keypoints_are_as_if_marked_missing(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    spots = data.draw(
        st.sets(st.tuples(st.integers(0, 19), st.integers(0, 16)), min_size=1, max_size=40)
    )
    zeroed, marked = (_people(scene("coco17", range(20), people=1)) for _ in range(2))
    for frame, joint in spots:
        zeroed[frame]["keypoints"][joint] = (0, 0, 0.35)
        marked[frame]["keypoints"][joint] = (0, 0, 0)
    folder = tmp_path_factory.mktemp("zeroed")
    one, other = _read(folder, zeroed), _read(folder, marked)
    np.testing.assert_array_equal(one.tracks[0].xy, other.tracks[0].xy)
    assert f"{len(spots)} keypoints at exactly (0, 0) are missing ones" in one.notes
    assert not any("(0, 0)" in note for note in other.notes)


@pytest.mark.parametrize(
    ("scale", "words"),
    [(lambda xy: (xy + 0.5) / SIZE, "0 to 1"), (lambda xy: 2 * (xy + 0.5) / SIZE - 1, "-1 to 1")],
)
def test_coordinates_that_are_parts_of_the_picture_become_px(
    tmp_path: Path, scale: Any, words: str
) -> None:
    frames = scene("coco17", people=1)
    entries = _people(frames)
    for entry in entries:
        entry["keypoints"][:, :2] = scale(entry["keypoints"][:, :2])
    found = _read(tmp_path, entries)
    planted = [people[0].keypoints[:, :2] for people in frames.values()]
    np.testing.assert_allclose(found.tracks[0].xy, planted, atol=1e-3)
    assert any(f"({words})" in note for note in found.notes)
    with pytest.raises(UsageError, match=r"parts of the picture.*--image-size"):
        _read(tmp_path, entries, image_size=None)


@pytest.mark.parametrize(
    ("scale", "expected", "note"),
    [
        (lambda s: 100 * s, lambda s: s, "percent"),
        (lambda s: 2.0 + 0 * s, lambda s: 1 + 0 * s, "visibility flags"),
        (lambda s: 4 * s, lambda s: np.minimum(4 * s, 1), "above 1"),
        (lambda s: s, lambda s: s, None),
    ],
)
def test_scores_of_other_scales_become_confidences(
    tmp_path: Path, scale: Any, expected: Any, note: str | None
) -> None:
    entries = _people(scene("coco17", people=1))
    before = entries[0]["keypoints"][:, 2].copy()
    for entry in entries:
        entry["keypoints"][:, 2] = scale(entry["keypoints"][:, 2])
    found = _read(tmp_path, entries)
    np.testing.assert_allclose(found.tracks[0].confidence[0], expected(before), atol=1e-6)
    said = [n for n in found.notes if "score" in n]
    assert (note is None and not said) or (note is not None and note in said[0])


def test_scores_that_cannot_be_confidences_are_refused(tmp_path: Path) -> None:
    entries = _people(scene("coco17", people=1))
    entries[3]["keypoints"][2, 2] = 4021.0
    with pytest.raises(DataError, match=r"scores run up to 4\.02e"):
        _read(tmp_path, entries)


def test_nothing_seen_at_all_is_said(tmp_path: Path) -> None:
    entries = _people(scene("coco17", people=1))
    for entry in entries:
        entry["keypoints"][:, 2] = 0
    with pytest.raises(DataError, match="no keypoint has a confidence above 0"):
        _read(tmp_path, entries)


@pytest.mark.parametrize(
    ("spoil", "note"),
    [
        (lambda e: e.update(keypoints=np.full((17, 3), 0.0)), "1 people without any keypoint"),
        (lambda e: e["keypoints"].__setitem__((slice(None), slice(0, 2)), 50.0), "all one point"),
        (lambda e: e.update(box=[5.0, 5.0, 0.0, 0.0]), "in a box without size"),
        (lambda e: e["keypoints"].__iadd__([4000, 0, 0]), "all outside the picture"),
    ],
)
def test_who_was_not_seen_is_not_there(tmp_path: Path, spoil: Any, note: str) -> None:
    entries = _people(scene("coco17", range(40), people=1))
    for entry in entries:
        entry["box"] = [10.0, 10.0, 50.0, 90.0]
    spoil(entries[20])
    found = _read(tmp_path, entries)
    assert any(note in said for said in found.notes), found.notes
    (track,) = found.tracks
    assert track.interpolated.tolist() == [n == 20 for n in range(40)]
    assert float(np.nanmax(track.xy)) < 640


def test_boxes_that_are_all_empty_are_filler(tmp_path: Path) -> None:
    entries = _people(scene("coco17", people=1))
    for entry in entries:
        entry["bbox"] = [0, 0, 0, 0]
    found = _read(tmp_path, entries)
    assert len(found.tracks) == 1
    assert "boxes without size are no boxes" in found.notes


def test_a_wrong_size_of_the_picture_is_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"are outside a picture of 100 x 60; is that the size"):
        _read(tmp_path, _people(scene("coco17", people=1)), image_size=(100, 60))


def test_empty_entries_are_absent_people(tmp_path: Path) -> None:
    entries = _people(scene("coco17", people=1))
    found = _read(tmp_path, [{}, *entries[:6], {}, None, *entries[6:]])
    assert "3 people without keypoints are not there" in found.notes
    assert np.isfinite(found.tracks[0].xy).all()


def test_other_categories_than_person_are_left_out(tmp_path: Path) -> None:
    frames = scene("coco17")
    entries = _people(frames)
    for entry in entries[1::2]:
        entry["category_id"] = 17
    found = _read(tmp_path, entries)
    assert len(found.tracks) == 1
    assert f"{len(frames)} entries of other categories than person are left out" in found.notes


@pytest.mark.parametrize("named", [True, False])
def test_annotations_of_a_dog_are_left_out_and_crowds_too(tmp_path: Path, named: bool) -> None:
    path = MADE["coco"].write(tmp_path, scene("coco17"))
    content = json.loads(path.read_text())
    joints = ["nose"] if not named else []
    content["categories"] = [
        {"id": 7, "name": "person" if named else "dancer", "keypoints": joints * 17},
        {"id": 9, "name": "dog"},
    ]
    for n, one in enumerate(content["annotations"]):
        one["category_id"] = 7 if n % 2 == 0 else 9
    if not named:
        content["categories"][0]["keypoints"] = None
        content["categories"] = content["categories"][:1]
    content["annotations"].append({**content["annotations"][0], "iscrowd": 1})
    path.write_text(json.dumps(content))
    found = read_tracks(path, frame_rate=RATE)
    assert len(found.tracks) == 1
    assert any("other categories" in note for note in found.notes)
    assert "1 entries of crowds are left out" in found.notes


def test_infinite_and_null_coordinates_are_missing(tmp_path: Path) -> None:
    frames = scene("coco17", range(40), people=1)
    frames[10] = [Person("ann", frames[10][0].keypoints.copy())]
    entries = _people(frames)
    text = [e["keypoints"].ravel().tolist() for e in entries]
    text[10][3:6] = [None, None, 0.9]
    text[11][3:6] = [float("inf"), 5.0, 0.9]
    path = tmp_path / "null.json"
    path.write_text(json.dumps([{**e, "keypoints": t} for e, t in zip(entries, text, strict=True)]))
    (track,) = read_tracks(path, frame_rate=RATE, image_size=SIZE).tracks
    assert np.isfinite(track.xy).all()
    assert (track.confidence[10:12, 1] == 0.1).all()


def test_unsure_keypoints_are_said_and_the_threshold_can_be_set(tmp_path: Path) -> None:
    entries = _people(scene("coco17", people=1))
    for entry in entries:
        entry["keypoints"][:, 2] *= 0.2
    found = _read(tmp_path, entries)
    assert found.tracks == []
    assert any("less sure than 0.2 and count as not seen" in note for note in found.notes)
    assert len(_read(tmp_path, entries, min_confidence=0.05).tracks) == 1
