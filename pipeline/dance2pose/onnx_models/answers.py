"""An account of a model's answers: how many there were, how sure the surest, how many were none."""

from __future__ import annotations

import threading
from collections.abc import Iterable

from dance2pose.errors import ModelError
from dance2pose.onnx_models.inference import NotFiniteError


class Answers:
    """Counts the answers of one model, from any number of threads.

    pictures: asked about. lost: of those, answered with NaN or infinite numbers. best_score: the
    highest score of any answer, whether it counts or not; None before the first.
    """

    def __init__(self) -> None:
        self.pictures = 0
        self.lost = 0
        self.best_score: float | None = None
        self.first_loss: str | None = None
        self._lock = threading.Lock()

    def note(self, best_score: float) -> None:
        """One more picture was answered."""
        with self._lock:
            self.pictures += 1
            self.best_score = max(best_score, self.best_score or 0.0)

    def note_loss(self, error: NotFiniteError) -> None:
        """One more picture was not."""
        with self._lock:
            self.pictures += 1
            self.lost += 1
            self.first_loss = self.first_loss or str(error)


def losses(accounts: Iterable[Answers], *, first_time_s: float) -> list[str]:
    """What was lost to answers that are no numbers, a line a model.

    first_time_s: when the first picture was shown. Raises ModelError where a model answered no
    picture at all.
    """
    lines = []
    for answers in accounts:
        if answers.lost and answers.lost == answers.pictures:
            raise ModelError(
                f"{answers.first_loss}; so it was for all {answers.pictures} pictures it was "
                f"asked about, from {first_time_s:.2f} s on"
            )
        if answers.lost:
            lines.append(
                f"{answers.lost} of {answers.pictures} pictures are lost to the model: "
                f"{answers.first_loss}"
            )
    return lines
