"""report.html: an archive to look through in any browser, one file, no network."""

from __future__ import annotations

import base64
import json
import time
from pathlib import Path
from typing import Any
from urllib.parse import quote

from dance2pose import __version__
from dance2pose.archive.layout import Archive
from dance2pose.archive.ledger import Ledger
from dance2pose.archive.ledger_tables import Item
from dance2pose.archive.packages import one_line
from dance2pose.archive.status import Status, read_status
from dance2pose.output_files import written_whole

_PAGE = Path(__file__).with_name("report_page.html")
_DATA_MARK = "/*DATA*/"
# Thumbnails stand in the page itself up to this many bytes; a page of a larger archive takes them
# from the packages beside it, as they are scrolled to.
LARGEST_EMBEDDED = 30_000_000

# What a row shows of `quality.Measures`, in order: name, heading, kind of number.
COLUMNS = (
    ("dancers", "dancers", "count"),
    ("frames", "frames", "count"),
    ("pose_share", "with pose", "share"),
    ("confidence", "confidence", "number"),
    ("reprojection", "reprojection error", "share"),
    ("invalid_bones", "invalid bones", "share"),
    ("jitter", "jitter", "fine"),
    ("sudden_turns", "turns", "number"),
    ("switches", "jumps", "number"),
    ("person_px", "height px", "count"),
    ("sigma", "sigma", "share"),
)


def write_report(archive: Archive, ledger: Ledger) -> Path:
    """Write the report of an archive; its path. Raises OutputError."""
    items = [_row(archive, item) for item in ledger.items()]
    _embed(archive, items)
    page = _PAGE.read_text(encoding="utf-8")
    before, after = page.split(_DATA_MARK)
    data = _script_safe({**_head(archive, read_status(ledger)), "items": items})
    with written_whole(archive.report, overwrite=True) as temporary:
        temporary.write_text(before + data + after, encoding="utf-8")
    return archive.report


def _script_safe(content: Any) -> str:
    """JSON that cannot end the script element it stands in, whatever text it holds."""
    text = json.dumps(content, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


def _head(archive: Archive, status: Status) -> dict[str, Any]:
    return {
        "archive": one_line(archive.path.name),
        "made": time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()),
        "program": f"dance2pose {__version__}",
        "status": status.to_json(),
        "columns": COLUMNS,
    }


def _row(archive: Archive, item: Item) -> dict[str, Any]:
    """What the page knows of an item; texts as they are, links relative to the page."""
    quality = item.quality
    given = item.metadata[0] if item.metadata else {}
    row: dict[str, Any] = {
        "item": item.item,
        "state": item.state,
        "names": [one_line(name) for name in item.names],
        "verdict": quality.get("verdict", "") if item.version else "",
        "reasons": quality.get("reasons", []),
        "version": item.version,
        "seconds": item.seconds,
        "values": [_number(quality.get(name)) for name, _, _ in COLUMNS],
        "about": {
            name: one_line(text) for name, text in given.items() if name != "filename" and text
        },
    }
    if item.state == "failed":
        row |= {"failure": item.failure, "error": one_line(item.error), "tries": item.attempts}
    if item.version:
        data = archive.package(item.item, item.version).relative_to(archive.path) / "data"
        row |= {"folder": quote(data.as_posix()) + "/"}
    return row


def _number(value: Any) -> float | None:
    is_number = isinstance(value, int | float) and abs(value) < float("inf")
    return round(float(value), 4) if is_number else None


def _embed(archive: Archive, rows: list[dict[str, Any]]) -> None:
    """Put the thumbnails into the rows, or links to them where together they are too large."""
    places = [
        (row, archive.package(row["item"], row["version"]) / "data" / "thumbnails.jpg")
        for row in rows
        if row["version"]
    ]
    sizes = [place.stat().st_size if place.is_file() else 0 for _, place in places]
    embedded = sum(sizes) <= LARGEST_EMBEDDED
    for (row, place), size in zip(places, sizes, strict=True):
        if size and embedded:
            content = base64.b64encode(place.read_bytes()).decode()
            row["strip"] = f"data:image/jpeg;base64,{content}"
        elif size:
            row["strip"] = row["folder"] + "thumbnails.jpg"
