"""Work against precision: the error of each integrator over a ladder of steps or tolerances, and what it cost."""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from math import log10
from time import perf_counter
from typing import Any

import numpy as np

from kickdrift.analysis.bench import processor
from kickdrift.analysis.ladder import Bench, Row
from kickdrift.analysis.pilot import OutOfTime, Subject, follow, state_at
from kickdrift.analysis.reference import is_stiff, reference, scout_method, tolerances
from kickdrift.errors import InputError
from kickdrift.forces.bound import check_threads
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import Integrator, method_of, refuse_unknown, takers_text, unpacked
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

SPLITTINGS = ("velocity-verlet", "forest-ruth", "pefrl", "blanes-moan4", "yoshida6", "blanes-moan6", "yoshida8")
EXPLICIT = ("midpoint", "rk4", "bogacki-shampine23", "dormand-prince45", "dop853")
STIFF = ("bdf", "radau", "rosenbrock", "lsoda", "dormand-prince45")
BESIDE_SPLITTINGS = ("rk4", "dormand-prince45", "dop853", "gauss-radau15")
BUDGET = 60.0  # seconds that a comparison should take, without compiling
ANY_STEP = 1e-3
LADDERED = ("dt", "rtol", "atol", "precision")  # what a comparison sets itself
LEAST_LIMIT = 10.0  # seconds that a reference run may take at least
LOOSE = 1e-3  # rtol of the run that tells how many evaluations the problem takes at the coarse end
FINEST, FINEST_ADAPTIVE, FINEST_ENERGY = 64, 8, 4  # times these evaluations, that the length of a pilot leaves time for
SAMPLES = (
    251,
    127,
    61,
    31,
    13,
    7,
)  # primes: a whole number of periods between samples would hide the errors in between
SAMPLES_ENERGY = 127

Progress = Callable[[int, int], Any]


@dataclass(frozen=True)
class Comparison:
    """What was measured of a System or Problem.

    Attributes
    ----------
    system : its name
    measure : "closed form", "reference" or "energy"
    reference : the same in words
    reference_error : no error below is believed
    lyapunov : rate at which neighbouring solutions part, 0 where they do not exponentially
    length : of the pilot, in the system's unit of time
    whole : of the run that the file, or the user, has in mind
    cycles : how often the solution came round in the pilot; 0 where it does not
    samples : at which the error was looked at
    rows : by method, from coarse to fine
    slopes : by method, of the global and the local error against the step, None where too few points show it
    notes : what the user should know of the choices
    """

    system: str
    measure: str
    reference: str
    reference_error: float
    lyapunov: float
    length: float
    whole: float
    cycles: float
    samples: int
    time_unit: str
    threads: int
    rows: tuple[Row, ...]
    slopes: dict[str, tuple[float | None, float | None]]
    notes: tuple[str, ...] = ()
    wall_seconds: float = field(default=0.0, compare=False)

    @property
    def methods(self) -> list[str]:
        """In the order of the rows."""
        return list(dict.fromkeys(row.method for row in self.rows))

    def of(self, method: str) -> list[Row]:
        """A method's rows, from coarse to fine."""
        return [row for row in self.rows if row.method == method]

    def as_json(self) -> dict[str, Any]:
        """The comparison as one object, with what it ran on."""
        return {
            **{key: value for key, value in vars(self).items() if key not in ("rows", "slopes")},
            "versions": {name: version(name) for name in ("kickdrift", "numpy", "numba", "scipy")}
            | {"python": platform.python_version()},
            "processor": processor(),
            "slopes": {name: {"global": pair[0], "local": pair[1]} for name, pair in self.slopes.items()},
            "rows": [row.as_json() for row in self.rows],
        }


