"""The files that a Simulation writes, with the cadence of each, and the writer of a run."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from kickdrift.disk.files import place
from kickdrift.errors import InputError
from kickdrift.jit.compile import features, processor
from kickdrift.model.memory import Memory
from kickdrift.model.system import System
from kickdrift.run.files.problem import (
    ProblemFile,
    ProblemTableFile,
    check_columns,
    check_options,
    check_suffix,
    is_table,
    slopes_of,
)
from kickdrift.run.watcher import Watcher
from kickdrift.run.watchers.file import File
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration
    from kickdrift.run.plan.plan import Plan
    from kickdrift.trajectory.layout.options import FileOptions
    from kickdrift.trajectory.write.columns import Described
    from kickdrift.trajectory.write.h5md import Writer


class Own(NamedTuple):
    """A file that a Simulation writes, with its cadence of looks."""

    run_id: str
    every: int
    interval: float | None
    backward: bool

    @classmethod
    def of(cls, run_id: str, every: int, plan: Plan | None) -> Own:
        """Return the entry of a run that began the file by a plan."""
        interval = plan.interval if plan and plan.exact and plan.interval else None
        return cls(run_id, every, interval, bool(plan and plan.backward))


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
    ) -> Watcher | None:
        """Return the watcher that writes looks and the user's ``columns`` to a file; None without output."""
        if output is None:
            if options is not None:
                raise InputError("file: sets how output is written; give output as well")
            return None
        run = self._run
        check_suffix(run.system, output)
        from kickdrift.trajectory.layout.options import FileOptions

        if not isinstance(options, FileOptions | None):
            raise InputError(f"file: expected kd.FileOptions, got {shown(options)}")
        if isinstance(run.system, System):
            return File(run, lambda: self._writer(output, plan, overwrite, options, columns), columns, going_on)
        check_columns(columns)
        if is_table(output):
            if options is not None:
                raise InputError("file: sets how a .h5 file is written; a table has no options")
            return ProblemTableFile(run, output, overwrite, self._method(), columns)
        check_options(options)
        return ProblemFile(run, lambda: self._writer(output, plan, overwrite, options, columns), columns, going_on)

    def _writer(
        self,
        output: str,
        plan: Plan,
        overwrite: bool,
        options: FileOptions | None,
        columns: dict[str, Described],
    ) -> Writer:
        from kickdrift.trajectory.problems.writer import ProblemWriter
        from kickdrift.trajectory.write.h5md import Writer

        run, path = self._run, os.path.realpath(output)
        if plan.backward and plan.interval and plan.exact:
            raise InputError(f"{output}: a file of a run back in time takes every, not interval")
        if path in self._files and not overwrite and self._files[path].backward != plan.backward:
            way = "back" if self._files[path].backward else "forwards"
            raise InputError(f"{output}: the run in this file goes {way} in time; give another output")
        system: Any = run.events.roster.filed if run.events else run.system  # with bodies that left or may come
        if path in self._files and not overwrite and os.path.exists(path):
            kind = Writer if isinstance(system, System) else ProblemWriter
            return kind.append_to(
                path, self._files[path].run_id, options=options, checkpoint=self._checkpoint, plan=plan.numbers,
                at=(run.steps_done, run.time), events=len(run.record.events), columns=columns,
            )  # fmt: skip
        path = str(place(output))
        run.replaced = False  # a new file begins with a checkpoint
        given: dict[str, Any] = {
            "method": self._method(), "every": plan.every, "overwrite": overwrite, "options": options,
            "checkpoint": self._checkpoint, "plan": plan.numbers, "columns": columns,
        }  # fmt: skip
        if isinstance(system, System):
            writer = Writer(path, system, **given)
        else:
            names = [event.kind for event in run.watched]
            writer = ProblemWriter(path, system, slopes=slopes_of(run), events=names, **given)
        self._files[path] = Own.of(writer.run_id, plan.every, plan)
        return writer

    def _method(self) -> dict[str, Any]:
        """The Simulation as a file describes it."""
        run = self._run
        return {
            "integrator": run.integrator,
            "order": run.method.order,
            "dt": run.dt,
            "threads": run.threads,
            "seed": getattr(run.system, "seed", None),
            "engine": run.engine.name,
            "engine_version": run.engine.version,
            "processes": run.processes,
            **run.options.extras(run.method.tunable),
            "options": dict(run.options),
            "processor": processor(),
            "features": features(),
        }
