"""A user's field, pair and body law beside the shipped force of the same formula: speed and bits.

    python -m docs.studies.laws [--turns 15]

Both run in turns (A B A B …) in one process, on one thread and on two. A ratio compares the fastest turn of each. The
paths must have the same bits. The body law is an exception, because its formula is written in another way. Everything
is compiled before the first turn.
"""

import argparse
import math
import sys
from collections.abc import Callable
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import most_threads
from kickdrift_validation.claim import Claim, claim, show
from kickdrift_validation.performance.liquids import liquid

LEAST = 0.9  # bound: share of the shipped force's speed
TURN = 0.01  # seconds of a turn
PLACES = 4  # Simulations are made anew, because the place of their arrays in memory changes the speed
OURS = "the shipped force, in turns"


class Case(NamedTuple):
    """A law, its systems and its method."""

    name: str
    own: Any
    ours: Any
    system: Callable[[Any], kd.System]
    integrator: str = "velocity-verlet"
    apart: float = 0.0  # largest relative difference of the paths; 0 means the same bits


def cloud(force: Any) -> kd.System:
    """1000 particles in open space."""
    rng = np.random.default_rng(1)
    x, v = rng.normal(size=(2, 1000, 3))
    return kd.System(x, v, rng.uniform(0.5, 1.5, 1000), forces=[force])


def orbits(force: Any) -> kd.System:
    """1000 light bodies about a heavy body."""
    rng = np.random.default_rng(2)
    x = 10.0 * rng.normal(size=(1001, 3))
    x[0] = 0.0
    return kd.System(x, masses=[1.0] + [1e-9] * 1000, forces=[force], units="nbody")


def fluid(force: Any) -> kd.System:
    """1000 particles of a Lennard-Jones liquid."""
    state = liquid(1000, 200)
    return kd.System(state.positions, state.velocities, box=state.edges, forces=[force])


def cases() -> tuple[Case, ...]:
    """Laws as a user writes them. They are made in a function, so they do not enter the registry of forces."""

    @kd.field_law
    class OwnTrap(NamedTuple):
        """Harmonic trap, as ``HarmonicTrap``."""

        stiffness: float

        def law(p, x, v, m, t):
            return 0.5 * ((p.stiffness * x) @ x), -(p.stiffness * x)

    @kd.field_law
    class OwnDrag(NamedTuple):
        """Linear drag, as ``LinearDrag``."""

        rate: float

        velocity_dependent = works = per_mass = True  # type: ignore[misc]

        def law(p, x, v, m, t):
            return None, -p.rate * v

    @kd.pair_law
    class OwnLennardJones(NamedTuple):
        """Lennard-Jones' law, as ``LennardJones``."""

        epsilon: float = 1.0
        sigma: float = 1.0

        def law(p, r2):
            attraction = 4.0 * p.epsilon * p.sigma**6
            repulsion = attraction * p.sigma**6
            inverse = 1.0 / r2
            inverse6 = inverse**3
            energy = (repulsion * inverse6 - attraction) * inverse6
            return energy, (12.0 * repulsion * inverse6 - 6.0 * attraction) * inverse6 * inverse

    @kd.body_law
    class OwnRelativity(NamedTuple):
        """Potential form of relativity about body 0, as ``PostNewtonian(form="potential")`` with G = 1."""

        light2: float  # the square of the speed of light
        share: float  # mass over the mass of body 0

        fastmath = True  # type: ignore[misc]
        varies = ("share",)  # type: ignore[misc]

        def law(p, x, v, m, t, a):
            gm, light2, n = m[0], p.light2, x.shape[1]
            back_x = back_y = back_z = energy = virial = 0.0
            for i in range(1, n):
                dx, dy, dz = x[0, i] - x[0, 0], x[1, i] - x[1, 0], x[2, i] - x[2, 0]
                inverse = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
                gm_over_r = gm * inverse
                along = -6.0 * gm_over_r * gm_over_r * inverse * inverse / light2
                ax, ay, az, share = along * dx, along * dy, along * dz, p.share[i]
                a[0, i] += ax
                a[1, i] += ay
                a[2, i] += az
                back_x, back_y, back_z = back_x + share * ax, back_y + share * ay, back_z + share * az
                virial += m[i] * (ax * dx + ay * dy + az * dz)
                energy -= 3.0 * m[i] * gm_over_r * gm_over_r / light2
            a[0, 0] -= back_x
            a[1, 0] -= back_y
            a[2, 0] -= back_z
            return energy, virial, n - 1

    return (
        Case("field law: harmonic trap", OwnTrap(1.7), kd.HarmonicTrap(1.7), cloud),
        Case("field law: drag", OwnDrag(0.3), kd.LinearDrag(0.3), cloud, "rk4"),
        Case("pair law: Lennard-Jones", OwnLennardJones(), kd.LennardJones(), fluid),
        Case(
            "body law: relativity",
            OwnRelativity(900.0, orbits(kd.PostNewtonian(c=30.0)).state.masses),
            kd.PostNewtonian(c=30.0, form="potential"),
            orbits,
            apart=1e-12,
        ),
    )


def raced(case: Case, threads: int, turns: int) -> tuple[float, float]:
    """Speed of the user's law over the shipped force's, and the largest relative difference of the paths."""
    best, steps, off = [math.inf, math.inf], 0, 0.0
    for _ in range(PLACES):
        sims = [kd.Simulation(case.system(force), case.integrator, dt=1e-4, threads=threads) for force in case[1:3]]
        for sim in sims:
            sim.run(20)
        began = perf_counter()
        for sim in sims:
            sim.run(20, every=20)
        steps = steps or max(20, round(40 * TURN / (perf_counter() - began)))
        for _ in range(turns):
            for k, sim in enumerate(sims):
                began = perf_counter()
                sim.run(steps, every=steps)
                best[k] = min(best[k], perf_counter() - began)
        own, ours = (sim.state.phase for sim in sims)
        off = max(off, float(np.abs(own - ours).max() / np.abs(ours).max()))
    return best[1] / best[0], off


def claims(turns: int = 15) -> list[Claim]:
    """Speed and bits of every law, on one thread and on two."""
    rows = []
    for case in cases():
        for threads in (1, 2):
            if threads > most_threads():
                continue
            ratio, off = raced(case, threads, turns)
            name = f"{case.name}, threads: {threads}"
            rows.append(claim(f"{name}: speed over ours", ratio, f"at least {LEAST}", ratio >= LEAST, OURS))
            text, bound = f"{name}: paths, relative difference", f"at most {case.apart:g}"
            rows.append(claim(text, off, bound, off <= case.apart, OURS))
    return rows


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--turns", type=int, default=15)
    sys.exit(show(claims(parser.parse_args().turns)))
