"""Sampling errors of heat baths from coupled paths, as ``kickdrift compare`` measures them.

Oscillators: the differences between dt and dt / 2 of <U> and <K> are those of the stationary covariances, which solve
discrete Lyapunov equations (see heat_baths). A Lennard-Jones liquid of 1000 particles (lj-1000, T* = 1, friction 5):
the error of <U> goes as dt squared for obabo, and cannot be resolved for baoab. Two runs of 1,470,000 steps of obabo at
dt = 0.01 and 1,340,000 steps at 0.005 differ by 0.00612 (0.00031) per particle: coupled paths agree. What independent
runs cost for the same error follows from the block averages of the fine paths.
"""

import math
from collections.abc import Iterator

import numpy as np

import kickdrift as kd
from kickdrift.analysis.compare.coupled_paths import CoupledPaths, difference, stretch_of, stretches
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.heat_baths import LYAPUNOV, covariance

SIGMAS = 3.0
WORDS = ("baoab", "obabo", "aboba", "oabao", "baoa")
WELLS = 1000
STEPS = (0.015, 0.0125, 0.01)
FRICTION = 5.0
LEAST_GAIN = 10.0
INDEPENDENT = (0.00612, 0.00031)  # see above
SLOPE = 0.3


def oscillator_claims() -> Iterator[Claim]:
    """Differences between dt and dt / 2 in harmonic wells."""
    rng = np.random.default_rng(4)
    wells = kd.System(rng.normal(size=(WELLS, 3)), rng.normal(size=(WELLS, 3)), forces=[kd.HarmonicTrap(1.0)])
    for name in WORDS:
        paths = CoupledPaths(wells, kd.integrator(name, temperature=1.0, friction=1.0, seed=2), 1.0, wells.state)
        stretches(paths, 10, 4)
        found = difference(stretches(paths, 12, 60), paths, 12)
        whole, half = (covariance(name.upper(), dt, 1.0) for dt in (1.0, 0.5))
        exact = 1.5 * WELLS * np.array([whole[k, k] - half[k, k] for k in (0, 1)])
        off = float(np.max(np.abs(found.values[:2] - exact) / found.errors[:2]))
        value = f"{found.values[0] / WELLS:.4f}, {found.values[1] / WELLS:.4f}"
        text = f"{name}: U and K of a particle in a well at omega dt = 1 less those at 1/2"
        print(f"  {text}: {value}; exact {exact / WELLS}; {off:.1f} standard errors", flush=True)
        yield claim(text, value, f"within {SIGMAS:g} standard errors of {exact[0] / WELLS:.4f}, "
                    f"{exact[1] / WELLS:.4f}", off <= SIGMAS, LYAPUNOV)  # fmt: skip


def liquid_claims(long: bool) -> Iterator[Claim]:
    """Errors of <U> of a liquid, their slope, and what independent runs cost."""
    system = kd.load("lj-1000")
    sim = kd.Simulation(system, "baoab", 0.005, temperature=1.0, friction=FRICTION, seed=5)
    sim.equilibrate(1.0, 10.0)
    count, found = 3000 if long else 200, {}
    for name in ("obabo", "baoab"):
        for dt in STEPS:
            method = kd.integrator(name, temperature=1.0, friction=FRICTION, seed=3)
            paths = CoupledPaths(system, method, dt, sim.state)
            steps = stretch_of(paths, 200)
            each = difference(stretches(paths, steps, count), paths, steps)
            value, error = each.values[0] / len(system), each.errors[0] / len(system)
            found[name, dt] = value, error
            print(f"  {name}, dt = {dt}: U {value:+.5f} ({error:.5f}), K {each.values[1] / len(system):+.5f} "
                  f"({each.errors[1] / len(system):.5f}), P {each.values[2]:+.4f} ({each.errors[2]:.4f}); "
                  f"stretches of {steps * dt:.3f}, {paths.steps:,} steps, "
                  f"gain {each.gain:.0f}", flush=True)  # fmt: skip
            yield claim(
                f"{name}: times the steps that independent runs need for the error of U at dt = {dt}", each.gain,
                f"at least {LEAST_GAIN:g}", each.gain >= LEAST_GAIN, "block averages of the fine paths",
            )  # fmt: skip
    value, error = found["obabo", 0.01]
    off = abs(value - INDEPENDENT[0]) / math.hypot(error, INDEPENDENT[1])
    yield claim("obabo: U at dt = 0.01 less U at 0.005", f"{value:.5f} ({error:.5f})",
                f"within {SIGMAS:g} standard errors of {INDEPENDENT[0]} ({INDEPENDENT[1]})", off <= SIGMAS,
                "independent runs of 2.8 million steps")  # fmt: skip
    rows = [(math.log(dt), math.log(found["obabo", dt][0]), found["obabo", dt][0] / found["obabo", dt][1])
            for dt in STEPS]  # fmt: skip
    x, y, weights = map(np.array, zip(*rows, strict=True))
    (slope, _), scatter = np.polyfit(x, y, 1, w=weights, cov="unscaled")
    text, bound = f"{slope:.2f} ± {math.sqrt(scatter[0, 0]):.2f}", "2, within three standard errors"
    good = abs(slope - 2.0) <= max(SIGMAS * math.sqrt(scatter[0, 0]), SLOPE)
    yield claim("obabo: slope of the error of U from dt = 0.015 to 0.01", text, bound, good, "the order of the word")
    for dt in STEPS:
        value, error = found["baoab", dt]
        yield claim(f"baoab: error of U at dt = {dt} over that of obabo", f"{value / found['obabo', dt][0]:+.3f}",
                    "at most 0.25 and three standard errors",
                    abs(value) <= 0.25 * found["obabo", dt][0] + SIGMAS * error,
                    "Leimkuhler & Matthews 2013, doi:10.1063/1.4802990")  # fmt: skip


def claims(long: bool = False) -> Iterator[Claim]:
    yield from oscillator_claims()
    yield from liquid_claims(long)


if __name__ == "__main__":
    main(claims, __doc__)
