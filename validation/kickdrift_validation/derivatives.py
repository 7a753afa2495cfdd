"""Derivatives of a motion: are they those of other programs, and of formulas in forty digits?

Slopes of every shipped field and body law: its own formula in mpmath, differentiated there. Columns of the transition
matrix: heyoka's variational equations of three bodies. Symplectic matrices after long Wisdom-Holman runs. The time of
one more direction over that of a step. Transits of TRAPPIST-1's planets: rebound's IAS15 with bisection. Their
derivatives: differences of times in 33 digits.
"""

from collections.abc import Iterator
from time import process_time
from types import FunctionType
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.slopes.variations import varied
from kickdrift_validation.claim import Claim, at_most, claim, largest, main, not_run
from kickdrift_validation.rebounds import simulation

DAY = 1 / 365.25
MASSES = [1.0, 1e-3, 3e-4]
SIGHT = (0.0, -1.0, 0.0)  # towards the observer of TRAPPIST-1
STEP = 1e-12  # of differences in 33 digits
LAWS = {
    "harmonic-trap": kd.HarmonicTrap((1.0, 2.0, 0.5), centre=(0.1, 0.0, -0.2)),
    "uniform-field": kd.UniformField((0.0, -9.8, 1.0)),
    "driven-field": kd.DrivenField((1.0, 0.5, 0.0), frequency=0.3),
    "hill": kd.Hill(omega=0.8),
    "linear-drag": kd.LinearDrag(0.7),
    "j2": kd.Oblateness(j2=0.01, radius=0.4, j4=-1e-4, pole=(0.1, 0.2, 1.0), G=1.0),
    "relativity-1pn": kd.PostNewtonian(c=10.0, G=1.0),
    "relativity-eih": kd.EinsteinInfeldHoffmann(c=10.0, G=1.0),
    "migration": kd.Migration([0.0, 300.0, 200.0], [0.0, 90.0, 80.0], [0.0, 120.0, 100.0], G=1.0),
    "radiation-reaction": kd.RadiationReaction(c=10.0, G=1.0),
}


def claims(long: bool = False) -> Iterator[Claim]:
    yield from laws()
    yield from columns()
    yield from maps(long)
    yield from costs()
    yield from transit_times()


def planets(*forces: Any) -> kd.System:
    x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.02], [-1.4, 0.1, 0.0]]
    v = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.86, 0.05]]
    return kd.System(x, v, MASSES, forces=[kd.Gravity(G=1.0), *forces], units="nbody", names=["star", "b", "c"])


def laws() -> Iterator[Claim]:
    text = f"slopes of the accelerations of {len(LAWS)} shipped laws by duals, relative to the largest"
    bound, reference = "at most 1e-13", "each law's formula in mpmath with 40 digits, differentiated there"
    try:
        import mpmath
    except ImportError:
        yield not_run(text, bound, reference)
        return
    rng = np.random.default_rng(3)
    x, v, dx, dv = rng.normal(size=(4, 3, 3))
    errors = []
    for force in LAWS.values():
        system = kd.System(x.T, v.T, MASSES, forces=[force], units="nbody").at(np.array([x, v]), 0.4)
        made = varied(system, np.array([dx, dv]))
        found = BoundForces(made).measure(0.4, made.state.phase)
        assert found is not None
        assert not made.forces[0].differs
        with mpmath.workdps(40):
            wanted = in_mpmath(mpmath, force, system, dx, dv)
        size = float(np.abs(wanted).max()) or 1.0
        errors.append(float(np.abs(found.accelerations[:, 3:] - wanted).max()) / size)
    value = largest(*errors)
    yield claim(text, value, bound, value <= 1e-13, reference)


def in_mpmath(mpmath: Any, force: Any, system: kd.System, dx: Any, dv: Any) -> np.ndarray:
    """Slope of a law's accelerations (3, n), from the law's own code with mpmath's functions in place of math's."""
    law = _with(mpmath, force.Parameters.law)
    if hasattr(force.Parameters, "pull"):  # the formula of a law of one central body
        law.__globals__["pull"] = _with(mpmath, force.Parameters.pull)
    x, v = (np.array([[mpmath.mpf(float(value)) for value in row] for row in half]) for half in system.state.phase)
    t, masses = mpmath.mpf(system.state.time), [mpmath.mpf(float(m)) for m in system.state.masses]

    def accelerations(h: Any) -> np.ndarray:
        a, at, speed = np.full(x.shape, mpmath.mpf(0)), x + h * dx, v + h * dv
        if hasattr(force, "bound_law"):
            law(force.bound_law(system), at, speed, masses, t, a)
            return a
        p = force.Parameters(**{key: _array(value) for key, value in force.values(system).items()})
        clock = _with(mpmath, p.clock.__func__)(p, t) if hasattr(p, "clock") else t
        for i, m in enumerate(masses):
            a[:, i] = law(p, at[:, i], speed[:, i], m, clock)[1]
            if not force.per_mass:
                a[:, i] = a[:, i] / m
        return a

    h = mpmath.mpf(10) ** -10
    return np.array(((accelerations(h) - accelerations(-h)) / (2 * h)).tolist(), dtype=float)


