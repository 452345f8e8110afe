"""Cuts between scenes are found where they are; dance, light and camera movement are none."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from dance2pose.poses import Frame, Image, Inner
from dance2pose.shots import ShotDetector
from dance2pose.video import open_video
from video_making import make_video, scene, with_dancer

COUNT = 20


def cuts(images: Iterable[Image]) -> list[int]:
    detector = ShotDetector()
    return [
        number
        for number, image in enumerate(images)
        if detector.is_cut(Frame(number, number / 25, np.asarray(image, dtype=np.uint8)))
    ]


def shot(seed: int, count: int = COUNT) -> list[Image]:
    background = scene(seed)
    return [with_dancer(background, number / 25) for number in range(count)]


def brighter(image: Image, gain: float, offset: float = 0) -> Image:
    return np.clip(image * gain + offset, 0, 255).astype(np.uint8)


def test_hard_cuts_are_found_exactly_through_a_real_encoder(tmp_path: Path) -> None:
    images = [*shot(1), *shot(2, 13), *shot(3), *shot(1)]
    path = make_video(tmp_path / "edited.mp4", images)
    detector = ShotDetector()
    with open_video(path) as video:
        assert [frame.index for frame in video if detector.is_cut(frame)] == [20, 33, 53]


@pytest.mark.parametrize("seed", range(10, 30, 2))
def test_each_cut_between_two_scenes(seed: int) -> None:
    assert cuts([*shot(seed, 5), *shot(seed + 1, 5)]) == [5]


def test_a_shot_of_one_frame() -> None:
    assert cuts([*shot(1, 5), scene(2), *shot(3, 5)]) == [5, 6]


def test_a_single_scene_and_a_single_frame_have_no_cut() -> None:
    assert cuts(shot(4, 60)) == []
    assert cuts([scene(1)]) == []


@pytest.mark.parametrize("gain,offset", [(1.5, 90), (0.3, 0), (2.0, 0), (1, 255), (0, 0)])
def test_a_flash_or_a_blackout_is_no_cut(gain: float, offset: float) -> None:
    images = shot(5)
    for number in (7, 8, 9):
        images[number] = brighter(images[number], gain, offset)
    assert cuts(images) == []


def test_coloured_stage_light_is_no_cut() -> None:
    images = shot(6)
    for number in range(8, 14):
        images[number] = brighter(images[number], 1) * np.array([0.25, 0.3, 1.0])
    assert cuts(images) == []


def test_a_cut_behind_a_blackout_is_where_the_new_scene_appears() -> None:
    black = np.zeros_like(scene(1))
    assert cuts([*shot(1, 5), black, black, *shot(2, 5)]) == [7]


def test_a_camera_that_follows_is_no_cut() -> None:
    wide = scene(7, 960, 240)
    images = [wide[:, 24 * number : 24 * number + 320] for number in range(20)]
    assert cuts(images) == []


def test_sizes_of_any_kind() -> None:
    for width, height in ((1, 1), (3, 500), (64, 64), (1000, 7)):
        assert cuts([np.full((height, width, 3), value, np.uint8) for value in (0, 200)]) == []


@pytest.mark.parametrize(
    ("size", "inners"),
    [
        ((1920, 8), (None, (0, 1, 1920, 6))),
        ((1280, 720), ((0, 356, 1280, 8), (0, 355, 1280, 9))),
        ((1920, 1080), ((953, 0, 14, 1080), (952, 0, 15, 1080))),
    ],
)
def test_pictures_that_are_nearly_all_border_are_compared(
    size: tuple[int, int], inners: tuple[Inner | None, Inner | None]
) -> None:
    detector = ShotDetector()
    for number, inner in enumerate(inners):
        image = np.zeros((size[1], size[0], 3), np.uint8)
        left, top, width, height = inner or (0, 0, *size)
        noise = np.random.default_rng(number).integers(0, 256, (height, width, 3))
        image[top : top + height, left : left + width] = noise
        assert isinstance(detector.is_cut(Frame(number, number / 25, image, inner)), bool)


@pytest.mark.shared
@pytest.mark.parametrize("every", [1, 3])
def test_real_dance_has_no_cut(shared: Path, every: int) -> None:
    for path in sorted((shared / "videos").glob("*.mp4")):
        detector = ShotDetector()
        with open_video(path, every=every) as video:
            assert not any(detector.is_cut(frame) for frame in video), path.name


@pytest.mark.shared
def test_real_cuts_between_cameras_and_to_a_close_up(shared: Path) -> None:
    def first(name: str, count: int = 6) -> list[Image]:
        with open_video(shared / "videos" / f"{name}.mp4") as video:
            return [frame.image for frame, _ in zip(video, range(count), strict=False)]

    one, other = first("contemporary_dance"), first("two_walkers")
    front, side = first("balance_cam01"), first("balance_cam03")
    near = [image[60:330, 90:300] for image in one]
    assert cuts([*one, *other, *front, *side]) == [6, 12, 18]
    assert cuts([*one, *near]) == [6]
