"""Keypoints that no body could have put there: a wrist found on a foot, a knee on a chair.

Such a keypoint is as sure of itself as any. But the bone that ends there looks longer than bones
can, beside the others; without the keypoint the pose is guessed from those that are right.

T frames, J joints of a lifting skeleton.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import maximum_filter1d

from dance2pose.body import body_bones_mm
from dance2pose.poses import BoolArray, FloatArray
from dance2pose.skeleton import get

# People's bones differ by up to a quarter from the one body's in proportion, and an arm stretched
# towards a camera two body heights away looks a third larger: 1.25 x 1.33.
_LONGEST = 1.67
# A bone is compared with the one that looks fourth longest, so that three wrong ones do not make
# themselves right; the longest that this one gets within so many seconds.
_RANK, _NEAR_S = 3, 1.0


def implausible(xy: FloatArray, time_s: FloatArray, skeleton: str) -> BoolArray:
    """Which keypoints (T, J) cannot be right.

    xy: (T, J, 2) px, NaN where not seen. A bone that is too long accuses both its ends; of the two
    the one goes that more such bones accuse, or else the one farther from the trunk.
    """
    tree = get(skeleton)
    parents, children = np.array(tree.bones).T
    out = np.zeros(xy.shape[:2], dtype=bool)
    if not len(xy):
        return out
    ratio = np.linalg.norm(xy[:, children] - xy[:, parents], axis=-1) / body_bones_mm(skeleton)
    known = np.nan_to_num(ratio)
    typical = np.sort(known, axis=1)[:, -1 - _RANK]
    step = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 1.0
    reach = min(len(xy), 2 * round(_NEAR_S / max(step, 1e-3)) + 1)
    typical = maximum_filter1d(typical, reach, mode="nearest")
    rows, bones = np.nonzero((known > _LONGEST * typical[:, None]) & (typical[:, None] > 0))
    accused = np.zeros(xy.shape[:2], dtype=int)
    np.add.at(accused, (rows, parents[bones]), 1)
    np.add.at(accused, (rows, children[bones]), 1)
    near = accused[rows, parents[bones]] > accused[rows, children[bones]]
    out[rows, np.where(near, parents[bones], children[bones])] = True
    return out
