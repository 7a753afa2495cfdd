"""How fast are N-body steps beside rebound's?

    python validation/performance/nbody_rebound.py [--turns 9] [--seconds 0.5] [CASE …]

Each case is one system and one method, run by kickdrift and by rebound from the same state with the same step. Both
first take some steps, after which their positions must agree; then they take turns (A B A B …) in one process, so that
whatever else the machine does falls on both. A figure is the median of the ratios of neighbouring turns, with its
quartiles. rebound is the wheel's, on one core.

The leapfrog is drift-kick-drift in both, with direct summation: one force evaluation a step. Nine bodies are the Sun
and the planets (JPL DE421 at J2000, G M in au^3/day^2, half a day a step); more are equal stars in a Plummer sphere
with softening 0.01, N-body units. What two threads gain is measured against one of kickdrift's own.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from claim import Claim, claim, not_run, show, where
from melt import turns

import kickdrift as kd
from kickdrift.plummer import plummer

INSTALL = "pip install 'kickdrift[rebound]'"
STATES = Path(__file__).parents[1] / "data" / "solar-system" / "de421.json"
PLANETS = ("mercury", "venus", "earthmoon", "mars", "jupiter", "saturn", "uranus", "neptune")
AGREE_STEPS, AGREE = 10, 1e-12  # positions after so many steps, relative to the largest coordinate
THREADS_GAIN = 1.7


class Start(NamedTuple):
    """Where a case begins; G is 1."""

    positions: np.ndarray
    velocities: np.ndarray
    masses: np.ndarray
    softening: float
    dt: float


class Case(NamedTuple):
    """One comparison; the ratio of the speeds is to be ``bound`` or more."""

    name: str
    start: Callable[[], Start]
    ours: Callable[[Start], kd.Simulation]
    theirs: Callable[[Start], Rebound]
    bound: float


class Rebound:
    """rebound from a Start; ``setup`` sets what the integrator has besides its name."""

    def __init__(self, start: Start, integrator: str, setup: Callable[[Any], None] = lambda simulation: None) -> None:
        import rebound

        self.simulation = sim = rebound.Simulation()
        sim.G, sim.softening, sim.dt, sim.integrator = 1.0, start.softening, start.dt, integrator
        for x, v, m in zip(start.positions, start.velocities, start.masses, strict=True):
            sim.add(m=float(m), x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2])
        setup(sim)

    def run(self, steps: int) -> None:
        """Take steps."""
        self.simulation.steps(steps)

    @property
    def positions(self) -> np.ndarray:
        """(n, 3)"""
        return np.array([particle.xyz for particle in self.simulation.particles])


def planets() -> Start:
    """Sun and planets."""
    bodies = [json.loads(STATES.read_text())["bodies"][name] for name in ("sun", *PLANETS)]
    x, v, gm = (np.array([body[key] for body in bodies]) for key in ("position", "velocity", "GM"))
    return Start(x, v, gm, softening=0.0, dt=0.5)


def stars(count: int) -> Start:
    """A Plummer sphere."""
    return Start(*plummer(count, seed=1), softening=0.01, dt=1e-3)


def native(start: Start, integrator: str, threads: int = 1, **options: Any) -> kd.Simulation:
    """kickdrift from a Start."""
    force = kd.Gravity(1.0, start.softening)
    system = kd.System(start.positions, start.velocities, start.masses, forces=[force], units="nbody")
    return kd.Simulation(system, integrator, start.dt, threads, **options)


def leapfrog(count: int, bound: float) -> Case:
    """Direct summation over so many bodies."""
    start = planets if count == 1 + len(PLANETS) else partial(stars, count)
    ours = partial(native, integrator="leapfrog-dkd")
    return Case(f"leapfrog, {count} bodies", start, ours, partial(Rebound, integrator="leapfrog"), bound)


CASES = (leapfrog(9, 1.8), leapfrog(100, 4.0), leapfrog(1000, 4.0), leapfrog(4096, 4.0))
ON_THREADS = (1000, 4096)


def agree(case: Case, start: Start) -> None:
    """Both go the same way for some steps; a RuntimeError where they do not."""
    ours, theirs = case.ours(start), case.theirs(start)
    ours.run(AGREE_STEPS)
    theirs.run(AGREE_STEPS)
    x = ours.state.positions
    apart = np.abs(x - theirs.positions).max() / np.abs(x).max()
    if not apart <= AGREE:
        raise RuntimeError(f"{case.name}: after {AGREE_STEPS} steps positions are {apart:.1e} apart")


def quartiles(ratios: np.ndarray) -> str:
    """Median and quartiles in words."""
    low, median, high = np.quantile(ratios, [0.25, 0.5, 0.75])
    return f"{median:.2f} (quartiles {low:.2f} to {high:.2f})"


def compare(case: Case, count: int, seconds: float) -> Claim:
    """Run both in turns and print what was measured."""
    start = case.start()
    agree(case, start)
    speeds = turns([case.ours(start), case.theirs(start)], seconds, count)
    ratios = speeds[:, 0] / speeds[:, 1]
    ours, theirs = (1e6 / np.median(speeds[:, k]) for k in range(2))
    print(f"  {case.name:22} {ours:12.3f} us a step, rebound {theirs:12.3f}: {quartiles(ratios)} times as fast")
    ratio = float(np.median(ratios))
    return claim(
        f"{case.name}: speed over rebound's", ratio, f"at least {case.bound:g}", ratio >= case.bound, "rebound"
    )


def gain(bodies: int, count: int, seconds: float) -> Claim:
    """What a second thread gives."""
    from numba import config

    text, bound = f"leapfrog, {bodies} bodies: speed of two threads over one", f"at least {THREADS_GAIN:g}"
    if config.NUMBA_NUM_THREADS < 2:
        return not_run(text, bound, "kickdrift itself", "a second core")
    start = stars(bodies)
    speeds = turns([native(start, "leapfrog-dkd", threads) for threads in (1, 2)], seconds, count)
    ratios = speeds[:, 1] / speeds[:, 0]
    print(f"  {bodies} bodies: two threads are {quartiles(ratios)} times as fast as one")
    ratio = float(np.median(ratios))
    return claim(text, ratio, bound, ratio >= THREADS_GAIN, "kickdrift itself, in turns")


def study(names: Sequence[str] = (), count: int = 9, seconds: float = 0.5) -> list[Claim]:
    """All cases, or those whose names begin with one of ``names``, printed as they come."""
    chosen = [case for case in CASES if not names or case.name.startswith(tuple(names))]
    try:
        import rebound  # noqa: F401
    except ImportError:
        return [not_run(f"{c.name}: speed over rebound's", f"at least {c.bound:g}", "rebound", INSTALL) for c in chosen]
    print(where("rebound"))
    rows = [compare(case, count, seconds) for case in chosen]
    if not names:
        rows += [gain(bodies, count, seconds) for bodies in ON_THREADS]
    return rows


def claims() -> list[Claim]:
    """All cases."""
    return study()


def main() -> int:
    """Compare with the given options and print the claims."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("cases", nargs="*", metavar="CASE", help="beginnings of names, e.g. leapfrog; default all")
    parser.add_argument("--turns", type=int, default=9, help="of each")
    parser.add_argument("--seconds", type=float, default=0.5, help="length of a turn")
    given = parser.parse_args()
    return show(study(given.cases, given.turns, given.seconds))


if __name__ == "__main__":
    sys.exit(main())
