"""Unknowns beside the bodies: an oscillator and spins beside rebound and tides-spin, orders of words, stiff networks.

An oscillator that the planet drives, and that pushes the planet, is integrated as one system with the bodies. rebound
5.2.2 has the same as an ODE beside its integrator ``bs``. Spins under tides with a constant time lag (Hut 1981, A&A 99,
126) are written as a user would, beside the force tides-spin. Robertson's network (1966) is stiff.
"""

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_least, at_most, claim, main, not_run
from kickdrift_validation.rebounds import simulation

RATE2, PUSH, END = 10.0, 1e-2, 10.0
WORDS = (("symplectic-euler", 1), ("velocity-verlet", 2), ("leapfrog-dkd", 2), ("yoshida4", 4), ("forest-ruth", 4),
         ("wisdom-holman", 2), ("saba", 2))  # fmt: skip
K2, RADIUS, TAU, INERTIA, SPIN = 0.3, 0.05, 0.1, 0.25, 1.4  # of a planet
MASSES = (1.0, 1e-3)


def oscillator(t: float, y: Any, bodies: Any) -> Any:
    """An oscillator that the direction of the planet drives."""
    dx, dy = bodies.x[0, 1] - bodies.x[0, 0], bodies.x[1, 1] - bodies.x[1, 0]
    return y[1], -RATE2 * y[0] + dy / np.sqrt(dx * dx + dy * dy)


def pushes(t: float, y: Any, bodies: Any, a: Any) -> None:
    """The oscillator pushes the planet along x."""
    a[0, 1] += PUSH * y[0]


def turning(t: float, y: Any, bodies: Any) -> Any:
    """The rate of the planet's spin about z."""
    dx, dy = bodies.x[0, 0] - bodies.x[0, 1], bodies.x[1, 0] - bodies.x[1, 1]
    ux, uy = bodies.v[0, 0] - bodies.v[0, 1], bodies.v[1, 0] - bodies.v[1, 1]
    r2 = dx * dx + dy * dy
    size = -3.0 * K2 * RADIUS**5 * bodies.m[0] / r2**4
    along = 2.0 * (dx * ux + dy * uy) / r2
    fx = size * (dx + TAU * (along * dx + y[0] * dy + ux))
    fy = size * (dy + TAU * (along * dy - y[0] * dx + uy))
    return (-bodies.m[0] * (dx * fy - dy * fx) / (INERTIA * bodies.m[1] * RADIUS**2),)


def tide(t: float, y: Any, bodies: Any, a: Any) -> None:
    """The tide's force on the star, and the opposite one on the planet."""
    dx, dy = bodies.x[0, 0] - bodies.x[0, 1], bodies.x[1, 0] - bodies.x[1, 1]
    ux, uy = bodies.v[0, 0] - bodies.v[0, 1], bodies.v[1, 0] - bodies.v[1, 1]
    r2 = dx * dx + dy * dy
    size = -3.0 * K2 * RADIUS**5 * bodies.m[0] / r2**4
    along = 2.0 * (dx * ux + dy * uy) / r2
    fx = size * (dx + TAU * (along * dx + y[0] * dy + ux))
    fy = size * (dy + TAU * (along * dy - y[0] * dx + uy))
    a[0, 0] += fx
    a[1, 0] += fy
    a[0, 1] -= bodies.m[0] / bodies.m[1] * fx
    a[1, 1] -= bodies.m[0] / bodies.m[1] * fy


def robertson(t: float, y: Any, bodies: Any) -> Any:
    """Robertson's network of three reactions."""
    slow, fast, back = 0.04 * y[0], 3e7 * y[1] * y[1], 1e4 * y[1] * y[2]
    return -slow + back, slow - back - fast, fast


def planet(*forces: Any, e: float = 0.1) -> kd.System:
    """A star and a planet, under gravity and these forces."""
    bodies = [{"name": "star", "mass": MASSES[0]}, {"name": "planet", "mass": MASSES[1], "a": 1.0, "e": e}]
    return kd.System.from_elements(bodies, units="nbody").with_forces(kd.Gravity(), *forces)


def driven() -> kd.System:
    """The planet beside the oscillator."""
    return planet(kd.Beside(oscillator, (1.0, 0.0), ("q", "p"), pushes))


def everything(sim: kd.Simulation) -> np.ndarray:
    """Positions, velocities and unknowns in one row."""
    return np.concatenate([sim.state.phase.ravel(), sim.state.unknowns])


def reference(system: kd.System) -> np.ndarray:
    """The same by SciPy's DOP853 at the least tolerance, with the equations of two bodies written out."""
    m = system.state.masses

    def rates(t: float, z: np.ndarray) -> np.ndarray:
        x, v, y = z[:6].reshape(3, 2), z[6:12].reshape(3, 2), z[12:]
        d = x[:, 1] - x[:, 0]
        r3 = (d @ d) ** 1.5
        a = np.array([m[1] * d / r3, -m[0] * d / r3]).T
        a[0, 1] += PUSH * y[0]
        forcing = d[1] / np.sqrt(d[0] * d[0] + d[1] * d[1])
        return np.concatenate([v.ravel(), a.ravel(), [y[1], -RATE2 * y[0] + forcing]])

    start = np.concatenate([system.state.phase.ravel(), [1.0, 0.0]])
    return np.asarray(solve_ivp(rates, (0.0, END), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1])


