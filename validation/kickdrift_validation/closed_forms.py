"""Motions with a closed form: Kepler's on every conic, free particles, two Lennard-Jones atoms, Mercury's perihelion.

Two bodies start at pericentre on a circle, on ellipses with e = 0.9 and 0.999, a parabola and hyperbolas. Where they
are later follows from the classical anomalies in 40 digits (Kepler's equation, Barker's for the parabola; Danby 1988,
Fundamentals of Celestial Mechanics, ch. 6), from the very numbers of the start; kickdrift's solver has universal
variables, so the two share nothing. A step of wisdom-holman on two bodies is nothing but that solver, whatever its
length. Two atoms that swing along their line have the period 2 ∫ dr / sqrt(2 (E - U) / mu) between the turning points.
"""

import math
from importlib.util import find_spec
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, claim, largest, main, not_run

EPSILON = float(np.finfo(float).eps)
HEAVY, LIGHT = 0.875, 0.125  # G (m1 + m2) = 1, in numbers without rounding
CONICS = {  # pericentre distance and speed there
    "circle": (1.0, 1.0),
    "ellipse, e = 0.9": (0.1, math.sqrt(19.0)),
    "ellipse, e = 0.999": (2.0**-10, math.sqrt(2048.0 - 1.0)),
    "parabola": (2.0, 1.0),
    "hyperbola, e = 1.25": (1.0, 1.5),
    "hyperbola, e = 3": (1.0, 2.0),
}
TIMES = (0.01, 0.3, 1.0, 2.0, 2.7, 3.5, 5.0, 9.0, 40.0, 300.0)
ROUNDINGS = 5.0  # of the start
DIGITS = 40
RATE = 1e-6  # G M / (c^2 a) is 2.6e-8, and the ellipse that fits at pericentre is off by some tens of that


def pair(q: float, v: float) -> kd.System:
    """Two bodies at pericentre, their centre of mass at rest."""
    x, u = np.zeros((2, 2, 3))
    x[:, 0] = -LIGHT * q, HEAVY * q
    u[:, 1] = -LIGHT * v, HEAVY * v
    return kd.System(x, u, [HEAVY, LIGHT], forces=[kd.Gravity(G=1.0)], units="nbody")


def relative(state: kd.State) -> tuple[np.ndarray, np.ndarray]:
    return state.positions[1] - state.positions[0], state.velocities[1] - state.velocities[0]