def _with(mpmath: Any, function: Any) -> Any:
    return FunctionType(function.__code__, {**function.__globals__, "math": mpmath})


def _array(value: Any) -> Any:
    return np.array(value) if isinstance(value, tuple) else value


def columns() -> Iterator[Claim]:
    text = "transition matrix of three bodies after 5 units of time, relative to its largest element"
    bound, reference = "at most 1e-11", "heyoka's variational equations"
    try:
        import heyoka
    except ImportError:
        yield not_run(text, bound, reference, "pip install heyoka")
        return
    system = planets()
    start = np.concatenate([system.state.positions, system.state.velocities], axis=1).ravel()
    equations = heyoka.var_ode_sys(heyoka.model.nbody(3, masses=MASSES, Gconst=1.0), heyoka.var_args.vars, order=1)
    run = heyoka.taylor_adaptive(equations, start, compact_mode=True)
    run.propagate_until(5.0)
    order = [6 * body + 3 * half + k for half in range(2) for body in range(3) for k in range(3)]
    theirs = run.state[run.get_vslice(order=1)].reshape(18, 18)[np.ix_(order, order)]
    for name in ("gauss-radau15", "dop853"):
        tight = {"rtol": 3e-14, "atol": 1e-16} if name == "dop853" else {}
        ours = kd.transition_matrix(system, 5.0, name, **tight).matrix
        value = float(np.abs(ours - theirs).max() / np.abs(theirs).max())
        yield claim(f"{name}: {text}", value, bound, value <= 1e-11, reference)


def maps(long: bool) -> Iterator[Claim]:
    steps = 100_000 if long else 10_000
    for system, dt in ((planets(), 0.05), (kd.load("trappist-1"), 0.06 * DAY)):
        found = kd.transition_matrix(system, steps * dt, "wisdom-holman", dt)
        value = found.symplectic_error
        assert value is not None
        text = f"M^T J M - J after {steps} steps of wisdom-holman, {len(system)} bodies, over the largest of M^2"
        yield at_most(text, value, 1e-12, "a symplectic map")


def costs() -> Iterator[Claim]:
    system = kd.load("trappist-1")
    for name, dt, steps in (("wisdom-holman", 0.06 * DAY, 20_000), ("yoshida6", 0.02 * DAY, 5000)):
        text = f"{name}: time of one of 48 directions over that of a step, TRAPPIST-1"
        yield at_most(text, cost_of_a_direction(system, name, dt, steps, 3), 1.3, "the same run without directions")


def cost_of_a_direction(system: kd.System, name: str, dt: float, steps: int, rounds: int) -> float:
    """Median over rounds of the time that each direction of the transition matrix adds, over the time of the steps."""
    kd.transition_matrix(system, 10 * dt, name, dt)  # compiles
    ratios = []
    for _ in range(rounds):
        plain = kd.Simulation(system, name, dt)
        plain.advance(10)
        alone = -process_time()
        plain.advance(steps)
        alone += process_time()
        together = -process_time()
        kd.transition_matrix(system, steps * dt, name, dt)
        together += process_time()
        ratios.append((together - alone) / (6 * len(system)) / alone)
    return float(np.median(ratios))


