"""Boxes and keypoints of frame after frame, joined into one track a dancer.

Each frame's detections are given to the tracks by one assignment (Hungarian method) over how well
they agree in motion, box, keypoints and colours. Memory grows with the poses alone.
"""

from __future__ import annotations

from array import array

import numpy as np
import numpy.typing as npt
from scipy.optimize import linear_sum_assignment

from dance2pose import skeleton as skeletons
from dance2pose.holes import usual_step
from dance2pose.options import parse_person
from dance2pose.poses import Boxes, FloatArray, Image, Poses2D, Timeline, Track2D
from dance2pose.tracking.appearance import torso_histogram, torso_joints
from dance2pose.tracking.candidates import LEAST_AGREEMENT, Candidate, Detections, agreement
from dance2pose.tracking.choosing import choose
from dance2pose.tracking.gaps import fill_gaps
from dance2pose.tracking.matching import BoxMotion, Float64Array, box_overlaps, duplicates
from dance2pose.tracking.settings import TrackingSettings

# Colours are learned from sights that overlap nobody else by more than this (IoU).
_OVERLAP = 0.1
_COLOUR_RATE = 0.1
# Nearer than this to the border, as a share of the picture, someone may be walking out.
_BORDER = 0.02
# A track not yet confirmed ends after this many seconds unseen.
_TENTATIVE_PATIENCE_S = 0.25
# The usual step between frames is told by so many of the last ones.
_STEPS_KEPT = 50


