"""The report of an archive: what is in it, and what a real browser makes of it."""

from __future__ import annotations

import contextlib
import html
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from dance2pose.archive.jobs import Outcome
from dance2pose.archive.layout import Archive, create_archive
from dance2pose.archive.ledger import Ledger
from dance2pose.archive.report import write_report
from dance2pose.archive.status import Status

EVIL = "</script><script>document.title='owned'</script>\"'&.mp4"


def make_archive(folder: Path, count: int = 5) -> Archive:
    """An archive with so many done items, one of them twice as blurred, one failed, one evil."""
    archive = create_archive(folder)
    with contextlib.closing(Ledger(archive.ledger)) as ledger, ledger.transaction():
        names = [EVIL, *(f"tape {n:05d}.mp4" for n in range(count))]
        for number, name in enumerate(names):
            item = f"item-{number:05d}"
            about = {"filename": name, "dc.creator": f"Choreographer-{number % 7}"}
            ledger.add_item(item, f"{number:064x}", {}, Path("/in") / name)
            ledger.set_name(Path("/in") / name, {}, item, name, about)
            ledger.set_waiting(item, "f")
    with contextlib.closing(Ledger(archive.ledger)) as ledger:
        for number in range(count):
            ledger.record_done(done(f"item-{number:05d}", number), f"{number:064x}")
        failure = Outcome(f"item-{count:05d}", 1, "f", "crash", "its process ended: <b>SIGSEGV</b>")
        ledger.record_failure(failure, again=False)
    return archive


def done(item: str, number: int) -> Outcome:
    verdict = ("good", "review", "poor")[number % 3]
    quality = {
        "verdict": verdict,
        "reasons": [] if verdict == "good" else ["frames with a pose 71.0%, below 90.0%"],
        "dancers": 1,
        "frames": 100 + number,
        "pose_share": 0.71,
        "confidence": 0.5 + number / 1e5,
        "sigma": None,
        "jitter": float("inf"),
    }
    return Outcome(item, 1, "f", quality=quality, seconds=2.0, started=1.0)


def page_of(archive: Archive) -> str:
    with contextlib.closing(Ledger(archive.ledger, read_only=True)) as ledger:
        return write_report(archive, ledger).read_text(encoding="utf-8")


def test_hostile_names_stay_text_and_nothing_comes_from_the_network(tmp_path: Path) -> None:
    page = page_of(make_archive(tmp_path / "archive"))
    data = page.split('type="application/json">')[1].split("</script>")[0]
    assert json.loads(data)["items"][0]["names"] == [EVIL]
    assert page.count("<script") == 2
    assert not re.search(r"(src|href)=[\"']?(https?:)?//", page)


def test_a_small_archive_holds_its_thumbnails_and_a_large_one_links_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    archive = make_archive(tmp_path / "archive")
    folder = archive.package("item-00001", 1) / "data"
    folder.mkdir(parents=True)
    (folder / "thumbnails.jpg").write_bytes(b"picture")
    assert "data:image/jpeg;base64,cGljdHVyZQ==" in page_of(archive)
    monkeypatch.setattr("dance2pose.archive.report.LARGEST_EMBEDDED", 3)
    assert '"strip":"packages/item-00001/v1/data/thumbnails.jpg"' in page_of(archive)


def browse(archive: Archive, folder: Path, script: str, width: int = 1200) -> str:
    """What stands in the page, in a real browser, after a script ran in it."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser")
    if browser is None:
        pytest.skip("needs chromium")
    page = page_of(archive)
    # The page's own policy holds: an inline script is what it allows.
    page = page.replace("</body>", f"<script>{script}</script></body>")
    tried = archive.path / "tried.html"
    tried.write_text(page, encoding="utf-8")
    result = subprocess.run(
        [
            browser,
            *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
            *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
            *(f"--user-data-dir={folder}", f"--window-size={width},900", "--dump-dom"),
            tried.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )
    told = re.search(r"TOLD(.*?)TOLD", html.unescape(result.stdout), re.DOTALL)
    assert told, result.stdout[:500] + result.stderr[-500:]
    return told[1]


TELL = "document.body.append('TO' + 'LD' + JSON.stringify({}) + 'TO' + 'LD');"


@pytest.mark.parametrize("width", [1200, 500])
def test_in_a_browser_the_page_searches_sorts_and_filters(tmp_path: Path, width: int) -> None:
    archive = make_archive(tmp_path / "archive", count=12)
    script = """
    const told = {};
    const press = (id, type) => document.getElementById(id).dispatchEvent(new Event(type));
    const rows = () => [...document.querySelectorAll('#rows tr')]
      .map(row => row.querySelector('b').textContent);
    told.title = document.title; told.all = rows().length; told.first = rows()[0];
    told.overflow = document.documentElement.scrollWidth - window.innerWidth;
    document.getElementById('search').value = 'choreographer-3'; press('search', 'input');
    told.found = rows();
    document.getElementById('search').value = ''; press('search', 'input');
    document.getElementById('show').value = 'good'; press('show', 'change');
    told.good = rows().length;
    document.getElementById('show').value = ''; press('show', 'change');
    [...document.querySelectorAll('#head button')].find(b => b.textContent === 'frames').click();
    told.fewest = rows()[0];
    [...document.querySelectorAll('#head button')].find(b => b.textContent === 'frames').click();
    told.most = rows()[0];
    told.sorted = document.querySelector('[aria-sort]').getAttribute('aria-sort');
    document.dispatchEvent(new KeyboardEvent('keydown', {key: '/', bubbles: true}));
    told.focus = document.activeElement.id;
    told.marked = document.querySelectorAll('td .failed b').length;
    """
    told = json.loads(browse(archive, tmp_path / "b", script + TELL.replace("{}", "told"), width))
    assert told["title"] == "Archive archive"
    assert (told["all"], told["first"]) == (13, "tape 00011.mp4")  # what failed stands first
    assert told["found"] == ["tape 00009.mp4", "tape 00002.mp4"]
    assert told["good"] == 4
    assert (told["fewest"], told["most"]) == (EVIL, "tape 00010.mp4")
    assert told["sorted"] == "descending"
    assert told["focus"] == "search"
    assert told["marked"] == 0  # an error's mark-up is text
    assert told["overflow"] <= 0


def test_nothing_left_has_no_time_left() -> None:
    done = Status({"done": 3}, {}, [], rate=0.5, left_s=0.0)
    assert done.lines() == [
        "3 items: 0 waiting, 0 running, 3 done, 0 failed",
        "1800.0 items an hour in the last run",
    ]
    half = Status({"done": 3, "waiting": 30}, {}, [], rate=0.5, left_s=60.0)
    assert half.lines()[-1].endswith(", about 1 min 0 s left")
