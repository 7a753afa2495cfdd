"""Objects, tables and progress as people see them: lines of text, HTML in notebooks, bars on a terminal."""

import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from html import escape
from importlib import import_module
from threading import Timer
from time import monotonic
from typing import Any

from kickdrift.display import layout
from kickdrift.display.card import Spark, card
from kickdrift.display.pace import PARTS, LineBar, Pace, busy_line
from kickdrift.text import CELL, clean

KEY = 17  # width of a line's key
SOON = 0.5  # seconds of work that go without a sign that turns
NOTEBOOK_SECONDS = 0.2  # between updates of a bar in a notebook

Lines = list[tuple[str, str]]
Table = tuple[str | None, list[str], list[list[str]]]  # title, columns, rows
Bar = Callable[[int, int], Any]

_making: ContextVar[Callable[[str], Bar] | None] = ContextVar("progress", default=None)  # of what is shown now

ABOVE: dict[str, str] = {}  # by what a function of a layer above makes, its "module:name"; a module has no name


def above(what: str) -> Any:
    """The function of a layer above that makes ``what``, or the module; the package's ``__init__`` fills the table."""
    module, _, name = ABOVE[what].partition(":")
    found = import_module(module)
    return getattr(found, name) if name else found


class Shown:
    """An object that prints as tables and as lines of key and text, and that a notebook shows as tables."""

    _lines_first = False  # whether the lines stand above the tables

    def _lines(self) -> Lines:
        """Return each line's key and text; a line that goes on has an empty key."""
        raise NotImplementedError

    def _tables(self) -> list[Table]:
        """Return the tables above the lines."""
        return []

    def _spark(self) -> Spark | None:
        """Return the series that a notebook shows as a sparkline, or None."""
        return None

    def __repr__(self) -> str:
        return str(self)

    def __str__(self) -> str:
        lines = "\n".join(clean(f"{key:{KEY}} {text}").rstrip() for key, text in self._lines())
        tables = [text_table(*each) for each in self._tables()]
        return "\n\n".join(part for part in ([lines, *tables] if self._lines_first else [*tables, lines]) if part)

    def _repr_html_(self) -> str:
        lines = [html_table(None, [], found)] if (found := self._lines()) else []
        tables = [html_table(*each) for each in self._tables()]
        inside = "\n".join(lines + tables if self._lines_first else tables + lines)
        return card(inside, self._spark())


def lines_of(shown: Shown) -> Lines:
    """Each line's key and text, of an object that prints itself."""
    return shown._lines()


def tables_of(shown: Shown) -> list[Table]:
    """Title, columns and rows of each table, of an object that prints itself."""
    return shown._tables()


def text_table(title: str | None, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table as text: the columns side by side, a line below their names."""
    head, *body = [[clean(cell, CELL) for cell in row] for row in (columns, *rows)]
    lines, _ = layout.table(head, body, sys.maxsize)
    return "\n".join([clean(title), *lines] if title else lines)


def html_table(title: str | None, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table for a notebook: the first cell of each row is its heading. All texts are escaped."""

    def row(cells: Sequence[str], tags: Sequence[str]) -> str:
        made = [
            f'<{tag} style="text-align: left">{escape(clean(text))}</{tag}>'
            for text, tag in zip(cells, tags, strict=True)
        ]
        return f"<tr>{''.join(made)}</tr>"

    body = [row(cells, ["th", *["td"] * (len(cells) - 1)]) for cells in rows]
    head = [row(columns, ["th"] * len(columns))] if columns else []
    caption = [f"<caption>{escape(clean(title))}</caption>"] if title else []
    return "\n".join(["<table>", *caption, *head, *body, "</table>"])


@contextmanager
def following(progress: bool | Callable[..., Any] | None, label: str) -> Iterator[Callable[..., Any] | None]:
    """Yield what is called with the progress: a bar for True, the function itself, or None for False and None."""
    if progress is True:
        with progress_bar() as bar:
            yield bar(label)
    else:
        yield progress or None


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Callable[[str], Bar]]:
    """Yield ``bar(label)``, as `_bars` does. Inside, `stage` and `last_stage` show parts of the work."""
    with _bars(quiet) as bar:
        token = _making.set(bar)
        try:
            yield bar
        finally:
            _making.reset(token)


def stage(label: str) -> Bar:
    """Function (done, of) that moves a bar of a part of the work. Nothing is shown outside of `progress_bar`."""
    making = _making.get()
    return making(clean(label, CELL)) if making else _nothing


