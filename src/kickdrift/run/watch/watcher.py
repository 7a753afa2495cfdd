"""What follows a run: a watcher begins with it, looks when it stops to be looked at, and ends with it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kickdrift.run.report import Report


class Watcher:
    """Follows a run. Events, the check of stability, the file and the user's ``observe`` are watchers.

    A watcher changes nothing of what it sees, but for events, which may change the bodies."""

    def begin(self) -> None:
        """The run begins; its first look follows."""

    def look(self) -> None:
        """The present was sampled, and is to be looked at."""

    def pause(self) -> None:
        """The run came back from compiled code between two looks."""

    def end(self) -> None:
        """The run has come to its end, or Ctrl-C has ended it. The report is made next."""

    def close(self, report: Report | None) -> None:
        """Nothing follows. There is no report where an error broke off the run."""


class Observe(Watcher):
    """Calls a user's function at each look.

    Parameters
    ----------
    function : called as ``function(sim)``
    sim : the Simulation
    """

    def __init__(self, function: Callable[[Any], Any], sim: Any) -> None:
        self._function, self._sim = function, sim

    def look(self) -> None:
        """Call it."""
        self._function(self._sim)
