"""The camera's own movement: planted turns and zooms are recovered, still ones stay."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dance2pose.background_motion import STILL_PX, CameraMotionEstimator
from dance2pose.background_view import BackgroundView, Scene
from dance2pose.errors import DataError
from dance2pose.lifting.lift import lift_all
from dance2pose.lifting.world.moving_camera import CameraMotion
from dance2pose.poses import FloatArray, Image, Track2D
from dance2pose.skeleton import get
from dance2pose.small_picture import SIZE, Grey, small_grey
from dance2pose.video import open_video

SHARED = Path(__file__).parents[2] / "shared"
WIDTH, HEIGHT, FOV_DEG = 480, 270, 50.0
NO_PEOPLE = np.zeros((0, 4))


def texture(seed: int = 0) -> Image:
    """Three times as wide as the picture, corners everywhere."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(0, 255, (3 * HEIGHT // 9, 3 * WIDTH // 9, 3), np.uint8)
    return cv2.resize(coarse, (3 * WIDTH, 3 * HEIGHT), interpolation=cv2.INTER_CUBIC)


def looking(world: Image, rotation: FloatArray, zoom: float = 1.0) -> Image:
    """What the camera sees of a plane far away, turned (axes y up) and zoomed."""
    focal = WIDTH / 2 / np.tan(np.radians(FOV_DEG) / 2)

    def intrinsics(f: float, width: int, height: int) -> FloatArray:
        # To px, y down, from camera axes with y up and z towards the viewer.
        return np.array([[f, 0, -(width - 1) / 2], [0, -f, -(height - 1) / 2], [0, 0, -1.0]])

    onto = intrinsics(focal * zoom, WIDTH, HEIGHT) @ rotation.T
    whole = intrinsics(focal, 3 * WIDTH, 3 * HEIGHT)
    return cv2.warpPerspective(world, onto @ np.linalg.inv(whole), (WIDTH, HEIGHT))


def turned(pan: float = 0.0, tilt: float = 0.0, roll: float = 0.0) -> FloatArray:
    """Of a camera: right, up, anticlockwise, degrees."""
    return Rotation.from_euler("YXZ", [-pan, tilt, roll], degrees=True).as_matrix()


def followed(pictures: list[Image], boxes: list[FloatArray] | None = None) -> CameraMotion:
    return followed_small([small_grey(picture) for picture in pictures], boxes)


def followed_small(pictures: list[Grey], boxes: list[FloatArray] | None = None) -> CameraMotion:
    estimator = CameraMotionEstimator((WIDTH, HEIGHT), FOV_DEG)
    for index, picture in enumerate(pictures):
        people = NO_PEOPLE if boxes is None else boxes[index]
        estimator.update(2 * index, index / 25, picture, people)
    return estimator.finish()


def off_deg(motion: CameraMotion, truth: list[FloatArray]) -> float:
    off = Rotation.from_matrix(motion.rotation) * Rotation.from_matrix(np.stack(truth)).inv()
    return float(np.degrees(off.magnitude()).max())


@pytest.mark.parametrize(
    ("axes", "note"),
    [
        ({"pan": 24.0}, "pans by 24 degrees"),
        ({"tilt": 11.0}, "tilts by 11 degrees"),
        ({"roll": 14.0}, "rolls by 14 degrees"),
        ({"pan": -40.0, "tilt": 5.0}, "pans by 40 degrees and tilts by 5 degrees"),
    ],
)
def test_a_turn_is_recovered_and_said(axes: dict[str, float], note: str) -> None:
    world = texture()
    truth = [turned(**{k: v * s for k, v in axes.items()}) for s in np.linspace(0, 1, 31)]
    motion = followed([looking(world, r) for r in truth])
    assert motion.moves
    assert off_deg(motion, truth) < 0.3
    np.testing.assert_allclose(motion.zoom, 1.0, atol=0.01)
    np.testing.assert_array_equal(motion.frame, 2 * np.arange(31))
    assert motion.notes() == (f"The camera {note}; this is undone in the dancers' paths.",)


def test_a_zoom_is_recovered_and_said() -> None:
    world = texture()
    zoom = np.linspace(1.0, 1.8, 23)
    motion = followed([looking(world, np.eye(3), z) for z in zoom])
    np.testing.assert_allclose(motion.zoom, zoom, rtol=0.01)
    assert off_deg(motion, [np.eye(3)] * 23) < 0.2
    assert "zooms by a factor of 1.8" in motion.notes()[0]


