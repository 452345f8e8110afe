"""Known motion as cameras see it: the scenes of the experiments, and how they are spoiled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dance2pose.evaluation.metrics import signal_to_noise_sigma
from dance2pose.lifting.lifted import Observed
from dance2pose.mocap.corpus import Take, resample
from dance2pose.poses import FloatArray

# Orthographic, one pixel this many mm, the hip in the middle of the picture.
MM_PER_PIXEL = 2.0
IMAGE_SIZE = (1920, 1080)


@dataclass(frozen=True)
class Scene:
    """A take in front of one camera.

    take: its name. azimuth_deg: the camera's way around the dancer; tilt_deg: how far it looks
    down. truth: (T, J, 3) mm in world axes as that camera sees them (x right, y up, z towards the
    viewer), first joint at the origin. xy: (T, J, 2) mm, y up, from the picture's middle, what is
    given to the lifters; NaN where a joint is missing. fov_deg: of a perspective camera, whose xy
    are mm at the dancer's usual distance; None for an orthographic one.
    """

    take: str
    azimuth_deg: float
    tilt_deg: float
    rate_hz: float
    skeleton: str
    truth: FloatArray
    xy: FloatArray
    fov_deg: float | None = None
    mm_per_pixel: float = MM_PER_PIXEL

    def observed(self, *, independent: bool = False) -> Observed:
        """The scene as a lifter takes it: pixels, y up, confidence 1 (0 where missing)."""
        width, height = IMAGE_SIZE
        # A perspective camera's principal point is where `perspective.camera_of` has it.
        middle = (width, height) if self.fov_deg is None else (width - 1, height - 1)
        pixels = self.xy / self.mm_per_pixel + np.array([middle[0] / 2, -middle[1] / 2])
        return Observed(
            xy=pixels,
            confidence=np.isfinite(self.xy).all(axis=-1).astype(float),
            time_s=np.arange(len(self.xy)) / self.rate_hz,
            skeleton=self.skeleton,
            image_size=IMAGE_SIZE,
            independent=independent,
            camera="weak-perspective" if self.fov_deg is None else "perspective",
            fov_deg=self.fov_deg,
        )


def rotation(azimuth_deg: float, tilt_deg: float) -> FloatArray:
    """Rotation (3, 3), camera from world: about the vertical first, then down by the tilt."""
    a, t = np.radians([azimuth_deg, tilt_deg])
    turn = np.array([[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]])
    tilt = np.array([[1, 0, 0], [0, np.cos(t), -np.sin(t)], [0, np.sin(t), np.cos(t)]])
    both: FloatArray = tilt @ turn
    return both


def scenes(
    takes: Sequence[Take],
    *,
    views: int,
    tilt_deg: float,
    seed: int,
    rate_hz: float | None = None,
) -> list[Scene]:
    """Every take before `views` cameras evenly around it.

    The first azimuth of a take is drawn at random, every tilt uniformly within ±tilt_deg, both
    from the seed. rate_hz: frames a second, None for the take's own.
    """
    out = []
    for number, take in enumerate(takes):
        rng = np.random.default_rng((seed, number))
        first = rng.uniform(0, 360 / views)
        at_rate = take if rate_hz is None or take.rate_hz <= rate_hz else resample(take, rate_hz)
        for view in range(views):
            azimuth = first + 360 / views * view
            tilt = rng.uniform(-tilt_deg, tilt_deg)
            truth = at_rate.xyz @ rotation(azimuth, tilt).T
            truth = truth - truth[:, :1]
            out.append(
                Scene(
                    take.name, azimuth, tilt, at_rate.rate_hz, take.skeleton, truth, truth[..., :2]
                )
            )
    return out


def with_noise(scene: Scene, rng: np.random.Generator, *, sigma_mm: float) -> Scene:
    """Gaussian noise on every coordinate of every joint, independent from frame to frame."""
    return replace(scene, xy=scene.xy + rng.normal(0.0, sigma_mm, scene.xy.shape))


def with_slow_errors(
    scene: Scene, rng: np.random.Generator, *, sigma_mm: float, correlation_s: float
) -> Scene:
    """Errors that last, as keypoint models make them while a pose looks alike.

    An Ornstein-Uhlenbeck process of each coordinate of each joint, with that standard deviation
    and correlation time.
    """
    keep = np.exp(-1 / (scene.rate_hz * correlation_s))
    off = rng.standard_normal(scene.xy.shape)
    for frame in range(1, len(off)):
        off[frame] = keep * off[frame - 1] + np.sqrt(1 - keep**2) * off[frame]
    return replace(scene, xy=scene.xy + sigma_mm * off)


def with_snr(scene: Scene, rng: np.random.Generator, *, snr_db: float) -> Scene:
    """Gaussian noise at a signal-to-noise ratio of the whole scene."""
    return with_noise(scene, rng, sigma_mm=signal_to_noise_sigma(scene.xy, snr_db))


def with_missing(
    scene: Scene, rng: np.random.Generator, *, share: float, shortest: int = 5, longest: int = 20
) -> Scene:
    """Joints missing in runs of `shortest` to `longest` frames, each joint by itself.

    Runs and the gaps between them alternate; gaps are drawn from a geometric distribution whose
    mean makes `share` of all joints missing on average.
    """
    frames, joints = scene.xy.shape[:2]
    gap = (shortest + longest) / 2 * (1 - share) / share
    xy = scene.xy.copy()
    for joint in range(joints):
        # Start inside a gap or a run alike, so that the share holds from the first frame on.
        frame = -int(rng.integers(0, longest + int(gap)))
        while frame < frames:
            frame += int(rng.geometric(1 / gap))
            run = int(rng.integers(shortest, longest + 1))
            xy[max(frame, 0) : max(frame + run, 0), joint] = np.nan
            frame += run
    return replace(scene, xy=xy)
