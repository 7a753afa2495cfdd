"""Comparison of heat baths on a user's own system: which word, and which step, for a wanted sampling error?"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

import numpy as np

from kickdrift.analysis.compare.coupled_paths import (
    FEWEST,
    PRESSURE,
    CoupledPaths,
    Difference,
    coupled_word,
    difference,
    stretch_of,
    stretches,
)
from kickdrift.analysis.compare.sampling import SamplingComparison, SamplingRow, advice
from kickdrift.analysis.compare.work_precision import file_length
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.asked import Integrator
from kickdrift.integrators.options import DT, FRICTION, NOISE, TEMPERATURE
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

BUDGET = 60.0  # seconds of the comparison, without compiling
STEPS = tuple(2.0 ** (-k / 2) for k in range(4))  # of the longest step
LONGEST = 4.0  # longest step, in steps of the file
RELAXATION = 2000  # longest steps, before the comparison
FORGOTTEN = 10.0  # times of the bath's friction after which a stretch ends
ORDER = 2  # of every word's means in the long run
SETTLED = 3.0  # standard errors between the results of half and of whole stretches
BATCH = 20  # stretches between two looks at the clock


def compare_sampling(
    system: System,
    methods: Sequence[Integrator],
    bar: Callable[[str], Callable[[int, int], Any]],
    time: float | None,
    accuracy: float | None,
    length: float | None,
    threads: int,
    longest: float | None = None,
    begin: Callable[[], None] = lambda: None,
    asked: str = "",
    budget: float = BUDGET,
) -> SamplingComparison:
    """Measure the errors of mean energies and pressure of methods with heat baths, over steps from long to short.

    ``time`` is the length of the paths of each method and step; by default the ``budget`` in seconds sets the length.
    Raises InputError for a method whose noise cannot be refined, and for a system without a step."""
    began = perf_counter()
    for each in methods:
        coupled_word(each)
        if NOISE.name in each.options:
            raise InputError(f"{NOISE.name}: compare sets it: each step runs with its own noise and with refined noise")
    plain = [_whole(system, each) for each in methods]
    dts = [_longest(system, longest) * part for part in STEPS]
    begin()
    progress, done = bar("comparing"), 0
    start = _equilibrated(system, plain[0], dts[-1], threads, bar)
    rows: list[SamplingRow] = []
    per_row = budget / (len(plain) * len(dts))
    for method in plain:
        pairs: list[tuple[SamplingRow, Difference | None]] = []
        for dt in dts:
            pairs.append(_row(system, method, dt, start, time, per_row, threads))
            done += 1
            progress(done, len(plain) * len(dts))
        rows += _against_zero(pairs, len(system))
    units = system.units
    notes = []
    if not all(row.settled for row in rows):
        notes.append("* half a stretch gives another result: the paths part before they settle; take a shorter step")
    found = SamplingComparison(
        system=system.name,
        particles=len(system),
        thermal=units.boltzmann * float(plain[0].options["temperature"]),
        time_unit=units.time if units.symbol("time") else "",
        energy_unit=units.symbol("energy"),
        pressure_unit=units.symbol("pressure") if np.isfinite(system.volume) else "",
        threads=threads,
        rows=tuple(rows),
        notes=tuple(notes),
        wall_seconds=perf_counter() - began,
        begin=float(start.time),
        asked=asked,
    )
    if accuracy is None:
        return found
    whole = length or file_length(system) or RELAXATION * dts[0]
    return replace(found, recommendation=advice(found, accuracy, whole))


def _longest(system: System, given: float | None) -> float:
    """The longest step: the one given, else some steps of the file."""
    if given is not None:
        return float(DT.checked(given))
    if system.run.dt is None:
        raise InputError(f"compare: {system.name} has no dt in [run]; give the longest step to try as dt")
    return LONGEST * float(system.run.dt)


def _whole(system: System, method: Integrator) -> Integrator:
    """The method with the options of the system's file. Raises InputError for one that is missing."""
    own = {key: value for key, value in system.run.options.items() if key in method.method.tunable}
    whole = replace(method, options=own | dict(method.options))
    for option in (TEMPERATURE, FRICTION):
        if whole.options.get(option.name) is None:
            raise InputError(f"{option.name} is needed: a heat bath has no default {option.name}")
    return whole