def work_precision(
    subject: Subject,
    integrators: Sequence[str | Integrator] | None = None,
    time: float | None = None,
    *,
    whole: float | None = None,
    accuracy: float | None = None,
    start: Any = None,
    threads: int = 1,
    options: Mapping[str, Any] | None = None,
    budget: float = BUDGET,
    progress: Progress | None = None,
) -> Comparison:
    """Run each integrator over a ladder of steps or tolerances, from where it blows up to where the reference's own
    error, the wanted ``accuracy`` or the time it is given is reached.

    Parameters
    ----------
    subject : System or Problem
    integrators : names, or values that ``kickdrift.integrator`` makes; default a choice that suits the subject
    time : length of the pilot runs; default what the ``budget`` leaves time for, at most ``whole``
    whole : length of the run in mind; default the file's
    accuracy : the error wanted: finer runs than a tenth of it, over the whole length, are spared
    start : a State to start from, default the subject's own
    options : for those of the methods that take them
    budget : seconds for all of it, without compiling

    Raises
    ------
    InputError
        Where an argument makes no sense.
    RunError
        Where there is no reference and no energy.
    """
    methods = chosen(subject, integrators, options)
    check_arguments(time, whole, accuracy, threads)
    began = perf_counter()
    start = start if start is not None else subject.state
    whole = whole or file_length(subject) or time
    if whole is None:
        raise InputError(f"compare: {subject.name} has no length in [run]; give a time")
    asked = time or whole
    stiff = is_stiff(subject, start, asked)
    scout, reached = _scout(subject, start, asked, stiff, threads, limit=budget / 20)
    if not stiff and is_stiff(subject, reached, asked):  # it need not be so at the start
        stiff = True
        scout, _ = _scout(subject, start, asked, stiff, threads, limit=budget / 20)
    methods = methods or chosen(subject, default_integrators(subject, stiff), options)
    share = 0.75 * budget / len(methods)
    length, notes = asked, []
    if time is None:
        length = min(asked, _affordable(scout, share, FINEST_ADAPTIVE if stiff else FINEST))
    # Two runs at a moderate tolerance, three times as dear as the scout's, in a tenth of the time.
    probe = min(asked, max(length, 0.1 * budget / (6 * scout[0] * scout[2])))
    plan = reference(
        subject,
        start,
        length,
        whole,
        _samples(scout, length),
        stiff,
        threads,
        limit=max(budget / 5, LEAST_LIMIT),
        probe=probe,
    )
    if plan.measure == "energy":
        if time is None:
            length = min(asked, _affordable(scout, share, FINEST_ENERGY))
        samples = SAMPLES_ENERGY
    else:
        length, samples = plan.length, _samples(scout, plan.length) if plan.y is None else len(plan.y) - 1
    if length < whole:
        notes.append(f"pilot runs of {length:.4g}, not of {whole:.4g}")
    wanted = accuracy and accuracy * min(1.0, length / whole) ** 2  # errors may grow as the square of the time
    bench = Bench(subject, start, plan, length, samples, scout[0] * length, wanted, threads, share, stiff)
    rows: list[Row] = []
    for index, each in enumerate(methods):
        rows += bench.ladder(each, partial(_part, progress, index, len(methods)))
    names = [str(each) for each in methods]
    return Comparison(
        system=subject.name,
        measure=plan.measure,
        reference=plan.text,
        reference_error=plan.error,
        lyapunov=plan.lyapunov,
        length=length,
        whole=whole,
        cycles=bench.cycles(),
        samples=samples,
        time_unit=subject.units.time if isinstance(subject, System) and subject.units.time != "time" else "",
        threads=threads,
        rows=tuple(rows),
        slopes={name: bench.slopes([row for row in rows if row.method == name], plan.error) for name in names},
        notes=(*plan.notes, *notes),
        wall_seconds=perf_counter() - began,
    )


def check_arguments(time: float | None, length: float | None, accuracy: float | None, threads: int = 1) -> None:
    """Refuse a time, length or accuracy that is no positive number, and more threads than there are."""
    check_threads(threads)
    for key, value in (("time", time), ("length", length), ("accuracy", accuracy)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"compare: {key} must be a positive finite number, got {value!r}")


def equilibrated(subject: Subject, threads: int, bar: Callable[[str], Progress] | None = None) -> Any:
    """Where the runs start: after the equilibration that the file asks for, with velocity Verlet."""
    if not (isinstance(subject, System) and subject.equilibration):
        return subject.state
    wanted = subject.equilibration
    sim = Simulation(subject, "velocity-verlet", threads=threads)
    sim.equilibrate(wanted.temperature, wanted.time, wanted.interval, bar and bar("equilibrating"))
    return sim.state


