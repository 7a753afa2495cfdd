"""The program's streams: results on standard output, messages and progress on standard error.

All that the program shows goes through this module, so that no text of a file reaches a terminal as it is.
"""

from __future__ import annotations

import codecs
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress

from kickdrift.text import CELL, clean, escaped

PLAIN = {"±": "+-", "×": "x", "→": "->", "…": "...", "–": "-", "ω": "omega", "∞": "inf"}  # for streams without them
PLAINLY = "kickdrift-plain"  # what Python knows the error handler by
KEY = 17  # characters of what stands before a line's text


def open_streams() -> None:
    """Make standard output and standard error usable, whatever the caller left of them.

    What is written to a closed stream is lost. A character that a stream cannot encode is written in plain letters.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:  # a closed one, whose number the next file would have
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)
    sys.stdout = sys.stdout or open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
    codecs.register_error(PLAINLY, _plainly)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors=PLAINLY)


def _plainly(error: UnicodeError) -> tuple[str, int]:
    """An error handler of ``codecs``: plain letters in the place of what cannot be encoded."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return "".join(PLAIN.get(each) or escaped(each) for each in error.object[error.start : error.end]), error.end


def out(text: str) -> None:
    """A line on standard output."""
    print(clean(text))


def print_lines(lines: Iterable[tuple[str, str]]) -> None:
    """Lines on standard output: what, and what of it."""
    for key, text in lines:
        out(f"{key:{KEY}} {text}")


def print_table(title: str | None, columns: list[str], rows: list[list[str]]) -> None:
    """A table on standard output, as wide as it needs to be where that is no terminal."""
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
    """A message on standard error; it is lost where nobody can read it."""
    if not quiet:
        with suppress(OSError):
            print(clean(text), file=sys.stderr, flush=True)


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Callable[[str], Callable[[int, int], None]]]:
    """Inside, ``bar(label)`` gives a function (done, of) that moves a bar on standard error, if that is a terminal."""
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
    """Inside, a function (done, of, failed) that shows them with their rate and the time left, on a terminal."""
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
            if not begun:  # those that were done before have no rate
                begun.append(done)
                progress.reset(task, total=of, completed=done)
            speed = progress.tasks[0].speed
            rate = f"{speed:.3g}/s" if speed else ""
            progress.update(task, completed=done, rate=rate, failed=f"{failed} failed" if failed else "")

        yield show


def _nothing(done: int, of: int) -> None:
    """A bar that is not shown."""
