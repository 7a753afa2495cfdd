"""Work against precision: the methods that a comparison runs, and the error of each over a ladder, with its cost."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import log10
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.compare.comparison import Comparison as Comparison
from kickdrift.analysis.compare.ladder import Bench, Row
from kickdrift.analysis.compare.pilot import OutOfTime, Subject, follow, resonance, state_at
from kickdrift.analysis.compare.reference import fineness, is_held, is_stiff, loose_method, reference
from kickdrift.errors import InputError
from kickdrift.forces.bound.forces import check_threads
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import Integrator, method_of, refuse_unknown, takers_text, unpacked
from kickdrift.model.system import System
from kickdrift.run.simulation import Simulation

SPLITTINGS = ("velocity-verlet", "forest-ruth", "pefrl", "blanes-moan4", "yoshida6", "blanes-moan6", "yoshida8")
EXPLICIT = ("midpoint", "rk4", "bogacki-shampine23", "dormand-prince45", "dop853")
STIFF = ("bdf", "radau", "rosenbrock", "lsoda", "dormand-prince45")
HELD = ("velocity-verlet", "leapfrog-dkd", "yoshida4", "yoshida6")  # that keep constraints
BESIDE_SPLITTINGS = ("rk4", "dormand-prince45", "dop853", "gauss-radau15")
ANY_STEP = 1e-3
SUBSTEPS = (2, 4, 8, 16)  # splits that a comparison tries of forces in groups
LADDERED = ("dt", "rtol", "atol", "precision")  # options that a comparison sets itself
BUDGET = 60.0  # seconds of a comparison, without compiling
LEAST_LIMIT = 10.0  # least time limit of a reference run, in seconds
LOOSE = 1e-3  # rtol of the run that estimates the cost
FINEST, FINEST_ADAPTIVE, FINEST_ENERGY = 64, 8, 4  # evaluations of the finest affordable run over those of this run
SAMPLES = 251, 127, 61, 31, 13, 7  # primes: a whole number of periods between samples would hide errors in between
SAMPLES_ENERGY = 127
Progress = Callable[[int, int], Any]


def chosen_methods(
    subject: Subject, integrators: Sequence[str | Integrator] | None, options: Mapping[str, Any] | None = None
) -> list[Integrator]:
    """Requested methods without duplicates, each with the ``options`` that it takes.

    Raises InputError for a method that is unknown or cannot run the subject, and for an option that no method takes.
    """
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
        Simulation(subject, each, dt=ANY_STEP)  # raises an InputError for a method that cannot run the subject
    return found


def check_reference(subject: Subject) -> None:
    """Refuse a System that no method for a reference can move, and constraints without a step."""
    if is_held(subject) and subject.run.dt is None:
        raise InputError(
            f"compare: {subject.name} has no dt in [run], and no method that keeps constraints chooses its step"
        )
    if isinstance(subject, System):
        name = loose_method(subject, False)
        try:
            Simulation(subject, name, dt=ANY_STEP if is_held(subject) else None, precision="double")
        except InputError as error:
            raise InputError(f"compare: its reference, {str(error).replace(f'{name}: ', f'{name}, ', 1)}") from None


def have_baths(integrators: Sequence[str | Integrator] | None) -> bool:
    """Whether all of these methods have a heat bath. Raises InputError if only some have."""
    methods = [method_of(each) for each in integrators or ()]
    bathed = [method.name for method in methods if method.bath]
    if bathed and len(bathed) < len(methods):
        other = next(method.name for method in methods if not method.bath)
        raise InputError(
            f"compare: {bathed[0]} has a heat bath and {other} has none; compare them apart: paths with noise are "
            "compared by their means, others by their errors"
        )
    return bool(bathed)


def default_integrators(subject: Subject, stiff: bool) -> list[str | Integrator]:
    """Methods that suit the subject.

    Splittings of orders 2 to 8 suit accelerations that depend on positions alone, explicit Runge-Kutta methods other
    equations, and implicit methods stiff ones. Forces in groups are tried with several splits of ``respa`` too.
    """
    if is_held(subject):
        return list(HELD)
    names: Sequence[str] = STIFF if stiff else (*SPLITTINGS, *BESIDE_SPLITTINGS) if _separable(subject) else EXPLICIT
    if isinstance(subject, System) and len(subject) > 64:
        names = [name for name in names if name not in ("yoshida8", "dormand-prince45", "gauss-radau15")]
    splits = [Integrator("respa", {"substeps": each}) for each in SUBSTEPS] if grouped(subject) else []
    return [*(name for name in names if name in INTEGRATORS), *splits]


def grouped(subject: Subject) -> bool:
    """Whether the forces of a System are in more than one group."""
    return isinstance(subject, System) and len({getattr(force, "group", 0) for force in subject.forces}) > 1


def _separable(subject: Subject) -> bool:
    if isinstance(subject, System):
        return not any(getattr(force, "velocity_dependent", False) for force in subject.forces)
    return subject.separable


class Cost(NamedTuple):
    """Estimated cost of a solution at a loose tolerance."""

    evaluations: float  # per unit of time
    steps: float  # per unit of time
    seconds: float  # per evaluation


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
    """Run each integrator over a ladder of steps or tolerances, from a blow-up to ever finer runs.

    The ladder ends at the reference's own error, at the wanted ``accuracy``, or at the end of the method's time.

    Parameters
    ----------
    subject : System or Problem
    integrators : names, or values of ``kickdrift.integrator``; default a choice that suits the subject
    time : length of the pilot runs; default the length that the ``budget`` allows, at most ``whole``
    whole : length of the intended run; default the file's
    accuracy : wanted error over the whole length; the ladder ends at a tenth of it
    start : State of the start, default the subject's own
    options : options for the methods that take them
    budget : seconds of the comparison, without compiling

    Raises
    ------
    InputError
        For an argument that makes no sense.
    RunError
        For a subject with neither a reference nor an energy.
    """
    methods = chosen_methods(subject, integrators, options)
    check_arguments(time, whole, accuracy, threads)
    began = perf_counter()
    start = start if start is not None else subject.state
    whole = whole or file_length(subject) or time
    if whole is None:
        raise InputError(f"compare: {subject.name} has no length in [run]; give a time")
    asked = time or whole
    stiff = is_stiff(subject, start, asked)
    cost, reached = _cost(subject, start, asked, stiff, threads, limit=budget / 20)
    if not stiff and is_stiff(subject, reached, asked):  # a problem can become stiff after its start
        stiff = True
        cost, _ = _cost(subject, start, asked, stiff, threads, limit=budget / 20)
    methods = methods or chosen_methods(subject, default_integrators(subject, stiff), options)
    share = 0.75 * budget / len(methods)
    length, notes = asked, []
    if time is None:
        length = min(asked, _affordable_length(cost, share, FINEST_ADAPTIVE if stiff else FINEST))
    # Two runs at a moderate tolerance, three times as expensive as at the loose one, take a tenth of the time.
    probe = min(asked, max(length, 0.1 * budget / (6 * cost.evaluations * cost.seconds)))
    plan = reference(
        subject,
        start,
        length,
        whole,
        _sample_count(cost, length),
        stiff,
        threads,
        limit=max(budget / 5, LEAST_LIMIT),
        probe=probe,
    )
    if plan.measure == "energy":
        if time is None:
            length = min(asked, _affordable_length(cost, share, FINEST_ENERGY))
        samples = SAMPLES_ENERGY
    else:
        length, samples = plan.length, _sample_count(cost, plan.length) if plan.y is None else len(plan.y) - 1
    if length < whole:
        notes.append(f"pilot runs of {length:.4g}, not of {whole:.4g}")
    if any(getattr(each.method, "groups", 0) for each in methods):
        notes += resonance(subject, start)
    wanted = accuracy and accuracy * min(1.0, length / whole) ** 2  # errors may grow as the square of the time
    bench = Bench(subject, start, plan, length, samples, cost.evaluations * length, wanted, threads, share, stiff)
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
        time_unit=subject.units.time if isinstance(subject, System) and subject.units.symbol("time") else "",
        threads=threads,
        rows=tuple(rows),
        slopes={name: bench.slopes([row for row in rows if row.method == name], plan.error) for name in names},
        notes=(*plan.notes, *notes),
        begin=float(start.time),
        wall_seconds=perf_counter() - began,
    )


def check_arguments(time: float | None, length: float | None, accuracy: float | None, threads: int = 1) -> None:
    """Refuse a time, length or accuracy that is no positive number, and more threads than there are."""
    check_threads(threads)
    for key, value in (("time", time), ("length", length), ("accuracy", accuracy)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(f"compare: {key} must be a positive finite number, got {value!r}")


def equilibrated(subject: Subject, threads: int, bar: Callable[[str], Progress] | None = None) -> Any:
    """State after the equilibration that the file asks for, with velocity Verlet; else the subject's own."""
    if not (isinstance(subject, System) and subject.equilibration):
        return subject.state
    wanted = subject.equilibration
    sim = Simulation(subject, "velocity-verlet", threads=threads)
    sim.equilibrate(**wanted.said(), progress=bar and bar("equilibrating"))
    if sim.system.box != subject.box:
        raise InputError("compare: [equilibrate] has a barostat, which changes the box; leave its pressure out")
    return sim.state