def chosen(
    subject: Subject, integrators: Sequence[str | Integrator] | None, options: Mapping[str, Any] | None = None
) -> list[Integrator]:
    """The methods asked for, each known and able to run the subject, with those of the ``options`` that it takes; none
    twice."""
    found: list[Integrator] = []
    refuse_unknown(options or ())
    for each in integrators or ():
        method, own = method_of(each), unpacked(each, {})[1]
        taken = {key: value for key, value in (options or {}).items() if key in method.tunable}
        value = Integrator(method.name, taken | own)
        if value not in found:
            found.append(value)
    for key in {*(options or {}), *(key for each in found for key in each.options)}:
        if key in LADDERED:
            raise InputError(f"{key}: compare sets it: it runs steps and tolerances from coarse to fine, in float64")
        if found and not any(key in each.options for each in found):
            raise InputError(f"{key}: {' or '.join(map(str, found))} does not take it; {takers_text(key)} it")
    for each in found:
        Simulation(subject, each, dt=ANY_STEP)  # which says what the method cannot do
    return found


def default_integrators(subject: Subject, stiff: bool) -> list[str]:
    """Methods that suit the subject: splittings of orders 2 to 8 where the accelerations depend on positions alone,
    explicit Runge-Kutta methods, and for stiff problems implicit ones."""
    names: Sequence[str] = STIFF if stiff else (*SPLITTINGS, *BESIDE_SPLITTINGS) if _separable(subject) else EXPLICIT
    if isinstance(subject, System) and len(subject) > 64:
        names = [name for name in names if name not in ("yoshida8", "dormand-prince45", "gauss-radau15")]
    return [name for name in names if name in INTEGRATORS]


def file_length(subject: Subject) -> float | None:
    """How long the run is that the file has in mind, if any."""
    run = subject.run
    if run.time is not None:
        return float(run.time)
    if run.steps is not None and run.dt is not None:
        return float(run.steps * run.dt)
    return None


def _part(progress: Progress | None, index: int, of: int, percent: int) -> None:
    if progress:
        progress(index * 100 + percent, of * 100)


def _separable(subject: Subject) -> bool:
    if isinstance(subject, System):
        return not any(getattr(force, "velocity_dependent", False) for force in subject.forces)
    return subject.separable


def _scout(
    subject: Subject, start: Any, length: float, stiff: bool, threads: int, limit: float
) -> tuple[tuple[float, float, float], Any]:
    """Evaluations and steps per unit of time at a loose tolerance, and seconds per evaluation; the state that was
    reached."""
    name = scout_method(stiff)
    run = tolerances(subject, start, LOOSE, name)
    for _ in range(2):  # the first run also loads what was compiled
        try:
            track = follow(subject, start, name, length, 7, threads=threads, limit=limit, **run)
            found = track.evaluations / length, track.steps / length, track.seconds / track.evaluations
            last, time = track.y[-1], length
        except OutOfTime as end:
            reached = max(end.time, 1e-300)
            found = end.evaluations / reached, end.evaluations / 12 / reached, end.seconds / max(end.evaluations, 1)
            last, time = end.y, end.time
    return found, state_at(start, last, start.time + time)


def _affordable(scout: tuple[float, float, float], share: float, finest: int) -> float:
    """A length whose finest rung takes a third of a method's time, since each rung takes twice the one before; to two
    digits."""
    rate, _, seconds = scout
    length = share / (3 * finest * rate * seconds)
    digits = 1 - int(np.floor(log10(length)))
    return float(np.floor(length * 10**digits) / 10**digits) if abs(digits) < 300 else length


def _samples(scout: tuple[float, float, float], length: float) -> int:
    """As many samples as the coarsest rungs have steps, roughly."""
    steps = scout[1] * length * 1.5
    return next((count for count in SAMPLES if count <= steps), SAMPLES[-1])
