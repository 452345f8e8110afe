"""How options become words on the command line, for every command alike."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, get_args

from cyclopts import Parameter, Token, convert, default_name_transform
from cyclopts.help import PlainFormatter

if TYPE_CHECKING:
    from rich.console import Console

# A field's name ends in its unit; the option's does not, its help text states it.
_UNITS = ("_deg", "_gb", "_hz", "_min", "_m", "_s")


def option_name(field: str) -> str:
    """`height_m` is `--height`."""
    for unit in _UNITS:
        if field.endswith(unit):
            field = field.removesuffix(unit)
            break
    return default_name_transform(field)


def _smooth_option_name(field: str) -> str:
    """The temporal model is `--smooth` where smoothing is one step of many."""
    return "smooth" if field == "model" else option_name(field)


def _converted(kind: Any, tokens: Sequence[Token]) -> Any:
    """As the library converts, but a whole number is not rounded from a fraction."""
    if int in (kind, *get_args(kind)):
        for token in tokens:
            try:
                int(token.value, 10)
            except ValueError:
                where = token.keyword or "argument"
                raise ValueError(f"{where} {token.value}: expected a whole number") from None
    return convert(kind, tokens)


class HelpFormatter(PlainFormatter):
    """Help as plain text, every entry wrapped as one paragraph.

    The library prints the line breaks of docstrings as they are and wraps the lines again.
    """

    def _print_plain(self, console: Console, text: str) -> None:
        width = min(console.width, 100)
        if text.startswith(self.indent):
            text = textwrap.fill(
                " ".join(text.split()),
                width,
                initial_indent=self.indent,
                subsequent_indent=3 * self.indent,
                break_on_hyphens=False,
            )
        console.print(text, highlight=False, markup=False, soft_wrap=True)


PARAMETERS = Parameter(negative=(), name_transform=option_name, converter=_converted)
# Groups of options are flattened: their fields are options of the command.
FLAT = Parameter(name="*")
SMOOTH_FLAT = Parameter(name="*", name_transform=_smooth_option_name)
# As FLAT, where what is on by default is switched off with --no-NAME.
SWITCHES_FLAT = Parameter(name="*", negative=None)
