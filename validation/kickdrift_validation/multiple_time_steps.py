"""Are multiple time steps of order 2 and reversible, do they resonate where theory says, and what do they save?

    python -m kickdrift_validation.multiple_time_steps [--long]

Order and reversal: two particles on a stiff spring in a soft trap. Resonance: one particle in a stiff and a soft trap,
whose propagation matrix is known. Savings: the Earth and the Moon, whose attraction is fast, beside the Sun's; and a
Kremer-Grest melt, with bonded neighbours in the fast group. A saving is the ratio of force evaluations of velocity
Verlet to those of respa at the same error: of the Moon's place, and of the energy of the melt.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, main

TUCKERMAN = "Tuckerman, Berne & Martyna 1992, doi:10.1063/1.463137"
BIESIADECKI = "Biesiadecki & Skeel 1993, doi:10.1006/jcph.1993.1220"
FAST, SLOW = 30.0, 3.0  # angular frequencies of the two traps
SUBSTEPS = 400  # of the fast trap, so that its motion is nearly exact
GM = 4 * math.pi**2  # of the Sun, in AU^3 / yr^2
SAVING = 1.8


@kd.body_law
class Attraction(NamedTuple):
    """Gravity of the pair of bodies 1 and 2 alone, or of all other pairs."""

    of_others: float

    def law(p, x, v, m, t, a):
        energy = 0.0
        for i in range(x.shape[1]):
            for j in range(i):
                if (j == 0) == (p.of_others > 0.5):
                    d = x[:, i] - x[:, j]
                    r = math.sqrt(d[0] ** 2 + d[1] ** 2 + d[2] ** 2)
                    energy -= 39.47841760435743 * m[i] * m[j] / r
                    for k in range(3):
                        a[k, i] -= 39.47841760435743 * m[j] * d[k] / r**3
                        a[k, j] += 39.47841760435743 * m[i] * d[k] / r**3
        return energy


# --- order and reversal ---


def sprung() -> kd.System:
    """Two particles on a stiff spring and one beside, in a soft trap."""
    x = np.array([[0.0, 0.0, 0.0], [1.1, 0.0, 0.0], [3.0, 1.0, 0.0]])
    v = np.array([[0.1, -0.2, 0.1], [0.0, 0.1, -0.1], [-0.1, 0.1, 0.05]])
    return kd.System(x, v, forces=[kd.Springs([(0, 1)], 900.0, 1.0), kd.HarmonicTrap(1.0, group=1)])


def orders() -> Iterator[Claim]:
    """Slope of the error at t = 2, and the way back."""
    system = sprung()
    exact = kd.Simulation(system, "yoshida8", dt=0.0005)
    exact.run(until=2.0)
    for substeps in (4, 16):
        steps, errors = (0.01, 0.005, 0.0025, 0.00125), []
        for dt in steps:
            sim = kd.Simulation(system, "respa", dt=dt, substeps=substeps)
            sim.run(until=2.0)
            errors.append(float(np.abs(sim.state.positions - exact.state.positions).max()))
        slope = float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
        text = f"respa, {substeps} substeps: slope of the error of a stiff spring in a soft trap"
        yield claim(text, round(slope, 3), "2 to 0.1", abs(slope - 2) < 0.1, TUCKERMAN)
    sim = kd.Simulation(system, "respa", dt=0.02)
    sim.advance(1000)
    back = kd.Simulation(system.at(sim.state.phase * np.array([1.0, -1.0])[:, None, None], 0.0), "respa", dt=0.02)
    back.advance(1000)
    off = float(np.abs(back.state.positions - system.state.positions).max())
    yield claim("respa: distance from the start after 1000 steps there and back", off, "1e-10", off < 1e-10, "itself")


# --- resonance ---


def growth(dt: float) -> float:
    """Logarithm of the larger eigenvalue of the impulse method with exact fast motion, per step; 0 if bounded."""
    angle = FAST * dt
    half = abs(math.cos(angle) - SLOW**2 * dt / (2 * FAST) * math.sin(angle))
    return math.acosh(half) if half > 1 else 0.0


def measured_growth(dt: float, steps: int = 4000) -> float:
    """Growth of the amplitude in a run, per step, over its second half."""
    system = kd.System(
        [[0.3, 0.0, 0.0]], [[0.1, 0.0, 0.0]],
        forces=[kd.HarmonicTrap((FAST**2, 0.0, 0.0)), kd.HarmonicTrap((SLOW**2, 0.0, 0.0), group=1)],
    )  # fmt: skip
    sim = kd.Simulation(system, "respa", dt=dt, substeps=SUBSTEPS)
    sizes = []
    for _ in range(2):
        sim.advance(steps // 2)
        phase = sim.state.phase
        sizes.append(math.hypot(FAST * phase[0, 0, 0], phase[1, 0, 0]))
    return math.log(sizes[1] / sizes[0]) / (steps // 2)


def resonance() -> Iterator[Claim]:
    """Steps around half a period of the fast trap: growth or none, as theory says."""
    resonant = math.pi / FAST
    steps = [resonant * part for part in (0.6, 0.8, 0.9, 0.95, 0.98, 0.985, 0.99, 0.995, 0.999, 1.01, 1.05)]
    theory = np.array([growth(dt) for dt in steps])
    found = np.array([measured_growth(dt) for dt in steps])
    unstable = [f"{dt / resonant:g}" for dt, rate in zip(steps, found, strict=True) if rate > 1e-3]
    predicted = [f"{dt / resonant:g}" for dt, rate in zip(steps, theory, strict=True) if rate > 1e-3]
    text = "steps that resonate, in halves of the fast period"
    yield claim(text, ", ".join(unstable), ", ".join(predicted), unstable == predicted, BIESIADECKI)
    off = float(np.abs(found - theory)[theory > 1e-3].max() / theory.max())
    text = "rate of growth in resonance beside the propagation matrix, relative"
    yield claim(text, off, "0.05", off < 0.05, BIESIADECKI)


# --- savings ---


def moon() -> kd.System:
    """Sun, Earth and Moon; the Earth and the Moon attract each other in group 0."""
    earth, moon_mass, apart = 3.003e-6, 3.694e-8, 0.00257
    speed, around = math.sqrt(GM), math.sqrt(GM * (earth + moon_mass) / apart)
    x = np.array([[0.0, 0, 0], [1.0, 0, 0], [1.0 + apart, 0, 0]])
    v = np.array([[0.0, 0, 0], [0, speed, 0], [0, speed + around, 0]])
    masses = np.array([1.0, earth, moon_mass])
    v -= masses @ v / masses.sum()
    return kd.System(x, v, masses, units="astro", forces=[Attraction(0.0), Attraction(1.0, group=1)])


def melt() -> kd.System:
    """kremer-grest-1000 with the repulsion of bonded beads in the law of bonds, in group 0."""
    system = kd.load("kremer-grest-1000")
    pairs = next(force for force in system.forces if isinstance(force, kd.LennardJones))
    chains = kd.Topology.chains(20, 50, factors=(0.0, 1.0, 1.0))
    return system.remade(forces=[kd.Fene(epsilon=1.0), replace(pairs, group=1)], topology=chains)


def scatter(method: str, dt: float, time: float, **options: int) -> float:
    """Standard deviation of the energy of the melt, per bead."""
    sim = kd.Simulation(melt(), method, dt=dt, **options)
    sim.advance(round(2.0 / dt))
    report = sim.run(round(time / dt), every=max(1, round(0.03 / dt)))
    return float(np.std(report.about.series.total)) / 1000


def moons_error(method: str, steps: int, **options: int) -> float:
    """Error of the Moon's place relative to the Earth after a year, relative to its distance."""
    exact, sim = kd.Simulation(moon(), "gauss-radau15"), kd.Simulation(moon(), method, dt=1.0 / steps, **options)
    exact.run(until=1.0)
    sim.advance(steps)
    found, right = (each.state.positions[2] - each.state.positions[1] for each in (sim, exact))
    return float(np.abs(found - right).max() / np.linalg.norm(right))