def test_a_camera_that_comes_back_is_where_it_was() -> None:
    world = texture()
    way = np.concatenate([np.linspace(0, 35, 25), np.linspace(35, 0, 25), np.zeros(3)])
    motion = followed([looking(world, turned(pan=p)) for p in way])
    assert off_deg(motion, [turned(pan=p) for p in way]) < 0.3


def test_a_still_camera_is_exactly_still_whatever_the_noise_and_the_dancer() -> None:
    world, rng = texture(), np.random.default_rng(1)
    still = looking(world, np.eye(3))
    pictures, boxes = [], []
    for index in range(40):
        noisy = np.clip(still + rng.normal(0, 8, still.shape), 0, 255).astype(np.uint8)
        x = 40 + 5 * index  # a dancer in a patterned dress who crosses the picture
        noisy[60:250, x : x + 90] = world[60:250, :90]
        pictures.append(noisy)
        boxes.append(np.array([[x, 60.0, x + 90, 250.0]]))
    motion = followed(pictures, boxes)
    assert not motion.moves
    assert motion.known.all()
    assert motion.notes() == ()


@pytest.mark.parametrize(("shake", "moves"), [(0.4, False), (2.0, True)])
def test_the_threshold_of_stillness_is_as_stated(shake: float, moves: bool) -> None:
    focal = WIDTH / 2 / np.tan(np.radians(FOV_DEG) / 2)
    degrees = np.degrees(shake * STILL_PX * WIDTH / SIZE / focal)
    world = texture()
    ways = degrees * np.sin(np.arange(30))
    motion = followed([looking(world, turned(pan=a)) for a in ways])
    assert motion.moves is moves
    if moves:
        assert off_deg(motion, [turned(pan=a) for a in ways]) < 0.1


def looks_of(pictures: list[Image], monkeypatch: pytest.MonkeyPatch) -> tuple[int, CameraMotion]:
    """How many of the pictures are looked at, and the motion."""
    small = [small_grey(picture) for picture in pictures]
    looked: set[int] = set()
    usual = BackgroundView.scene

    def scene(self: BackgroundView, picture: Grey, boxes: FloatArray) -> Scene:
        looked.add(next(i for i, one in enumerate(small) if one is picture))
        return usual(self, picture, boxes)

    monkeypatch.setattr(BackgroundView, "scene", scene)
    motion = followed_small(small)
    return len(looked), motion


def test_an_even_movement_needs_few_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    world = texture()
    truth = [turned(pan=p) for p in np.linspace(0, 20, 60)]
    looks, motion = looks_of([looking(world, r) for r in truth], monkeypatch)
    assert looks <= 30
    assert off_deg(motion, truth) < 0.1
    assert motion.known.all()


