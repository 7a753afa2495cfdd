"""The program's streams: results on standard output, messages and progress on standard error.

All output passes through this module, so that no text from a file reaches a terminal unchecked.
"""

from __future__ import annotations

import codecs
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TextIO

from kickdrift.disk.outputs import write_json
from kickdrift.display import layout, showing
from kickdrift.display.showing import KEY, lines_of, tables_of
from kickdrift.display.showing import members_bar as members_bar
from kickdrift.text import CELL, MESSAGE, clean, escaped

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
HINT = "A wider terminal or a pipe shows every column."
NARROW, WIDE = 40, 80  # columns: of the narrowest terminal that lines wrap for, and of a terminal that tells no width

_json_alone = False  # whether standard output is kept for a JSON object
_quiet = False  # whether --quiet was given
_doing = ""  # the progress bar that moved last, and how far


def open_streams() -> None:
    """Make standard output and standard error usable, whatever their state.

    Output to a closed stream is lost. Plain letters replace a character that a stream cannot encode.
    """
    global _json_alone, _quiet, _doing
    _json_alone, _quiet, _doing = False, False, ""
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


def results_on_stderr() -> None:
    """Keep standard output for a JSON object: results for people go to standard error from now on."""
    global _json_alone
    _json_alone = True


def hush() -> None:
    """Show nothing for people on standard error but errors."""
    global _quiet
    _quiet = True


def _show(lines: Callable[[int | None], Iterable[str]]) -> None:
    """Print the lines that the function makes for a width."""
    if _json_alone and _quiet:
        return
    to = sys.stderr if _json_alone else sys.stdout
    for line in lines(width_of(to)):
        print(line, file=to)


def width_of(stream: TextIO) -> int | None:
    """Columns of the terminal that the stream writes to; None without a terminal, where no line wraps."""
    if not stream.isatty():
        return None
    try:
        wide = int(os.environ.get("COLUMNS") or os.get_terminal_size(stream.fileno()).columns)
    except (OSError, ValueError):
        wide = 0
    return max(wide, NARROW) if wide > 0 else WIDE


def out(text: str) -> None:
    """Print a result; on a terminal it wraps between words."""
    _show(lambda width: layout.folded(clean(text), width))


def verbatim(text: str) -> None:
    """Print a file's text on standard output unchanged; on a terminal, without control characters."""
    if sys.stdout.isatty():
        text = "".join(f"{clean(line, len(line) + 1)}\n" for line in text.splitlines())
    sys.stdout.write(text)


def print_lines(lines: Iterable[tuple[str, str]], key_width: int = KEY) -> None:
    """Print lines of key and text; on a terminal the text wraps beside its key."""
    cleaned = [(clean(key), clean(text)) for key, text in lines]
    _show(lambda width: (each for key, text in cleaned for each in layout.beside(key, text, key_width + 1, width)))


def print_table(title: str | None, columns: list[str], rows: list[list[str]], whole: bool = False) -> None:
    """Print a table, after an empty line if it has a title.

    Without a terminal, each row is a line with every column. In a narrow terminal the table leaves out some columns,
    and a last line names them; a ``whole`` table becomes a list instead.
    """
    heads = [clean(each, CELL) for each in columns]
    body = [[clean(each, CELL) for each in row] for row in rows]

    def lines(width: int | None) -> list[str]:
        found, left_out = layout.table(heads, body, width, whole)
        above = [] if title is None else ["", *layout.folded(clean(title), width)]
        below = layout.folded(f"Not shown: {', '.join(left_out)}. {HINT}", width)
        return [*above, *found, *(["", *below] if left_out else [])]

    _show(lines)


def say(text: str, quiet: bool = False) -> None:
    """Print a message on standard error, or lose it if the stream is closed; on a terminal it wraps between words."""
    if not quiet:
        with suppress(OSError):
            for line in layout.folded(clean(text, MESSAGE), width_of(sys.stderr)):
                print(line, file=sys.stderr)
            sys.stderr.flush()


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[[str], Callable[[int, int], Any]]]:
    """Yield ``bar(label)``, which returns a function (done, of) that moves a bar on standard error, or prints lines."""
    with showing.progress_bar(quiet) as bar:
        yield lambda label: _noting(clean(label, CELL), bar(label))


@contextmanager
def busy(label: str, quiet: bool = False) -> Iterator[None]:
    """Show what is being done on standard error, for work that counts nothing and takes more than two seconds."""
    with showing.busy(clean(label, CELL), quiet):
        yield


def _noting(label: str, move: Callable[[int, int], Any]) -> Callable[[int, int], Any]:
    """Function (done, of) that moves a bar, and remembers where the bar stands for `stopped_at`."""

    def note(done: int, of: int) -> None:
        global _doing
        _doing = f"{100 * done // max(of, 1)} % of {label}"
        move(done, of)

    return note


def stopped_at() -> str:
    """The place at which Ctrl-C stopped a command that writes nothing before its end."""
    if not _doing:
        return "interrupted; all written files are whole"
    return f"stopped at {_doing}; nothing is kept, and the same command begins again"


def show_found(found: Any, json_file: Path | None, overwrite: bool, whole: bool = False) -> None:
    """Print the tables and lines of a result, and write the result as JSON if a file is given."""
    if found._lines_first:
        print_lines(lines_of(found))
    for title, columns, rows in tables_of(found):
        print_table(title, columns, rows, whole)
    if not found._lines_first:
        print_lines(lines_of(found))
    write_json(json_file, found.as_json(), overwrite=overwrite)
