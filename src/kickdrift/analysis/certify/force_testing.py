"""`force_checks`: whether forces are safe for dynamics."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from math import isnan, nan
from time import perf_counter
from typing import Any

import numpy as np

from kickdrift.analysis.certify import force_tests
from kickdrift.analysis.certify.certificate import FAIL, PASS, ForceCheck, ForceChecks, judged, skipped
from kickdrift.analysis.certify.force_tests import WHERE, Evaluator, Jump, jump_along, nearest_distances, tested_states
from kickdrift.display.showing import following
from kickdrift.errors import InputError, RunError
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.group import ListedForce
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.step_choice.step_length import MOST, fastest
from kickdrift.model.checks.values import positive, whole_number
from kickdrift.model.nearness import pairs_nearer
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.report.report import Report
from kickdrift.run.simulation import Simulation
from kickdrift.text import measured, shown

SMOOTH, BACK, DRIFT = "smoothness", "time reversal", "energy drift"
STATES, PART = 3, 0.05  # tested positions, and their displacement in nearest distances
LINES, LINE = 3, 0.25  # lines along which one particle moves, and their length in nearest distances
STEPS = 2000  # of the run whose energy is tested
REVERSED, RETURN = 50, 1e-8  # steps forwards and back, and the bound of the distance from the start
ON_CUTOFF = 1e-4  # relative distance from the cutoff of a shell that lies there
PERIODS = 40  # steps in a period of the fastest oscillation, where no dt is known
SURE = 2.0  # times the 95 % interval that a drift must exceed
STAGES = 6


def force_checks(
    subject: System | Any,
    *,
    engine: str | None = None,
    dt: float | None = None,
    steps: int = STEPS,
    threads: int = 1,
    seed: int = 0,
    progress: bool | Callable[[int, int], Any] | None = None,
) -> ForceChecks:
    """Test whether forces are safe for dynamics; a `ForceChecks`, one page with a verdict for each line.

    The tests are: the force as slope of the energy; the digits of the energy; sums of forces and torques; translation,
    periodic images, rotation and the exchange of like particles; jumps of the energy and the force; the virial as slope
    of the energy over the volume; the same bits on repetition; a run forwards and back in time; and the drift of the
    energy of a run at constant energy, with its 95 % interval.

    A force may state its error, as Ewald's sum does by ``accuracy``. This error is then the bound of a test that exact
    forces pass to rounding. The forces that state none are tested alone, too, with the bounds of exact forces.

    Tests that make no sense for these forces are on the page as "not tested", with the reason. Forces that depend on
    velocity or do work have no energy to test.

    Parameters
    ----------
    subject : System with any forces, ASE Atoms with a calculator, or a pair force
        A pair force is tested on 256 particles of a crystal with a nearest distance of 0.42 cutoffs.
    engine : test the forces of this program in place of kickdrift's
    dt : step of the two runs; default the system file's, or 1/40 of the period of the fastest oscillation
    steps : steps of the run at constant energy
    threads : number of threads
    seed : seed of the random positions, directions and orders
    progress : True shows a bar; a function is called as ``progress(done, of)``

    Raises
    ------
    InputError
        For a system without forces or particles, and for an engine that cannot run the system.
    RunError
        For forces that are not finite at positions near the system's own.
    """
    system = _system(subject)
    if not (len(system) and system.forces):
        raise InputError(f"force_checks: {system.name} has no {'forces' if len(system) else 'particles'}")
    steps = whole_number("steps", steps, 100)
    if dt is not None:
        positive("dt", dt)
    began, system = perf_counter(), system.watched(())
    evaluate = Evaluator(system, engine, threads)
    rng = np.random.default_rng(seed)
    curves: dict[str, Floats] = {}
    rows: list[ForceCheck] = []
    working = sorted({*system.acting("velocity_dependent"), *system.acting("works")})
    with following(progress, "testing") as bar:
        told = bar or (lambda done, of: None)
        states = tested_states(evaluate, STATES, PART, rng)
        given = force_tests.Subject(
            evaluate,
            states,
            evaluate(states[0]),
            nearest_distances(system),
            rng,
            tuple(system.acting("external")),
            _listed(system),
            **_stated(evaluate, states, seed),
        )
        stages = _stages(given, working, curves, dt, steps, engine, threads)
        for done, found in enumerate(stages, 1):
            rows += found
            told(min(done, STAGES), STAGES)
    notes = tuple(shell_notes(system))
    return ForceChecks(system.name, tuple(rows), evaluate.calls, perf_counter() - began, notes, curves)


def _stated(evaluate: Evaluator, states: list[Floats], seed: int) -> dict[str, Any]:
    """The largest error that forces state, the names of these forces, and the other forces alone, for a Subject."""
    system = evaluate.system
    errors = [force.stated_error() if hasattr(force, "stated_error") else 0.0 for force in system.forces]
    stating = tuple(force.name for force, error in zip(system.forces, errors, strict=True) if error)
    others = [force for force, error in zip(system.forces, errors, strict=True) if not error]
    if not stating or not others:
        return {"stated": max(errors), "stating": stating}
    alone = evaluate.another(system.remade(forces=others))
    exact = force_tests.Subject(
        alone,
        states,
        alone(states[0]),
        nearest_distances(system),
        np.random.default_rng(seed),
        tuple(alone.system.acting("external")),
        _listed(alone.system),
    )
    return {"stated": max(errors), "stating": stating, "exact": exact}


Tests = Callable[[force_tests.Subject], Iterable[ForceCheck]]


def _apart(given: force_tests.Subject, tests: Tests) -> Iterator[ForceCheck]:
    """Rows of these tests. Forces that state no error are tested alone, too, and a row that they fail is theirs."""
    rows, stating = list(tests(given)), ", ".join(given.stating)
    alone = {row.test: row for row in tests(given.exact)} if given.exact is not None else {}
    for row in rows:
        other = alone.get(row.test, row)
        if (row.verdict, other.verdict) == (PASS, FAIL):
            yield replace(other, remark="; ".join(filter(None, [f"without {stating}", other.remark])))
        elif stating and row.bound == given.stated:
            yield replace(row, remark="; ".join(filter(None, [f"the bound is the error of {stating}", row.remark])))
        else:
            yield row


def shell_notes(system: System) -> Iterator[str]:
    """A line for each force whose cutoff lies on a shell of neighbours of the System's crystal."""
    for force in system.forces:
        cutoff = getattr(force, "cutoff", None)
        if not isinstance(force, ListedForce) or not cutoff:
            continue
        x = system.state.positions
        most = 0.5 * float(system.box.heights.min()) if system.box.periodic else np.inf
        first, second = pairs_nearer(x, system.box, min(cutoff * (1.0 + ON_CUTOFF), most)).T
        r = np.sort(np.linalg.norm(system.box.minimum_image(x[first] - x[second]), axis=1))
        shells = 1 + np.count_nonzero(np.diff(r) > 2.0 * ON_CUTOFF * cutoff)
        there = int((np.abs(r - cutoff) <= ON_CUTOFF * cutoff).sum())
        if 2 * there >= len(system):
            yield (
                f"{force.name}: its cutoff, {cutoff:.6g}, lies on shell {shells} of the neighbours ({there} pairs), "
                "so energies may jump under small strains"
            )


