"""Are the derivatives that trace carries those of its own map, and do they approach those of the motion?

    python -m kickdrift_validation.trace_derivatives [--long]

Two giants that meet, with a third; a planet that passes close to the star; massless bodies beside both. The columns of
the transition matrix are compared with differences of trace's own runs, and with the variational equations under
gauss-radau15. Is the map symplectic across encounters, and what does a direction cost?
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from time import process_time
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, main

DT, STEPS = 0.4, 16
Rows = list[tuple[float, ...]]
MEETING: Rows = [(1e-3, 5.0, 0.02, -0.12, 0.01), (8e-4, 5.6, 0.04, 0.0, 0.02), (6e-4, 9.0, 0.1, 2.0, 0.03)]
DIVING: Rows = [(1e-3, 5.0, 0.97, -0.35, 0.01), (1e-3, 12.0, 0.05, 1.0, 0.02)]
LIGHT: Rows = [(0.0, 5.2, 0.05, -0.06, 0.0), (0.0, 7.0, 0.97, -0.3, 0.0)]
FLAT = kd.Oblateness(j2=0.02, radius=0.5, pole=(0.1, 0.0, 1.0), G=1.0)
FIELD = kd.DrivenField((1e-4, 0.0, 5e-5), frequency=0.7)
CASES: dict[str, tuple[Rows, list[Any], float]] = {
    "giants that meet": (MEETING, [], 1e-4),
    "a passage of the pericentre": (DIVING, [], 1e-5),
    "giants that meet, and massless bodies": (MEETING + LIGHT, [], 1e-5),
    "all of these about a flat star in a field that changes": (MEETING + LIGHT, [FLAT, FIELD], 1e-5),
    "a passage by a flat star in a field that changes": (DIVING, [FLAT, FIELD], 1e-5),
}


def claims(long: bool = False) -> Iterator[Claim]:
    yield from slopes()
    yield from motion(long)
    yield from spectra()
    yield from costs()


def system_of(rows: Rows, *forces: Any) -> kd.System:
    """A star of mass 1 with bodies (mass, a, e, eccentric anomaly, height)."""
    n = len(rows) + 1
    x, v, masses = np.zeros((n, 3)), np.zeros((n, 3)), np.ones(n)
    for i, (mass, a, e, angle, height) in enumerate(rows, 1):
        b, rate = np.sqrt(1 - e * e), np.sqrt((1.0 + mass) / a**3) / (1 - e * np.cos(angle))
        x[i] = a * (np.cos(angle) - e), a * b * np.sin(angle), height
        v[i] = -a * np.sin(angle) * rate, a * b * np.cos(angle) * rate, 0.0
        masses[i] = mass
    return kd.System(x, v, masses, forces=[kd.Gravity(G=1.0), *forces], units="nbody")


def moved(system: kd.System, column: int, by: float) -> kd.System:
    phase, n = system.state.phase.transpose(0, 2, 1).copy(), len(system)
    phase[column // (3 * n), column % (3 * n) // 3, column % 3] += by
    return kd.System(*phase, system.state.masses, forces=system.forces, units="nbody")


def end_of(system: kd.System) -> np.ndarray:
    sim = kd.Simulation(system, "trace", DT)
    sim.run(STEPS)
    return np.concatenate([sim.state.positions.ravel(), sim.state.velocities.ravel()])


def difference(end: Callable[[float], np.ndarray], h: float) -> np.ndarray:
    """Derivative by differences of order 6."""
    one, two, three = ((end(k * h) - end(-k * h)) / (2 * k * h) for k in (1, 2, 3))
    return np.asarray(1.5 * one - 0.6 * two + 0.1 * three)


def slopes() -> Iterator[Claim]:
    for name, (rows, forces, h) in CASES.items():
        system = system_of(rows, *forces)
        found, worst = kd.transition_matrix(system, STEPS * DT, "trace", DT), []
        for column in range(found.matrix.shape[1]):
            wanted = difference(lambda by, k=column, of=system: end_of(moved(of, k, by)), h)
            worst.append(np.abs(found.matrix[:, column] - wanted).max() / np.abs(wanted).max())
        value = float(max(worst))
        text = f"trace, {STEPS} steps of {name}: all columns of the transition matrix, each relative to its largest"
        yield claim(text, value, "at most 1e-8", value <= 1e-8, "differences of order 6 of trace's own runs")
        own = np.concatenate([found.end.positions.ravel(), found.end.velocities.ravel()])
        same = bool((own == end_of(system)).all())
        yield claim(f"trace, {name}: the same bits with and without derivatives", same, "yes", same, "the plain run")


def motion(long: bool) -> Iterator[Claim]:
    single, steps = 1000 if long else 200, 1000
    for name, rows in (("giants that meet", MEETING), ("passages of the pericentre", DIVING)):
        sim, worst = kd.Simulation(system_of(rows), "trace", DT), []
        for _ in range(single):
            worst.append(kd.transition_matrix(sim, DT).symplectic_error or 0.0)
            sim.run(1)
        value = float(max(worst))
        text = f"M^T J M - J of each of {single} steps of trace with {name}, over the largest of M^2"
        yield claim(text, value, "at most 1e-14", value <= 1e-14, "a symplectic map")
        value = kd.transition_matrix(system_of(rows), steps * DT, "trace", DT).symplectic_error or 0.0
        text = f"M^T J M - J after {steps} steps of trace with {name}, over the largest of M^2"
        yield claim(text, value, "at most 1e-12", value <= 1e-12, "a symplectic map")
    system, length = system_of(MEETING), 640.0
    exact = kd.transition_matrix(system, length, "gauss-radau15").matrix
    far = [np.abs(kd.transition_matrix(system, length, "trace", dt).matrix - exact).max() for dt in (0.2, 0.025)]
    value = float(np.log2(far[0] / far[1]) / 3.0)
    text = "giants that meet: power of dt of the matrix's difference from the motion's, between dt = 0.2 and 0.025"
    yield claim(text, value, "1.8 to 2.2", 1.8 <= value <= 2.2, "the variational equations under gauss-radau15")
    value = float(far[1] / np.abs(exact).max())
    text = "the same difference at dt = 0.025, relative to the largest element, some 8e4"
    yield claim(text, value, "at most 1e-2", value <= 1e-2, "the variational equations under gauss-radau15")


def spectra() -> Iterator[Claim]:
    found = kd.lyapunov_spectrum(system_of(MEETING), 400.0, "trace", DT)
    value = abs(found.sum)
    text = "24 Lyapunov exponents of giants that meet: their sum"
    yield claim(text, value, "at most 1e-11", value <= 1e-11, "a symplectic map keeps volumes")


def costs() -> Iterator[Claim]:
    steps = 4000
    for name, rows in (("giants that meet", MEETING), ("passages of the pericentre", DIVING)):
        system = system_of(rows)
        directions, ratios = 6 * len(system), []
        kd.transition_matrix(system, DT, "trace", DT)
        kd.Simulation(system, "trace", DT).advance(1)
        for _ in range(5):
            sim = kd.Simulation(system, "trace", DT)
            alone = -process_time()
            sim.advance(steps)
            alone += process_time()
            together = -process_time()
            kd.transition_matrix(system, steps * DT, "trace", DT)
            together += process_time()
            ratios.append((together - alone) / directions / alone)
        value = float(np.median(ratios))
        text = f"trace, {name}: time of one of {directions} directions over that of a step"
        yield claim(text, value, "at most 1.3", value <= 1.3, "the same run without directions")


if __name__ == "__main__":
    sys.exit(main(claims, __doc__))