def one_system(wanted: np.ndarray) -> Iterator[Claim]:
    """Adaptive methods take bodies and unknowns as one system."""
    for name, given, bound in (("gauss-radau15", {}, 1e-8), ("dop853", {"rtol": 1e-12, "atol": 1e-12}, 1e-8)):
        sim = kd.Simulation(driven(), name, **given)
        sim.run(until=END, exact="shorten")
        off = np.abs(everything(sim) - wanted)
        yield at_most(f"{name}: unknowns at t = 10, largest error", float(off[12:].max()), bound, "SciPy's DOP853")
        yield at_most(f"{name}: positions and velocities, largest error", float(off[:12].max()), bound,
                      "SciPy's DOP853")  # fmt: skip


def beside_rebound() -> Iterator[Claim]:
    """rebound's ODE beside its bs, which pushes the planet by an additional force."""
    texts = "oscillator at t = 10, difference", "orbit at t = 10, difference"
    if find_spec("rebound") is None:
        yield from (not_run(text, "at most 1e-08", "rebound's bs") for text in texts)
        return
    there = simulation(driven(), "bs", 1e-3)
    there.integrator.eps_rel = there.integrator.eps_abs = 1e-12
    ode = there.create_ode(length=2, needs_nbody=True)
    ode.y[0], ode.y[1] = 1.0, 0.0
    now = [1.0, 0.0]

    def derivatives(ode: Any, rates: Any, y: Any, t: float) -> None:
        star, body = there.particles[0], there.particles[1]
        dx, dy = body.x - star.x, body.y - star.y
        rates[0], rates[1] = y[1], -RATE2 * y[0] + dy / np.sqrt(dx * dx + dy * dy)
        now[0] = y[0]

    def push(pointer: Any) -> None:
        there.particles[1].ax += PUSH * now[0]

    ode.derivatives = derivatives
    there.additional_forces, there.force_is_velocity_dependent = push, 0
    there.integrate(END)
    sim = kd.Simulation(driven(), "gauss-radau15")
    sim.run(until=END, exact="shorten")
    found = np.array([ode.y[0], ode.y[1]])
    yield at_most(texts[0], float(np.abs(sim.state.unknowns - found).max()), 1e-8, "rebound's bs")
    places = np.array([each.xyz for each in there.particles])
    yield at_most(texts[1], float(np.abs(sim.state.positions - places).max()), 1e-8, "rebound's bs")


def orders(wanted: np.ndarray) -> Iterator[Claim]:
    """Orders of splitting words, from two steps."""
    for name, order in WORDS:
        errors = []
        for dt in (0.02, 0.01):
            sim = kd.Simulation(driven(), name, dt=dt)
            sim.run(until=END)
            errors.append(float(np.abs(everything(sim) - wanted).max()))
        found = float(np.log2(errors[0] / errors[1]))
        text = f"{name}: order in steps of 0.02 and 0.01; error {errors[1]:.1e}"
        yield claim(text, found, f"{order} within 0.15", abs(found - order) <= 0.15, "SciPy's DOP853")


def spins() -> Iterator[Claim]:
    """A spin under tides with a constant time lag, written by a user."""
    given = {"k2": (0.0, K2), "radius": RADIUS, "inertia": (0.0, INERTIA), "tau": TAU, "flattening": "none"}
    own = kd.TidesSpin(spin=((0.0, 0.0, 0.0), (0.0, 0.0, SPIN)), **given)
    shipped = kd.Simulation(planet(own, e=0.3), "gauss-radau15")
    beside = kd.Beside(turning, (SPIN,), ("spin",), tide, velocity_dependent=True)
    written = kd.Simulation(planet(beside, e=0.3), "gauss-radau15")
    for sim in (shipped, written):
        sim.run(until=50.0, exact="shorten")
    spin = float(shipped.state.spins[2, 1])
    yield at_least("the spin changes in the run", abs(spin - SPIN), 0.01, "tides-spin")
    yield at_most("spin at t = 50, difference", abs(float(written.state.unknowns[0]) - spin), 1e-6, "tides-spin")
    off = float(np.abs(written.state.positions - shipped.state.positions).max())
    yield at_most("positions at t = 50, difference", off, 1e-6, "tides-spin")


def stiff() -> Iterator[Claim]:
    """Robertson's network, by methods for stiff equations and by others."""
    wanted = solve_ivp(lambda t, y: robertson(t, y, None), (0.0, 40.0), [1.0, 0.0, 0.0], method="Radau", rtol=1e-11,
                       atol=1e-14).y[:, -1]  # fmt: skip
    steps = {}
    for name in ("rosenbrock", "radau", "dormand-prince45"):
        system = planet(kd.Beside(robertson, (1.0, 0.0, 0.0), ("A", "B", "C"), atol=(1e-8, 1e-12, 1e-8)))
        sim = kd.Simulation(system, name, rtol=1e-7, atol=1e-9)
        sim.run(until=40.0, exact="shorten")
        steps[name] = sim.steps_done
        off = float(np.abs(sim.state.unknowns / wanted - 1.0).max())
        yield at_most(f"{name}: Robertson's network at t = 40 in {sim.steps_done} steps", off, 1e-5, "SciPy's Radau")
    ratio = steps["dormand-prince45"] / steps["rosenbrock"]
    yield at_least("steps of dormand-prince45 over those of rosenbrock", ratio, 5.0, "a stiff network")


def claims(long: bool = False) -> Iterator[Claim]:
    wanted = reference(driven())
    yield from one_system(wanted)
    yield from beside_rebound()
    yield from orders(wanted)
    yield from spins()
    yield from stiff()


if __name__ == "__main__":
    main(claims, __doc__)