@contextmanager
def last_stage(label: str) -> Iterator[None]:
    """Show, inside of `progress_bar`, a part of the work that counts nothing."""
    making = _making.get()
    if making is LineBar:
        with busy_line(clean(label, CELL)):
            yield
        return
    move = stage(label)
    move(0, 0)
    yield
    move(PARTS, PARTS)


@contextmanager
def _bars(quiet: bool) -> Iterator[Callable[[str], Bar]]:
    """Yield ``bar(label)``, which returns a function (done, of) that moves a bar with rate and time left: on standard
    error where this is a terminal, in a notebook below its cell. Elsewhere it prints lines on standard error now and
    then."""
    if not quiet and _in_notebook():
        yield _notebook_bar
        return
    if not _has_terminal(quiet):
        yield LineBar if _has_lines(quiet) else lambda label: _nothing
        return
    shown = ("{task.description}", "BarColumn", "{task.fields[share]}", "{task.fields[rate]}", "TimeRemainingColumn")
    with _rich(*shown) as progress:

        def bar(label: str) -> Bar:
            task, pace = progress.add_task(clean(label, CELL), total=None, rate="", share=""), Pace()

            def move(done: int, of: int) -> None:
                pace.moved(done, of)
                share = f"{100 * done / of:3.0f} %" if of else ""
                progress.update(task, completed=done, total=of or None, rate=pace.rate_text(of), share=share)

            return move

        yield bar


@contextmanager
def members_bar(quiet: bool = False) -> Iterator[Callable[[int, int, int], None] | None]:
    """Yield a function (done, of, failed) that shows these with the rate and the remaining time: as a bar on a terminal
    and in a notebook, else as lines on standard error. None if nothing is to be shown."""
    if not quiet and _in_notebook():
        bar = _notebook_bar("members")
        yield lambda done, of, failed: bar(done, of)
        return
    if not _has_terminal(quiet):
        line = LineBar("members")
        yield (
            (lambda done, of, failed: line(done, of, f", {failed} failed" if failed else ""))
            if _has_lines(quiet)
            else None
        )
        return
    shown = ("members", "BarColumn", "MofNCompleteColumn", "{task.fields[rate]}", "TimeRemainingColumn")
    with _rich(*shown, "{task.fields[failed]}") as progress:
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


def _has_terminal(quiet: bool) -> bool:
    """Whether bars can be seen on standard error."""
    return not quiet and sys.stderr is not None and sys.stderr.isatty()


def _has_lines(quiet: bool) -> bool:
    """Whether lines can be written on standard error."""
    return not quiet and sys.stderr is not None


@contextmanager
def busy(label: str, quiet: bool = False) -> Iterator[None]:
    """Show what is being done, for work that counts nothing: a sign that turns on a terminal, else a line on standard
    error after two seconds."""
    if not _has_lines(quiet) or _in_notebook():
        yield
    elif _has_terminal(quiet):
        begun: list[Any] = []
        timer = Timer(SOON, lambda: begun.append(_spinner(clean(label, CELL))))
        timer.daemon = True
        timer.start()
        try:
            yield
        finally:
            timer.cancel()
            timer.join()
            for each in begun:
                each.stop()
    else:
        with busy_line(clean(label, CELL)):
            yield


def _rich(*columns: str) -> Any:
    """Progress on standard error that goes at its end: of rich's columns by their names, and of columns of text."""
    from rich import progress
    from rich.console import Console

    text = partial(progress.TextColumn, markup=False)
    made = [getattr(progress, each)() if each.endswith("Column") else text(each) for each in columns]
    return progress.Progress(*made, console=Console(stderr=True), transient=True)


def _spinner(label: str) -> Any:
    """Show a sign that turns on a terminal, until ``stop()``."""
    progress = _rich("SpinnerColumn", "{task.description}", "TimeElapsedColumn")
    progress.add_task(label, total=None)
    progress.start()
    return progress


def _in_notebook() -> bool:
    """Whether the program runs in a notebook, which has loaded IPython."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and type(shell).__name__ not in ("TerminalInteractiveShell", "InteractiveShell")


def _notebook_bar(label: str) -> Bar:
    """A bar below the notebook's cell, which goes when all is done."""
    from IPython.display import HTML, display

    handle = display(HTML(""), display_id=True)
    last, pace = 0.0, Pace()

    def show(done: int, of: int) -> None:
        nonlocal last
        pace.moved(done, of)
        if done < of and monotonic() - last < NOTEBOOK_SECONDS:
            return
        last = monotonic()
        text = f"{escape(label)} <progress value={done} max={of}></progress> {pace.text(done, of)}"
        handle.update(HTML(text if done < of else ""))

    return show


def _nothing(done: int, of: int) -> None:
    """Ignore progress: no bar is shown."""
