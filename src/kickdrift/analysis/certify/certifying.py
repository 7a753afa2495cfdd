"""`ensemble_checks`: whether runs sample the ensemble of their heat bath."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from kickdrift.analysis.certify import canonical
from kickdrift.analysis.certify.canonical import Deviation, Point
from kickdrift.analysis.certify.certificate import FAIL, PASS, Check, EnsembleChecks
from kickdrift.analysis.certify.sampled_run import BAR, SampledRun, sampled_run
from kickdrift.analysis.observables.vectors import Source
from kickdrift.engines import engine as engine_named
from kickdrift.errors import InputError
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import unpacked
from kickdrift.model.checks.values import whole_number
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

LEVEL = 0.01  # probability that a right run fails; certify.py of kickdrift_validation measures the true rate


def ensemble_checks(
    runs: Source | Any,
    temperature: float | Sequence[float] | None = None,
    pressure: float | Sequence[float] | None = None,
    *,
    constraints: int = 0,
    level: float = LEVEL,
) -> EnsembleChecks:
    """Test whether one or two runs sample the canonical ensemble; an `EnsembleChecks`.

    Each run gives the mean, the width and the whole distribution of the kinetic energy, and the temperature of each
    axis and each species. A run with a barostat gives the mean pressure. Two runs of one system at neighbouring
    temperatures, or pressures, also give the ratio of
    their distributions of potential energy, enthalpy or volume. A run of constant energy, without a heat bath, gives
    only the temperatures of axes and species relative to the mean temperature.

    Samples of the equilibration are left out, and the others are thinned until they are independent. A heat bath sets
    the kinetic energies long before the positions, so kinetic and potential energies begin at their own samples.

    Parameters
    ----------
    runs : a run or a sequence of one or two
        The path of a run's file, an open run or a slice of its frames, a Simulation that has run, or an MDAnalysis
        Universe or AtomGroup with velocities. A Simulation keeps no velocities, so axes and species are not tested.
    temperature, pressure : number, or one for each run
        Default: the run's heat bath and barostat. In the run's units; K and bar for a Universe.
    constraints : number of rigid bonds and angles, of runs of other programs
    level : probability that a right run fails any test, shared equally by all tests

    Raises
    ------
    InputError
        If physical_validation is not installed; for runs without velocities or with fewer than 100 independent
        samples; for two runs of different systems, at equal temperatures and pressures, or without overlap.

    Source: Merz & Shirts 2018, doi:10.1371/journal.pone.0202764; Shirts 2013, doi:10.1021/ct300688p.
    """
    canonical.packages()
    given = list(runs) if isinstance(runs, list | tuple) else [runs]
    if not 1 <= len(given) <= 2:
        raise InputError(f"runs: expected one or two, got {len(given)}")
    if not 0 < level < 1:
        raise InputError(f"level must lie between 0 and 1, got {level}")
    constraints = whole_number("constraints", constraints, 0)
    temperatures, pressures = _each("temperature", temperature, len(given)), _each("pressure", pressure, len(given))
    found = []
    for source, each, press in zip(given, temperatures, pressures, strict=True):
        run = sampled_run(source)
        run = run.constrained(constraints) if constraints else run
        if press is not None and run.name == "the Universe":
            press *= BAR
        found.append(
            replace(
                run,
                temperature=run.temperature if each is None else each,
                pressure=run.pressure if press is None else press,
            )
        )
    return checked(found, level)


def engine_checks(
    system: System,
    engine: str,
    integrator: str | None = None,
    steps: int | None = None,
    every: int | None = None,
    progress: Callable[..., Any] | None = None,
    *,
    temperature: float | Sequence[float] | None = None,
    **options: Any,
) -> EnsembleChecks:
    """Run a System on an engine and test the run, which is written to a temporary file; an `EnsembleChecks`.

    ``temperature`` is that of an integrator's heat bath; two temperatures make two runs. With a bath, a tenth of the
    steps comes before the run, to equilibrate. A run at constant energy tests axes and species alone, unless
    ``temperature`` gives the temperature for comparison. Raises InputError if the engine cannot run the system or the
    integrator."""
    canonical.packages()
    count = 1 if temperature is None else np.size(temperature)
    if count > 2:
        raise InputError(f"temperature: expected one or two, got {count}")
    asked = _each("temperature", temperature, count)
    found = []
    for each in asked:
        given = {**options, "temperature": each} if each is not None and _bath(system, engine, integrator) else options
        sim = Simulation(system, integrator, engine=engine, **given)
        if sim.method.bath and steps:
            sim.equilibrate(sim.options["temperature"], max(1, steps // 10) * (sim.dt or 0.0), progress=progress)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "run.h5md"
            sim.run(steps, every=every, output=path, progress=progress)
            run = replace(sampled_run(path), name=f"{system.name} on {engine}")
        found.append(run if each is None else replace(run, temperature=each))
    return checked(found)


def _bath(system: System, engine: str, integrator: Any) -> bool:
    """Whether the integrator of a run on an engine has a heat bath."""
    name = unpacked(integrator, {})[0] or system.run.integrator
    return name is not None and method_named(engine_named(engine).method_name(name)).bath


def checked(runs: Sequence[SampledRun], level: float = LEVEL) -> EnsembleChecks:
    """Tests of one or two runs whose samples have been read."""
    found = [_settled(run) for run in runs]
    if len(found) == 2:
        _comparable(*found)
        if found[0].name == found[1].name:
            found = [replace(run, name=f"{run.name} ({k})") for k, run in enumerate(found, 1)]
    rows: list[tuple[str, str, Deviation | float, int]] = []
    for run in found:
        rows += [(run.name, *row) for row in (_canonical(run) if _thermal(run) else _even(run))]
    if len(found) == 2:
        rows.append(("", *_pair(*found)))
    notes = dict.fromkeys(note for run in found for note in run.notes)
    return EnsembleChecks(tuple(_row(*row, level / len(rows)) for row in rows), level, tuple(notes))


def _thermal(run: SampledRun) -> bool:
    return run.temperature is not None


def _settled(run: SampledRun) -> SampledRun:
    """The run without its equilibration. Raises InputError if there is no temperature and no constant energy."""
    if len(run.kinetic) < canonical.FEWEST:
        raise InputError(f"{run.name}: {len(run.kinetic)} samples; the tests need {canonical.FEWEST} or more")
    if run.temperature is None:
        if run.bath:
            raise InputError(f"{run.name} does not say its temperature; give temperature")
        if not run.groups:
            raise InputError(f"{run.name} has constant energy and no velocities: nothing can be tested; give its file")
        note = "constant energy: axes and species are compared with the mean temperature, and nothing else is tested"
        run = replace(run, notes=(*run.notes, note))
    if first := canonical.equilibrated(run.kinetic):
        note = f"the first {first} of {len(run.kinetic)} kinetic energies of {run.name} count as equilibration"
        run = replace(run.from_sample(first), notes=(*run.notes, note))
    return run


def _canonical(run: SampledRun) -> list[tuple[str, Deviation | float, int]]:
    """Tests of a run at a known temperature."""
    kinetic = canonical.independent(run.kinetic, run.name)
    mean, width = canonical.mean_and_width(kinetic, run.freedom, run.point)
    return [
        ("temperature from the mean kinetic energy", mean, len(kinetic)),
        ("temperature from the width of its distribution", width, len(kinetic)),
        ("shape of its distribution", canonical.distribution(kinetic, run.freedom, run.point), len(kinetic)),
        *_groups(run, run.point),
        *_pressure(run),
    ]


def _pressure(run: SampledRun) -> list[tuple[str, Deviation | float, int]]:
    """The mean pressure beside the barostat's. The volume settles later than the velocities."""
    if run.pressure is None or run.pressures is None:
        return []
    settled = run.pressures[canonical.equilibrated(run.pressures) :]
    found = canonical.mean_of(settled, run.pressure, f"{run.name}: pressure")
    return [("mean pressure", found, found.samples)]


