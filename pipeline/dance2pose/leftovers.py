"""Temporary names that say whose they are, and the removal of those that are nobody's.

A run that is killed leaves its temporary files behind. Each name tells the process that made it:
its number, when it started, and the machine. The next run there removes the files of processes that
are no more, and of no other: runs side by side, and on machines that share a folder, are safe.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import platform
import re
import secrets
import time
from pathlib import Path

# Files of another machine, or of this one before it was started anew, are left until they are so
# old that no run can still be writing them.
OLD_S = 7 * 24 * 3600

# Bytes of a file's own name that its temporary name begins with; names end at 255.
_NAME_BYTES = 120

_TEMPORARY = re.compile(
    r"\..*\.(?P<pid>\d+)-(?P<start>\d+)-(?P<machine>[0-9a-f]{8})\.[0-9a-f]{8}\.part(\..*)?",
    re.DOTALL,
)


def temporary_name(path: Path) -> Path:
    """A hidden name in the same folder with the same suffix, short enough for any name length."""
    begin = path.name.encode(errors="surrogateescape")[:_NAME_BYTES].decode(errors="ignore")
    pid = os.getpid()
    owner = f"{pid}-{_started(pid) or 0}-{_machine()}"
    return path.with_name(f".{begin}.{owner}.{secrets.token_hex(4)}.part{path.suffix[:16]}")


def aside_name(path: Path) -> Path:
    """A hidden name for a file that is put aside while its successor takes its place. It is never
    swept: until then it may be the only copy."""
    begin = path.name.encode(errors="surrogateescape")[:_NAME_BYTES].decode(errors="ignore")
    return path.with_name(f".{begin}.{secrets.token_hex(4)}.kept{path.suffix[:16]}")


_swept: set[Path] = set()


def sweep_once(folder: Path) -> None:
    """Sweep a folder unless this process already did."""
    folder = folder.absolute()
    if folder not in _swept:
        _swept.add(folder)
        sweep(folder)


def sweep(folder: Path) -> list[Path]:
    """Remove the temporary files of runs that are no more; returns their names.

    What cannot be looked at or removed is left as it is.
    """
    removed = []
    with contextlib.suppress(OSError):
        for entry in folder.iterdir():
            found = _TEMPORARY.fullmatch(entry.name)
            if found and _is_nobodys(entry, found) and entry.is_file() and not entry.is_symlink():
                with contextlib.suppress(OSError):
                    entry.unlink()
                    removed.append(entry)
    return removed


def _is_nobodys(path: Path, owner: re.Match[str]) -> bool:
    if owner["machine"] != _machine():
        with contextlib.suppress(OSError):
            return time.time() - path.stat().st_mtime > OLD_S
        return False
    pid = int(owner["pid"])
    started = _started(pid)
    if started is not None:  # another process may have been given the number since
        return str(started) != owner["start"]
    return not _is_running(pid)


def _is_running(pid: int) -> bool:
    """Whether a process of that number runs, where its start is not known."""
    if os.name == "nt":
        return True  # asking there would end it; its files are left
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:  # somebody else's
        return True
    return True


def _started(pid: int) -> int | None:
    """When a process started, in ticks of the clock since the machine did; None if not known."""
    try:
        text = Path(f"/proc/{pid}/stat").read_text()
        return int(text.rpartition(")")[2].split()[19])
    except (OSError, ValueError, IndexError):
        return None


@functools.cache
def _machine() -> str:
    """Where process numbers mean the same: this machine since its start, in this container."""
    parts = [platform.node()]
    with contextlib.suppress(OSError):
        parts.append(Path("/proc/sys/kernel/random/boot_id").read_text())
    with contextlib.suppress(OSError):
        parts.append(str(Path("/proc/self/ns/pid").readlink()))
    return hashlib.sha256("\0".join(parts).encode(errors="replace")).hexdigest()[:8]