class Tracker:
    """Joins detections into tracks while they stream in; `finish` gives the tracks.

    skeleton: of the keypoints. image_size: (width, height) px.
    """

    def __init__(
        self,
        skeleton: str,
        image_size: tuple[int, int],
        settings: TrackingSettings | None = None,
    ) -> None:
        self.skeleton = skeleton
        self.image_size = image_size
        self.settings = settings or TrackingSettings()
        self._joints = len(skeletons.get(skeleton))
        self._torso = torso_joints(skeleton)
        self._body = skeletons.body_keypoints(skeleton)
        self._frame = array("q")
        self._time_s = array("d")
        self._step_s = 0.0  # the usual one between the last frames
        self._shot_starts: list[int] = [0]
        self._followed: list[Candidate] = []
        self._ended: list[Candidate] = []

    def update(
        self,
        frame_index: int,
        time_s: float,
        boxes: Boxes,
        poses: Poses2D,
        *,
        cut: bool,
        image: Image | None = None,
    ) -> None:
        """Take in one processed frame, with or without people in it.

        boxes, poses: the same N people in the same order. cut: whether a new shot begins with
        this frame; no track goes on across it. image: the picture, to tell people by their
        colours; it is not kept. Frame indices must increase and times must not run backwards
        (ValueError).
        """
        self._check(frame_index, time_s, boxes, poses)
        step_s = time_s - self._time_s[-1] if self._time_s else 0.0
        if cut and self._frame:
            self._end(self._followed)
            self._shot_starts.append(len(self._frame))
        self._frame.append(frame_index)
        self._time_s.append(time_s)
        self._step_s = usual_step(self._time_s[-_STEPS_KEPT:])
        self._end([c for c in self._followed if self._is_over(c)])
        for candidate in self._followed:
            candidate.motion.advance(step_s)
        detections = self._detections(boxes, poses, image)
        free = np.arange(len(detections))
        # Those who are known choose first: a newcomer must not take a dancer's detection.
        confirmed = [c for c in self._followed if self._is_confirmed(c)]
        tentative = [c for c in self._followed if not self._is_confirmed(c)]
        for group in (confirmed, tentative):
            free = self._assign(group, detections, free)
        for i in free:
            self._followed.append(self._begin(detections, int(i)))

    def finish(self, person: str | int = "auto") -> list[Track2D]:
        """The tracks of the people asked for, numbered from 1 by prominence.

        person: "auto" (the most prominent one, and all others of comparable prominence), "all",
        "largest", "central", or a number; see `choosing.choose`. No person found gives an empty
        list. Raises UsageError for a person that is not there.
        """
        parse_person(person)
        everyone = sorted(self._ended + self._followed, key=lambda c: c.rows[0])
        ends = [*self._shot_starts[1:], len(self._frame)]
        frames_of_shot = {
            shot: end - start
            for shot, (start, end) in enumerate(zip(self._shot_starts, ends, strict=True))
        }
        kept = [
            c
            for c in everyone
            if len(c.rows) >= min(self.settings.birth_sights, frames_of_shot[c.shot])
        ]
        return choose([self._track(c) for c in kept], person, frames_of_shot=frames_of_shot)

    def _check(self, frame_index: int, time_s: float, boxes: Boxes, poses: Poses2D) -> None:
        if len(boxes) != len(poses):
            raise ValueError(f"{len(boxes)} boxes do not fit {len(poses)} poses")
        if poses.skeleton != self.skeleton or poses.xy.shape[1] != self._joints:
            raise ValueError(
                f"poses are {poses.skeleton} with {poses.xy.shape[1]} keypoints,"
                f" expected {self.skeleton} with {self._joints}"
            )
        if self._frame and (frame_index <= self._frame[-1] or time_s < self._time_s[-1]):
            raise ValueError(
                f"frame {frame_index} at {time_s} s comes after"
                f" frame {self._frame[-1]} at {self._time_s[-1]} s"
            )

    def _detections(self, boxes: Boxes, poses: Poses2D, image: Image | None) -> Detections:
        """Those who show enough keypoints, each person once."""
        confidence = poses.confidence.astype(np.float64)
        xy = poses.xy.astype(np.float64)
        unsure = ~(confidence >= self.settings.min_confidence)  # or not a number
        missing = unsure | ~np.isfinite(xy).all(axis=2)
        xy[missing], confidence[missing] = np.nan, 0
        xyxy = boxes.xyxy.astype(np.float64)
        keep = np.isfinite(xyxy).all(axis=1)
        body = (~missing)[:, self._body].sum(axis=1)
        keep &= body >= min(self.settings.min_keypoints, len(self._body))
        xy, xyxy, confidence = xy[keep], xyxy[keep], confidence[keep]
        alone = np.ones(len(xy), np.bool_)
        if len(xy) > 1:
            strength = boxes.confidence[keep] * confidence[:, self._body].mean(axis=1)
            once = ~duplicates(
                xy[:, self._body], xyxy, strength, threshold=self.settings.same_person
            )
            xy, xyxy, confidence = xy[once], xyxy[once], confidence[once]
            overlap = box_overlaps(xyxy, xyxy) - np.eye(len(xyxy))
            alone = np.max(overlap, axis=1, initial=0) < _OVERLAP
        colours = [
            None if image is None else torso_histogram(image, xy[i], self._torso)
            for i in range(len(xyxy))
        ]
        return Detections(xyxy, xy, confidence, colours, alone)

    def _assign(
        self, candidates: list[Candidate], detections: Detections, free: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.int64]:
        """Give the free detections to the candidates; returns those that stay free."""
        if not candidates or not len(free):
            return free
        agreed = np.array([self._agreement(c, detections, free) for c in candidates])
        pairs = zip(*linear_sum_assignment(-agreed), strict=True)
        is_free = np.ones(len(free), np.bool_)
        for row, column in pairs:
            if agreed[row, column] >= LEAST_AGREEMENT:
                self._see(candidates[row], detections, int(free[column]))
                is_free[column] = False
        return free[is_free]

    def _agreement(
        self, candidate: Candidate, detections: Detections, free: npt.NDArray[np.int64]
    ) -> Float64Array:
        since_s = self._time_s[-1] - self._time_s[candidate.rows[-1]]
        lost = self._unseen_s(candidate) > self.settings.patience_s
        return agreement(candidate, detections, free, self._body, since_s=since_s, lost=lost)

    def _begin(self, detections: Detections, i: int) -> Candidate:
        xyxy = detections.xyxy[i]
        candidate = Candidate(
            shot=len(self._shot_starts) - 1,
            motion=BoxMotion(xyxy),
            xy=detections.xy[i],
            centre=(xyxy[:2] + xyxy[2:]) / 2,
            colours=detections.colours[i],
        )
        self._record(candidate, detections, i)
        return candidate

    def _see(self, candidate: Candidate, detections: Detections, i: int) -> None:
        xyxy, colours = detections.xyxy[i], detections.colours[i]
        if self._unseen_s(candidate) > self.settings.patience_s:
            candidate.motion = BoxMotion(xyxy)  # the way there tells nothing of the speed now
        else:
            candidate.motion.correct(xyxy)
        # Keypoints not seen now keep the place they had, moved along with the body.
        expected = candidate.expected_xy()
        candidate.xy = np.where(np.isfinite(detections.xy[i]), detections.xy[i], expected)
        candidate.centre = candidate.motion.state[0].copy()
        if colours is not None and candidate.colours is None:
            candidate.colours = colours
        elif colours is not None and candidate.colours is not None and detections.alone[i]:
            candidate.colours = candidate.colours + _COLOUR_RATE * (colours - candidate.colours)
        self._record(candidate, detections, i)

    def _record(self, candidate: Candidate, detections: Detections, i: int) -> None:
        row = len(self._frame) - 1
        candidate.sights.add(row, detections.xy[i], detections.confidence[i], detections.xyxy[i])

    def _is_confirmed(self, candidate: Candidate) -> bool:
        return len(candidate.rows) >= self.settings.birth_sights

    def _unseen_s(self, candidate: Candidate) -> float:
        """Seconds beyond the usual step since the person was last seen.

        0 for who was seen in the frame before, even with few frames a second; but a hole in time
        is time unseen, whether its frames are absent or empty.
        """
        since = self._time_s[-1] - self._time_s[candidate.rows[-1]]
        return max(0.0, since - self._step_s)

    def _is_over(self, candidate: Candidate) -> bool:
        unseen_s = self._unseen_s(candidate)
        if not unseen_s:
            return False
        if not self._is_confirmed(candidate):
            return unseen_s > _TENTATIVE_PATIENCE_S
        if candidate.colours is None or self._at_border(candidate.sights.last_box):
            return unseen_s > self.settings.patience_s
        return unseen_s > max(self.settings.patience_s, self.settings.hidden_patience_s)

    def _at_border(self, xyxy: FloatArray) -> bool:
        size = np.array(self.image_size)
        margin = _BORDER * size
        return bool((xyxy[:2] <= margin).any() or (xyxy[2:] >= size - margin).any())

    def _end(self, candidates: list[Candidate]) -> None:
        if not candidates:
            return
        over = {id(candidate) for candidate in candidates}
        self._ended += [c for c in self._followed if id(c) in over and self._may_count(c)]
        self._followed = [c for c in self._followed if id(c) not in over]

    def _may_count(self, candidate: Candidate) -> bool:
        """Whether `finish` could keep it: seen often enough, or in all of a very short shot."""
        shot_frames = len(self._frame) - self._shot_starts[candidate.shot]
        return len(candidate.rows) >= min(self.settings.birth_sights, shot_frames)

    def _track(self, candidate: Candidate) -> Track2D:
        first, last = candidate.rows[0], candidate.rows[-1]
        length = last - first + 1
        rows = np.array(candidate.rows) - first
        time_s = np.array(self._time_s[first : last + 1])
        xy = np.full((length, self._joints, 2), np.nan, np.float32)
        confidence = np.zeros((length, self._joints), np.float32)
        box = np.full((length, 4), np.nan, np.float32)
        xy[rows], confidence[rows], box[rows] = candidate.sights.arrays()
        xy, filled = fill_gaps(xy, time_s, longest_s=self.settings.longest_gap_s)
        confidence[filled] = self.settings.min_confidence / 2
        unseen = np.ones(length, np.bool_)
        unseen[rows] = False
        return Track2D(
            person=1,  # numbered by `choose`
            timeline=Timeline(np.array(self._frame[first : last + 1], np.int64), time_s),
            xy=xy,
            confidence=confidence,
            skeleton=self.skeleton,
            interpolated=unseen & filled.any(axis=1),
            box=box,
            image_size=self.image_size,
            shot=candidate.shot,
        )