def _even(run: SampledRun) -> list[tuple[str, Deviation | float, int]]:
    """Tests of a run at constant energy: each part beside the mean temperature."""
    temperature = 2 * float(run.kinetic.mean()) / (run.freedom * run.boltzmann)
    return _groups(run, replace(run, temperature=temperature).point)


def _groups(run: SampledRun, point: Point) -> list[tuple[str, Deviation | float, int]]:
    rows: list[tuple[str, Deviation | float, int]] = []
    for group in run.groups:
        found = canonical.mean_temperature(group.kinetic, group.freedom, point, f"{run.name}: {group.name}")
        rows.append((f"temperature of {group.name}", found, found.samples))
    return rows


def _comparable(one: SampledRun, two: SampledRun) -> None:
    """Raise InputError unless two runs have one system and neighbouring temperatures or pressures."""
    if one.likeness != two.likeness:
        raise InputError(
            f"{one.name} and {two.name} are runs of different systems: their ratio needs the same particles, forces "
            "and box"
        )
    for run in (one, two):
        if not _thermal(run):
            raise InputError(f"{run.name} has constant energy: the ratio of two runs needs two temperatures")
    if (one.pressure is None) != (two.pressure is None):
        raise InputError("one run has a pressure and the other a constant volume: their ratio is not defined")
    if (one.temperature, one.pressure) == (two.temperature, two.pressure):
        raise InputError(
            f"both runs have temperature {one.temperature:g}: their ratio needs two neighbouring temperatures"
            " or pressures"
        )
    if one.temperature != two.temperature and one.pressure != two.pressure:
        raise InputError("the runs differ in temperature and in pressure: their ratio needs one equal")
    if one.temperature != two.temperature and (one.potential is None or two.potential is None):
        raise InputError("a run holds no potential energies: the ratio at two temperatures needs them")


