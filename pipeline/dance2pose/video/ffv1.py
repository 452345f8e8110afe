"""The checksums inside FFV1, the archives' lossless codec.

FFmpeg's decoder covers a slice whose checksum fails with the same part of the picture before and
says so only in its log. A keeper of tapes must hear of it, so the sums are computed here as well.

The format is RFC 9043: a version 3 picture is a row of slices, each ending in a footer of its size
(24 bits), a status byte and a CRC-32 (polynomial 0x04C11DB7, initial value 0, most significant bit
first) that makes the sum over the whole slice zero (sections 4.9 and 4.5).
"""

from __future__ import annotations

import zlib

FOOTER_BYTES = 8

# zlib computes the same polynomial least significant bit first; with the bits of every byte
# reversed the two agree.
_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def slices(packet: bytes) -> list[bytes] | None:
    """The slices of a coded picture, last first, or None if it is not a row of slices with
    checksums (an older version, or one written without them)."""
    found = []
    end = len(packet)
    while end > 0:
        start = end - FOOTER_BYTES - int.from_bytes(packet[max(0, end - 8) : max(0, end - 5)])
        if start < 0 or end - start <= FOOTER_BYTES:
            return None
        found.append(packet[start:end])
        end = start
    return found


def is_sound(part: bytes) -> bool:
    """Whether a slice's checksum is right."""
    return zlib.crc32(part.translate(_REVERSED), 0xFFFFFFFF) ^ 0xFFFFFFFF == 0


class Checksums:
    """Counts the pictures whose checksums fail. None are expected if the first picture has none."""

    def __init__(self) -> None:
        self._expected: bool | None = None
        self.failed = 0

    def check(self, packet: bytes) -> None:
        """Check one coded picture."""
        if self._expected is False:
            return
        parts = slices(packet)
        if self._expected is None:
            self._expected = parts is not None and any(is_sound(part) for part in parts)
        if self._expected and (parts is None or not all(is_sound(part) for part in parts)):
            self.failed += 1
