"""Followers of a run: views that show the run while it goes on. They read the present and change nothing."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from kickdrift.display.showing import above
from kickdrift.errors import InputError
from kickdrift.text import shown

Told = Callable[[int, int], Any]


class Follower(Protocol):
    """A view that follows a run. ``follow`` is called now and then with the amount done and the total, like
    ``progress``."""

    def settle(self, sim: Any, done: int, of: int) -> None:
        """Show the equilibration before a run, after so many of its steps; ``sim`` takes these steps."""

    def begin(self) -> None:
        """Begin with a run."""

    def follow(self, done: int, of: int) -> None:
        """Show the present, if enough time has passed since the last time."""

    def end(self, whole: bool) -> None:
        """Show the end of a run; ``whole`` is False after an error or Ctrl-C."""


@contextmanager
def watched_live(sim: Any, live: bool | int) -> Iterator[None]:
    """Serve a page that follows all that the Simulation does in this context.

    ``live`` is False, True, or the port of the page."""
    if not isinstance(live, int) or (live is not False and live < 0):
        raise InputError(f"live: expected True, False or the number of a port, got {shown(live)}")
    if live is False:
        yield
        return
    with above("live page")(sim, 0 if live is True else live) as follower:
        sim.followers.append(follower)
        try:
            yield
        finally:
            sim.followers.remove(follower)


@contextmanager
def followed(sim: Any, told: Told | None, live: bool | int) -> Iterator[Told | None]:
    """Yield what the run tells its progress: ``told``, the Simulation's followers, and a live page if asked for."""
    with watched_live(sim, live):
        followers = list(sim.followers)
        if not followers:
            yield told
            return

        def tell(done: int, of: int) -> None:
            for each in followers:
                each.follow(done, of)
            if told:
                told(done, of)

        whole = False
        try:
            for each in followers:
                each.begin()
            yield tell
            whole = True
        finally:
            for each in followers:
                each.end(whole)
