"""Files that a run writes: when, by which writer, and what is saved when a force fails."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.disk import kinds
from kickdrift.disk.files import place
from kickdrift.disk.outputs import checked_target, plain, reason
from kickdrift.errors import InputError, KickdriftError, RunError
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.jit.compile import features, processor
from kickdrift.looks.record import WRITING
from kickdrift.model.memory import Memory
from kickdrift.model.problem import Problem, ProblemState
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.file_units import Scale
from kickdrift.run.advance import Integration
from kickdrift.run.watcher import Watcher
from kickdrift.run.watchers.file import File
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.looks.observers import Looks, Sample
    from kickdrift.run.plan.plan import Plan
    from kickdrift.run.report.report import Report
    from kickdrift.trajectory.layout.options import FileOptions
    from kickdrift.trajectory.write.continued import Described
    from kickdrift.trajectory.write.h5md import Writer


SPECIES_BYTES = 64_000  # HDF5 keeps the names of species in a message of at most 65,535 bytes
_OWN_COLUMN = re.compile(r"y\d*|energy")


def check_suffix(system: System | Problem, output: str) -> None:
    """Refuse a name whose suffix is that of another kind of run, and more species than a file can name."""
    kind = kinds.RUN if isinstance(system, System) else kinds.PROBLEM
    suffixes = kind.suffixes if isinstance(system, System) else (*kind.suffixes, *kinds.SERIES.suffixes)
    if Path(output).suffix.lower() not in suffixes:
        noun = kind.noun if isinstance(system, System) else "a Problem's run"
        raise InputError(f"{output}: the name of {noun} {kinds.wrong_ending(output, suffixes)}")
    if isinstance(system, System):
        size = sum(len(name.encode()) // 8 * 8 + 12 for name in system.species)
        if size > SPECIES_BYTES:
            raise InputError(f"{output}: cannot hold {len(system.species):,} species, whose names take {size:,} bytes")


def is_table(output: str) -> bool:
    """Whether a Problem's output is a table."""
    return Path(output).suffix.lower() in kinds.SERIES.suffixes


def check_columns(names: Iterable[str]) -> None:
    """Refuse columns whose names a Problem's file uses."""
    for name in names:
        if _OWN_COLUMN.fullmatch(name):
            raise InputError(f"column {name!r}: a Problem's file uses this name itself; choose another")


def check_options(options: FileOptions | None) -> None:
    """Refuse options that are about frames of particles."""
    from kickdrift.trajectory.layout.options import FileOptions

    for key in ("store", "compress", "write"):
        if options is not None and getattr(options, key) != getattr(FileOptions(), key):
            raise InputError(f"{key}: is for the frames of particles; a Problem's file takes flush alone")


def slopes_of(run: Integration) -> list[Floats]:
    """Values of a Problem's f at fixed states, by which a file recognises f again; nan where f is not defined."""
    from kickdrift.trajectory.problems.record import states_to_compare

    problem = run.system
    assert isinstance(problem, Problem)
    flow: Any = run.flow
    found = []
    for y in states_to_compare(problem):
        slope = np.full(len(problem), np.nan)
        with suppress(Exception), np.errstate(all="ignore"):  # whatever a user's function raises
            slope = np.array(flow.derivative(problem.t0, flow.array(ProblemState(y)))).reshape(-1)
        flow.forget_errors()
        found.append(slope)
    return found


class ProblemFile(File):
    """Writes a Problem's looks and events to a file; see `File`."""

    takes_series = False

    def _append(self, looks: Looks, columns: dict[str, Any]) -> None:
        energy = looks.total if self._run.system.energy is not None else None
        self._writer.append_look(self._run.state, columns, energy)


