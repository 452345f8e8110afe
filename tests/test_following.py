"""People between the looks of the detector: interpolated, followed, found again, never invented."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from dance2pose.detection import load_detector
from dance2pose.following import Stretch, find_in_stretch
from dance2pose.keypoints import load_pose_model
from dance2pose.options import SpeedOptions
from dance2pose.people import FramePeople, PoseModels, find_people, stretches
from dance2pose.poses import Boxes, Frame, Image, Poses2D
from dance2pose.video import open_video
from onnx_graphs import emitting, heatmaps_of_colours

SIZE = (90, 160)  # height, width
# The keypoints of everybody, COCO order, in shares of the box.
BODY = np.random.default_rng(5).uniform(0.02, 0.98, (17, 2))
Float64Array = npt.NDArray[np.float64]


def picture(number: int) -> Image:
    """A picture that says which frame it is, and is like every other to the cut detector."""
    image = np.random.default_rng(1).integers(0, 255, (*SIZE, 3), np.uint8)
    image[0, 0] = number
    return image


def frames(
    count: int, *, rate: float = 25.0, skip_s: Mapping[int, float] | None = None
) -> list[Frame]:
    """Frames of a video; skip_s: seconds that are missing before a frame."""
    times = np.arange(count) / rate
    for index, more in (skip_s or {}).items():
        times[index:] += more
    return [Frame(i, float(t), picture(i)) for i, t in enumerate(times)]


@dataclass
class Scene:
    """Stands in for both models, and knows where everybody is.

    boxes: of each person by frame, (4,) px. unseen: (person, frame) that the detector misses.
    """

    boxes: Mapping[str, Mapping[int, Float64Array]]
    unseen: frozenset[tuple[str, int]] = frozenset()
    ghosts: Mapping[int, Float64Array] = field(default_factory=dict)
    looks: list[int] = field(default_factory=list)

    def detect(self, image: Image) -> Boxes:
        t = int(image[0, 0, 0])
        self.looks.append(t)
        there = [
            path[t]
            for name, path in self.boxes.items()
            if t in path and (name, t) not in self.unseen
        ]
        there += [self.ghosts[t]] if t in self.ghosts else []
        return Boxes(np.array(there).reshape(-1, 4), np.full(len(there), 0.9))

    def estimate(self, image: Image, boxes: Boxes) -> Poses2D:
        """The pose of whom the box overlaps most; of nobody, keypoints that mean nothing."""
        t = int(image[0, 0, 0])
        xy = np.empty((len(boxes), 17, 2))
        confidence = np.empty((len(boxes), 17))
        for row, box in enumerate(boxes.xyxy):
            there = [path[t] for path in self.boxes.values() if t in path]
            shared = [overlap(box, other) for other in there]
            hit = bool(shared) and max(shared) > 0.3
            of = there[int(np.argmax(shared))] if hit else box
            xy[row] = of[:2] + BODY * (of[2:] - of[:2])
            confidence[row] = 0.9 if hit else 0.05
        return Poses2D(xy, confidence, "coco17")


def overlap(one: Float64Array, other: Float64Array) -> float:
    shared = np.prod(np.maximum(np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2]), 0))
    areas = [np.prod(box[2:] - box[:2]) for box in (one, other)]
    return float(shared / (sum(areas) - shared))


def walking(start: int, end: int, *, x: float, speed: float = 1.0) -> dict[int, Float64Array]:
    """A box that moves to the right, from frame `start` to before `end`."""
    return {t: np.array([x + speed * t, 20, x + speed * t + 25, 80]) for t in range(start, end)}


def found_in(scene: Scene, stretch: Stretch) -> list[tuple[Boxes, Poses2D]]:
    first, last = (scene.detect(f.image) for f in (stretch.frames[0], stretch.frames[-1]))
    return find_in_stretch(stretch, first, last, scene)


def sees(found: tuple[Boxes, Poses2D], path: Mapping[int, Float64Array], t: int) -> bool:
    """Whether the pose of this person is among those found in frame t."""
    true = path[t][:2] + BODY * (path[t][2:] - path[t][:2])
    return any(np.allclose(xy, true) for xy in found[1].xy)


def test_a_dancer_has_interpolated_boxes_between_two_looks() -> None:
    path = walking(0, 11, x=10)
    scene = Scene({"a": path})
    found = found_in(scene, Stretch(tuple(frames(11)), next_begins=True))
    assert scene.looks == [0, 10]
    assert len(found) == 10
    for t, (boxes, poses) in enumerate(found):
        np.testing.assert_allclose(boxes.xyxy, [path[t]])
        assert sees((boxes, poses), path, t)


def test_interpolation_follows_time_and_not_the_number_of_frames() -> None:
    """A step of three frames' length between two frames moves the box three times as far."""
    shots = frames(5, skip_s={3: 0.08})
    boxes = {t: np.array([25 * f.time_s, 20, 25 * f.time_s + 25, 80]) for t, f in enumerate(shots)}
    found = found_in(Scene({"a": boxes}), Stretch(tuple(shots), next_begins=True))
    for t, (between, _) in enumerate(found):
        np.testing.assert_allclose(between.xyxy, [boxes[t]])