def _equilibrated(
    system: System, method: Integrator, dt: float, threads: int, bar: Callable[[str], Callable[[int, int], Any]]
) -> State:
    """State after some time in the bath. Both paths of a pair start in one state, so it need not be exact."""
    sim = Simulation(system, method, dt, threads=threads)
    wanted = system.equilibration
    time = RELAXATION * dt
    if wanted is not None:
        time = (wanted.steps or 0) * dt if wanted.time is None else float(wanted.time)
    sim.equilibrate(float(sim.options["temperature"]), time, progress=bar("equilibrating"))
    return sim.state


def _row(
    system: System, method: Integrator, dt: float, start: State, time: float | None, seconds: float, threads: int
) -> tuple[SamplingRow, Difference | None]:
    """A row with the costs, and the difference between this step and half of it; None if the path blew up."""
    name = str(method)
    try:
        paths = CoupledPaths(system, method, dt, start, threads)
        begun = perf_counter()
        friction = float(paths.coarse.options["friction"])
        limit = RELAXATION if paths.word.overdamped else max(2, round(FORGOTTEN / (friction * dt)))
        steps = stretch_of(paths, limit)
        count = max(FEWEST, round((time or 0.0) / (steps * dt)))
        looks = [stretches(paths, steps, BATCH)]
        while len(looks) * BATCH < count if time is not None else perf_counter() - begun < seconds:
            looks.append(stretches(paths, steps, BATCH))
    except RunError as error:
        return SamplingRow(name, dt, failure=str(error).split(": ")[1] if ": " in str(error) else str(error)), None
    found = np.concatenate(looks)
    means = difference(found, paths, steps) if np.isfinite(found[..., :PRESSURE]).all() else None
    thermal = system.units.boltzmann * float(paths.coarse.options[TEMPERATURE.name])
    if means is None or not np.all(np.abs(means.values[:PRESSURE]) < system.dimensions * len(system) * thermal):
        return SamplingRow(name, dt, failure="too long: the energies are far off"), None
    row = SamplingRow(
        name, dt, stretch=steps * dt, stretches=len(found), steps=paths.steps, seconds=perf_counter() - begun
    )
    return row, means


def _against_zero(pairs: list[tuple[SamplingRow, Difference | None]], count: int) -> list[SamplingRow]:
    """Rows with the error against a step of zero: the difference between dt and dt/2, and the error at dt/2. That error
    is a row's own two places later, or follows from the difference by the power 2."""
    made: dict[int, SamplingRow] = {}
    sums: dict[int, tuple[Any, Any]] = {}
    for k in reversed(range(len(pairs))):
        row, found = pairs[k]
        if found is None:
            made[k] = row
            continue
        if k + 2 in sums:
            values, variances = found.values + sums[k + 2][0], found.errors**2 + sums[k + 2][1]
        else:
            all_of = 2.0**ORDER / (2.0**ORDER - 1.0)
            values, variances = all_of * found.values, (all_of * found.errors) ** 2
        sums[k] = values, variances
        errors = np.sqrt(variances)
        made[k] = replace(
            row,
            potential=float(values[0] / count), potential_error=float(errors[0] / count),
            kinetic=float(values[1] / count), kinetic_error=float(errors[1] / count),
            pressure=float(values[2]), pressure_error=float(errors[2]),
            gain=found.gain if np.isfinite(found.gain) else None,
            settled=not bool(found.apart[0] > SETTLED),
        )  # fmt: skip
    return [made[k] for k in range(len(pairs))]
