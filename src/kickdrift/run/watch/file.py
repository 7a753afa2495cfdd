"""The watcher that writes a run's file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from kickdrift.errors import RunError
from kickdrift.looks.record import WRITING
from kickdrift.run.forces import forces_at
from kickdrift.run.watch.watcher import Watcher

if TYPE_CHECKING:
    from kickdrift.looks.observers import Sample
    from kickdrift.run.advance import Integration
    from kickdrift.run.report import Report
    from kickdrift.trajectory.h5md import Writer


class File(Watcher):
    """Writes a run's looks and events to a file.

    Parameters
    ----------
    run : the Integration to sample
    open : opens the Writer when the run begins
    columns : names of the user's columns to write
    going_on : returns the events that have begun but not ended
    """

    part = WRITING

    def __init__(
        self, run: Integration, open: Callable[[], Writer], columns: Iterable[str], going_on: Callable[[], Any]
    ) -> None:
        self._run, self._open, self._columns, self._going_on = run, open, tuple(columns), going_on

    def begin(self) -> None:
        """Open the file."""
        run = self._run
        self._writer: Any = self._open()
        self._told, self._named = len(run.record.events), 0
        self._acting = run.heat is not None or (run.events is not None and run.events.acting)
        if run.events:
            self._writer.absorbed = run.events.roster.absorbed

    def look(self) -> None:
        """Write the current frame and sample, and the events since the last look."""
        run, writer = self._run, self._writer
        if run.events and len(run.events.roster.names) > self._named:
            writer.name(self._named, run.events.roster.names[self._named :])
            self._named = len(run.events.roster.names)
        for event in run.record.events[self._told :]:
            writer.append_event(event)
        self._told = len(run.record.events)
        sample = run.record.samples[-1]
        self._append(sample, {name: sample.columns[name] for name in self._columns})
        if run.replaced:
            writer.flush(final=True, anew=True)
            run.replaced = False

    def _append(self, sample: Sample, columns: dict[str, Any]) -> None:
        """Write the sample, and the state at it."""
        run, writer = self._run, self._writer
        forces = forces_at(run) if "forces" in writer.writes else None
        writer.append(run.state, sample.observables(taken=self._acting) | columns, forces=forces)

    def pause(self) -> None:
        """Flush the file if the time between flushes has passed."""
        self._writer.flush_if_due()

    def close(self, report: Report | None) -> None:
        """Close the file, with the report if there is one."""
        if report is None:
            with suppress(RunError):  # the error that ended the run is raised instead
                self._writer.close(whole=False)
            return
        with self._writer as writer:
            writer.report = report.as_json()
            writer.report["events"] = self._going_on()  # the file already holds all events that have ended
