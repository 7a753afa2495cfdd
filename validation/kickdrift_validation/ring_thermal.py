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
Goldreich & Tremaine 1978, Icarus 34, 227). Particles with a larger
restitution heat up without limit. Spaute & Greenberg (1987, Icarus 70) found this above 0.63 in simulations of smooth
spheres (number from their abstract). A normal distribution of heights also gives the filling factor of the midplane,
4 R tau / (3 sqrt(2 pi) c_z), at an optical depth tau.

Both motions of a particle have one period, so the difference of their phases stays between bounces, and velocities are
not exactly normal. `scattered` solves Boltzmann's equation with this difference: points without size, whose pairs are
drawn at equal heights with a probability as |g|, turn by random angles between bounces. Its rates of heating differ
from those of normal distributions by a quarter, and the patch must have them.
"""

import math
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim

THEORY = "kinetic theory (derivation in ring_thermal.py)"
PUBLISHED = 0.63
ERRORS = 4.0  # standard errors
BOLTZMANN = "Monte Carlo solution of Boltzmann's equation"
NEIGHBOURS = 50  # in height, to either side, which give the density
ABSTRACT = "Spaute & Greenberg 1987, abstract"
RADIUS = 0.02  # of particles, for c_x = 1
DEPTH = 0.05
STEPS = 40  # in an orbit
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


def scattered(restitution: float, ratio: float, n: int = 20_000, rounds: int = 200, seed: int = 1) -> float:
    """Change of the logarithm of the random energy for a bounce of each particle, by a Monte Carlo solution of
    Boltzmann's equation for a thin, dilute ring."""
    rng = np.random.default_rng(seed)
    u = rng.normal(0.0, 1.0, (4, n)) * np.array([[1.0], [0.5], [ratio], [ratio]])  # u_x, u_y, u_z, z
    bounces, start = 0.0, 0.0
    for number in range(rounds):
        turn = rng.uniform(0.0, 2.0 * math.pi, n)
        c, s = np.cos(turn), np.sin(turn)
        u = np.stack([u[0] * c + 2.0 * u[1] * s, u[1] * c - 0.5 * u[0] * s, u[2] * c - u[3] * s, u[3] * c + u[2] * s])
        u = u[:, np.argsort(u[3])]
        if number == rounds // 4:
            bounces, start = 0.0, energy(u)
        first = np.arange(NEIGHBOURS, n - NEIGHBOURS, 2)
        density = 1.0 / (u[3, first + NEIGHBOURS] - u[3, first - NEIGHBOURS])
        g = u[:3, first] - u[:3, first + 1]
        speed = np.sqrt((g**2).sum(axis=0))
        chance = speed * density
        met = rng.uniform(0.0, 4.0 * np.quantile(chance, 0.9), len(first)) < chance
        first, g, speed = first[met], g[:, met], speed[met]
        cosine = np.sqrt(rng.uniform(0.0, 1.0, len(first)))  # of g with n: the bounce takes a disc of equal areas
        across = rng.normal(0.0, 1.0, g.shape)
        across -= (across * g).sum(axis=0) / speed**2 * g
        across /= np.sqrt((across**2).sum(axis=0))
        kick = 0.5 * (1.0 + restitution) * speed * cosine * (cosine * g / speed + np.sqrt(1.0 - cosine**2) * across)
        u[:3, first] -= kick
        u[:3, first + 1] += kick
        bounces += 2.0 * len(first) / n
    return math.log(energy(u) / start) / bounces


def energy(u: np.ndarray) -> float:
    """Sum of the mean squared amplitudes of the epicycles and of the vertical motion."""
    return float((u[0] ** 2 + 4.0 * u[1] ** 2 + u[2] ** 2 + u[3] ** 2).mean())


class Heated(NamedTuple):
    """What a run of a dilute ring shows."""

    rate: float  # change of the logarithm of the random energy, for a bounce of each particle
    shape: float  # c_z / c_x
    filling: float  # of the midplane, over that of a normal distribution of heights


