"""What a reader must know before a result is used: what was seen in it, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from dance2pose.body import BODY_HEIGHT_MM
from dance2pose.lifting.world.ground_plane import floor_heights
from dance2pose.portions import portions
from dance2pose.poses import Dancer, FloatArray, Timeline, Track2D, Track3D, Unit
from dance2pose.skeleton import get

# A bone that turns further from one frame to the next turned in the data, not on the stage: at 25
# frames a second this is 1,000 degrees a second, which wrists reach and knees do not.
SUDDEN_TURN_DEG = 40.0
# Frames further apart than this are no neighbours.
_NEIGHBOURS_S = 0.1
# A joint drawn further from its keypoint than this part of the dancer's height in the picture.
FAR_OFF = 0.1
_FAR_OFF_SHARE = 0.01
# Below the floor by more than this.
SUNK: dict[Unit, float] = {"metres": 0.03, "body heights": 0.018}
# Seen in fewer of the frames of the shot than this share.
SHARE_OF_SHOT = 0.9
# A camera nearer to the pelvis than this sees no whole body.
NEAREST: dict[Unit, float] = {"metres": 1.6, "body heights": 1.0}
# A dancer whose floor is this much higher than the one at y = 0 stands on another.
ANOTHER_FLOOR: dict[Unit, float] = {"metres": 0.2, "body heights": 0.12}
# Left out, but seen for at least this long.
LEFT_OUT_S = 1.0


def find(
    dancers: Sequence[Dancer], followed: Sequence[Track2D], timeline: Timeline
) -> tuple[str, ...]:
    """Sentences on the dancers of a video; none where there is nothing to report.

    Parameters
    ----------
    dancers
        Those who were lifted.
    followed
        The tracks of people who were followed, numbered as the dancers are; those who are none of
        these were left out.
    timeline
        Every frame that was processed.
    """
    sentences = list(_left_out(dancers, followed))
    for dancer in dancers:
        found = [
            *_seen_seldom(dancer, timeline, alone=len(dancers) == 1),
            *_sudden_turns(dancer.smoothed),
            *_far_off(dancer),
            *_sunk(dancer.smoothed),
            *_on_a_floor_above(dancer.smoothed, dancers),
            *_too_near(dancer.smoothed),
        ]
        sentences += [f"dancer {dancer.person}: {sentence}" for sentence in found]
    return tuple(sentences)


def _left_out(dancers: Sequence[Dancer], followed: Sequence[Track2D]) -> Iterator[str]:
    kept = {dancer.person for dancer in dancers}
    for track in followed:
        seconds = float(track.time_s[-1] - track.time_s[0])
        if track.person not in kept and seconds >= LEFT_OUT_S:
            yield (
                f"person {track.person}, seen from {track.time_s[0]:.1f} to "
                f"{track.time_s[-1]:.1f} s, was left out as less prominent (--person all takes "
                f"everyone, --person {track.person} this one)"
            )


def _seen_seldom(dancer: Dancer, timeline: Timeline, *, alone: bool) -> Iterator[str]:
    seen = int((~np.isnan(dancer.keypoints.xy).all(axis=(1, 2))).sum())
    if seen < SHARE_OF_SHOT * len(timeline) and (alone or len(timeline) - seen > 1):
        yield f"seen in {seen} of {len(timeline)} frames"


def turns_deg(xyz: FloatArray, timeline: Timeline, skeleton: str) -> FloatArray:
    """How far each bone turns from each frame to the next, (T - 1, J - 1) degrees.

    NaN where a joint is missing or the frames are no neighbours in time.
    """
    turned = np.full((max(len(xyz) - 1, 0), xyz.shape[1] - 1), np.nan)
    for rows in portions(len(turned)):
        turned[rows] = _turns_deg(xyz[rows.start : rows.stop + 1], skeleton)
    turned[np.diff(timeline.time_s) > _NEIGHBOURS_S] = np.nan
    return turned


def _turns_deg(xyz: FloatArray, skeleton: str) -> FloatArray:
    parents, children = np.array(get(skeleton).bones).T
    bone = (xyz[:, children] - xyz[:, parents]).astype(np.float64)
    length = np.linalg.norm(bone, axis=-1, keepdims=True)
    direction = np.divide(bone, length, out=np.full_like(bone, np.nan), where=length > 0)
    cosine = (direction[1:] * direction[:-1]).sum(axis=-1)
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1, 1))))


def _sudden_turns(track: Track3D) -> Iterator[str]:
    if len(track) < 2:
        return
    turned = turns_deg(track.xyz, track.timeline, track.skeleton)
    turned[track.estimated[1:, 1:] & track.estimated[:-1, 1:]] = np.nan  # nobody saw them turn
    sudden = np.nan_to_num(turned) > SUDDEN_TURN_DEG
    if sudden.any():
        row, bone = np.unravel_index(int(np.nan_to_num(turned).argmax()), turned.shape)
        joint = get(track.skeleton).joints[int(bone) + 1]
        yield (
            f"{int(sudden.any(axis=1).sum())} sudden turns of more than {SUDDEN_TURN_DEG:g} "
            f"degrees between two frames, the largest at {track.time_s[row + 1]:.2f} s "
            f"({_plain(joint)}, {turned[row, bone]:.0f} degrees)"
        )


def _far_off(dancer: Dancer) -> Iterator[str]:
    """Joints that are drawn far from where their keypoints were seen."""
    error, xy = dancer.raw.reprojection_error, dancer.keypoints.xy
    seen = np.isfinite(error)
    extents = [np.ptp(row[np.isfinite(row)]) for row in xy[..., 1] if np.isfinite(row).any()]
    if not seen.any() or not extents:
        return
    height_px = float(np.percentile(extents, 75))
    far = seen & (error > FAR_OFF * height_px)
    if far.sum() > _FAR_OFF_SHARE * seen.sum():
        worst = np.where(far, error, 0.0)
        row, joint = np.unravel_index(int(worst.argmax()), worst.shape)
        name = _plain(get(dancer.smoothed.skeleton).joints[int(joint)])
        yield (
            f"{far.sum() / seen.sum():.1%} of joints lie further from their keypoints than "
            f"{FAR_OFF:.0%} of the dancer's height in the picture, the worst at "
            f"{dancer.timeline.time_s[row]:.2f} s ({name}, {worst[row, joint]:.0f} px)"
        )


def _sunk(track: Track3D) -> Iterator[str]:
    if track.root is None:
        return
    height = track.xyz[..., 1] + track.root[:, None, 1]
    known = np.isfinite(height).any(axis=1)
    lowest = np.where(np.isfinite(height), height, np.inf).min(axis=1)
    sunk = known & (lowest < -SUNK[track.unit])
    if sunk.any():
        yield (
            f"a foot lies under the floor in {int(sunk.sum())} of {int(known.sum())} frames, by "
            f"up to {-lowest[sunk].min():.2f} {track.unit}"
        )


def _on_a_floor_above(track: Track3D, dancers: Sequence[Dancer]) -> Iterator[str]:
    """That a dancer's floor is above the lowest of those in the shot."""
    beside = [d.smoothed for d in dancers if d.smoothed.shot == track.shot]
    per_mm = BODY_HEIGHT_MM if track.unit == "body heights" else 1000.0
    known = [height for height in floor_heights(beside, per_mm) if np.isfinite(height)]
    (own,) = floor_heights([track], per_mm)
    if known and own - min(known) > ANOTHER_FLOOR[track.unit]:
        yield (
            f"stands on a floor of its own, {own - min(known):.2f} {track.unit} above the lowest "
            "dancer's"
        )


def _too_near(track: Track3D) -> Iterator[str]:
    """A distance that cannot be: the field of view is not that of the picture."""
    if track.root is None or track.viewpoint is None:
        return
    away = np.linalg.norm(track.root - track.viewpoint.position, axis=1)
    if not np.isfinite(away).any():
        return
    distance = float(np.nanmedian(away))
    if distance < NEAREST[track.unit]:
        yield (
            f"would be {distance:.2f} {track.unit} from the camera, from where it sees no whole "
            "body: its field of view is narrower than assumed or given (a cropped picture, a "
            "lens of long focal length); give it with --fov, across the longer side"
        )


def _plain(joint: str) -> str:
    return joint.replace("_", " ")