def step_of(wanted: float, steps: Sequence[float], errors: Sequence[float]) -> float:
    """Step of velocity Verlet with the wanted error, from the power law of a ladder."""
    slope, offset = np.polyfit(np.log(steps), np.log(errors), 1)
    return math.exp((math.log(wanted) - offset) / slope)


def savings(long: bool) -> Iterator[Claim]:
    """Fewer evaluations at the same error."""
    ladder = [1 / steps for steps in (500, 1000, 2000, 4000)]
    errors = [moons_error("velocity-verlet", round(1 / dt)) for dt in ladder]
    for substeps in (4, 8):
        wanted = moons_error("respa", 1000, substeps=substeps)
        ratio = 3 / step_of(wanted, ladder, errors) / ((2 + substeps) * 1000)
        text = f"Sun, Earth and Moon: fewer pairs of bodies at an error of the Moon's place of {wanted:.1e}"
        bound = f"at least {SAVING}"
        yield claim(f"{text}, {substeps} substeps", round(ratio, 2), bound, ratio >= SAVING, "gauss-radau15")
    time = 200.0 if long else 40.0
    ladder = [0.003, 0.004, 0.005, 0.006, 0.007]
    errors = [scatter("velocity-verlet", dt, time) for dt in ladder]
    for outer in (0.01, 0.012):
        wanted = scatter("respa", outer, time, substeps=4)
        ratio = outer / step_of(wanted, ladder, errors)
        text = f"Kremer-Grest melt: fewer evaluations of the pair force at a scatter of the energy of {wanted:.1e}"
        yield claim(f"{text}, dt = {outer} / 4", round(ratio, 2), "at least 1.2", ratio >= 1.2, "velocity-verlet")


def claims(long: bool = False) -> Iterator[Claim]:
    """Yield all claims."""
    yield from orders()
    yield from resonance()
    yield from savings(long)


if __name__ == "__main__":
    sys.exit(main(claims, __doc__))
