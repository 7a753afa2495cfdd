"""Protocols: the stages of a System, run one after another, each from the end of the one before."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kickdrift.disk import kinds
from kickdrift.disk.outputs import checked_target
from kickdrift.display.showing import Lines, Shown, Table, following
from kickdrift.errors import InputError, RunError
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import in_units, known_options, other_barostats
from kickdrift.integrators.options import PRECISION, SEED
from kickdrift.looks.report_lines import mean_with_units
from kickdrift.model.run_defaults import RunDefaults, with_ramps
from kickdrift.model.stages import Stage
from kickdrift.model.system import System, later_seed
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.run.files import check_suffix
from kickdrift.run.minimization import Minimum, minimum
from kickdrift.run.push_off import soft_systems
from kickdrift.run.report.report import Report
from kickdrift.run.resuming import resume, staged
from kickdrift.run.simulation import Simulation
from kickdrift.run.times import length_of
from kickdrift.systemfile.files import prefixed
from kickdrift.text import counted

if TYPE_CHECKING:
    from kickdrift.trajectory.layout.options import FileOptions

Progress = Callable[[int, int], Any]


@dataclass(frozen=True, repr=False)
class StageReports(Shown):
    """What the stages of a protocol have shown.

    ``print(reports)`` shows a table: the means of each stage with their standard errors. ``reports["heat"]`` is the
    `Report` of a stage, or the `Minimum` of one that minimizes.

    Attributes
    ----------
    reports : results by the name of the stage, in order
    outputs : files of the stages that have one, by name
    system : the System at the end, from which a new run may begin
    """

    reports: dict[str, Report | Minimum]
    outputs: dict[str, Path]
    system: System

    def __getitem__(self, name: str) -> Report | Minimum:
        return self.reports[name]

    def _lines(self) -> Lines:
        return [("written", str(path)) for path in self.outputs.values()]

    def _tables(self) -> list[Table]:
        units, d = self.system.units, self.system.dimensions
        symbols = {
            "temperature": units.symbol("temperature"),
            "pressure": symbol_of(f"{units.energy}/{units.length}^{d}"),
            "volume": symbol_of(f"{units.length}^{d}"),
        }
        rows = []
        for name, found in self.reports.items():
            means = [
                _mean(getattr(found, key, None), getattr(found, f"{key}_error", None), symbol)
                for key, symbol in symbols.items()
            ]
            if isinstance(found, Report) and found.volume is None and self.system.box.periodic:
                means[-1] = "constant"
            rows.append([name, f"{found.steps:,}", *means])
        return [("Means of the stages", ["stage", "steps", *symbols], rows)]

    def as_json(self) -> dict[str, Any]:
        """Return the reports as plain numbers, texts and Nones, by the name of the stage."""
        return {name: found.as_json() for name, found in self.reports.items()}


def _mean(value: float | None, error: float | None, symbol: str) -> str:
    return "" if value is None else mean_with_units(value, error, symbol)


class StageRun:
    """One stage that is ready to run.

    Attributes
    ----------
    stage : the stage
    sim : its Simulation; None for a stage that minimizes
    output : its file; None without one
    result : its `Report` or `Minimum`, once it has run
    system : the System at its end, for the next stage
    """

    result: Report | Minimum
    system: System

    def __init__(self, stage: Stage, sim: Simulation | None, output: Path | None) -> None:
        self.stage, self.sim, self.output = stage, sim, output

    def run(self, progress: Progress | None = None) -> Report | Minimum:
        """Run the stage. The error of a run that blows up names the stage, and says what is kept."""
        try:
            self.result, self.system = self._run(progress)
        except RunError as error:
            kept = f"; {self.output} has its frames up to the last good one" if self.output else ""
            error.args = (f"stage {self.stage.name}: {error}{kept}", *error.args[1:])
            raise
        return self.result

    def _run(self, progress: Progress | None) -> tuple[Report | Minimum, System]:
        raise NotImplementedError


class _Minimized(StageRun):
    def __init__(self, stage: Stage, system: System, threads: int) -> None:
        super().__init__(stage, None, None)
        self._start, self._threads = system, threads

    def _run(self, progress: Progress | None) -> tuple[Minimum, System]:
        start, asked = self._start, dict(self.stage.minimize or {})
        found = minimum(start, self._threads, **asked, progress=progress)
        if not found.converged:
            raise RunError(f"not converged: {found.trouble}")
        state = start.state
        return found, start.at(found.system.state.phase, state.time, box=state.box)


class _New(StageRun):
    def __init__(self, stage: Stage, system: System, made: _Making, output: Path | None) -> None:
        super().__init__(stage, simulation_of(system, stage, made.threads), output)
        self._made = made

    def _run(self, progress: Progress | None) -> tuple[Report, System]:
        sim, made = self.sim, self._made
        assert sim is not None
        run = sim.system.run
        from kickdrift.run.equilibration import equilibrate_as_told  # needs numba

        equilibrate_as_told(sim)
        length = length_of(sim, self.stage.name)
        file = made.file if self.output else None
        found = sim.run(
            **length, every=run.every, interval=run.interval, output=self.output, overwrite=made.overwrite, file=file,
            progress=progress,
        )  # fmt: skip
        return found, sim.now()


class _Resumed(StageRun):
    def _run(self, progress: Progress | None) -> tuple[Report, System]:
        sim = self.sim
        assert sim is not None
        assert sim.plan is not None
        found = sim.report() if sim.plan.over(sim) else sim.run(progress=progress)
        return found.written_to(self.output), sim.now()


@dataclass(frozen=True)
class _Making:
    """How the stages of a protocol run."""

    output: Path | None
    overwrite: bool
    threads: int
    file: FileOptions | None

    def path(self, stage: Stage) -> Path | None:
        """The file of a stage."""
        if self.output is None or not stage.keep or stage.minimize is not None:
            return None
        return self.output.with_name(f"{self.output.stem}-{stage.name}{self.output.suffix}")


def run_stages(
    system: System | str | os.PathLike[str],
    stages: Iterable[Stage] | None = None,
    *,
    output: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    threads: int = 1,
    file: FileOptions | None = None,
    progress: bool | Progress | None = None,
) -> StageReports:
    """Run the stages of a protocol, each from the end of the one before, and return their `StageReports`.

    A stage has the integrator, the length and the options of ``[run]``, where it does not say others. Options of
    ``[run]`` that its integrator does not take stay behind. Time goes on from stage to stage, and so does the noise of
    heat baths.

    ``run_stages("copper-heat.h5md")`` finishes the stage of that file, and goes on with those after it. The bits are
    those of a protocol that was never stopped.

    Parameters
    ----------
    system : a System, or the file of a stage, to go on from there
    stages : `Stage` values; default those of the System
    output : "copper.h5md" for the files copper-heat.h5md and so on, one for each stage that keeps one; default no file
    overwrite, threads, file : as in `Simulation.run` and `Simulation`
    progress : True for a bar, or a function (done, of), called in each stage

    Raises
    ------
    InputError
        Before anything runs: for a stage that makes no sense, which it names, and for a file that exists.
    RunError
        If a stage blows up. The files of the stages before are whole.
    """
    reports, outputs = {}, {}
    each: StageRun | None = None
    for each in protocol(system, stages, output=output, overwrite=overwrite, threads=threads, file=file):
        with following(progress, each.stage.name) as told:
            reports[each.stage.name] = each.run(told)
        if each.output is not None:
            outputs[each.stage.name] = each.output
    assert each is not None
    return StageReports(reports, outputs, each.system)


def protocol(
    system: System | str | os.PathLike[str],
    stages: Iterable[Stage] | None = None,
    *,
    output: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
    threads: int | None = 1,
    file: FileOptions | None = None,
) -> Iterator[StageRun]:
    """Yield each stage of `run_stages`. Who takes one runs it before the next."""
    if not isinstance(system, System):
        if stages is not None or output is not None:
            raise InputError("run_stages: the file of a stage has the stages and the name of the files after it")
        yield from _resumed(Path(system), threads, file)
        return
    chosen = system.with_stages(*(system.stages if stages is None else stages))
    if not chosen.stages:
        raise InputError(f"run_stages: {system.name!r} has no stages; give [[stage]] in its file, or stages")
    chosen = chosen.with_stages(*(_completed(each, chosen) for each in chosen.stages))
    made = _Making(None if output is None else Path(output), overwrite, threads or 1, file)
    _check(chosen, made)
    yield from _each(chosen, made)


def _resumed(path: Path, threads: int | None, file: FileOptions | None) -> Iterator[StageRun]:
    """The rest of a protocol, from the file of a stage."""
    sim = resume(path, threads=threads)
    if not getattr(sim.system, "stages", ()):
        raise InputError(f"{path}: is the file of a single run; resume it with kd.resume(file).run()")
    stage, *rest = sim.system.stages
    one = _Resumed(stage, sim, path)
    yield one
    stem = path.stem.removesuffix(f"-{stage.name}")
    made = _Making(path.with_name(stem + path.suffix), False, sim.threads, file)
    if rest:
        chosen = one.system.with_stages(*rest)
        _check(chosen, made)
        yield from _each(chosen, made)


def _each(system: System, made: _Making) -> Iterator[StageRun]:
    """Each stage of a System."""
    stages = system.stages
    for k, stage in enumerate(stages):
        system = system.with_stages(*stages[k:])
        one: StageRun
        if stage.minimize is not None:
            one = _Minimized(stage, system, made.threads)
        else:
            one = _New(stage, system, made, made.path(stage))
        yield one
        system = one.system


def _completed(stage: Stage, system: System) -> Stage:
    """The stage with all that its run needs: its own keys over those of ``[run]``, as numbers in the system's units.
    The rest of a protocol then inherits nothing from the stage that runs, whose keys are ``[run]`` in its file."""
    if stage.minimize is not None:
        return stage
    with prefixed(f"stage {stage.name}: "):
        base = system.run if stage.inherit else RunDefaults()
        given = in_units(with_ramps(stage.run), known_options().values(), system.units)
        options, left = dict(base.options), other_barostats(given)
        if (named := given.get("integrator") or base.integrator) is not None:
            left += [key for key in options if key not in (PRECISION.name, *method_named(named).tunable)]
        own = {key: value for key, value in base.said().items() if key not in left}
        run = RunDefaults(**own).changed(**given).in_units(system.units)
    return Stage(stage.name, keep=stage.keep, inherit=False, **run.said())


def simulation_of(system: System, stage: Stage, threads: int) -> Simulation:
    """The Simulation of a stage. A seed that all stages share gives each one noise of its own."""
    run = RunDefaults(**stage.run)
    seed = run.options.get(SEED.name)
    made = system.with_run(**dict.fromkeys(system.run.said())).with_run(**run.said())
    sim = Simulation(made if seed is None else made.with_run(seed=later_seed(seed, system.state.time)), threads=threads)
    return staged(sim, system.stages)


def check_length(sim: Simulation) -> None:
    """Refuse a stage of unknown length, and one that ends before its ramp does."""
    run, ramp = sim.system.run, sim.integration.ramp
    if run.steps is run.time is run.times is None:
        raise InputError("names neither steps nor time nor times, and so does [run]")
    length = length_of(sim, sim.system.name)
    if ramp is None or ramp.steps is None or "times" in length:
        return
    if ramp.steps > (steps := sim.steps_to(**length)):
        raise InputError(
            f"its ramp takes {counted(ramp.steps, 'step', ',')} and the stage ends after {steps:,}; give the stage "
            f"{ramp.steps:,} steps, or leave out the steps of the ramp"
        )


def _check(system: System, made: _Making) -> None:
    """Refuse files that exist, and stages that cannot run, before the first one runs."""
    for stage in system.stages:
        with prefixed(f"stage {stage.name}: "):
            if (path := made.path(stage)) is not None:
                check_suffix(system, str(path))
                checked_target(path, kinds.RUN, made.overwrite)
            if stage.minimize is None:
                sim = simulation_of(system, stage, made.threads)
                sim.refuse_still()
                check_length(sim)
            elif system.tied_by:
                raise InputError(f"minimize moves particles freely, so it breaks {system.tied_by}")
            elif stage.minimize.get("soft") is True:
                next(soft_systems(system))  # refuses a system without cores
