"""Do runs that `kickdrift compare --accuracy` recommends meet the wanted error, from starts that it has not seen?

One pilot and one recommendation for each system; then the recommended run, at full length, from ten other starts: drawn
velocities for the liquid, initial values off by 2 % for the others. The error is that of the comparison: the root mean
square relative energy error of the liquid, the largest error over the samples against the closed form or a tight run
for the others. Asked of each system: at least 9 of 10 within the wanted error.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

import kickdrift as kd
from kickdrift.analysis.compare.recommendation import Choice, recommendation
from kickdrift.analysis.compare.reference import compared, distance, natural_scale
from kickdrift.analysis.compare.work_precision import work_precision
from kickdrift.odes import kepler, robertson
from kickdrift_validation.claim import Claim, claim, main

SEEDS, LEAST = 10, 0.9
SHORT = "orbit, e = 0.9"  # the case of the short set
OFF = 0.02  # of each initial value
LOOKS = 127


@dataclass(frozen=True)
class Case:
    """A system, as it stands and from another start, and what is wanted of its run."""

    name: str
    start: Callable[[int], kd.System | kd.Problem]  # 0: that of the pilot
    accuracy: float
    length: float
    time: float | None = None  # of the pilot, where it is not the default


def liquid(seed: int) -> kd.System | kd.Problem:
    return kd.load("lj-1000-switch", seed=1 + seed)


def off(values: np.ndarray, seed: int) -> np.ndarray:
    """The values, each off by about 2 %, for every seed but 0."""
    return values * (1.0 + OFF * np.random.default_rng(seed).standard_normal(values.shape) * (seed > 0))


def orbit(eccentricity: float) -> Callable[[int], kd.Problem]:
    """Kepler's ellipse from near the pericentre."""
    return lambda seed: kepler(eccentricity, y0=off(kepler(eccentricity).y0, seed))


def reaction(seed: int) -> kd.Problem:
    """Robertson's, with other rates: its start is all of one kind."""
    k1, k2, k3 = off(np.array([0.04, 3e7, 1e4]), seed)
    return robertson(k1=k1, k2=k2, k3=k3)


CASES = (
    Case("liquid", liquid, 1e-3, 30.0),
    Case("orbit, e = 0.3", orbit(0.3), 1e-8, 6000.0, 600.0),
    Case("orbit, e = 0.9", orbit(0.9), 1e-6, 600.0, 200.0),
    Case("Robertson", reaction, 1e-5, 1e4, 1e4),
)


def error_of(subject: kd.System | kd.Problem, choice: Choice, length: float) -> float:
    sim = kd.Simulation(subject, choice.method, dt=choice.dt, rtol=choice.rtol, atol=choice.atol)
    seen: list[tuple[float, np.ndarray]] = []

    def look(sim: kd.Simulation) -> None:
        seen.append((sim.time, sim.state.y.copy()))

    if isinstance(subject, kd.System):
        energy = sim.run(choice.steps, every=max(1, choice.steps // 500)).energy
        return energy.rms_relative_error
    if choice.steps:
        sim.run(choice.steps, every=max(1, choice.steps // LOOKS), observe=look)
    else:
        sim.run(until=length, interval=length / LOOKS, observe=look)
    y = np.array([each for _, each in seen])
    truth = np.array(solution(subject, [time for time, _ in seen]))
    scale = natural_scale(subject, truth)
    return float(distance(compared(subject, y) - compared(subject, truth), scale).max())


def solution(problem: kd.Problem, times: list[float]) -> list[np.ndarray]:
    """In closed form, or by radau at tight tolerance."""
    if problem.exact is not None:
        return [np.asarray(problem.exact(time)) for time in times]
    sim = kd.Simulation(problem, "radau", rtol=1e-11, atol=1e-15)
    found = []
    for time in times:
        sim.run(until=time, every=10**9)
        found.append(sim.state.y.copy())
    return found


def study(case: Case, seeds: int = SEEDS) -> list[Claim]:
    pilot = work_precision(case.start(0), time=case.time, whole=case.length, accuracy=case.accuracy)
    found = recommendation(pilot, case.accuracy, case.length)
    print(f"{case.name}: error {case.accuracy:g} over {case.length:g}; pilot {pilot.length:g}, {pilot.measure}")
    bound, reference = f"at least {int(LEAST * seeds)} of {seeds}", f"{pilot.reference}"
    text = f"{case.name}: runs within {case.accuracy:g}"
    if found.choice is None:
        print(f"  nothing: {found.refusal}")
        return [claim(text, f"refused: {found.refusal}", bound, False, reference)]
    best = found.choice
    print(f"  {best.options(case.length)}; {best.seconds:.2g} s, next {found.margin or np.nan:.2g} times that")
    for line in found.evidence:
        print(f"    {line}")
    errors = [error_of(case.start(seed), best, case.length) for seed in range(1, seeds + 1)]
    print("  errors: " + ", ".join(f"{error:.1e}" for error in errors), flush=True)
    met = sum(error <= case.accuracy for error in errors)
    value = f"{met} of {seeds}, {best.method}, worst {max(errors):.1e}"
    return [claim(text, value, bound, met >= int(LEAST * seeds), reference)]


def claims(long: bool = False) -> list[Claim]:
    """Claims on one system; if ``long``, on all systems and on whether their winners differ."""
    rows = [row for case in CASES if long or case.name == SHORT for row in study(case)]
    winners = {str(row["value"]).split(", ")[1] for row in rows if ", " in str(row["value"])}
    if long:
        rows.append(claim("different winners", len(winners), "3 or more", len(winners) >= 3, ", ".join(winners)))
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
