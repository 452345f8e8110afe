"""JSON from anywhere: bounded in size and depth, and its entries taken out by name and kind."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dance2pose.errors import DataError

LARGEST_JSON = 512 * 1024**2
# Deeper than any of the formats; Python's parser would otherwise decide by its own stack.
DEEPEST = 64
# What tools call the number of a frame.
FRAME_KEYS = (
    *("frame_id", "frame_index", "frame_idx", "frame_number", "frameNumber", "frame_num", "frame"),
    "index",
)


def load_json(path: Path) -> Any:
    """The content of a JSON file; DataError for what is too large, too deep or not JSON."""
    try:
        size = path.stat().st_size
        if size > LARGEST_JSON:
            raise DataError(f"{path}: {size / 1e9:.1f} GB are too much for one JSON file; split it")
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from error
    if not data.strip():
        raise DataError(f"{path}: not a JSON file: it is empty")
    try:
        content = json.loads(data)
    except RecursionError as error:
        raise DataError(
            f"{path}: nested too deeply; keypoint files are not deeper than {DEEPEST}"
        ) from error
    except ValueError as error:
        raise DataError(f"{path}: not a JSON file: {error}") from error
    if _is_deeper(content, DEEPEST):
        raise DataError(f"{path}: nested too deeply; keypoint files are not deeper than {DEEPEST}")
    return content


def _is_deeper(content: Any, depth: int) -> bool:
    """Whether the first entries are nested more than so deep; without recursion."""
    for _ in range(depth):
        if isinstance(content, dict):
            content = next(iter(content.values()), None)
        elif isinstance(content, list):
            content = content[0] if content else None
        else:
            return False
    return isinstance(content, (dict, list))


def entry(path: Path, container: Any, key: str, kind: type | tuple[type, ...], inside: str) -> Any:
    """container[key], or DataError unless it is there and of the kind."""
    require(path, container, (key,), inside)
    value = container[key]
    if not isinstance(value, kind) or isinstance(value, bool):
        name = f"{inside}.{key}" if inside else key
        raise DataError(f"{path}: {name} is of type {type(value).__name__}")
    return value


def require(path: Path, container: Any, keys: Sequence[str], inside: str) -> None:
    """DataError that names all of the keys that are missing at once."""
    at = f" {inside}" if inside else ""
    if not isinstance(container, dict):
        kind = type(container).__name__
        raise DataError(f"{path}:{at or ' it'} is of type {kind}, expected {', '.join(keys)}")
    missing = [key for key in keys if key not in container]
    if missing:
        there = ", ".join(str(key)[:40] for key in list(container)[:12]) or "nothing"
        raise DataError(f"{path}:{at} has no {' and no '.join(missing)}; it holds: {there}")


def first(container: dict[str, Any], *keys: str) -> Any:
    """The value of the first key that is there and not null, else None."""
    return next((container[key] for key in keys if container.get(key) is not None), None)


def whole_number(value: Any) -> int | None:
    """A number that names something, None for anything else (12, 12.0 and "12" are 12)."""
    if isinstance(value, bool):
        return None
    if isinstance(value, int):
        return value if abs(value) < 10**18 else None
    if isinstance(value, float) and value.is_integer() and abs(value) < 10**15:
        return int(value)
    if isinstance(value, str) and value.strip().isdecimal() and len(value) <= 18:
        return int(value)
    return None


def number(value: Any) -> float | None:
    """A finite number, None for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        found = float(value)
    except OverflowError:
        return None
    return found if abs(found) < float("inf") else None


def size_of(container: dict[str, Any]) -> tuple[int, int] | None:
    """Width and height, where an entry has both."""
    width = whole_number(first(container, "width", "image_width", "img_width"))
    height = whole_number(first(container, "height", "image_height", "img_height"))
    if width is None or height is None or not (0 < width < 10**6 and 0 < height < 10**6):
        return None
    return width, height
