"""Poses of other programs: 2D keypoints as tracks, positions in space as sequences.

A module a format, `registry` the list of them. What every format has in common has one place:
`measurements` (what is one), `numbering` (which frame a picture is), `layouts` (which skeleton),
`following` (who is who).
"""

from dance2pose.reading.positions import ReadPoses, read_poses
from dance2pose.reading.tracks import MIN_CONFIDENCE, ReadTracks, read_tracks

__all__ = ["MIN_CONFIDENCE", "ReadPoses", "ReadTracks", "read_poses", "read_tracks"]
