"""A report in the making: its text, tables and figures, and the files they go to."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from dance2pose.evaluation.tables import Table
from dance2pose.output_files import written_whole

REPORT = "REPORT.md"
ASSETS = "report"  # the folder of tables and figures, beside the report


@dataclass
class Report:
    """What goes into the report, in order, and the files written so far."""

    folder: Path
    overwrite: bool
    parts: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)

    @property
    def assets(self) -> Path:
        return self.folder / ASSETS

    def heading(self, text: str, *paragraphs: str) -> None:
        self.parts += [f"## {text}", *paragraphs]

    def table(self, table: Table) -> None:
        self.parts.append(table.markdown())
        self.files.append(table.write_csv(self.assets, overwrite=self.overwrite))

    def figure(self, path: Path, caption: str) -> None:
        self.parts.append(f"![{caption}]({ASSETS}/{path.name})\n\n{caption}")
        self.files.append(path)

    def write(self) -> None:
        path = self.folder / REPORT
        with written_whole(path, overwrite=self.overwrite) as temporary:
            temporary.write_text("\n\n".join(self.parts) + "\n", encoding="utf-8")
        self.files.append(path)