def _system(subject: Any) -> System:
    """The System whose forces are tested."""
    if isinstance(subject, System):
        return subject
    if isinstance(subject, PairForce):
        cell = 0.42 * float(subject.cutoff or 1.0) * 2**0.5
        corners = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
        places = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
        positions = cell * (places + corners).reshape(-1, 3)
        kinds = list(subject.names) or None
        species = None if kinds is None else [kinds[k % len(kinds)] for k in range(len(positions))]
        return System(
            positions,
            np.zeros_like(positions),
            box=3 * [4 * cell],
            forces=[subject],
            species=species,
            name=subject.name,
        )
    if hasattr(subject, "get_positions") and hasattr(subject, "calc"):
        return System.from_ase(subject)
    raise InputError(
        f"force_checks: expected a System, a pair force or ASE Atoms with a calculator, got {shown(subject)}"
    )


def _stages(
    given: force_tests.Subject,
    working: list[str],
    curves: dict[str, Floats],
    dt: float | None,
    steps: int,
    engine: str | None,
    threads: int,
) -> Iterator[list[ForceCheck]]:
    why = f"{', '.join(working)} has no potential energy"
    if working:
        yield [skipped(force_tests.SLOPE, why), skipped(force_tests.NOISE, why)]
    else:
        rows, curves["error of the force"] = force_tests.slope_tests(given)
        yield rows
    yield [*_apart(given, force_tests.sum_tests), *_apart(given, force_tests.symmetry_tests)]
    yield [skipped(SMOOTH, why)] if working else [*_apart(given, lambda of: [_smoothness(of, curves)])]
    virial = [skipped(force_tests.VIRIAL, why)] if working else _apart(given, lambda of: [force_tests.virial_test(of)])
    yield [*virial, force_tests.bits_test(given)]
    if working:
        yield [skipped(BACK, why), skipped(DRIFT, why)]
        return
    if engine is not None:
        because = f"the run of {engine} has its own integrator; see kd.compare"
        yield [skipped(BACK, because), skipped(DRIFT, because)]
        return
    step = dt or given.evaluate.system.run.dt or _step(given.evaluate.system)
    if step is None:
        yield [skipped(each, "no step is known; give dt") for each in (BACK, DRIFT)]
        return
    yield [_reversal(given, step, threads)]
    yield [_drift(given, step, steps, threads, curves)]


