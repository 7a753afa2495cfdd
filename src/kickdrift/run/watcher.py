"""Watchers of a run: each begins and ends with the run, and is called at each look."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.looks.record import LOOKS, OBSERVING

if TYPE_CHECKING:
    from kickdrift.run.report.report import Report


class Watcher:
    """Follows a run. Events, the check of stability, the file and the user's ``observe`` are watchers.

    Watchers change nothing in the run, except that events may change the bodies. ``part`` names the part of the work
    that a watcher's time counts as."""

    part: ClassVar[str] = LOOKS

    def begin(self) -> None:
        """Prepare for a run, before its first look."""

    def look(self) -> None:
        """Look at the current state, which has just been sampled."""

    def pause(self) -> None:
        """Act between two looks, when compiled code has returned."""

    def end(self) -> None:
        """Act at the run's end, also after Ctrl-C, before the report is made."""

    def close(self, report: Report | None) -> None:
        """Close the watcher; ``report`` is None if an error ended the run."""


class Observe(Watcher):
    """Calls a user's function at each look.

    Parameters
    ----------
    function : called as ``function(sim)``
    sim : the Simulation
    """

    part = OBSERVING

    def __init__(self, function: Callable[[Any], Any], sim: Any) -> None:
        self._function, self._sim = function, sim

    def look(self) -> None:
        self._function(self._sim)