def file_length(subject: Subject) -> float | None:
    """Length of the run in the file, or None."""
    run = subject.run
    if run.time is not None:
        return float(run.time)
    if run.steps is not None and run.dt is not None:
        return float(run.steps * run.dt)
    return None


def _part(progress: Progress | None, index: int, of: int, percent: int) -> None:
    if progress:
        progress(index * 100 + percent, of * 100)


def _cost(subject: Subject, start: Any, length: float, stiff: bool, threads: int, limit: float) -> tuple[Cost, Any]:
    """Cost of a run at a loose tolerance, and its last state."""
    name = loose_method(subject, stiff)
    run = fineness(subject, start, 1.0 if is_held(subject) else LOOSE, name, length, 7)
    for _ in range(2):  # the first run also loads compiled code
        try:
            track = follow(subject, start, name, length, 7, threads=threads, limit=limit, **run)
            found = Cost(track.evaluations / length, track.steps / length, track.seconds / track.evaluations)
            last, time = track.y[-1], length
        except OutOfTime as end:
            reached = max(end.time, 1e-300)
            rate, seconds = end.evaluations / reached, end.seconds / max(end.evaluations, 1)
            found = Cost(rate, rate / 12, seconds)
            last, time = end.y, end.time
    return found, state_at(start, last, start.time + time)


def _affordable_length(cost: Cost, share: float, finest: int) -> float:
    """Length, to two digits, whose finest run takes a third of a method's time. Each run takes twice the one before."""
    length = share / (3 * finest * cost.evaluations * cost.seconds)
    digits = 1 - int(np.floor(log10(length)))
    return float(np.floor(length * 10**digits) / 10**digits) if abs(digits) < 300 else length


def _sample_count(cost: Cost, length: float) -> int:
    """Number of samples: roughly the number of steps of the coarsest runs."""
    steps = cost.steps * length * 1.5
    return next((count for count in SAMPLES if count <= steps), SAMPLES[-1])