def transit_times() -> Iterator[Claim]:
    text, bound = "transit times of TRAPPIST-1's seven planets in 40 days, in days", "at most 1e-9"
    reference, system = "rebound's IAS15 and bisection", kd.load("trappist-1")
    try:
        import rebound  # noqa: F401
    except ImportError:
        yield not_run(text, bound, reference)
    else:
        found = [kd.transits(system, name, until=40 * DAY, direction=SIGHT, bodies=name) for name in system.names[1:]]
        errors = [abs(time - bisected(system, ours.planet, time)) / DAY for ours in found for time in ours.times]
        value = largest(*errors)
        yield claim(f"{len(errors)} {text}", value, bound, value <= 1e-9, reference)
    text, bound = "derivatives of transit times in 5 days, each relative to itself", "at most 1e-8"
    reference = "differences of times in 33 digits, by heyoka"
    try:
        import heyoka
    except ImportError:
        yield not_run(text, bound, reference, "pip install heyoka")
        return
    if not hasattr(heyoka, "real128"):
        yield not_run(text, bound, reference, "conda install heyoka.py, which has numbers of 128 bits")
        return
    value, count = derivatives_of_times(heyoka, system)
    yield claim(f"{count} {text}", value, bound, value <= 1e-8, reference)


def derivatives_of_times(heyoka: Any, system: kd.System) -> tuple[float, int]:
    """The largest relative error of the derivatives, and their number."""
    found = [kd.transits(system, name, until=5 * DAY, direction=SIGHT) for name in system.names[1:4]]
    errors = []
    for body, half, axis in (("b", 0, 0), ("c", 0, 0), ("c", 1, 1), ("f", 0, 1)):
        row = system.names.index(body)
        later, sooner = (long_times(heyoka, system, found, (half, axis, row), sign * STEP) for sign in (1.0, -1.0))
        wanted = {key: float((later[key] - sooner[key]) / heyoka.real128(2 * STEP)) for key in later}
        for ours in found:
            column = ours.jacobian[:, 3 * (half * len(system) + row) + axis]
            errors += [abs(value / wanted[ours.planet, k] - 1.0) for k, value in enumerate(column)]
    return largest(*errors), len(errors)


def long_times(
    heyoka: Any, system: kd.System, near: list[kd.Transits], at: tuple[int, int, int], by: float
) -> dict[tuple[str, int], Any]:
    """Times of these transits in 33 digits, by Newton's method, from a start with one number moved."""
    real, n = heyoka.real128, len(system)
    exact = np.vectorize(lambda value: real(float(value)), otypes=[real])
    phase = exact(system.state.phase)
    half, axis, row = at
    phase[half, axis, row] += real(by)
    gm = exact(system.state.masses) * real(float(system.units.gravity or 0.0))
    equations = heyoka.model.nbody(n, masses=list(gm), Gconst=real(1))
    run = heyoka.taylor_adaptive(equations, phase.transpose(2, 0, 1).ravel(), compact_mode=True, fp_type=real)
    known = sorted((float(time), ours.planet, k) for ours in near for k, time in enumerate(ours.times))
    found = {}
    for begin, planet, k in known:
        own, time = system.names.index(planet), real(begin)
        for _ in range(4):
            run.propagate_until(time)
            x, v = run.state.reshape(n, 2, 3).transpose(1, 0, 2)
            d, u = (x[own] - x[0])[[0, 2]], (v[own] - v[0])[[0, 2]]
            push = (_pull(gm, x, own) - _pull(gm, x, 0))[[0, 2]]
            time = time - (d * u).sum() / ((u * u).sum() + (d * push).sum())
        found[planet, k] = time
    return found


def _pull(gm: Any, x: Any, body: int) -> Any:
    """Acceleration of a body by the others."""
    others = [j for j in range(len(gm)) if j != body]
    d = x[others] - x[body]
    square = (d * d).sum(axis=1)
    return (gm[others, None] * d / (square * np.sqrt(square))[:, None]).sum(axis=0)


def bisected(system: kd.System, planet: str, near: float) -> float:
    """The transit nearest to a time, seen from -y, by bisection of rebound's run."""
    sim = simulation(system, "ias15")
    star, own = sim.particles[0], sim.particles[system.names.index(planet)]
    low, high = near - 0.05 * DAY, near + 0.05 * DAY
    sim.integrate(low)
    while True:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            return high
        if high - low < 1e-4 * DAY:  # the last steps are one secant
            break
        sim.integrate(middle)
        low, high = (middle, high) if _rate(own, star) < 0 else (low, middle)
    for _ in range(3):
        sim.integrate(low)
        first = _rate(own, star)
        sim.integrate(high)
        second = _rate(own, star)
        if first == second:
            break
        low, high = high, low - first * (high - low) / (second - first)
    return high


def _rate(planet: Any, star: Any) -> float:
    return float((planet.x - star.x) * (planet.vx - star.vx) + (planet.z - star.z) * (planet.vz - star.vz))


if __name__ == "__main__":
    main(claims, __doc__)