def anomalies(mp: Any, q: Any, v: Any, t: float) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity (3,) a time after pericentre, for G M = 1."""
    q, v, t = mp.mpf(q), mp.mpf(v), mp.mpf(t)
    over_a, e, h = 2 / q - v * v, q * v * v - 1, q * v
    if over_a == 0:
        w = mp.mpf(3) / 2 * t / mp.sqrt(2 * q**3)
        y = mp.cbrt(w + mp.sqrt(w * w + 1))
        d = y - 1 / y
        x, y = q * (1 - d * d), 2 * q * d
    else:
        a = 1 / over_a
        mean = t / mp.sqrt(abs(a) ** 3)
        if a > 0:
            mean = mp.fmod(mean, 2 * mp.pi)
            one = root(mp, lambda u: u - e * mp.sin(u) - mean, mean - e, mean + e + mp.mpf(1) / 2)
            x, y = a * (mp.cos(one) - e), a * mp.sqrt(1 - e * e) * mp.sin(one)
        else:
            one = root(mp, lambda u: e * mp.sinh(u) - u - mean, mp.mpf(0), 2 + mp.asinh((mean + 5) / (e - 1)))
            x, y = a * (mp.cosh(one) - e), -a * mp.sqrt(e * e - 1) * mp.sinh(one)
    r = mp.sqrt(x * x + y * y)
    place, speed = (x, y, 0), (-y / r / h, (e + x / r) / h, 0)
    return np.array([float(c) for c in place]), np.array([float(c) for c in speed])


def root(mp: Any, f: Any, low: Any, high: Any) -> Any:
    """Where f, which rises, is zero: halving alone."""
    for _ in range(int(3.4 * DIGITS)):
        middle = (low + high) / 2
        low, high = (low, middle) if f(middle) > 0 else (middle, high)
    return (low + high) / 2


def off_by(mp: Any, found: tuple[np.ndarray, np.ndarray], q: float, v: float, t: float) -> float:
    """The larger of the errors of position and velocity, each over what it would be for a perfect program whose start
    were one rounding away (in the distance and in the speed), and whose result is rounded."""
    exact = anomalies(mp, q, v, t)
    moved = [anomalies(mp, mp.mpf(q) * (1 + EPSILON), v, t), anomalies(mp, q, mp.mpf(v) * (1 + EPSILON), t)]
    errors = []
    for part in range(2):
        least = EPSILON * norm(exact[part]) + sum(norm(other[part] - exact[part]) for other in moved)
        errors.append(norm(found[part] - exact[part]) / least)
    return max(errors)


def norm(vector: np.ndarray) -> float:
    return float(np.linalg.norm(vector))


def kepler() -> list[Claim]:
    text = "two bodies after a time, on circle, ellipses, parabola and hyperbolas"
    if find_spec("mpmath") is None:
        return [not_run(text, f"{ROUNDINGS:g} roundings", "classical anomalies")]
    import mpmath

    rows = []
    with mpmath.workdps(DIGITS):
        for name, (q, v) in CONICS.items():
            start = pair(q, v)
            x, u = relative(start.state)
            steps, runs = [], []
            for t in TIMES:
                sim = kd.Simulation(start, "wisdom-holman", dt=t)
                sim.run(1)
                steps.append(off_by(mpmath, relative(sim.state), x[0], u[1], t))
                if name != "ellipse, e = 0.999" and t <= 9.0:
                    sim = kd.Simulation(start, "gauss-radau15")
                    sim.run(until=t, every=2**40)
                    runs.append(off_by(mpmath, relative(sim.state), x[0], u[1], t))
            times = f"{TIMES[0]:g} to {TIMES[-1]:g}"
            print(
                f"  {name:20} one Kepler step: {', '.join(f'{off:.1f}' for off in steps)} roundings"
                f"{'; gauss-radau15: ' if runs else ''}{', '.join(f'{off:.1f}' for off in runs)}"
            )
            for method, found, most in (
                ("wisdom-holman, one step", steps, ROUNDINGS),
                ("gauss-radau15", runs, ROUNDINGS),
            ):
                if found:
                    rows.append(
                        at_most(
                            f"{name}, {method}: error in roundings, largest of times {times}",
                            largest(*found),
                            most,
                            "classical anomalies in 40 digits",
                        )
                    )
    return rows


def free() -> list[Claim]:
    """x + t v, in numbers that need no rounding."""
    random = np.random.default_rng(3)
    x, v = random.integers(-1024, 1024, (2, 50, 3)) / 64.0
    rows = []
    for name in ("velocity-verlet", "yoshida4", "rk4"):
        sim = kd.Simulation(kd.System(x, v, forces=[]), name, dt=2.0**-7)
        sim.run(4096, every=4096)
        off = float(np.abs(sim.state.positions - (x + 32.0 * v)).max())
        most = 0.0 if name == "velocity-verlet" else 4096 * EPSILON * 512
        reference = "x + t v" if most == 0.0 else "x + t v; a rounding of the largest place a step"
        text = f"free particles, {name}: largest error after 4096 steps"
        rows.append(claim(text, off, f"at most {most:.2g}" if most else "0", off <= most, reference))
    return rows


def swing(r: float, speed: float, points: int = 400) -> float:
    """The period of two atoms of mass 1 that are r apart and part with that speed, by the midpoint rule, which
    converges as fast as any where what is integrated is periodic."""
    from scipy.optimize import brentq

    def potential(r):
        return 4.0 * (r**-12.0 - r**-6.0)

    energy = 0.25 * speed**2 + potential(r)
    low = brentq(lambda r: potential(r) - energy, 0.8, 2.0 ** (1 / 6), xtol=1e-15)
    high = brentq(lambda r: potential(r) - energy, 2.0 ** (1 / 6), 9.0, xtol=1e-15)
    angle = math.pi * (np.arange(points) + 0.5) / points
    at = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(angle)
    dr = 0.5 * (high - low) * np.sin(angle) * math.pi / points
    return float(2.0 * (dr / (2.0 * np.sqrt(energy - potential(at)))).sum())


def atoms() -> list[Claim]:
    r, speed, periods = 1.2, 0.5, 10
    period = swing(r, speed)
    x, v = np.zeros((2, 2, 3))
    x[1, 0], v[:, 0] = r, (-0.5 * speed, 0.5 * speed)
    sim = kd.Simulation(
        kd.System(x, v, forces=[kd.LennardJones(cutoff=10.0, truncation="cut")]), "yoshida8", dt=period / 400
    )
    sim.run(400 * periods, every=400 * periods)
    late = float(sim.state.positions[1, 0] - sim.state.positions[0, 0] - r) / speed
    off, bound = abs(late) / (periods * period), 1e-11
    text = f"two Lennard-Jones atoms: period {period:.12f}, relative difference, yoshida8"
    return [claim(text, off, f"at most {bound:g}", off <= bound, "quadrature of the radial motion")]


def to_pericentre(r: np.ndarray, u: np.ndarray, gm: float) -> float:
    """The time until then on the ellipse that a state belongs to; below 0 where it has just been."""
    a = 1.0 / (2.0 / norm(r) - float(u @ u) / gm)
    e_sin, e_cos = float(r @ u) / math.sqrt(gm * a), 1.0 - norm(r) / a
    return -math.sqrt(a**3 / gm) * (math.atan2(e_sin, e_cos) - e_sin)


def perihelion() -> list[Claim]:
    """A planet of no mass on Mercury's orbit, 400 revolutions."""
    from kickdrift.model.units.unit_systems import unit_system

    units = unit_system("astro")
    gm, c = float(units.gravity or 0.0), float(units.light or 0.0)
    a, e, turns = 0.38709893, 0.20563069, 400
    x, v = np.zeros((2, 2, 3))
    x[1, 0], v[1, 1] = a * (1 - e), math.sqrt(gm / a * (1 + e) / (1 - e))
    rows = []
    for form in ("full", "potential"):
        system = kd.System(x, v, [1.0, 0.0], forces=[kd.Gravity(), kd.PostNewtonian(form=form)], units="astro")
        sim = kd.Simulation(system, "dop853", rtol=2.3e-14, atol=1e-18)
        length = turns * 2 * math.pi * math.sqrt(a**3 / gm)
        sim.run(until=0.9999 * length, every=2**40)
        left = to_pericentre(*relative(sim.state), gm)
        sim.run(until=sim.time + left, every=2**40)  # elsewhere the ellipse that fits leans to and fro
        r, u = relative(sim.state)
        laplace = np.cross(u, np.cross(r, u)) / gm - r / norm(r)
        found = math.atan2(laplace[1], laplace[0]) / turns
        wanted = 6 * math.pi * gm / (c**2 * a * (1 - e**2))
        century = math.degrees(found) * 3600 * 100 / (length / turns)
        off, bound = abs(found / wanted - 1), RATE
        text = f"Mercury's perihelion, {form} form: {century:.4f} arcseconds a century, relative difference"
        rows.append(at_most(text, off, bound, "6 pi G M / (c^2 a (1 - e^2))"))
    return rows


def claims(long: bool = False) -> list[Claim]:
    return [*kepler(), *free(), *atoms(), *perihelion()]


if __name__ == "__main__":
    main(claims, __doc__)
