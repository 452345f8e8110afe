"""The presentation time of every picture, in seconds from the start of the video stream."""

from __future__ import annotations

from fractions import Fraction

from av.video.frame import VideoFrame

# FFmpeg's own assumption for streams that carry no rate at all.
DEFAULT_RATE = Fraction(25)

# A timestamp that jumps back by more is a new recording spliced in (its clock begins again); a
# smaller step back is one wrong timestamp.
RESTART_S = 1.0

# The least step of time between two frames whose own timestamps do not increase.
LEAST_STEP_S = 1e-3


class Clock:
    """Turns timestamps into seconds that strictly increase.

    start_pts: the stream's first timestamp, in units of time_base, None if unknown. rate: frames a
    second, for pictures that carry no timestamp.
    """

    def __init__(self, start_pts: int | None, time_base: Fraction | None, rate: Fraction | None):
        self._start = start_pts
        self._time_base = time_base
        self.rate = rate or DEFAULT_RATE
        self._period_s = float(1 / self.rate)
        self._offset_s = 0.0
        self._last_s: float | None = None
        self.frames = 0
        self.without_time = 0
        self.out_of_order = 0
        self.restarts = 0

    def seconds(self, pts: int) -> float:
        """The time of a timestamp, before any correction."""
        assert self._start is not None and self._time_base is not None
        return float((pts - self._start) * self._time_base)

    def read(self, picture: VideoFrame) -> float:
        """The time of the next picture in presentation order."""
        self.frames += 1
        pts = timestamp(picture)
        if pts is None or self._time_base is None:
            self.without_time += 1
            time_s = 0.0 if self._last_s is None else self._last_s + self._period_s
        else:
            if self._start is None or (self._last_s is None and pts < self._start):
                self._start = pts
            time_s = self._in_order(self.seconds(pts) + self._offset_s)
        self._last_s = time_s
        return time_s

    def _in_order(self, time_s: float) -> float:
        last_s = self._last_s
        if last_s is None or time_s > last_s:
            return time_s
        if time_s > last_s - RESTART_S:
            self.out_of_order += 1
            return last_s + LEAST_STEP_S
        self.restarts += 1
        self._offset_s += last_s + self._period_s - time_s
        return last_s + self._period_s

    def warnings(self) -> list[str]:
        """What had to be supposed about time, one line each."""
        lines = []
        if self.without_time:
            part = (
                "no frame carries"
                if self.without_time == self.frames
                else (f"{self.without_time} of {self.frames} frames carry no")
            )
            lines.append(
                f"{part} a timestamp: their times are derived from the stream's rate of"
                f" {float(self.rate):g} frames a second"
            )
        if self.out_of_order:
            lines.append(f"{self.out_of_order} timestamps do not increase: moved by a millisecond")
        if self.restarts:
            lines.append(
                f"the timestamps begin again {self.restarts} times, as in joined recordings:"
                " time runs on"
            )
        return lines


def timestamp(picture: VideoFrame) -> int | None:
    """The picture's presentation timestamp; from its packet where the container stores only those
    of decoding (AVI), in which presentation and decoding order agree."""
    return picture.pts if picture.pts is not None else picture.dts
