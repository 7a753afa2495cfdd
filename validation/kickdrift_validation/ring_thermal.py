"""Thermal balance of a thin, dilute ring of bouncing spheres, beside kinetic theory and a published figure.

Units: omega = 1. Random velocities are c from the shear, u = v + 3/2 x e_y. Between bounces a particle keeps the
amplitudes of its epicycle, u_x^2 + 4 u_y^2, and of its vertical motion, u_z^2 + z^2. Where bounces are rare, phases are
random: velocities have a normal distribution with c_y = c_x / 2. Two particles meet with the relative velocity g, whose
distribution has the same shape. The bounce of smooth spheres along the direction n takes A (g n) n from g, with
A = 1 + restitution. The means over n of smooth spheres, for given g, are

    <(g n) g_i n_i> = g_i^2 / 2,    <(g n)^2 n_i^2> = g_i^2 / 4 + g^2 / 12,

so a bounce adds -A g_i^2 + A^2 (g_i^2 / 4 + g^2 / 12) to g_i^2. Bounces happen at a rate of |g|. Neither amplitude
changes on average if, with brackets for means over the distribution of g,

    <|g| (g_x^2 + 4 g_y^2)> = 5 <|g| g_z^2>,    A = 12 / (3 + <|g|^3> / <|g| g_z^2>).

The first equation is for c_z / c_x, the second for the restitution: 0.6270, and c_z / c_x = 0.6525 (the argument of
Goldreich & Tremaine 1978, doi:10.1016/0019-1035(78)90165-6, and Hameen-Anttila 1978). Particles with a larger
restitution heat up without limit. Spaute & Greenberg (1987, Icarus 70) found this above 0.63 in simulations of smooth
spheres (number from their abstract). A normal distribution of heights also gives the filling factor of the midplane,
4 R tau / (3 sqrt(2 pi) c_z), at an optical depth tau.
"""

from __future__ import annotations

import math

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim

THEORY = "kinetic theory (derivation in ring_thermal.py)"
ABSTRACT = "Spaute & Greenberg 1987, abstract"
RADIUS = 0.02  # of particles, for c_x = 1
DEPTH = 0.05
ORBIT = 2.0 * math.pi
STEPS = 100  # in an orbit
WARM = 4  # orbits before the first sample
EITHER = (0.567, 0.687)  # restitutions at which rates of heating are measured


def weighted_squares(ratio: float) -> np.ndarray:
    """<|g| g_i^2> up to a common factor, for c_x = 1, c_y = 1/2 and c_z = ratio: integrals over directions of g."""
    cosine, weights = np.polynomial.legendre.leggauss(200)
    angle = 2.0 * math.pi * (np.arange(400) + 0.5) / 400
    sine = np.sqrt(1.0 - cosine**2)[:, None]
    squares = np.stack(
        [(sine * np.cos(angle)) ** 2, (sine * np.sin(angle)) ** 2, np.repeat(cosine[:, None] ** 2, 400, axis=1)]
    )
    density = (squares / np.array([1.0, 0.25, ratio**2])[:, None, None]).sum(axis=0) ** -3.0
    return np.asarray((squares * density * weights[:, None]).sum(axis=(1, 2)))


def balance() -> tuple[float, float]:
    """c_z / c_x and the restitution at which a thin, dilute ring keeps its random velocities."""
    from scipy.optimize import brentq

    ratio = float(brentq(lambda c: weighted_squares(c) @ [1.0, 4.0, -5.0], 0.2, 1.5, xtol=1e-12))
    squares = weighted_squares(ratio)
    return ratio, float(12.0 / (3.0 + squares.sum() / squares[2]) - 1.0)


def dilute(n: int, seed: int, ratio: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Positions and velocities of particles at random phases, and the side of their patch."""
    rng = np.random.default_rng(seed)
    side = math.sqrt(n * math.pi / DEPTH) * RADIUS
    centre = rng.uniform(-0.5 * side, 0.5 * side, (n, 2))
    u_x, height, u_z = rng.normal(0.0, 1.0, (3, n)) * np.array([[1.0], [ratio], [ratio]])
    u_y = rng.normal(0.0, 0.5, n)
    x = np.stack([centre[:, 0] - 2.0 * u_y, centre[:, 1] + 2.0 * u_x, height], axis=1)
    return x, np.stack([u_x, u_y - 1.5 * x[:, 0], u_z], axis=1), side


def heating(n: int, seed: int, restitution: float, orbits: int, ratio: float) -> tuple[float, float, float, float]:
    """Change of ln c^2 by a bounce of each particle, its standard error from parts of the run, mean c_z / c_x, and the
    filling factor of the midplane over that of a normal distribution."""
    x, v, side = dilute(n, seed, ratio)
    forces = [kd.Hill(1.0), kd.GravitySheet(1.0, side, side, G=0.0)]
    system = kd.System(x, v, masses=np.ones(n), radii=np.full(n, RADIUS), forces=forces, units="nbody")
    sim = kd.Simulation(
        system, "sei", dt=ORBIT / STEPS, events=[kd.Collision(action="bounce", restitution=restitution)]
    )
    sim.run(WARM * STEPS, every=WARM * STEPS)
    logs, shapes, filled = [], [], []

    def look(sim: kd.Simulation) -> None:
        state = sim.state
        u = state.velocities + 1.5 * np.outer(state.positions[:, 0], [0.0, 1.0, 0.0])
        squares, height = u.var(axis=0), state.positions[:, 2]
        logs.append(math.log(squares[0] + 4.0 * squares[1] + squares[2] + height.var()))
        shapes.append([squares[0] + 4.0 * squares[1], squares[2] + height.var()])
        inside = math.pi * np.clip(RADIUS**2 - height**2, 0.0, None).sum() / side**2
        filled.append(inside * 3.0 * math.sqrt(ORBIT) * height.std() / (4.0 * RADIUS * DEPTH))

    report = sim.run(orbits * STEPS, every=STEPS // 10, observe=look)
    times = np.array([event["time"] for event in report.events]) / ORBIT
    bounces = 2.0 * (times > WARM).sum() / n
    rate = (logs[-1] - logs[0]) / bounces
    across, upright = np.mean(np.array(shapes) / np.exp(logs)[:, None], axis=0)
    return rate, bounces, math.sqrt(upright / across), float(np.mean(filled))