def test_who_moves_further_than_the_own_width_does_not_lag_behind() -> None:
    """The boxes of the two looks share nothing, but nobody else is near."""
    path = walking(0, 11, x=10, speed=3.0)
    scene = Scene({"a": path, "other": walking(0, 11, x=120, speed=0.0)})
    found = found_in(scene, Stretch(tuple(frames(11)), next_begins=True))
    assert scene.looks == [0, 10]
    for t, (boxes, _) in enumerate(found):
        assert len(boxes) == 2
        assert any(np.allclose(box, path[t]) for box in boxes.xyxy)


def test_a_leaver_and_a_newcomer_of_another_shape_are_two() -> None:
    leaver = {t: np.array([20.0, 60, 80, 85]) for t in range(4)}  # lies on the floor
    newcomer = {t: np.array([60.0, 20, 85, 80]) for t in range(6, 11)}
    scene = Scene({"leaver": leaver, "newcomer": newcomer})
    found = found_in(scene, Stretch(tuple(frames(11)), next_begins=True))
    assert [len(boxes) for boxes, _ in found] == [1] * 4 + [0] * 2 + [1] * 4


@pytest.mark.parametrize("came", range(1, 10))
def test_a_newcomer_is_found_from_the_frame_of_coming(came: int) -> None:
    known, new = walking(0, 11, x=10), walking(came, 11, x=100)
    scene = Scene({"known": known, "new": new})
    found = found_in(scene, Stretch(tuple(frames(11)), next_begins=True))
    for t, people in enumerate(found):
        assert sees(people, known, t)
        assert len(people[0]) == (2 if t >= came else 1)
        assert t < came or sees(people, new, t)


@pytest.mark.parametrize("left", range(2, 10))
def test_one_who_leaves_is_followed_until_then(left: int) -> None:
    known, leaver = walking(0, 11, x=10), walking(0, left, x=100)
    found = found_in(
        Scene({"known": known, "leaver": leaver}), Stretch(tuple(frames(11)), next_begins=True)
    )
    for t, people in enumerate(found):
        assert sees(people, known, t)
        assert len(people[0]) == (2 if t < left else 1)
        assert t >= left or sees(people, leaver, t)


@pytest.mark.parametrize("missed", [0, 10])
def test_one_whom_the_detector_misses_in_a_key_frame_is_followed_from_the_other(
    missed: int,
) -> None:
    path = walking(0, 11, x=40)
    scene = Scene({"a": path}, unseen=frozenset({("a", missed)}))
    found = found_in(scene, Stretch(tuple(frames(11)), next_begins=True))
    seen = [t for t, people in enumerate(found) if sees(people, path, t)]
    assert seen == [t for t in range(10) if t != missed]


def test_where_the_pose_is_doubtful_the_detector_looks_again() -> None:
    """Someone who jumps aside between two looks and comes back is not where boxes expect him."""
    path = walking(0, 11, x=20)
    path |= {t: path[t] + [70, 0, 70, 0] for t in (4, 5)}
    scene = Scene({"a": path})
    found = found_in(scene, Stretch(tuple(frames(11)), next_begins=True))
    assert all(sees(people, path, t) for t, people in enumerate(found))
    assert sorted(scene.looks) == [0, 4, 5, 10]


def test_what_is_seen_once_and_has_no_pose_is_not_followed() -> None:
    scene = Scene({"a": walking(0, 11, x=10)}, ghosts={0: np.array([120.0, 10, 150, 80])})
    found = found_in(scene, Stretch(tuple(frames(11)), next_begins=True))
    assert [len(boxes) for boxes, _ in found] == [2] + [1] * 9


def test_nobody_is_found_twice() -> None:
    """Too fast to be the same person by the boxes of two looks: followed from both ends."""
    path = walking(0, 11, x=5, speed=9.0)
    found = found_in(Scene({"a": path}), Stretch(tuple(frames(11)), next_begins=True))
    for t, people in enumerate(found):
        assert len(people[0]) == 1
        assert sees(people, path, t)


# Stretches ------------------------------------------------------------------------------------


def lengths(video: list[Frame], detect_every: int) -> list[tuple[int, bool]]:
    return [(len(s.own), s.next_begins) for s in stretches(video, detect_every)]


def test_stretches_take_every_frame_once_in_order() -> None:
    own = [f.index for s in stretches(frames(23), 5) for f in s.own]
    assert own == list(range(23))
    assert lengths(frames(23), 5) == [(5, True)] * 4 + [(3, False)]
    assert lengths(frames(4), 1) == [(1, True)] * 3 + [(1, False)]


