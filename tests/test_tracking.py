"""One track a dancer: on staged (synthetic) dancers, and on real video with real models."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dance2pose.errors import UsageError
from dance2pose.poses import Boxes, Poses2D
from dance2pose.tracking.settings import TrackingSettings
from dance2pose.tracking.tracker import Tracker
from staged import HEIGHT, WIDTH, Actor, J, perform, times, who

RED, GREEN, BLUE = (40, 40, 200), (40, 200, 40), (200, 60, 30)


def _walker(start: float, speed: float, y: float = 180.0, **options: object) -> Actor:
    return Actor(lambda t: (start + speed * t, y), **options)  # type: ignore[arg-type]


# Identity.


@pytest.mark.parametrize("rate", [6.0, 12.5, 25.0, 60.0])
@pytest.mark.parametrize("seed", range(3))
def test_two_who_cross_keep_their_tracks(rate: float, seed: int) -> None:
    actors = [_walker(100, 110), _walker(540, -110, 186)]
    tracks = perform(actors, times(rate, 4), seed=seed).finish()
    assert [who(track, actors) for track in tracks] in ([{0}, {1}], [{1}, {0}])
    assert {len(track) for track in tracks} == {int(4 * rate)}


@pytest.mark.parametrize("seed", range(5))
def test_who_is_hidden_behind_another_comes_out_as_the_same(seed: int) -> None:
    front = _walker(100, 110)
    behind = _walker(540, -110, 186, seen=lambda t: not 1.7 < t < 2.3)  # boxes overlap
    actors = [front, behind]
    tracks = perform(actors, times(25, 4), seed=seed).finish()
    assert [who(track, actors) for track in tracks] in ([{0}, {1}], [{1}, {0}])
    assert {len(track) for track in tracks} == {100}
    hidden = min(tracks, key=lambda track: np.isfinite(track.box[:, 0]).sum())
    assert np.isnan(hidden.xy[45:55]).all()  # longer than the limit: not interpolated
    assert not hidden.interpolated.any()


@pytest.mark.parametrize("seed", range(5))
def test_frames_at_irregular_times_do_not_matter(seed: int) -> None:
    steps = np.random.default_rng(seed).choice([0.016, 0.033, 0.1, 0.2], size=60)
    actors = [_walker(80, 90), _walker(560, -90, 186)]
    time_s = np.cumsum(steps)
    tracks = perform(actors, time_s, seed=seed).finish()
    assert [who(track, actors) for track in tracks] in ([{0}, {1}], [{1}, {0}])
    np.testing.assert_array_equal(tracks[0].time_s, time_s)


def _there_and_back(start: float, turn: float) -> Actor:
    """Walks to a point, stays for a while, walks back."""

    def place(t: float) -> tuple[float, float]:
        share = np.interp(t, [0, 1.5, 2.5, 4], [0, 1, 1, 0])
        return start + (turn - start) * float(share), 180.0

    return Actor(place)


@pytest.mark.parametrize("seed", range(5))
def test_colours_tell_who_turned_back_from_who_went_on(seed: int) -> None:
    left, right = _there_and_back(120, 310), _there_and_back(520, 330)
    actors = [
        Actor(left.place, colour=RED),
        Actor(right.place, colour=BLUE, seen=lambda t: not 1.3 < t < 2.7),
    ]
    tracks = perform(actors, times(25, 4), pictures=True, seed=seed).finish()
    assert [who(track, actors) for track in tracks] in ([{0}, {1}], [{1}, {0}])


def test_five_at_once() -> None:
    actors = [
        Actor(lambda t, k=k: (320 + 200 * np.cos(t + 1.25 * k), 180 + 60 * np.sin(t + 1.25 * k)))
        for k in range(5)
    ]
    tracks = perform(actors, times(25, 5)).finish()
    assert sorted(min(who(track, actors)) for track in tracks) == [0, 1, 2, 3, 4]
    assert all(len(who(track, actors)) == 1 and len(track) == 125 for track in tracks)


def test_noise_and_dropped_detections() -> None:
    rng = np.random.default_rng(11)
    lost = set(rng.choice(100, 30, replace=False).tolist())
    flicker = _walker(100, 60, seen=lambda t: round(25 * t) not in lost)
    actors = [flicker, _walker(500, -20, 200)]
    tracks = perform(actors, times(25, 4), noise=4).finish()
    assert [who(track, actors) for track in tracks] in ([{0}, {1}], [{1}, {0}])


@given(st.integers(0, 2**16), st.floats(-300, 300), st.floats(0, 1e5))
@settings(deadline=None, max_examples=10)
def test_order_of_detections_and_start_of_the_clock_do_not_matter(
    seed: int, shift: float, start_s: float
) -> None:
    actors = [_walker(100, 110), _walker(540, -110, 186)]

    def tracks(order: int, offset: float) -> list[np.ndarray]:
        tracker = Tracker("coco17", (WIDTH, HEIGHT))
        rng = np.random.default_rng(order)
        for frame, now in enumerate(times(12.5, 4).tolist()):
            turn = rng.permutation(2)
            boxes = np.array([actors[i].box(now) for i in turn])
            xy = np.array([actors[i].keypoints(now) for i in turn])
            tracker.update(
                frame,
                now + offset,
                Boxes(boxes, np.ones(2)),
                Poses2D(xy, np.ones((2, J)), "coco17"),
                cut=False,
            )
        return [track.xy for track in tracker.finish("all")]

    for one, other in zip(tracks(0, 0.0), tracks(seed, start_s), strict=True):
        np.testing.assert_array_equal(one, other)


# Coming and going.


def test_a_cut_ends_every_track() -> None:
    actors = [_walker(200, 5), _walker(420, -5)]
    tracks = perform(actors, times(25, 4), cuts=(0, 40)).finish()
    spans = sorted((track.shot, int(track.frame[0]), int(track.frame[-1])) for track in tracks)
    assert spans == [(0, 0, 39), (0, 0, 39), (1, 40, 99), (1, 40, 99)]
    assert sorted(track.person for track in tracks) == [1, 2, 3, 4]


def test_a_track_runs_from_the_first_to_the_last_sight() -> None:
    actor = _walker(100, 30, seen=lambda t: 1 <= t < 3 and not 1.5 <= t < 2.2)
    (track,) = perform([actor], times(25, 4)).finish()
    np.testing.assert_array_equal(track.frame, np.arange(25, 75))
    unseen = np.isnan(track.box[:, 0])
    np.testing.assert_array_equal(np.flatnonzero(unseen), np.arange(13, 30))
    np.testing.assert_array_equal(np.isnan(track.xy).all(axis=(1, 2)), unseen)
    assert (track.confidence[unseen] == 0).all()


def test_every_nth_frame_keeps_its_number() -> None:
    tracker = Tracker("coco17", (WIDTH, HEIGHT))
    actor = _walker(300, 10)
    for frame in range(0, 50, 5):
        _show(tracker, frame, frame / 25, [actor.keypoints(frame / 25)])
    (track,) = tracker.finish()
    np.testing.assert_array_equal(track.frame, np.arange(0, 50, 5))


def test_who_walks_out_and_comes_much_later_is_someone_new() -> None:
    actor = _walker(605, 10, seen=lambda t: t < 1 or t > 4)  # at the border of the picture
    tracks = perform([actor], times(25, 6), pictures=True).finish("all")
    assert sorted(len(track) for track in tracks) == [25, 49]


@pytest.mark.parametrize(("after", "tracks_found"), [(RED, 1), (GREEN, 2)])
def test_who_vanishes_within_the_picture_is_known_again_by_colours(
    after: tuple[int, int, int], tracks_found: int
) -> None:
    before = _walker(300, 5, colour=RED, seen=lambda t: t < 1)
    later = _walker(300, 5, colour=after, seen=lambda t: t > 4)
    tracks = perform([before, later], times(25, 6), pictures=True).finish("all")
    assert len(tracks) == tracks_found


@pytest.mark.parametrize("rate", [1.0, 25.0])
def test_a_minute_without_frames_ends_a_track_and_a_slow_film_does_not(rate: float) -> None:
    """The frames in between are not there at all: nobody was missed in any of them."""
    actor = Actor(lambda time_s: (200.0 + 2 * min(time_s, 10), 180.0))
    before = times(rate, 20)
    after = before + before[-1] + 60
    tracks = perform([actor], np.concatenate([before, after])).finish("all")
    assert [len(track) for track in tracks] == [len(before), len(after)]
    assert len(perform([actor], before).finish("all")) == 1


def test_patience_is_in_seconds_whatever_the_frame_rate() -> None:
    for rate in (10.0, 50.0):
        for away_s, tracks_found in ((1.5, 1), (2.6, 2)):
            actor = _walker(300, 0, seen=lambda t, away_s=away_s: not 1 < t < 1 + away_s)
            tracks = perform([actor], times(rate, 6)).finish("all")
            assert len(tracks) == tracks_found, (rate, away_s)


@pytest.mark.parametrize("rate", [0.2, 1.0, 3.0])
def test_few_frames_a_second_are_no_gaps(rate: float) -> None:
    actors = [_walker(200, 4 * rate), _walker(420, -4 * rate)]
    tracks = perform(actors, times(rate, 20 / rate)).finish()
    assert [who(track, actors) for track in tracks] in ([{0}, {1}], [{1}, {0}])
    assert [len(track) for track in tracks] == [20, 20]


# Who is a dancer.


def test_nobody_gives_nothing() -> None:
    tracker = perform([], times(25, 2))
    for person in ("auto", "all", "largest", "central", 1):
        assert tracker.finish(person) == []
    assert Tracker("coco17", (WIDTH, HEIGHT)).finish() == []


def test_a_flash_in_one_or_two_frames_is_nobody() -> None:
    dancer = _walker(300, 10)
    flash = _walker(80, 0, seen=lambda t: t in (1.0, 1.04))
    assert len(perform([dancer, flash], times(25, 4)).finish("all")) == 1


@pytest.mark.parametrize("frames", [1, 2])
def test_a_video_of_one_or_two_frames_has_its_dancer(frames: int) -> None:
    (track,) = perform([_walker(300, 10)], times(25, 4)[:frames]).finish()
    assert len(track) == frames


def test_a_passer_by_is_no_dancer_by_default() -> None:
    dancer = _walker(320, 0, size=180)
    passer_by = _walker(-200, 160, 100, size=70, seen=lambda t: 1.3 < t < 5)
    tracker = perform([passer_by, dancer], times(25, 12))
    (track,) = tracker.finish()
    assert track.person == 1 and len(track) == 300
    assert [track.person for track in tracker.finish("all")] == [1, 2]


def test_a_second_dancer_who_is_smaller_and_comes_later_is_one() -> None:
    first = _walker(250, 0, size=150)
    second = _walker(420, 0, size=110, seen=lambda t: t > 4)
    assert len(perform([first, second], times(25, 10)).finish()) == 2


def test_one_person_can_be_asked_for() -> None:
    small_central = _walker(320, 0, size=90)
    large_aside = _walker(100, 0, size=170)
    brief = _walker(560, 0, size=120, seen=lambda t: t < 2)
    actors = [small_central, large_aside, brief]
    tracker = perform(actors, times(25, 6))
    (central,) = tracker.finish("central")
    (largest,) = tracker.finish("largest")
    assert who(central, actors) == {0} and who(largest, actors) == {1}
    everyone = tracker.finish("all")
    assert [track.person for track in everyone] == [1, 2, 3]
    for track in (central, largest):  # the number of a person does not depend on the question
        same = everyone[track.person - 1]
        np.testing.assert_array_equal(same.xy, track.xy)
    for number in (1, 2, 3):
        for form in (number, str(number)):
            (one,) = tracker.finish(form)
            np.testing.assert_array_equal(one.xy, everyone[number - 1].xy)
    with pytest.raises(UsageError, match="person 4 was asked for, but 3 were found"):
        tracker.finish(4)


@pytest.mark.parametrize("person", ["", "everyone", "0", 0, -1, "-1", "1.5"])
def test_an_impossible_person_is_refused(person: str | int) -> None:
    with pytest.raises(UsageError, match="a number from 1"):
        perform([], times(25, 1)).finish(person)


def test_one_person_detected_twice_is_one() -> None:
    tracker = Tracker("coco17", (WIDTH, HEIGHT))
    actor, rng = _walker(300, 10), np.random.default_rng(3)
    for frame, now in enumerate(times(25, 2).tolist()):
        poses = [actor.keypoints(now) + rng.normal(0, 1.5, (J, 2)) for _ in range(3)]
        poses[2][11:] += 60  # a box that cut the legs off: the upper body agrees
        _show(tracker, frame, now, poses[:2])
    assert len(tracker.finish("all")) == 1


def test_two_who_dance_closely_are_two() -> None:
    left, right = _walker(300, 0), _walker(318, 0, 185)
    tracks = perform([left, right], times(25, 2), noise=0.5).finish("all")
    assert [len(track) for track in tracks] == [50, 50]


# Keypoints.


def _show(
    tracker: Tracker,
    frame: int,
    time_s: float,
    poses: list[np.ndarray],
    confidence: np.ndarray | None = None,
) -> None:
    xy = np.array(poses).reshape(-1, J, 2)
    boxes = np.concatenate([xy.min(axis=1), xy.max(axis=1)], axis=1)
    sure = np.full(xy.shape[:2], 0.8) if confidence is None else confidence[np.newaxis]
    tracker.update(
        frame,
        time_s,
        Boxes(np.nan_to_num(boxes), np.full(len(xy), 0.9)),
        Poses2D(xy, sure, "coco17"),
        cut=False,
    )


def test_unsure_keypoints_are_missing_and_short_gaps_filled_and_marked() -> None:
    settings_ = TrackingSettings(min_confidence=0.3, longest_gap_s=0.2)
    tracker = Tracker("coco17", (WIDTH, HEIGHT), settings_)
    actor = _walker(300, 50)
    time_s = times(25, 1)
    for frame, now in enumerate(time_s.tolist()):
        confidence = np.full(J, 0.8)
        if 5 <= frame < 8:
            confidence[9] = 0.29  # 0.16 s between the sights: filled
        if 10 <= frame < 18:
            confidence[4] = 0.1  # 0.36 s: stays missing
        if frame > 20:
            confidence[2] = 0.0  # to the end: stays missing
        _show(tracker, frame, now, [actor.keypoints(now)], confidence)
    (track,) = tracker.finish()
    expected = np.array([actor.keypoints(now) for now in time_s])
    np.testing.assert_allclose(track.xy[5:8, 9], expected[5:8, 9], atol=3)
    assert (track.confidence[5:8, 9] == np.float32(0.15)).all()
    assert np.isnan(track.xy[10:18, 4]).all() and (track.confidence[10:18, 4] == 0).all()
    assert np.isnan(track.xy[21:, 2]).all()
    assert not track.interpolated.any()  # of whole poses there were none to fill
    seen = track.confidence >= 0.3
    np.testing.assert_allclose(track.xy[seen], expected[seen], rtol=1e-6)


def test_a_pose_filled_in_is_marked() -> None:
    actor = _walker(300, 50, seen=lambda t: not 0.39 < t < 0.5)
    (track,) = perform([actor], times(25, 1)).finish()
    np.testing.assert_array_equal(np.flatnonzero(track.interpolated), [10, 11, 12])
    assert np.isfinite(track.xy).all()
    assert np.isnan(track.box[10:13]).all()
    assert (track.confidence[10:13] < TrackingSettings().min_confidence).all()
    assert (track.confidence[10:13] > 0).all()


def test_a_pose_of_too_few_keypoints_is_none() -> None:
    tracker = Tracker("coco17", (WIDTH, HEIGHT))
    actor = _walker(300, 0)
    for frame in range(20):
        confidence = np.where(np.arange(J) < 3, 0.8, 0.1)
        _show(tracker, frame, frame / 25, [actor.keypoints(0)], confidence)
    assert tracker.finish("all") == []


def test_nan_from_a_model_is_missing() -> None:
    tracker = Tracker("coco17", (WIDTH, HEIGHT))
    actor = _walker(300, 0)
    for frame in range(20):
        xy = actor.keypoints(0)
        confidence = np.full(J, 0.8)
        xy[3] = np.nan
        confidence[5] = np.nan
        box = Boxes(actor.box(0)[np.newaxis], np.ones(1))
        tracker.update(
            frame, frame / 25, box, Poses2D(xy[None], confidence[None], "coco17"), cut=False
        )
    (track,) = tracker.finish()
    assert np.isnan(track.xy[:, [3, 5]]).all()
    assert (track.confidence[:, [3, 5]] == 0).all()
    assert np.isfinite(np.delete(track.xy, [3, 5], axis=1)).all()


# The stream.


def test_pictures_are_not_kept() -> None:
    tracker = Tracker("coco17", (WIDTH, HEIGHT))
    image = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    actor = _walker(300, 0)
    poses = Poses2D(actor.keypoints(0)[None], np.full((1, J), 0.8), "coco17")
    tracker.update(0, 0.0, Boxes(actor.box(0)[None], np.ones(1)), poses, cut=False, image=image)
    gone = weakref.ref(image)
    del image
    gc.collect()
    assert gone() is None


def test_finish_can_be_asked_again_and_later() -> None:
    actor = _walker(200, 20)
    tracker = perform([actor], times(25, 1))
    first = tracker.finish()
    again = tracker.finish()
    np.testing.assert_array_equal(first[0].xy, again[0].xy)
    _show(tracker, 25, 1.0, [actor.keypoints(1.0)])
    assert len(tracker.finish()[0]) == 26


def test_what_does_not_fit_is_refused() -> None:
    tracker = Tracker("coco17", (WIDTH, HEIGHT))
    pose = np.zeros((1, J, 2))
    poses = Poses2D(pose, np.ones((1, J)), "coco17")
    box = Boxes(np.array([[0.0, 0, 9, 9]]), np.ones(1))
    none = Boxes(np.empty((0, 4)), np.empty(0))
    with pytest.raises(ValueError, match="0 boxes do not fit 1 poses"):
        tracker.update(0, 0.0, none, poses, cut=False)
    with pytest.raises(ValueError, match="expected coco17 with 17"):
        tracker.update(
            0, 0.0, box, Poses2D(np.zeros((1, 26, 2)), np.ones((1, 26)), "halpe26"), cut=False
        )
    tracker.update(5, 0.2, box, poses, cut=False)
    for frame, time_s in ((5, 0.3), (4, 0.3), (6, 0.1)):
        with pytest.raises(ValueError, match="comes after"):
            tracker.update(frame, time_s, box, poses, cut=False)


# Real video, real models.


@pytest.mark.shared
@pytest.mark.parametrize(
    ("video", "detector", "every", "dancers"),
    [
        ("two_people_cam03.mp4", "picodet_s_320_pedestrian.onnx", 5, 2),
        ("two_walkers.mp4", "picodet_s_320_pedestrian.onnx", 5, 2),
        ("contemporary_dance.mp4", "rtmdet_nano.onnx", 12, 1),
        ("balance_cam03.mp4", "picodet_s_320_pedestrian.onnx", 10, 1),
    ],
)
def test_real_dancers_have_one_track_each(
    shared: Path, video: str, detector: str, every: int, dancers: int
) -> None:
    from dance2pose.detection import load_detector
    from dance2pose.keypoints import OneStageEstimator, load_pose_model
    from dance2pose.video import open_video

    boxes_of = load_detector(shared / "models" / detector)
    keypoints_of = load_pose_model(shared / "models" / "pp_tinypose_128x96.onnx")
    assert not isinstance(keypoints_of, OneStageEstimator)
    frames = 0
    with open_video(shared / "videos" / video, every=every) as reader:
        size = (reader.info.width, reader.info.height)
        tracker = Tracker(keypoints_of.skeleton, size)
        for frame in reader:
            boxes = boxes_of.detect(frame.image)
            poses = keypoints_of.estimate(frame.image, boxes)
            tracker.update(frame.index, frame.time_s, boxes, poses, cut=False, image=frame.image)
            frames += 1
    tracks = tracker.finish()
    assert len(tracks) == dancers
    if video != "two_walkers.mp4":  # there both come and go
        assert {len(track) for track in tracks} == {frames}
    for track in tracks:
        middles = (track.box[:, :2] + track.box[:, 2:]) / 2
        middles = middles[np.isfinite(middles[:, 0])]
        heights = np.nanmean(track.box[:, 3] - track.box[:, 1])
        if video != "two_walkers.mp4":  # where one jumps off a roof, unseen
            assert np.linalg.norm(np.diff(middles, axis=0), axis=1).max() < 0.5 * heights
