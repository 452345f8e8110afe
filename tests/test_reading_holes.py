"""Frames that a file leaves out are frames without anyone: short holes fill, long ones end."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.reading import read_tracks
from dance2pose.tracking.settings import TrackingSettings
from reading_making import HEIGHT, MADE, RATE, WIDTH, alphapose, results, scene

SIZE = (WIDTH, HEIGHT)


@settings(max_examples=15, deadline=None)
@given(gone=st.sets(st.integers(1, 58), max_size=30), tracked=st.booleans())
def test_random_absent_frames_are_as_if_they_were_listed_empty(
    tmp_path_factory: pytest.TempPathFactory, gone: set[int], tracked: bool
) -> None:
    """tracked: the file itself says who is who."""
    folder = tmp_path_factory.mktemp("holes")
    frames = scene("coco17", range(60))
    entries = []
    for frame, people in frames.items():
        if frame not in gone:
            entries += [
                {
                    "image_id": frame,
                    "keypoints": p.keypoints.ravel().tolist(),
                    **({"track_id": p.who} if tracked else {}),
                }
                for p in people
            ]
    listed = {"images": [{"id": n} for n in range(60)], "annotations": entries}
    (folder / "absent.json").write_text(json.dumps(entries))
    (folder / "listed.json").write_text(json.dumps(listed))
    one, other = (
        read_tracks(folder / name, frame_rate=RATE, image_size=SIZE).tracks
        for name in ("absent.json", "listed.json")
    )
    assert len(one) == len(other)
    # Every second frame gone is a file of every second frame: then less is listed.
    for a, b in zip(one, other, strict=True):
        rows = np.isin(b.frame, a.frame)
        np.testing.assert_allclose(a.xy, b.xy[rows], atol=1e-3)
        seen = ~np.isin(a.frame, sorted(gone))
        assert np.isfinite(a.xy[seen]).all()


@pytest.mark.parametrize("rate", [25.0, 100.0])
def test_holes_are_filled_or_kept_by_seconds_not_by_frames(tmp_path: Path, rate: float) -> None:
    longest = int(TrackingSettings().longest_gap_s * rate)
    frames = scene("coco17", [*range(40), *range(40 + longest - 1, 80), *range(80 + longest, 140)])
    for track in read_tracks(results(tmp_path, frames), frame_rate=rate, image_size=SIZE).tracks:
        filled = track.frame[track.interpolated]
        np.testing.assert_array_equal(filled, range(40, 40 + longest - 1))
        away = (track.frame >= 80) & (track.frame < 80 + longest)
        assert np.isnan(track.xy[away]).all()


def test_who_comes_after_a_long_hole_is_someone_new_unless_the_file_says_otherwise(
    tmp_path: Path,
) -> None:
    frames = scene("coco17", [*range(20), *range(1520, 1540)], people=1)
    for frame in range(1520, 1540):
        frames[frame][0].keypoints[:] = frames[frame - 1520][0].keypoints
    found = read_tracks(results(tmp_path, frames), frame_rate=RATE, image_size=SIZE)
    assert [len(track) for track in found.tracks] == [20, 20]
    (same,) = read_tracks(
        MADE["deeplabcut semicolons"].write(tmp_path, frames), frame_rate=RATE, image_size=SIZE
    ).tracks
    assert np.isnan(same.xy[20:-20]).all()
    assert len(same) < 45
    assert same.time_s[-1] == pytest.approx(1539 / RATE)


def test_one_id_for_everyone_does_not_make_them_one(tmp_path: Path) -> None:
    """Tools that do not track write the same id for all."""
    found = read_tracks(alphapose(tmp_path, scene("halpe26")), frame_rate=RATE, image_size=SIZE)
    assert len(found.tracks) == 2
    assert "who is who is taken from the file" not in found.notes
