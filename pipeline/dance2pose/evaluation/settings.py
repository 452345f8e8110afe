"""What an evaluation is told: the one place for its defaults."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EvaluationSettings:
    """Settings of `dance2pose evaluate`.

    views: cameras around every take. tilt_deg: cameras look up or down by up to this. seed: of
    all random numbers. window: frames, of the temporal models in Table 1 and of the noise
    experiment. rate_hz: frames a second of everything that is not said to be at the takes' own
    rate. snr_db: of the noise experiment. noise_mm: Gaussian noise on the 2D joints, at body
    scale. missing: share of joints taken away in runs of 5 to 20 frames. ablate: with the
    ablations of the paper's lifter. only_own_bodies: only the default lifter on own bodies.
    """

    views: int = 2
    tilt_deg: float = 20.0
    seed: int = 0
    window: int = 5
    rate_hz: float = 30.0
    snr_db: tuple[float, ...] = (1, 5, 9, 13, 17, 21, 25, 30, 35, 40)
    noise_mm: float = 10.0
    missing: float = 0.15
    ablate: bool = False
    only_own_bodies: bool = False