def test_a_shaking_camera_is_looked_at_in_every_frame_once_that_is_seen(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = texture()
    way = np.concatenate([np.zeros(24), np.sin(np.arange(30))])
    looks, motion = looks_of([looking(world, turned(pan=a)) for a in way], monkeypatch)
    assert looks >= 24 // 3 + 27
    # Two frames between looks show nothing of it, if the third is where it was.
    seen = motion.at(motion.frame[27:])
    assert off_deg(seen, [turned(pan=a) for a in way[27:]]) < 0.1


def test_every_frame_is_accounted_for_however_the_times_lie() -> None:
    world, times = texture(), np.cumsum([0.01, 0.04, 0.04, 0.3, 0.04, 0.02, 0.02, 0.02, 0.5, 0.04])
    estimator = CameraMotionEstimator((WIDTH, HEIGHT), FOV_DEG)
    truth = [turned(pan=3 * t) for t in times - times[0]]
    for index, (time_s, rotation) in enumerate(zip(times, truth, strict=True)):
        picture = small_grey(looking(world, rotation))
        estimator.update(index, float(time_s), picture, NO_PEOPLE)
    motion = estimator.finish()
    np.testing.assert_array_equal(motion.frame, np.arange(len(times)))
    assert off_deg(motion, truth) < 0.1


def test_every_shot_begins_anew() -> None:
    estimator = CameraMotionEstimator((WIDTH, HEIGHT), FOV_DEG)
    way = np.linspace(0, 10, 11)
    for index in range(22):
        world = texture(index // 11)
        picture = small_grey(looking(world, turned(pan=way[index % 11] if index < 11 else 0)))
        estimator.update(index, index / 25, picture, NO_PEOPLE, cut=index == 11)
    motion = estimator.finish()
    np.testing.assert_array_equal(motion.shot, np.repeat([0, 1], 11))
    assert (motion.rotation[11:] == np.eye(3)).all()
    assert motion.spans()[0][0] == pytest.approx(10, abs=0.3)
    assert motion.notes() == (
        "The camera pans by 10 degrees in shot 1; this is undone in the dancers' paths.",
    )


def test_a_picture_without_background_is_said() -> None:
    blank = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    motion = followed([blank] * 9)
    assert not motion.known.any()
    assert not motion.moves
    assert "cannot be told in 100% of the frames" in motion.notes()[0]


def test_rows_of_a_track_are_found_by_frame() -> None:
    world = texture()
    motion = followed([looking(world, turned(pan=p)) for p in np.linspace(0, 9, 13)])
    rows = motion.at(np.array([4, 8, 10]))
    np.testing.assert_array_equal(rows.rotation, motion.rotation[[2, 4, 5]])
    with pytest.raises(DataError, match="not known in every frame"):
        motion.at(np.array([4, 5]))
    with pytest.raises(DataError, match="not known in every frame"):
        motion.at(np.array([99]))


@pytest.mark.shared
@pytest.mark.parametrize(
    ("name", "low", "high"), [("contemporary_dance", 18, 36), ("balance_cam01", 0, 0)]
)
def test_real_cameras(name: str, low: float, high: float) -> None:
    with open_video(SHARED / f"videos/{name}.mp4", every=3) as frames:
        estimator = None
        for frame in frames:
            height, width = frame.image.shape[:2]
            estimator = estimator or CameraMotionEstimator((width, height))
            estimator.update(frame.index, frame.time_s, frame.small, NO_PEOPLE)
    assert estimator is not None
    pan = estimator.finish().spans()[0][0]
    assert low <= pan <= high


def test_the_path_under_a_camera_that_pans_and_zooms_is_that_under_a_still_one() -> None:
    frames, size = 31, (1920, 1080)
    body = walker(frames)
    focal = size[0] / 2 / np.tan(np.radians(50) / 2)
    middle = (np.array(size) - 1) / 2
    zoom = np.linspace(1.0, 1.4, frames)
    rotation = np.stack([turned(pan=p, tilt=p / 5) for p in np.linspace(0, 20, frames)])
    motion = CameraMotion(
        np.arange(frames), rotation, zoom, np.ones(frames, bool), np.zeros(frames, np.int64)
    )

    def seen(xyz: FloatArray, f: FloatArray) -> Track2D:
        xy = f[:, None, None] * xyz[..., :2] / -xyz[..., 2:] * [1, -1] + middle
        return Track2D.from_arrays(
            xy, time_s=np.arange(frames) / 25, skeleton="body17", image_size=size
        )

    still = seen(body, np.full(frames, focal))
    moving = seen(body @ rotation, focal * zoom)
    (expected,) = lift_all([still])
    (found,) = lift_all([moving], motion=motion)
    (fooled,) = lift_all([moving])
    assert expected.root is not None and found.root is not None and fooled.root is not None
    np.testing.assert_allclose(found.root, expected.root, atol=0.01)
    np.testing.assert_allclose(found.xyz, expected.xyz, atol=0.01)
    assert np.abs(fooled.root - expected.root).max() > 0.3
    assert np.nanmax(found.reprojection_error) < 1.5 * np.nanmax(expected.reprojection_error) + 5


def walker(frames: int) -> FloatArray:
    """(T, 17, 3) mm in the camera's axes: a man who walks to the right, 4 m away."""
    height = {"knee": 500, "ankle": 90, "toe": 20, "head": 1600, "neck": 1400, "shoulder": 1370}
    height |= {"elbow": 1100, "wrist": 850, "hip": 930, "pelvis": 930}
    width = {"hip": 90, "shoulder": 180, "elbow": 210, "wrist": 230, "knee": 90, "ankle": 90}
    phase = 2 * np.pi * np.arange(frames) / 25
    xyz = np.zeros((frames, 17, 3))
    for joint, name in enumerate(get("body17").joints):
        side = 1.0 if name.startswith("left") else -1.0 if name.startswith("right") else 0.0
        part = name.split("_")[-1]
        swing = {"knee": 150, "ankle": 250, "toe": 250, "elbow": -80, "wrist": -200}.get(part, 0)
        xyz[:, joint, 0] = side * swing * np.sin(phase) + 30.0 * np.arange(frames) - 400
        xyz[:, joint, 1] = height[part] - 1000
        xyz[:, joint, 2] = -4000 - side * width.get(part, 90) + (120 if part == "toe" else 0)
    return xyz
