"""The camera's field of view, where the picture tells it.

Taken too narrow, a field of view stretches the room along the view, too wide, it squeezes it: the
floor under standing feet, near and far, then rises less or more steeply than upright bodies say
that the camera looks down. Where it looks down enough and feet stand far enough apart, the field of
view at which both agree is known; elsewhere it is not, and one is assumed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dance2pose.lifting.world.camera_tilt import UPRIGHT_DEG, tilt_evidence
from dance2pose.poses import Track3D

# Standard deviation of the logarithm of focal lengths of cameras that people use, about the one
# that is assumed.
_PRIOR = 0.25
# Evidence worth less than this, as an error of the logarithm, is none.
_LEAST_SURE = 0.35
_FACTORS = np.exp(np.linspace(-0.8, 0.8, 161))


@dataclass(frozen=True)
class FieldOfView:
    """degrees: across the longer side of the picture. error_deg: standard deviation."""

    degrees: float
    error_deg: float


def estimated_fov(
    tracks: Sequence[Track3D], mm_per_unit: float, assumed_deg: float
) -> FieldOfView | None:
    """The field of view that the dancers of one still camera tell, None where they do not.

    tracks: in the camera's axes, lifted with a field of view of assumed_deg.
    """
    placed = [track for track in tracks if track.root is not None]
    evidence = tilt_evidence(placed, mm_per_unit)
    upright, (plane, plane_error) = evidence.upright_deg, evidence.plane
    if not np.isfinite([upright, plane]).all():
        return None
    roots = np.concatenate([track.root for track in placed if track.root is not None])
    roots = roots[np.isfinite(roots).all(axis=1)]
    below = float(np.median(-roots[:, 1] / np.maximum(-roots[:, 2], 1e-9)))
    # A longer focal length by a factor k stretches depths by k, and the dancer is seen at a lesser
    # angle below the camera's axis, from which bodies' tilts are told.
    floor = np.degrees(np.arctan(np.tan(np.radians(plane)) / _FACTORS))
    bodies = upright + np.degrees(np.arctan(below) - np.arctan(below / _FACTORS))
    error = math.hypot(UPRIGHT_DEG, plane_error)
    slope = float(np.abs(np.gradient(floor - bodies, np.log(_FACTORS)))[len(_FACTORS) // 2])
    if slope * _LEAST_SURE < error:
        return None
    cost = ((floor - bodies) / error) ** 2 + (np.log(_FACTORS) / _PRIOR) ** 2
    weight = np.exp(-(cost - cost.min()) / 2)
    mean = float((weight * np.log(_FACTORS)).sum() / weight.sum())
    sigma = math.sqrt(float((weight * (np.log(_FACTORS) - mean) ** 2).sum() / weight.sum()))
    half = math.tan(math.radians(assumed_deg) / 2)
    low, middle, high = (
        2 * math.degrees(math.atan(half / math.exp(mean + step * sigma))) for step in (1, 0, -1)
    )
    return FieldOfView(middle, (high - low) / 2)
