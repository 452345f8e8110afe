"""What a file is that FFmpeg opens but cannot decode, as its first and last bytes tell."""

from __future__ import annotations

import os
import re
from pathlib import Path

# The index of an MP4 or MOV lies at its beginning or at its end.
_LOOKED_AT_BYTES = 4 * 1024**2

_ENCRYPTED = frozenset({"encv", "drmi"})


def why_undecodable(path: Path) -> str | None:
    """Why FFmpeg cannot decode a file, where that can be told; else None."""
    head, tail = _ends(path)
    if head[:4] == b"RIFF" and head[8:16] == b"WEBPVP8X" and head[20] & 2:
        return "is an animated WebP, which FFmpeg cannot decode; convert it to MP4 or GIF"
    name = _codec_name(head, tail)
    if name in _ENCRYPTED:
        return f"its video is encrypted ({name}); only the seller's own player opens it"
    if name is not None:
        return f"its video codec is {name!r}, which cannot be decoded here; convert it"
    return None


def _ends(path: Path) -> tuple[bytes, bytes]:
    try:
        with path.open("rb") as file:
            head = file.read(_LOOKED_AT_BYTES).ljust(32, b"\0")
            file.seek(max(0, os.fstat(file.fileno()).st_size - _LOOKED_AT_BYTES))
            return head, file.read()
    except OSError:
        return bytes(32), b""


def _codec_name(head: bytes, tail: bytes) -> str | None:
    """The name of the video's codec, as MP4 (after the video's header), AVI or Matroska has it."""
    for pattern in (
        rb"vmhd.{0,4096}?stsd.{12}([ -~]{4})",
        rb"strh.{4}vids([ -~]{4})",
        rb"\x86[\x80-\xbf](V_[ -~]{2,40})",
    ):
        for part in (head, tail):
            found = re.search(pattern, part, re.DOTALL)
            if found:
                return found[1].decode("ascii").strip()
    return None
