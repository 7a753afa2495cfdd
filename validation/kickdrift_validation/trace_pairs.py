"""Is a scattering by trace the same map as by rebound's TRACE, step by step, and is its energy error larger?

Three giants scatter one another, as in ``kickdrift_validation.trace``. First both programs take each step of a run from
the same state, with all steps that meet, pass or repeat and some of the others. Then both run 200 systems to the end.
The runs soon part, because they are chaotic, but the initial conditions still set much of the energy error. So
Wilcoxon's test takes the ratio of the two errors for each system. The number and seeds of the systems were fixed before
the first run. As a control, TRACE runs a second time from places one rounding away. rebound 5.2.2: Rein & Liu 2012,
doi:10.1051/0004-6361/201118085.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.batch import Batch
from kickdrift_validation.claim import INSTALL, Claim, claim, main, not_run
from kickdrift_validation.rebounds import energy, phase, put
from kickdrift_validation.trace import DT, INNER, SIGNIFICANT, TURN, YEARS, giants, theirs

OWN = 7_000_000  # first seed of the systems
COUNT = 200
STEPS = int(YEARS * TURN / DT)
SELDOM = 40  # of the steps without encounters, one in as many is compared
ROUNDING = 2.0**-52


def steps_from_the_same_states(seeds: range) -> Iterator[Claim]:
    """Steps of both programs from the states of whole runs, and the energy that each step moves."""
    apart, moved, counts, repeated = np.zeros(2), np.zeros((2, 2)), np.zeros(2, int), 0
    for seed in seeds:
        system = giants(seed)
        m, rebounds, sim = system.state.masses, theirs(system), kd.Simulation(system, "trace", dt=DT)
        before, flags, twice = sim.state, (0, 0), 0
        for k in range(STEPS):
            sim.advance(1)
            stepper: Any = sim.integration.stepper
            again, meets = stepper._twice > twice, max(*flags, *stepper.flags) > 0 or stepper._twice > twice
            if meets or k % SELDOM == 0:
                put(rebounds, before)
                rebounds.steps(1)
                x, v = phase(rebounds)
                start, after = energy(m, before.positions, before.velocities), sim.state
                ends = energy(m, after.positions, after.velocities), energy(m, x, v)
                row, far = int(meets), float(np.abs(after.positions - x).max() / np.abs(x).max())
                apart[row] = max(apart[row], far)
                moved[row] += [float(abs(end / start - 1)) for end in ends]
                counts[row] += 1
                repeated += again
            before, flags, twice = sim.state, stepper.flags, stepper._twice
    for row, what, bound in ((0, "without encounters", 1e-15), (1, "with encounters or passages", 1e-9)):
        ours, other = moved[row]
        text = f"{counts[row]} steps {what} of {len(seeds)} scatterings: largest difference from TRACE's, relative"
        note = f"sum of |dE / E| {ours:.7e}, TRACE {other:.7e}" + (f"; {repeated} steps done twice" if row else "")
        yield claim(text, float(apart[row]), f"at most {bound:g}", bool(0 < apart[row] <= bound), note)


def error(system: kd.System, x: np.ndarray, v: np.ndarray) -> float:
    """Relative energy error of an end."""
    m, start = system.state.masses, system.state
    return float(abs(energy(m, x, v) / energy(m, start.positions, start.velocities) - 1))


def by_trace(system: kd.System, nudge: float) -> float:
    """Energy error of rebound's TRACE, from x moved by a fraction ``nudge``."""
    sim = theirs(system)
    for body in sim.particles:
        body.x *= 1.0 + nudge
    sim.steps(STEPS)
    return error(system, *phase(sim))


def errors_in_pairs() -> Iterator[Claim]:
    """Energy errors after whole runs, over TRACE's for the same system."""
    from scipy.stats import spearmanr, wilcoxon

    systems = [giants(OWN + seed) for seed in range(COUNT)]
    found: dict[str, list[float]] = {}
    for inner in INNER:
        batch = Batch(systems, "trace", DT, inner=inner)
        batch.run(STEPS, every=STEPS)
        ends = zip(systems, batch.states(), strict=True)
        found[f"{inner}, in lanes"] = [error(system, end.positions, end.velocities) for system, end in ends]
        found[inner] = []
        for system in systems:
            sim = kd.Simulation(system, "trace", dt=DT, inner=inner)
            sim.advance(STEPS)
            found[inner].append(error(system, sim.state.positions, sim.state.velocities))
    found["TRACE one rounding away"] = [by_trace(system, ROUNDING) for system in systems]
    other = np.log([by_trace(system, 0.0) for system in systems])
    least = SIGNIFICANT / len(found)  # all tests together are wrong by chance in one of 20 cases
    for name, errors in found.items():
        ratio = np.log(errors) - other
        p = float(wilcoxon(ratio, alternative="greater").pvalue)
        text = f"{COUNT} scatterings of {YEARS} yr, {name}: Wilcoxon that the energy errors are larger than TRACE's, p"
        medians = f"medians {np.median(errors):.2e}, TRACE {np.exp(np.median(other)):.2e}"
        spread = np.exp(ratio.std() / np.sqrt(COUNT))
        note = f"{medians}; mean ratio {np.exp(ratio.mean()):.2f}, to a factor {spread:.2f}"
        note += f"; rank correlation {spearmanr(errors, other).statistic:.2f}"
        yield claim(text, round(p, 3), f"above {least:g}", p > least, note)


def claims(long: bool = False) -> Iterator[Claim]:
    """All comparisons; ``long`` takes steps of 12 scatterings in place of two."""
    try:
        import rebound  # noqa: F401
    except ImportError:
        yield not_run("scatterings beside rebound's TRACE", "see the other claims", "rebound", INSTALL)
        return
    yield from steps_from_the_same_states(range(OWN, OWN + (12 if long else 2)))
    yield from errors_in_pairs()


if __name__ == "__main__":
    main(claims, __doc__)
