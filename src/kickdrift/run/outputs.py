"""The files that a Simulation writes, with the cadence of each, and the writer of a run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from kickdrift.disk.files import place
from kickdrift.errors import InputError, RunError
from kickdrift.jit.compile import features, processor
from kickdrift.model.memory import Memory
from kickdrift.model.system import System
from kickdrift.run.forces import forces_at
from kickdrift.run.watch.watcher import Watcher
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration
    from kickdrift.run.plan import Plan
    from kickdrift.run.report import Report
    from kickdrift.trajectory.columns import Described
    from kickdrift.trajectory.h5md import Writer
    from kickdrift.trajectory.options import FileOptions


class Own(NamedTuple):
    """A file that a Simulation writes, with its cadence of looks."""

    run_id: str
    every: int
    interval: float | None

    @classmethod
    def of(cls, run_id: str, every: int, plan: Plan | None) -> Own:
        """Return the entry of a run that began the file by a plan."""
        return cls(run_id, every, plan.interval if plan and plan.exact and plan.interval else None)


class Outputs:
    """The files of a Simulation.

    Parameters
    ----------
    run : the Integration whose looks are written
    checkpoint : returns a checkpoint of the run

    Attributes
    ----------
    default : str or None
        The file for a run that names no output: the file of a resumed run.
    """

    def __init__(self, run: Integration, checkpoint: Callable[[], Memory]) -> None:
        self._run, self._checkpoint = run, checkpoint
        self._files: dict[str, Own] = {}  # files that this Simulation began or continues
        self.default: str | None = None

    def chosen(self, output: str | None, overwrite: bool) -> str | None:
        """Return the file to write. Raises InputError if this is the default file and cannot be continued."""
        if output is not None or self.default is None:
            return output
        if overwrite or not os.path.exists(self.default):
            why = "this run continues this file" if overwrite else "this run continues this file, which is gone"
            raise InputError(f"{self.default}: {why}; give another output")
        return self.default

    def own(self, output: str | None) -> Own | None:
        """Return the entry of that file or of the default file, if this Simulation began it."""
        return self._files.get(os.path.realpath(output or "")) or self._files.get(self.default or "")

    def continue_in(self, path: str, run_id: str, every: int, plan: Plan | None) -> None:
        """Continue a file that another Simulation of the same run began."""
        self.default = path
        self._files[path] = Own.of(run_id, every, plan)

    def watcher(
        self,
        output: str | None,
        plan: Plan,
        overwrite: bool,
        options: FileOptions | None,
        columns: dict[str, Described],
        going_on: Callable[[], Any],
    ) -> File | None:
        """Return the watcher that writes looks and the user's ``columns`` to a file; None without output."""
        if output is None:
            if options is not None:
                raise InputError("file: sets how output is written; give output as well")
            return None
        if not isinstance(self._run.system, System):
            raise InputError("output: a run's file holds particles, so a Problem cannot write one; use observe")
        from kickdrift.trajectory.options import FileOptions

        if not isinstance(options, FileOptions | None):
            raise InputError(f"file: expected kd.FileOptions, got {shown(options)}")
        return File(self._run, lambda: self._writer(output, plan, overwrite, options, columns), columns, going_on)

    def _writer(
        self,
        output: str,
        plan: Plan,
        overwrite: bool,
        options: FileOptions | None,
        columns: dict[str, Described],
    ) -> Writer:
        from kickdrift.trajectory.h5md import Writer

        run, path = self._run, os.path.realpath(output)
        if path in self._files and not overwrite and os.path.exists(path):
            return Writer.append_to(
                path, self._files[path].run_id, options=options, checkpoint=self._checkpoint, plan=plan.numbers,
                at=(run.steps_done, run.time), events=len(run.record.events), columns=columns,
            )  # fmt: skip
        assert isinstance(run.system, System)
        method = {
            "integrator": run.integrator,
            "order": run.method.order,
            "dt": run.dt,
            "threads": run.threads,
            "seed": run.system.seed,
            "engine": run.engine.name,
            "engine_version": run.engine.version,
            "processes": run.processes,
            **run.options.extras(run.method.tunable),
            "options": dict(run.options),
            "processor": processor(),
            "features": features(),
        }
        path = str(place(output))
        run.replaced = False  # a new file begins with a checkpoint
        system: Any = run.events.first if run.events else run.system  # including the bodies that have left
        writer = Writer(
            path, system, method=method, every=plan.every, overwrite=overwrite, options=options,
            checkpoint=self._checkpoint, plan=plan.numbers, columns=columns,
        )  # fmt: skip
        self._files[path] = Own.of(writer.run_id, plan.every, plan)
        return writer


class File(Watcher):
    """Writes a run's looks and events to a file.

    Parameters
    ----------
    run : the Integration to sample
    open : opens the Writer when the run begins
    columns : names of the user's columns to write
    going_on : returns the events that have begun but not ended
    """

    def __init__(
        self, run: Integration, open: Callable[[], Writer], columns: Iterable[str], going_on: Callable[[], Any]
    ) -> None:
        self._run, self._open, self._columns, self._going_on = run, open, tuple(columns), going_on

    def begin(self) -> None:
        """Open the file."""
        run = self._run
        self._writer = self._open()
        self._told = len(run.record.events)
        self._acting = run.method.bath or (run.events is not None and run.events.acting)
        if run.events:
            self._writer.absorbed = run.events.absorbed

    def look(self) -> None:
        """Write the current frame and sample, and the events since the last look."""
        run, writer = self._run, self._writer
        for event in run.record.events[self._told :]:
            writer.append_event(event)
        self._told = len(run.record.events)
        forces = forces_at(run) if "forces" in writer.writes else None
        sample = run.record.samples[-1]
        values = sample.observables(taken=self._acting) | {name: sample.columns[name] for name in self._columns}
        writer.append(run.state, values, forces=forces)
        if run.replaced:
            writer.flush(final=True, anew=True)
            run.replaced = False

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