def _pair(one: SampledRun, two: SampledRun) -> tuple[str, Deviation | float, int]:
    """Test of two runs: the slope of the logarithm of their distributions' ratio."""

    def series(run: SampledRun) -> Floats:
        if one.temperature == two.temperature:
            return settled(run.volume)
        assert run.potential is not None
        return settled(run.potential if run.pressure is None else run.potential + run.pressure * run.volume)

    def settled(values: Floats) -> Floats:
        return values[canonical.equilibrated(values) :]

    chosen = [canonical.independent(series(run), run.name) for run in (one, two)]
    found = canonical.ratio(chosen[0], chosen[1], (one.point, two.point))
    what = "volumes" if one.temperature == two.temperature else "potential energies"
    what = "enthalpies" if one.pressure is not None and one.temperature != two.temperature else what
    return f"slope of the logarithm of the ratio of {what}", found, found.samples


def _row(run: str, test: str, found: Deviation | float, samples: int, threshold: float) -> Check:
    p = found if isinstance(found, float) else found.p_value
    verdict = PASS if p >= threshold else FAIL  # a p-value that is not a number fails
    if isinstance(found, float):
        return Check(run, test, None, None, None, p, samples, verdict)
    return Check(run, test, found.measured, found.expected, found.errors, p, samples, verdict)


def _each(name: str, value: float | Sequence[float] | None, count: int) -> list[float | None]:
    """One number for each run. Raises InputError for another number of them, or for a number that makes no sense."""
    if value is None:
        return [None] * count
    values = np.atleast_1d(np.asarray(value, dtype=float)).tolist()
    values = values * count if len(values) == 1 else values
    if len(values) != count:
        raise InputError(f"{name}: expected one number for each of {count} runs, got {len(values)}")
    for each in values:
        if not math.isfinite(each) or (name == "temperature" and each <= 0):
            raise InputError(f"{name}: expected a {'positive ' if name == 'temperature' else ''}number, got {each:g}")
    return values
