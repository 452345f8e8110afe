"""Settings that a row of a table gives to one video, by the names of the command line's options."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, Union

from dance2pose.errors import UsageError
from dance2pose.options import OutputOptions, Settings, combined, flat

# As on the command line: units are dropped, and the temporal model is `smooth`.
_UNITS = ("_deg", "_hz", "_m", "_s")
_FLAGS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How one video is reconstructed and what is written of it: all that a row can change."""

    settings: Settings = field(default_factory=Settings)
    outputs: OutputOptions = field(default_factory=OutputOptions)

    def values(self) -> dict[str, Any]:
        """Every option by its field's name."""
        return flat(self)

    def models(self) -> dict[str, Path]:
        """The options that name a model."""
        return {name: value for name, value in flat(self).items() if isinstance(value, Path)}

    def changed(self, **options: Any) -> Recipe:
        """The same with other values of some options."""
        return combined(Recipe, self, options)

    def with_row(self, row: Mapping[str, str]) -> Recipe:
        """The same with the values of a table's row, by column.

        Raises UsageError for a value that is not of its option's kind or out of its range.
        """
        hints = {_column(name): (name, hint) for name, hint in _hints(Recipe)}
        return self.changed(
            **{
                hints[column][0]: _parsed(column, text, hints[column][1])
                for column, text in row.items()
            }
        )


def _column(name: str) -> str:
    """The column of an option: `height` of height_m."""
    if name == "model":
        return "smooth"
    return next((name.removesuffix(unit) for unit in _UNITS if name.endswith(unit)), name)


def _hints(kind: Any) -> Iterator[tuple[str, Any]]:
    """(name, type) of every option of nested groups."""
    for name, hint in typing.get_type_hints(kind).items():
        if dataclasses.is_dataclass(hint):
            yield from _hints(hint)
        else:
            yield name, hint


COLUMNS = frozenset(_column(name) for name, _ in _hints(Recipe))
"""The columns of a table that are settings of a video."""


def _parsed(column: str, text: str, kind: Any) -> Any:
    """The text as the first of the option's types that it fits."""
    for one in _alternatives(kind):
        try:
            return _as_kind(text, one)
        except ValueError:
            continue
    raise UsageError(
        f"{column} is {text!r}, which is not a value of this setting of the reconstruction "
        "(give a column that only describes the video another name)"
    )


def _alternatives(kind: Any) -> tuple[Any, ...]:
    if typing.get_origin(kind) in (Union, types.UnionType):
        return tuple(part for part in typing.get_args(kind) if part is not types.NoneType)
    return (kind,)


def _as_kind(text: str, kind: Any) -> Any:
    if typing.get_origin(kind) is Literal:
        if text not in typing.get_args(kind):
            raise ValueError(text)
        return text
    if kind is bool:
        if text.lower() not in _FLAGS:
            raise ValueError(text)
        return _FLAGS[text.lower()]
    if kind in (int, float, str, Path):
        return kind(text)
    raise ValueError(text)