def heated(n: int, seed: int, restitution: float, orbits: int, ratio: float) -> Heated:
    """A run of so many orbits."""
    x, v, side = dilute(n, seed, ratio)
    forces = [kd.Hill(1.0), kd.GravitySheet(1.0, side, side, G=0.0)]
    system = kd.System(x, v, masses=np.ones(n), radii=np.full(n, RADIUS), forces=forces, units="nbody")
    bounce = kd.Collision(action="bounce", restitution=restitution)
    sim = kd.Simulation(system, "sei", dt=2.0 * math.pi / STEPS, events=[bounce])
    sim.run(WARM * STEPS, every=WARM * STEPS)
    energies, filled = [], []

    def look(sim: kd.Simulation) -> None:
        x, v = sim.state.positions, sim.state.velocities.copy()
        v[:, 1] += 1.5 * x[:, 0]
        squares, heights = v.var(axis=0), x[:, 2]
        energies.append([squares[0] + 4.0 * squares[1], squares[2] + heights.var()])
        inside = math.pi * np.clip(RADIUS**2 - heights**2, 0.0, None).sum() / side**2
        filled.append(inside * 3.0 * math.sqrt(2.0 * math.pi) * heights.std() / (4.0 * RADIUS * DEPTH))

    report = sim.run(orbits * STEPS, every=STEPS // 10, observe=look)
    bounces = 2.0 * sum(event["time"] > 2.0 * math.pi * WARM for event in report.events) / n
    across, upright = np.array(energies).T
    rate = float(np.log((across[-1] + upright[-1]) / (across[0] + upright[0]))) / bounces
    return Heated(rate, float(np.mean(np.sqrt(upright / across))), float(np.mean(filled)))


def thermal_balance(n: int, replicas: int, orbits: int) -> list[Claim]:
    """Heating on either side of the critical restitution, the shape of the velocities, and the filling factor."""
    ratio, critical = balance()
    runs = np.array([[heated(n, seed, each, orbits, ratio) for seed in range(replicas)] for each in EITHER])
    mean, error = runs.mean(axis=1), runs.std(axis=1, ddof=1) / math.sqrt(replicas)
    (low, high), width = mean[:, 0], EITHER[1] - EITHER[0]
    found = EITHER[0] - width * low / (high - low)
    spread = width * math.hypot(high * error[0, 0], low * error[1, 0]) / (high - low) ** 2
    text = f"dilute ring, depth {DEPTH:g}, {n} particles, {replicas} replicas, {orbits} orbits"
    rows = [
        claim(f"{text}: restitution at which random velocities stay, with a standard error of {spread:.2g}",
              float(found), "0.63 within 0.05", bool(low < 0.0 < high and abs(found - PUBLISHED) <= 0.05),
              f"{ABSTRACT}; normal distributions {critical:.3f}"),
    ]  # fmt: skip
    for each, rate, own in zip(EITHER, mean[:, 0], error[:, 0], strict=True):
        there = np.array([scattered(each, ratio, seed=seed) for seed in range(4)])
        own, expected = math.hypot(own, there.std(ddof=1) / 2.0), float(there.mean())
        off = abs(rate - expected) / own
        rows.append(claim(f"{text}: change of ln(energy) by a bounce at restitution {each:g}, {rate:.4f} beside "
                          f"{expected:.4f}, in standard errors of {own:.2g}",
                          float(off), f"at most {ERRORS:g}", off <= ERRORS, BOLTZMANN))  # fmt: skip
    for k, name, expected in ((1, "c_z / c_x", ratio), (2, "filling factor of the midplane, over the formula", 1.0)):
        value, own = mean[:, k].mean(), math.hypot(*error[:, k]) / 2.0
        off = abs(value - expected) / own
        rows.append(claim(f"{text}: {name} {value:.3f} beside {expected:.3f}, in standard errors of {own:.2g}",
                          float(off), f"at most {ERRORS:g}", off <= ERRORS, THEORY))  # fmt: skip
    return rows
