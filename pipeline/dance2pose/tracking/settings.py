"""What counts as seeing a dancer."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackingSettings:
    """What counts as seeing a dancer, and for how long one is remembered.

    min_confidence: keypoints below it are missing (NaN). min_keypoints: a pose with fewer is not
    one. birth_sights: a track needs to be seen this often (or in every frame of a shorter shot).
    patience_s: a track unseen for longer has ended; whoever comes then is someone new.
    hidden_patience_s: the same for those who vanished within the picture, not at its border;
    after patience_s they are known again only by their colours.
    longest_gap_s: gaps up to this long are interpolated, those of a whole pose and those of a
    single keypoint; what was interpolated has half of min_confidence, so that a keypoint below
    min_confidence is always one that was not seen. same_person: keypoint similarity from which
    two detections of one frame are the same person.
    """

    min_confidence: float = 0.2
    min_keypoints: int = 4
    birth_sights: int = 3
    patience_s: float = 2.0
    hidden_patience_s: float = 6.0
    longest_gap_s: float = 0.25
    same_person: float = 0.7
