"""The program's streams: results on standard output, messages and progress on standard error.

All output passes through this module, so that no text from a file reaches a terminal unchecked.
"""

from __future__ import annotations

import codecs
import os
import sys
from collections.abc import Iterable
from contextlib import suppress

from kickdrift.display.showing import KEY
from kickdrift.display.showing import members_bar as members_bar
from kickdrift.display.showing import progress_bar as progress_bar
from kickdrift.text import CELL, clean, escaped

PLAIN = {
    "±": "+-",
    "×": "x",
    "→": "->",
    "…": "...",
    "–": "-",
    "ω": "omega",
    "σ": "sigma",
    "τ": "tau",
    "ε": "epsilon",
    "∞": "inf",
}  # replacements for streams that cannot encode these
PLAINLY = "kickdrift-plain"  # name of the error handler


def open_streams() -> None:
    """Make standard output and standard error usable, whatever their state.

    Output to a closed stream is lost. Plain letters replace a character that a stream cannot encode.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # closed: the next file would get its number
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    codecs.register_error(PLAINLY, _plainly)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors=PLAINLY)


def _plainly(error: UnicodeError) -> tuple[str, int]:
    """Error handler of ``codecs``: replace characters that cannot be encoded by plain letters."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(each) or escaped(each) for each in error.object[error.start : error.end]), error.end


def out(text: str) -> None:
    """Print a line on standard output."""
    print(clean(text))


def verbatim(text: str) -> None:
    """Print a file's text on standard output unchanged; on a terminal, without control characters."""
    if sys.stdout.isatty():
        text = "".join(f"{clean(line, len(line) + 1)}\n" for line in text.splitlines())
    sys.stdout.write(text)


def print_lines(lines: Iterable[tuple[str, str]]) -> None:
    """Print lines of key and text on standard output."""
    for key, text in lines:
        out(f"{key:{KEY}} {text}")


def print_table(title: str | None, columns: list[str], rows: list[list[str]]) -> None:
    """Print a table on standard output; without a terminal, as wide as needed."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    console = Console(width=None if sys.stdout.isatty() else 200, markup=False, emoji=False)
    title = None if title is None else clean(title, CELL)
    table = Table(*(clean(each, CELL) for each in columns), title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for row in rows:
        table.add_row(*(clean(each, CELL) for each in row))
    console.print(table)


def say(text: str, quiet: bool = False) -> None:
    """Print a message on standard error, or lose it if the stream is closed."""
    if not quiet:
        with suppress(OSError):
            print(clean(text), file=sys.stderr, flush=True)
