"""eos beside rebound's eos: the same map, its errors, its orders, and speed in turns.

Two planets of a thousandth of the star's mass are those of rebound's own tests. Rein 2020, doi:10.1093/mnras/stz3601;
rebound 5.2.2.
"""

import time
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import INSTALL, Claim, at_least, at_most, main, not_run
from kickdrift_validation.rebounds import simulation

BODIES = [{"mass": 1.0}, {"mass": 1e-3, "a": 1.0, "e": 0.05}, {"mass": 1e-3, "a": 1.6, "e": 0.05, "f": 57.29577951}]
MAPS = (("lf", "lf", 16, 0.0628), ("lf4", "lf4", 2, 0.00628), ("lf4_2", "lf4", 2, 0.00628), ("lf6", "lf6", 2, 0.05),
        ("lf8_6_4", "lf8", 2, 0.02), ("lf8", "lf8", 1, 0.05), ("lf", "pmlf4", 8, 0.0628), ("lf4", "pmlf6", 2, 0.00628),
        ("lf8_6_4", "plf7_6_4", 2, 0.02), ("pmlf4", "pmlf6", 2, 0.02), ("pmlf6", "pmlf6", 2, 0.02),
        ("plf7_6_4", "pmlf6", 2, 0.02))  # fmt: skip
STEPS, TURNS = 1000, 5


def planets() -> kd.System:
    return kd.System.from_elements(BODIES, units="nbody", frame="jacobi")


def ours(phi0: str, phi1: str, substeps: int, dt: float) -> kd.Simulation:
    return kd.Simulation(planets(), "eos", dt=dt, phi0=phi0, phi1=phi1, substeps=substeps)


def theirs(phi0: str, phi1: str, substeps: int, dt: float, safe_mode: int = 1) -> Any:
    there = simulation(planets(), "eos", dt)
    own = there.integrator
    own.phi0, own.phi1, own.n, own.safe_mode = phi0, phi1, substeps, safe_mode
    return there


def same_map(given: tuple[str, str, int, float]) -> Iterator[Claim]:
    """Positions after 1000 steps, and the error of the energy."""
    sim, there = ours(*given), theirs(*given)
    begun, before = sim.energy().total, there.energy()
    sim.run(STEPS)
    there.steps(STEPS)
    there.synchronize()
    text = f"phi0 {given[0]}, phi1 {given[1]}, {given[2]} substeps, dt {given[3]}"
    off = float(np.abs(sim.state.positions - np.array([each.xyz for each in there.particles])).max())
    yield at_most(f"{text}: positions after {STEPS} steps, difference", off, 2e-11, "rebound's eos")
    errors = abs(sim.energy().total / begun - 1.0), abs(there.energy() / before - 1.0)
    text = f"{text}: energy error {errors[0]:.1e}, less that of rebound"
    yield at_most(text, abs(errors[0] - errors[1]), 1e-3 * errors[1] + 2e-13, "rebound's eos")


def orders() -> Iterator[Claim]:
    """Orders of both maps together, from two steps."""
    exact = kd.Simulation(planets(), "gauss-radau15")
    exact.run(until=2.0, exact="shorten")
    for name, order, step in (("lf", 2, 0.1), ("lf4", 4, 0.1), ("lf6", 6, 0.1), ("lf8", 8, 0.5),
                              ("plf7_6_4", 4, 0.1), ("pmlf4", 4, 0.1), ("pmlf6", 6, 0.2)):  # fmt: skip
        errors = []
        for dt in (step, step / 2):
            sim = ours(name, name, 1, dt)
            sim.run(until=2.0)
            errors.append(float(np.abs(sim.state.phase - exact.state.phase).max()))
        found = float(np.log2(errors[0] / errors[1]))
        yield at_least(f"order of {name} in both places; error {errors[1]:.1e}", found, order - 0.5, "gauss-radau15")


def speed(given: tuple[str, str, int, float]) -> Iterator[Claim]:
    """Processor time of rebound over ours, in turns; the median. Without ``safe_mode`` rebound joins the last drift of
    a step and the first of the next, which is another map with fewer kicks."""
    sim, there, joined = ours(*given), theirs(*given), theirs(*given, safe_mode=0)
    took: list[list[float]] = []
    for count in (STEPS, *TURNS * (100 * STEPS,)):
        clocks = [time.process_time()]
        for each in (sim.run, there.steps, joined.steps):
            each(count)
            clocks.append(time.process_time())
        took.append(np.diff(clocks).tolist())
    own, same, fewer = np.array(took[1:]).T
    text = f"phi0 {given[0]}, phi1 {given[1]}, {given[2]} substeps: processor time of rebound over ours"
    yield at_least(f"{text}, same map", float(np.median(same / own)), 0.5, "rebound's eos")
    yield at_least(f"{text}, drifts joined", float(np.median(fewer / own)), 0.3, "rebound's eos")


def claims(long: bool = False) -> Iterator[Claim]:
    if find_spec("rebound") is None:
        yield not_run("the map, its errors and its speed", "rounding", "rebound's eos", INSTALL)
    else:
        for given in MAPS:
            yield from same_map(given)
        for given in (*MAPS[:3], *MAPS[6:8]):
            yield from speed(given)
    yield from orders()


if __name__ == "__main__":
    main(claims, __doc__)
