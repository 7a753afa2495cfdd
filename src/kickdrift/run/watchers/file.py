"""The watcher that writes a run's file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from kickdrift.display.showing import last_stage
from kickdrift.errors import RunError
from kickdrift.integrators.options import PAIRS, REGULARISED
from kickdrift.looks.columns import TIME
from kickdrift.looks.observers import columns_of
from kickdrift.looks.record import WRITING
from kickdrift.model.state import Floats
from kickdrift.run.present import forces_at
from kickdrift.run.watcher import Watcher

if TYPE_CHECKING:
    from kickdrift.looks.observers import Looks
    from kickdrift.run.advance import Integration
    from kickdrift.run.report.report import Report
    from kickdrift.trajectory.write.h5md import Writer


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
        run = self._run
        self._writer: Any = self._open()
        self._told, self._named = len(run.record.events), 0
        self._acting = run.heat is not None or run.method.bounces or (run.events is not None and run.events.acting)
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
        looks = run.record.looks
        self._append(looks, {name: looks.columns[name] for name in self._columns})
        if run.replaced:
            writer.flush(final=True, anew=True)
            run.replaced = False

    @property
    def takes_series(self) -> bool:
        """Whether `series` can write looks after the run has left them: these have no events, columns or forces."""
        told = self._run.events or self._run.options.get(PAIRS.name) == REGULARISED
        other = told or self._acting or self._columns or "forces" in self._writer.writes
        return not (other or self._run.replaced)

    def patience(self, most: float) -> float:
        """Seconds that looks may wait for `series`, at most this many."""
        return float(min(most, self._writer.flush_seconds))

    def series(self, first: int, phases: Floats, whole: bool) -> None:
        """Write looks from row ``first`` on, with their positions and velocities (looks, 2, 3, n). Flush only at the
        run's own place, and not if the run has failed there."""
        looks, writer, state = self._run.record.looks, self._writer, self._run.flow.shared_state  # type: ignore[union-attr]
        rows = looks.rows[first : first + len(phases)]
        steps, times = looks.steps[first : first + len(phases)].tolist(), rows[:, TIME].tolist()
        columns = columns_of(rows)
        if not (columns and writer.append_series(steps, times, columns, phases, state(phases[0], times[0], steps[0]))):
            for k, phase in enumerate(phases):
                writer.append(state(phase, times[k], steps[k]), looks.observables(first + k), flush=False)
        if whole:
            writer.flush_if_full()

    def _append(self, looks: Looks, columns: dict[str, Any]) -> None:
        """Write the last look, and the state at it."""
        run, writer = self._run, self._writer
        forces = forces_at(run) if "forces" in writer.writes else None
        state = run.flow.shared_state(run.y, run.time, run.steps_done)  # type: ignore[union-attr]
        writer.append(state, looks.observables(looks.count - 1, taken=self._acting) | columns, forces=forces)

    def pause(self) -> None:
        """Flush the file if the time between flushes has passed."""
        self._writer.flush_if_due()

    def close(self, report: Report | None) -> None:
        """Close the file, with the report if there is one."""
        if report is None:
            with suppress(RunError):  # the error that ended the run is raised instead
                self._writer.close(whole=False)
            return
        with last_stage(f"finishing {self._writer.path.name}"), self._writer as writer:
            writer.report = report.as_json()
            writer.report["events"] = self._going_on()  # the file already holds all events that have ended
