"""Comparison of heat baths on a user's own system: how far means at a step are from those at a step of zero."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import ceil, isfinite, log, sqrt
from time import perf_counter
from typing import Any

import numpy as np

from kickdrift.analysis.compare.bench import processor
from kickdrift.analysis.compare.comparison import Choice, Compared, Recommendation, versions
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
from kickdrift.analysis.compare.work_precision import file_length
from kickdrift.display.showing import Lines, Table, above
from kickdrift.errors import InputError, RunError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import Integrator
from kickdrift.integrators.options import DT, FRICTION, NOISE, TEMPERATURE
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.run.simulation import Simulation
from kickdrift.text import counted, duration

SURE = 2.0  # standard errors that a recommended step leaves for chance
RESOLVED = 4.0  # standard errors of an error that counts for a slope
_OTHERWISE = ("rows", "recommendation", "begin", "asked")
BUDGET = 60.0  # seconds of the comparison, without compiling
STEPS = tuple(2.0 ** (-k / 2) for k in range(4))  # of the longest step
LONGEST = 4.0  # longest step, in steps of the file
RELAXATION = 2000  # longest steps, before the comparison
FORGOTTEN = 10.0  # times of the bath's friction after which a stretch ends
ORDER = 2  # of every word's means in the long run
SETTLED = 3.0  # standard errors between the results of half and of whole stretches
BATCH = 20  # stretches between two looks at the clock


@dataclass(frozen=True)
class SamplingRow:
    """Sampling error of a method at a step. Energies are means per particle, in the system's units.

    Attributes
    ----------
    method, dt : what ran
    potential, kinetic, pressure : means at this step less means at a step of zero; nan where unknown
    potential_error, kinetic_error, pressure_error : their standard errors
    stretch, stretches : the time for which paths stay together, and the number of such stretches
    steps, seconds : cost, of both paths
    gain : how many times the steps two independent runs need for the same error of ``potential``; None if unknown
    settled : whether half a stretch gives the same results
    failure : why there is no result, "" if there is
    """

    method: str
    dt: float
    potential: float = float("nan")
    potential_error: float = float("nan")
    kinetic: float = float("nan")
    kinetic_error: float = float("nan")
    pressure: float = float("nan")
    pressure_error: float = float("nan")
    stretch: float = 0.0
    stretches: int = 0
    steps: int = 0
    seconds: float = field(default=0.0, compare=False)
    gain: float | None = None
    settled: bool = True
    failure: str = ""

    @property
    def bound(self) -> float:
        """Largest likely error of the mean potential energy."""
        return abs(self.potential) + SURE * self.potential_error

    def as_json(self) -> dict[str, Any]:
        """In plain numbers, None for nan."""
        return {key: None if isinstance(value, float) and not isfinite(value) else value
                for key, value in vars(self).items()}  # fmt: skip


@dataclass(frozen=True)
class SamplingAdvice(Recommendation):
    """A recommended heat bath and step; the accuracy is the error of the mean potential energy of a particle over k_B
    T."""

    def lines(self, time_unit: str, to_run: str) -> Lines:
        lines = [("wanted", f"error {self.accuracy:g} k_B T of the mean potential energy of a particle")]
        if self.choice is None:
            lines.append(("recommended", f"nothing: {self.refusal}"))
        else:
            lines.append(("recommended", self.choice.foreseen))
        lines += [("next", other.foreseen) for other in self.others[:1]]
        lines += [("evidence", line) for line in self.evidence]
        return [*lines, ("to run it", to_run)] if self.choice is not None else lines


@dataclass(frozen=True, repr=False)
class SamplingComparison(Compared):
    """Sampling errors of methods with a heat bath, over steps from long to short.

    Attributes
    ----------
    system : name of the system
    particles : number of particles
    thermal : k_B T
    rows : by method, from the longest step on; see `SamplingRow`
    slopes : of the error of the potential energy against the step, by method; None if too few errors are resolved
    recommendation : the cheapest method and step for the wanted accuracy, or the reason for none; None without an
        accuracy
    notes : remarks for the user

    ``print(comparison)`` shows what the command line prints, and ``as_json()`` returns what ``--json`` writes.
    """

    system: str
    particles: int
    thermal: float
    time_unit: str
    energy_unit: str
    pressure_unit: str
    threads: int
    rows: tuple[SamplingRow, ...]
    notes: tuple[str, ...] = ()
    wall_seconds: float = field(default=0.0, compare=False)
    recommendation: SamplingAdvice | None = None
    begin: float = 0.0
    asked: str = ""

    measure = "sampling"

    def of(self, method: str) -> list[SamplingRow]:
        """Rows of a method, from the longest step on."""
        return [row for row in self.rows if row.method == method]

    @property
    def slopes(self) -> dict[str, float | None]:
        return {name: _slope(self.of(name)) for name in self.methods}

    def as_json(self) -> dict[str, Any]:
        """The comparison as one JSON object, with versions and processor."""
        return {
            "measure": self.measure,
            **{key: value for key, value in vars(self).items() if key not in _OTHERWISE},
            "versions": versions(),
            "processor": processor(),
            "slopes": self.slopes,
            "rows": [row.as_json() for row in self.rows],
            "recommendation": self.recommendation and self.recommendation.as_json(),
        }

    def plot(self) -> Any:
        """Draw the errors of the mean energies and of the pressure against the step; a matplotlib Figure.

        An InputError if every run failed."""
        return above("sampling figure")(self)

    def label(self, method: str) -> str:
        """A method without its options, where no other of that name is compared."""
        name = method.split()[0]
        return name if sum(other.split()[0] == name for other in self.methods) == 1 else method

    def _tables(self) -> list[Table]:
        unit = symbol_of(self.energy_unit)
        columns = ["method", "dt", f"U / N{_of(unit)}", f"K / N{_of(unit)}", f"pressure{_of(self.pressure_unit)}",
                   "stretch", "stretches", "gain"]  # fmt: skip
        slopes = [[self.label(name), "–" if slope is None else f"{slope:.2f}"] for name, slope in self.slopes.items()]
        return [
            (
                f"{self.system}: errors of means against the step",
                columns,
                [_cells(row, self.label(row.method)) for row in self.rows],
            ),
            ("Slope of the error of U against the step", ["method", "slope"], slopes),
        ]

    def _lines(self) -> Lines:
        steps = sum(row.steps for row in self.rows)
        lines = [
            *(("method", name) for name in self.methods),
            ("error", "of the mean at a step, less that at a step of zero, with its standard error"),
            ("paths", "at dt and dt/2 on the same noise, compared after each stretch"),
            ("gain", "times the steps that independent runs need for the error of U"),
            *(("note", note) for note in self.notes),
            ("time taken", f"{duration(self.wall_seconds)}, {steps:,} steps on {counted(self.threads, 'thread')}"),
        ]
        return [*lines, *self._advice()]


def advice(found: SamplingComparison, accuracy: float, length: float) -> SamplingAdvice:
    """The method and step that cost the fewest evaluations for an error of the mean potential energy below ``accuracy``
    times k_B T for each particle; between two measured steps by the power 2, and never beyond the measured ones."""
    wanted, choices, said = accuracy * found.thermal, [], []
    for name in found.methods:
        rows = [row for row in found.of(name) if not row.failure]
        good = [k for k, row in enumerate(rows) if all(each.settled and each.bound <= wanted for each in rows[k:])]
        if not good:
            least = min((row.bound for row in rows), default=float("inf")) / found.thermal
            said.append(
                f"{found.label(name)}: error {least:.2g} at its best step; shorter steps or a longer time may do"
            )
            continue
        row, dt = rows[good[0]], rows[good[0]].dt
        if good[0] > 0:
            dt = min(dt * sqrt(wanted / row.bound), 0.99 * rows[good[0] - 1].dt)
        steps = ceil(length / dt)
        evaluations = steps * max(INTEGRATORS[name.split()[0]].evaluations, 1)
        seconds, error = row.seconds / max(row.steps, 1) * steps, row.bound * (dt / row.dt) ** 2 / found.thermal
        choices.append(Choice(name, float(f"{dt:.3g}"), steps, None, None, error, evaluations, seconds))
        said.append(f"{found.label(name)}: at dt = {row.dt:.4g} the error is {row.potential / found.thermal:+.1e} "
                    f"± {row.potential_error / found.thermal:.1e}")  # fmt: skip
    choices.sort(key=lambda choice: choice.evaluations)
    refusal = None if choices else "no method reaches the wanted accuracy at the steps that were tried"
    return SamplingAdvice(accuracy, length, 0.0, 1.0, choices[0] if choices else None, tuple(choices[1:]), refusal,
                          tuple(said))  # fmt: skip


def _of(unit: str) -> str:
    return f" ({unit})" if unit else ""


def _cells(row: SamplingRow, label: str) -> list[str]:
    if row.failure:
        return [label, f"{row.dt:.4g}", row.failure, *["–"] * 5]
    pairs = (
        (row.potential, row.potential_error), (row.kinetic, row.kinetic_error), (row.pressure, row.pressure_error)
    )  # fmt: skip
    cells = ["–" if not isfinite(value) else f"{value:+.5f} ± {error:.5f}" for value, error in pairs]
    gain = "–" if row.gain is None else f"{row.gain:.0f}"
    stretch = f"{row.stretch:.3g}" + ("" if row.settled else " *")
    return [label, f"{row.dt:.4g}", *cells, stretch, str(row.stretches), gain]


def _slope(rows: list[SamplingRow]) -> float | None:
    """Slope of the resolved errors, weighted by their precision."""
    good = [row for row in rows if not row.failure and abs(row.potential) > RESOLVED * row.potential_error > 0]
    if len(good) < 2:
        return None
    weights = [abs(row.potential) / row.potential_error for row in good]
    return float(np.polyfit([log(row.dt) for row in good], [log(abs(row.potential)) for row in good], 1, w=weights)[0])


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
