"""Tables of results, as Markdown for people and CSV for programs."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dance2pose.output_files import written_whole

Cell = str | float | int


@dataclass(frozen=True)
class Table:
    """name: of its CSV file. title, note: above and below it in the report. digits: decimals of
    numbers in the report; the CSV has six significant digits."""

    name: str
    title: str
    header: tuple[str, ...]
    rows: Sequence[Sequence[Cell]]
    digits: int = 1
    note: str = ""

    def markdown(self) -> str:
        """The table with its title and note."""
        lines = [f"**{self.title}**", "", _line(self.header)]
        lines.append(_line(["---"] + ["---:"] * (len(self.header) - 1)))
        lines += [_line([self._text(cell) for cell in row]) for row in self.rows]
        if self.note:
            lines += ["", self.note]
        return "\n".join(lines)

    def _text(self, cell: Cell) -> str:
        if isinstance(cell, float):
            return "–" if math.isnan(cell) else f"{cell:.{self.digits}f}"
        return str(cell)

    def write_csv(self, folder: Path, *, overwrite: bool) -> Path:
        """Write NAME.csv; an unknown number is an empty cell."""
        path = folder / f"{self.name}.csv"
        with (
            written_whole(path, overwrite=overwrite) as temporary,
            temporary.open("w", newline="", encoding="utf-8") as file,
        ):
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(self.header)
            for row in self.rows:
                writer.writerow([_csv(cell) for cell in row])
        return path


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _csv(cell: Cell) -> str:
    if isinstance(cell, float):
        return "" if math.isnan(cell) else f"{cell:.6g}"
    return str(cell)
