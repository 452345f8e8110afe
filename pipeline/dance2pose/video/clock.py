"""The presentation time of every picture, in seconds from the start of the video stream."""

from __future__ import annotations

from fractions import Fraction

from av.video.frame import VideoFrame
from av.video.stream import VideoStream

# FFmpeg's own assumption for streams that carry no rate at all.
DEFAULT_RATE = Fraction(25)

# A timestamp that steps back by more periods than this is a new recording spliced in (its clock
# begins again); a smaller step back is one wrong timestamp.
RESTART_PERIODS = 4

# The least step of time between two frames whose own timestamps do not increase.
LEAST_STEP_S = 1e-3

# The rate is steady if so many of the steps between frames are as long as the rate says.
STEADY = 0.98


class Clock:
    """Turns timestamps into seconds that strictly increase.

    start_pts: the stream's first timestamp, in units of time_base, None if it has none. rate:
    frames a second, for pictures that carry no timestamp. by_decoding: see `make_clock`.
    """

    def __init__(
        self,
        start_pts: int | None,
        time_base: Fraction | None,
        rate: Fraction | None,
        *,
        by_decoding: bool = False,
    ) -> None:
        self._start = start_pts
        self._time_base = time_base
        self.by_decoding = by_decoding
        self.rate = rate or DEFAULT_RATE
        self.period_s = float(1 / self.rate)
        self._offset_s = 0.0
        self.last_s: float | None = None
        self.frames = 0
        self.without_time = 0
        self.out_of_order = 0
        self.restarts = 0
        self._regular = 0
        self._gaps = 0
        self._gaps_s = 0.0

    def read(self, picture: VideoFrame) -> float:
        """The time of the next picture in presentation order."""
        self.frames += 1
        pts = picture.dts if self.by_decoding else picture.pts
        if pts is None or self._start is None or self._time_base is None:
            self.without_time += not self.by_decoding  # the last few of an AVI come without
            time_s = 0.0 if self.last_s is None else self.last_s + self.period_s
        else:
            base = self._time_base  # Fractions take a hundred times as long, for the same number
            seconds = (pts - self._start) * base.numerator / base.denominator
            time_s = self._in_order(seconds + self._offset_s)
        if self.last_s is not None:
            self._note_step(time_s - self.last_s)
        self.last_s = time_s
        return time_s

    def _note_step(self, step_s: float) -> None:
        periods = step_s / self.period_s
        if periods > 1.9:
            self._gaps += 1
            self._gaps_s += step_s - self.period_s
        else:
            self._regular += 0.9 < periods < 1.1

    def pts(self, time_s: float) -> int | None:
        """The timestamp of a time, None in a stream without timestamps."""
        if self._start is None or self._time_base is None:
            return None
        return self._start + round(Fraction(time_s) / self._time_base)

    @property
    def end_s(self) -> float:
        """When the last picture read ends."""
        return 0.0 if self.last_s is None else self.last_s + self.period_s

    def _in_order(self, time_s: float) -> float:
        last_s = self.last_s
        if last_s is None or time_s > last_s:
            return time_s
        if time_s > last_s - RESTART_PERIODS * self.period_s:
            self.out_of_order += 1
            return last_s + LEAST_STEP_S
        self.restarts += 1
        self._offset_s += last_s + self.period_s - time_s
        return last_s + self.period_s

    def warnings(self) -> list[str]:
        """What had to be supposed about time, one line each."""
        lines = []
        if self.without_time:
            part = f"{self.without_time} of {self.frames} frames carry no timestamp"
            if self.without_time == self.frames:
                part = "no frame carries a timestamp"
            lines.append(
                f"{part}: times follow the stream's rate of {float(self.rate):g} frames a second"
            )
        if self.out_of_order:
            lines.append(f"{self.out_of_order} timestamps did not increase: moved by a millisecond")
        if self.restarts:
            lines.append(
                f"the timestamps begin again at {self.restarts} places, as in joined recordings:"
                " the time runs on"
            )
        # At a steady rate a longer step is a hole; at a variable one it is how the video is.
        steps = self.frames - 1
        if 0 < self._gaps < self._regular and self._regular >= STEADY * (steps - self._gaps):
            lines.append(
                f"frames seem to be missing at {self._gaps} places, {self._gaps_s:.2f} s in all"
            )
        return lines


def make_clock(stream: VideoStream, first: VideoFrame) -> Clock:
    """The clock of a stream whose first picture was decoded.

    Time 0 is the stream's first timestamp, or the first picture's if the container gets that wrong.
    AVI stores times of decoding only, and what FFmpeg guesses from them is wrong where pictures are
    stored out of order; there each picture comes out when it is shown, so the decoding time at
    that moment serves.
    """
    names = stream.container.format.name.split(",")
    by_decoding = "avi" in names and bool(stream.codec_context.has_b_frames)
    start_pts = first.dts if by_decoding else first.pts
    if start_pts is not None and stream.start_time is not None and not by_decoding:
        start_pts = min(start_pts, stream.start_time)
    # FFmpeg's guess knows the codec's own rate; the average of a raw stream is a fixed 25.
    rate = stream.guessed_rate or stream.average_rate
    return Clock(start_pts, stream.time_base, rate, by_decoding=by_decoding)