def _listed(system: System) -> tuple[str, ...]:
    """Names of the forces on listed particles. Like particles are then not exchangeable."""
    scaled = system.topology is not None and len(system.topology.scaled.pairs) > 0
    sites = system.virtual_sites is not None
    return (*system.acting("joins"), *(["topology"] if scaled else []), *(["virtual_site"] if sites else []))


def _smoothness(given: force_tests.Subject, curves: dict[str, Floats]) -> ForceCheck:
    """The strongest jump along lines on which one particle moves."""
    worst: Jump | None = None
    free = np.flatnonzero(given.evaluate.system.state.masses > 0)
    flat = np.array([1.0, 1.0, float(given.evaluate.system.dimensions == 3)])
    for k in range(LINES if free.size else 0):
        x, i = given.states[k % len(given.states)], int(given.rng.choice(free))
        u = given.rng.standard_normal(3) * flat
        u /= np.linalg.norm(u)

        def values(s: float, x: Floats = x, i: int = i, u: Floats = u) -> tuple[float, float]:
            y = x.copy()
            y[i] += s * u
            at = given.evaluate(y)
            return at.energy, float(at.forces[i] @ u)

        length = LINE * float(given.near[i])
        try:
            found = jump_along(values, length)
        except RunError as error:
            return skipped(SMOOTH, str(error))
        if worst is None or (found is not None and found.derivative < worst.derivative):
            worst = found
        if "energy" not in curves:
            s = np.linspace(0.0, length, 101)
            line = np.array([values(float(each)) for each in s]).T
            curves["energy"], curves["force"] = np.array([s, line[0]]), np.array([s, line[1]])
    if worst is None:
        return ForceCheck(SMOOTH, None, None, PASS, "no jump up to the curvature of the force")
    what, kept = WHERE[worst.derivative], f"no method keeps more than order {worst.derivative}"
    bound = given.stated * force_tests.rms(given.first.forces) * float(given.near.mean()) or None
    small = bound is not None and worst.derivative == 0 and worst.size < bound
    if small:
        kept = "less than the stated error of the forces allows"
    elif worst.derivative == 0:
        kept = "no method conserves the energy"
    remark = f"the {what} jumps by {worst.size:.2g}, as at a cutoff: {kept}"
    bound = bound if worst.derivative == 0 else None
    return ForceCheck(SMOOTH, worst.size, bound, PASS if worst.derivative or small else FAIL, remark)