class ProblemTableFile(Watcher):
    """Keeps a Problem's looks, and writes them as a table when the run ends.

    Parameters
    ----------
    run : the Integration to sample
    output : a name that ends in .csv or .parquet
    overwrite : replace a table of that name
    method : what the Simulation says of itself
    columns : names of the user's columns to write
    """

    part = WRITING

    def __init__(
        self, run: Integration, output: str, overwrite: bool, method: Mapping[str, Any], columns: Iterable[str]
    ) -> None:
        self._run, self._path, self._overwrite = run, Path(output), overwrite
        self._method, self._columns = method, tuple(columns)

    def begin(self) -> None:
        """Check that the table can be written."""
        from kickdrift.trajectory.problems import table

        table.check(self._path)
        checked_target(self._path, kinds.SERIES, self._overwrite)
        self._rows: list[tuple[float, Floats, Sample]] = []

    def look(self) -> None:
        """Keep the current sample."""
        self._rows.append((self._run.time, self._run.state.y, self._run.record.samples[-1]))

    def close(self, report: Report | None) -> None:
        """Write the table, also that of a run which failed."""
        if report is not None:
            self._write(report.as_json())
            return
        with suppress(KickdriftError):  # the error that ended the run is raised instead
            self._write(None)

    def _write(self, report: dict[str, Any] | None) -> None:
        from kickdrift.trajectory.layout.names import versions
        from kickdrift.trajectory.problems import table

        if not self._rows:
            return
        problem = self._run.system
        assert isinstance(problem, Problem)
        times, states, samples = zip(*self._rows, strict=True)
        energies = np.array([each.energies.total for each in samples]) if problem.energy is not None else None
        own = {name: np.array([each.columns[name] for each in samples]) for name in self._columns}
        about = {
            "name": problem.name,
            "separable": problem.separable,
            "method": plain(dict(self._method)),
            "versions": versions(),
            "report": plain(report),
        }
        columns = table.series(np.array(times), np.array(states), energies, own)
        table.write(Path(os.path.abspath(self._path)), columns, about, overwrite=self._overwrite)


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


@contextmanager
def keeping_failed_atoms(run: Integration, output: str | None) -> Iterator[None]:
    """If a function or calculator fails in the run, write its particles beside ``output``, and name that file in the
    error's line. Without output there is no such file."""
    try:
        yield
    except RunError as error:
        flow: Any = run.moving
        if output is not None and error.failed_at is not None and isinstance(flow, ParticleFlow):
            for host in flow.forces.hosts:
                if host is not None and host.failure:
                    places = host.positions / host.parts.scale
                    error.args = (f"{error}; {_written(run.system, places, error.failed_at, Path(output))}",)
                    break
        raise


def _written(system: Any, places: Floats, at: tuple[int, float], output: Path) -> str:
    """Write the file; return what became of it."""
    name = f"{output.stem}-step-{at[0]}"
    names = [output.with_name(f"{name}{more}.extxyz") for more in ("", *(f"-{k}" for k in range(2, 100)))]
    path = next((each for each in names if not each.exists()), names[-1])
    try:
        path.write_text(extxyz(system, places, at))
    except OSError as error:
        return f"its particles could not be written to {path}: {reason(error)}"
    return f"its particles are in {path}"


def extxyz(system: System, places: Floats, at: tuple[int, float]) -> str:
    """Text of an extended XYZ file of particles at ``places`` (n, 3), with all digits; in angstrom if the units can be
    converted. A space in the name of a species becomes an underscore."""
    scale = Scale.of(system.units).length
    step, time = at
    edges = " ".join(repr(float(edge)) for edge in (system.box.matrix / scale).flat)
    axes = " ".join("T" if periodic else "F" for periodic in system.box.periodic_axes)
    lattice = f'Lattice="{edges}" ' if system.box.periodic else ""
    head = f'{lattice}Properties=species:S:1:pos:R:3 pbc="{axes}" step={step} time={time!r}'
    rows = [
        f"{'_'.join(system.species[kind].split())} {float(x)!r} {float(y)!r} {float(z)!r}"
        for kind, (x, y, z) in zip(system.species_index, places / scale, strict=True)
    ]
    return "\n".join([str(len(rows)), head, *rows, ""])
