"""Standard deviations made of parts, and the factors of the parts fitted to planted errors."""

from __future__ import annotations

import numpy as np
import pytest

from dance2pose.lifting.error_calibration import METADATA, Calibration, ErrorParts, read, written
from lifter_training.calibration import Case, fitted, shares

JOINTS = 17


def test_parts_add_as_variances() -> None:
    parts = ErrorParts(np.full((7, JOINTS), 30.0), np.full((7, JOINTS), 10.0), 20.0)
    calibration = Calibration(tuple([2.0] + [1.0] * 16), noise=1.5, bias=3.0)
    sigma = calibration.sigma(parts)
    assert sigma[0, 0] == pytest.approx(np.sqrt(60**2 + 15**2 + 60**2))
    assert sigma[6, 16] == pytest.approx(np.sqrt(30**2 + 15**2 + 60**2))


def test_frames_that_were_not_lifted_have_no_error_known() -> None:
    parts = ErrorParts(np.ones((2, JOINTS)), np.full((2, JOINTS), 3.0), 5.0)
    spread = parts.on_rows(np.array([1, 4]), 6)
    assert spread.pose.shape == (6, JOINTS) and spread.bias_mm == 5.0
    assert np.isfinite(spread.pose).all(axis=1).tolist() == [False, True, False, False, True, False]
    assert spread.noise[4, 0] == 3.0


def test_calibrations_are_kept_in_the_networks_metadata() -> None:
    one, two = Calibration(noise=0.5), Calibration(tuple(np.linspace(1, 2, JOINTS)), 0.7, 4.0)
    metadata = {METADATA: written(one, two)}
    assert read(metadata, pictures=False) == one
    assert read(metadata, pictures=True) == two
    assert read({}, pictures=True) == Calibration()


def test_planted_factors_are_found() -> None:
    """Errors drawn as a calibration says: as many lie within one and two sigma as should."""
    rng = np.random.default_rng(0)
    true = Calibration(tuple([0.5, *np.linspace(0.6, 1.4, 16)]), noise=1.0, bias=4.0)
    found = []
    for group, noise, bias in (("clean", 1.0, 0.0), ("white", 25.0, 0.0), ("slow", 5.0, 12.0)):
        pose = rng.uniform(10, 40, (4000, JOINTS))
        parts = ErrorParts(pose, np.full(pose.shape, noise), bias)
        errors = np.abs(rng.normal(size=pose.shape)) * true.sigma(parts)
        errors[::7] = np.nan
        found.append(Case(group, False, errors, parts))
    calibration = fitted(found)
    assert calibration.noise == true.noise and calibration.bias == true.bias
    # 70 % of a normal distribution lie within 1.036 standard deviations.
    np.testing.assert_allclose(calibration.joints[1:], 1.036 * np.array(true.joints[1:]), rtol=0.1)
    for one, two in shares(found, calibration).values():
        assert one == pytest.approx(0.70, abs=0.02) and two == pytest.approx(0.95, abs=0.02)