def _start(given: force_tests.Subject) -> Floats:
    """Start (2, 3, n) of a run: the system's own, or the first tested positions if nothing moves at its own."""
    phase = given.evaluate.system.state.phase
    return phase if phase[1].any() else np.array([given.states[0].T, phase[1]])


def _reversal(given: force_tests.Subject, dt: float, threads: int) -> ForceCheck:
    """Distance from the start after steps forwards and back."""
    system = given.evaluate.system
    if system.acting("time_dependent"):
        return skipped(BACK, f"{', '.join(system.acting('time_dependent'))} depends on time")
    sim = Simulation(system.at(_start(given), 0.0), "velocity-verlet", dt=dt, threads=threads)
    start = sim.state.phase  # with constraints, projected
    try:
        sim.advance(REVERSED)
        turned = sim.state.phase * np.array([1.0, -1.0])[:, None, None]
        back = Simulation(system.at(turned, 0.0), "velocity-verlet", dt=dt, threads=threads)
        back.advance(REVERSED)
    except RunError as error:
        return ForceCheck(BACK, nan, RETURN, FAIL, str(error))
    off = float((np.abs(back.state.phase[0] - start[0]) / given.near).max())
    return judged(BACK, off, RETURN, f"velocity Verlet, {REVERSED} steps forwards and back, in nearest distances")


def _drift(given: force_tests.Subject, dt: float, steps: int, threads: int, curves: dict[str, Floats]) -> ForceCheck:
    """Drift of the energy of a run at constant energy, per particle and unit of time.

    A drift that falls with the step is an error of the step. Else it is an error of the forces."""
    system = given.evaluate.system
    unit, time = system.units.symbol("energy"), system.units.symbol("time") or "unit of time"
    try:
        report, slope, error = _energy_run(given, dt, steps, threads)
        series = report.about.series
        curves["energy of a run"] = np.array([series.times, series.total])
        assert report.energy is not None
        verdict = report.energy.verdict
        bad = isnan(slope) or (verdict == "secular drift" and abs(slope) > SURE * error)
        if bad and abs(_energy_run(given, dt / 2, 2 * steps, threads)[1]) < abs(slope) / 2:
            bad, verdict = False, "falls with the step, so it is an error of the step"
    except RunError as trouble:
        return ForceCheck(DRIFT, nan, None, FAIL, str(trouble))
    rate = measured("", unit)
    remark = f"{slope:+.1e} ± {error:.1e}{rate} per particle and {time}, dt = {dt:.3g}: {verdict}"
    return ForceCheck(DRIFT, abs(slope), None, FAIL if bad else PASS, remark)


def _energy_run(given: force_tests.Subject, dt: float, steps: int, threads: int) -> tuple[Report, float, float]:
    """Report of a run at constant energy, and the drift per particle with its 95 % interval."""
    system = given.evaluate.system
    sim = Simulation(system.at(_start(given), 0.0), "velocity-verlet", dt=dt, threads=threads)
    sim.advance(steps // 5)  # the error of a step grows to its size in the first steps
    report = sim.run(steps - steps // 5, every=max(1, steps // 500))
    found = report.energy
    assert found is not None
    scale = (abs(found.initial) or 1.0) / len(system)
    return report, found.drift_per_unit_time * scale, found.drift_error * scale


def _step(system: System) -> float | None:
    """A step for systems without one: a part of the period of the fastest oscillation; None if none is known."""
    if len(system) > MOST:
        return None
    state = system.state
    omega = fastest(ParticleFlow(system, 1, True), state.time, state.phase)
    return 2 * np.pi / omega / PERIODS if omega > 0 else None
