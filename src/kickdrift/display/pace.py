"""Progress of long work: its rate, the time left, and lines where no terminal shows a bar."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from threading import Timer
from time import monotonic

from kickdrift.text import CELL, clean, duration

SHORT = 2.0  # seconds of work that go without a word
FIRST, LONGEST = 10.0, 60.0  # seconds between the first two lines, and at most
PARTS = 1000  # a run to a time counts thousandths of the way, which have no rate of their own
_silent: ContextVar[bool] = ContextVar("silent", default=False)


class Pace:
    """Rate and time left of work, from its first report on: what came before was compiling, or done earlier."""

    def __init__(self, clock: Callable[[], float] = monotonic) -> None:
        self._clock = clock
        self._begun: tuple[int, float] | None = None
        self.rate = self.left = 0.0  # parts a second, and seconds; 0 while unknown

    def moved(self, done: int, of: int) -> None:
        """Take note of how far the work is."""
        now = self._clock()
        if self._begun is None or done < self._begun[0]:
            self._begun = (done, now)
        first, began = self._begun
        fine = done > first and now > began
        self.rate = (done - first) / (now - began) if fine else 0.0
        self.left = (of - done) / self.rate if fine else 0.0

    def rate_text(self, of: int) -> str:
        """The rate as text, such as "1,200/s"; "" while unknown or for thousandths of a run."""
        if not self.rate or of == PARTS:
            return ""
        return f"{self.rate:,.0f}/s" if self.rate >= 10 else f"{self.rate:.2g}/s"

    def text(self, done: int, of: int) -> str:
        """Share, rate and time left, such as "12 %, 1,200/s, 45 s left"."""
        left = f"{duration(self.left)} left" if self.left else ""
        return ", ".join(each for each in (f"{100 * done // max(of, 1)} %", self.rate_text(of), left) if each)


class LineBar:
    """Progress as lines on standard error: none in the first two seconds, then ever fewer."""

    def __init__(self, label: str, clock: Callable[[], float] = monotonic) -> None:
        self._label, self._clock, self._pace = clean(label, CELL), clock, Pace(clock)
        self._next, self._gap = clock() + SHORT, FIRST

    def __call__(self, done: int, of: int, more: str = "") -> None:
        """Print a line if one is due; ``more`` stands at its end."""
        self._pace.moved(done, of)
        if done < of and self._clock() >= self._next:
            self._next, self._gap = self._clock() + self._gap, min(2 * self._gap, LONGEST)
            print_line(f"{self._label}: {self._pace.text(done, of)}{more}")


@contextmanager
def silent(quiet: bool) -> Iterator[None]:
    """Print no `notice` in this context, if quiet."""
    token = _silent.set(quiet)
    try:
        yield
    finally:
        _silent.reset(token)


def notice(text: str) -> None:
    """Print a line about what goes on, unless that is unwanted."""
    if not _silent.get():
        print_line(text)


def print_line(text: str) -> None:
    """Print a line on standard error, or lose the line if that is closed."""
    with suppress(OSError, AttributeError):
        print(clean(text), file=sys.stderr, flush=True)


@contextmanager
def busy_line(label: str) -> Iterator[None]:
    """Print what is being done on standard error, once that has taken two seconds: for work that counts nothing."""
    timer = Timer(SHORT, print_line, [f"{label} …"])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
