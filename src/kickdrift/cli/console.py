"""The program's streams: results on standard output, messages and progress on standard error.

All output passes through this module, so that no text from a file reaches a terminal unchecked.
"""

from __future__ import annotations

import codecs
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress

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
KEY = 17  # width of a line's key


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
    """Print a file's text on standard output as it is; on a terminal without control characters."""
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


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[[str], Callable[[int, int], None]]]:
    """Yield ``bar(label)``, which returns a function (done, of) that moves a bar on standard error, on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield lambda label: _nothing
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    layout = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*layout, console=Console(stderr=True), transient=True) as progress:

        def bar(label: str) -> Callable[[int, int], None]:
            task = progress.add_task(clean(label, CELL), total=None)
            return lambda done, of: progress.update(task, completed=done, total=of)

        yield bar


@contextmanager
def members_bar(quiet: bool) -> Iterator[Callable[[int, int, int], None] | None]:
    """Yield a function (done, of, failed) that shows these with the rate and the remaining time, on a terminal."""
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    rate = TextColumn("{task.fields[rate]}")
    layout = TextColumn("members"), BarColumn(), MofNCompleteColumn(), rate, TimeRemainingColumn()
    with Progress(
        *layout, TextColumn("{task.fields[failed]}"), console=Console(stderr=True), transient=True
    ) as progress:
        task = progress.add_task("members", total=None, rate="", failed="")
        begun: list[int] = []

        def show(done: int, of: int, failed: int) -> None:
            if not begun:  # members done earlier have no rate
                begun.append(done)
                progress.reset(task, total=of, completed=done)
            speed = progress.tasks[0].speed
            rate = f"{speed:.3g}/s" if speed else ""
            progress.update(task, completed=done, rate=rate, failed=f"{failed} failed" if failed else "")

        yield show


def _nothing(done: int, of: int) -> None:
    """Ignore progress: no bar is shown."""