def test_a_hole_in_time_and_a_low_frame_rate_end_a_stretch() -> None:
    assert lengths(frames(12, skip_s={4: 1.0}), 10) == [(4, False), (8, False)]
    assert lengths(frames(3, rate=5.0), 10) == [(1, False)] * 3
    # Twice a second at least, whatever the rate.
    assert lengths(frames(13, rate=12.5), 60) == [(7, True), (6, False)]


def test_a_cut_ends_a_stretch_and_is_told() -> None:
    one, other = frames(6), frames(12)[6:]
    grey = np.random.default_rng(9).integers(0, 255, (*SIZE, 3), np.uint8)
    video = [*one, *(Frame(f.index, f.time_s, grey) for f in other)]
    found = list(stretches(video, 10))
    assert [(len(s.own), s.next_begins, s.cut) for s in found] == [
        (6, False, False),
        (6, False, True),
    ]


# The whole, with ONNX models --------------------------------------------------------------------


@pytest.fixture
def made_models(tmp_path: Path) -> Iterator[tuple[Path, Path]]:
    """A detector of three fixed people, and a keypoint model that looks and takes any batch."""
    dets = np.array(
        [[[5, 8, 30, 80, 0.9], [50, 8, 70, 80, 0.8], [75, 20, 92, 70, 0.7]]], np.float32
    )
    values = {"dets": dets, "labels": np.zeros((1, 3), np.int64)}
    detector = emitting(tmp_path / "det.onnx", values, input_shape=(1, 3, 96, 96))
    yield detector, heatmaps_of_colours(tmp_path / "pose.onnx", width=48, height=64)


def people(
    video: list[Frame], models: tuple[Path, Path], **options: int
) -> tuple[list[FramePeople], PoseModels]:
    speed = SpeedOptions(**options)  # type: ignore[arg-type]
    loaded = PoseModels(
        load_detector(models[0], threads=1),
        load_pose_model(models[1], threads=1, batch=speed.batch),
    )
    return list(find_people(video, loaded, speed)), loaded


@pytest.mark.parametrize("detect_every", [1, 10])
@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("batch", [1, 2, 16])
def test_what_is_found_does_not_depend_on_threads_and_batch(
    made_models: tuple[Path, Path], detect_every: int, threads: int, batch: int
) -> None:
    random = np.random.default_rng(3)
    video = [
        Frame(i, i / 25, random.integers(0, 255, (96, 96, 3), np.uint8) // 4 + 90)
        for i in range(24)
    ]
    usual, _ = people(video, made_models, detect_every=detect_every, threads=1, batch=4)
    found, _ = people(video, made_models, detect_every=detect_every, threads=threads, batch=batch)
    assert [f.frame.index for f in found] == list(range(24))
    for one, other in zip(usual, found, strict=True):
        assert len(one.poses) >= 3
        np.testing.assert_allclose(one.poses.xy, other.poses.xy, atol=1e-3)
        np.testing.assert_allclose(one.boxes.xyxy, other.boxes.xyxy, atol=1e-3)


def test_a_failure_in_a_model_ends_the_run_with_its_own_error() -> None:
    class Failing:
        description = None

        def detect(self, image: Image) -> Boxes:
            raise RuntimeError("as planned")

    models = PoseModels(Failing(), None)  # type: ignore[arg-type]
    with pytest.raises(RuntimeError, match="as planned"):
        list(find_people(frames(40), models, SpeedOptions(threads=2)))


@pytest.mark.shared
@pytest.mark.parametrize("detect_every", [1, 10])
def test_with_real_models_threads_change_nothing(shared: Path, detect_every: int) -> None:
    models = (
        shared / "models" / "yolox_nano.onnx",
        shared / "models" / "simcc_adapter_tinypose_256x192.onnx",
    )
    results = []
    for threads in (1, 3):
        with open_video(shared / "videos" / "contemporary_dance.mp4", end_s=0.8) as reader:
            found, _ = people(list(reader), models, detect_every=detect_every, threads=threads)
        results.append(found)
    for one, other in zip(*results, strict=True):
        np.testing.assert_allclose(one.poses.xy, other.poses.xy, atol=1e-3)


@pytest.mark.shared
@pytest.mark.parametrize(
    # The second is as much as the model's keypoints move when its box is shifted by 1 % of its
    # height (3.1 px on this video).
    ("name", "most_px"),
    [("contemporary_dance", 2.0), ("two_walkers", 3.1)],
)
def test_between_looks_poses_are_as_with_the_detector_on_every_frame(
    shared: Path, name: str, most_px: float
) -> None:
    from bench_following import compare

    result = compare(
        shared / "videos" / f"{name}.mp4",
        shared / "models" / "yolox_nano.onnx",
        shared / "models" / "simcc_adapter_tinypose_256x192.onnx",
        detect_every=10,
        end_s=4.0,  # one pose in a hundred is then more than one
    )
    assert result.poses > 100
    assert result.mean_px <= most_px
    assert result.missed <= 0.01 * result.poses
