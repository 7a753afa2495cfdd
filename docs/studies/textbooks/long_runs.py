"""On long runs: has leapfrog no drift after 10^9 steps?

Kepler's ellipse of e = 0.5 at dt = 0.01, 10^7 steps, 10^9 with --long; the slope of the energy error and its 95 %
interval are those of `kickdrift.statistics.drift`, carried on to 10^9 steps. Rounding makes the energy walk: by some
eps sqrt(n) after n steps (Brouwer 1937, doi:10.1086/105423).
"""

import math

import numpy as np

import kickdrift as kd
from docs.studies.textbooks.article import Claim, Reading, article, near
from kickdrift.odes import harmonic_oscillator, kepler

STEPS, LONG_STEPS, SAID = 10_000_000, 1_000_000_000, 1e9
DT, SAMPLES = 0.01, 1000
WALKS = 3.0  # standard deviations of a random walk
EPSILON = float(np.finfo(float).eps)
BROUWER = "a random walk of roundings, Brouwer 1937"


def walk(steps: int, share: float = 1.0) -> float:
    """How far rounding may take the energy; ``share`` of what is added is rounded."""
    return WALKS * EPSILON * math.sqrt(steps) * share


def orbit(steps: int, compensated: bool) -> Reading:
    """The slope of the relative energy error on an ellipse."""
    sim = kd.Simulation(kepler(0.5), "velocity-verlet", dt=DT, compensated=compensated)
    energy = sim.run(steps, every=steps // SAMPLES - 11).energy  # of no common measure with the period
    assert energy is not None
    slope, error = (x * DT for x in (energy.drift_per_unit_time, energy.drift_error))
    share, what = (DT, "compensated sums, as in exact arithmetic") if compensated else (1.0, "float64")
    bound = walk(steps, share) + error * steps
    return Reading(
        f"{what}, Kepler e = 0.5, {steps:.0e} steps{'' if steps >= SAID else ', extrapolated'}",
        slope * SAID, abs(slope) <= error, f"slope x steps at most 3 eps sqrt(n) + its error = {bound:.1e}",
        abs(slope) * steps <= bound, BROUWER, f"± {error * SAID:.1g} of E in 10^9 steps",
    )  # fmt: skip


def oscillator(steps: int) -> Reading:
    """What leapfrog conserves exactly on the oscillator, v^2 + (1 - dt^2 / 4) x^2, in float64."""
    sim = kd.Simulation(harmonic_oscillator(), "velocity-verlet", dt=DT)

    def kept() -> float:
        x, v = sim.state.y
        return v * v + (1 - DT * DT / 4) * x * x

    before = kept()
    sim.run(steps, every=steps)
    change = abs(kept() / before - 1)
    return Reading(
        f"float64, oscillator, {steps:.0e} steps, its modified energy", change, change <= walk(steps),
        f"at most 3 eps sqrt(n) = {walk(steps):.1e}", change <= walk(steps), BROUWER, "of it",
    )  # fmt: skip


def too_long() -> Reading:
    """Beyond the step where it is stable, as far as floats reach."""
    dt, steps = 2.01, 1000
    sim = kd.Simulation(harmonic_oscillator(), "velocity-verlet", dt=dt)
    sim.run(steps // 2, every=steps)
    before = float(np.hypot(*sim.state.y))
    sim.run(steps // 2, every=steps)
    growth = math.log(float(np.hypot(*sim.state.y)) / before) / (steps // 2)
    theory = math.acosh(dt * dt / 2 - 1)
    reference = "arcosh(dt^2 / 2 - 1), the eigenvalue of its step"
    return near("dt above 2 / omega", growth, False, theory, 1e-9, reference, "growth rate per step")


def claims(long: bool = False) -> list[Claim]:
    """All of this page, to 10^9 steps where ``long``."""
    steps = LONG_STEPS if long else STEPS
    return article(
        "leapfrog has no drift after 10^9 steps",
        "The method has none at a step that is stable and constant. Its sums in float64 do wander, by some "
        "eps sqrt(n): 10^-10 or less after 10^9 steps, six orders below the error that does not grow.",
        orbit(steps, True),
        orbit(steps, False),
        oscillator(steps),
        too_long(),
    )
