"""Speed of an adaptive solve of a small ODE over SciPy's solve_ivp; the bound is twenty.

    python -m kickdrift_validation.performance.ode_scipy [--turns 9] [--seconds 0.4]

Both use the same method and tolerances, and the same right-hand side, compiled by numba beforehand. They take turns
(A B A B …), so that other load of the machine falls on both. A turn is as many solves as fit in its time, from the
start to the state at the end. The figure is the median of the ratios of neighbouring turns. The claim concerns the
smallest figure.

A solve is ``sim.state = …; sim.run(until=…)`` with an existing Simulation. Making a Simulation takes a tenth of a
second or more, because it compiles the right-hand side for the step loop. The script prints this time too, and the
time of a solve with the default of a thousand looks.
"""

import argparse
import sys
from time import perf_counter
from typing import Any

import numba
import numpy as np
from scipy.integrate import solve_ivp

import kickdrift as kd
from kickdrift.odes import ODES
from kickdrift_validation.claim import Claim, claim, show, where
from kickdrift_validation.performance.turns import Calls, turns

METHODS = {"bogacki-shampine23": "RK23", "dormand-prince45": "RK45", "dop853": "DOP853"}
# parameters, and the final time
PROBLEMS: dict[str, tuple[dict[str, float], float]] = {
    "lorenz": ({}, 10.0),
    "kepler": ({"eccentricity": 0.5}, 20.0),
    "van-der-pol": ({"mu": 5.0}, 20.0),
    "arenstorf": ({}, 17.0),
}
TOLERANCE = 1e-6
BOUND = 20.0
CLAIM = "adaptive solve of a small ODE over SciPy's time"


def compare(name: str, integrator: str, seconds: float, count: int) -> float:
    """Return the ratio of SciPy's time for a solve to ours, and print the details."""
    parameters, time = PROBLEMS[name]
    made = ODES[name](**parameters)
    f = numba.njit(made.f)
    f(0.0, made.y0.copy())
    f(0.0, made.y0)  # read-only; numba gives read-only arrays another type
    problem = kd.Problem(f, made.y0, name=name)
    began = perf_counter()
    sim = kd.Simulation(problem, integrator, rtol=TOLERANCE, atol=TOLERANCE)
    making = perf_counter() - began
    method = METHODS[integrator]

    def ours() -> Any:
        sim.state = problem.state
        sim.run(until=time, interval=time)
        return sim.state.y

    def looking() -> Any:
        sim.state = problem.state
        sim.run(until=time)

    def theirs() -> Any:
        return solve_ivp(f, (0.0, time), problem.y0, method, t_eval=[time], rtol=TOLERANCE, atol=TOLERANCE)

    ours()
    evaluations, steps = sim.record.force_evaluations, sim.steps_done
    found = theirs()
    times = 1.0 / turns([Calls(solve) for solve in (ours, theirs, looking)], seconds, count)
    ratios = times[:, 1] / times[:, 0]
    low, median, high = np.quantile(ratios, [0, 0.5, 1])
    us, them, looks = 1e6 * np.median(times, axis=0)
    print(
        f"  {name:12} {integrator:19} {us:7.0f} us, {steps} steps, {evaluations} evaluations; {method:6} {them:7.0f} "
        f"us, {found.nfev}; ratio {median:6.1f} ({low:.1f} to {high:.1f}); with 1000 looks {looks:.0f} us, "
        f"ratio {them / looks:.1f}; making the Simulation {making:.2f} s"
    )
    return float(median)


def claims(seconds: float = 0.4, count: int = 9) -> list[Claim]:
    """Compare every method on every problem."""
    print(where("scipy"))
    print(f"rtol = atol = {TOLERANCE:g}, {count} turns of {seconds:g} s each")
    ratios = {(name, method): compare(name, method, seconds, count) for name in PROBLEMS for method in METHODS}
    worst = min(ratios, key=lambda key: ratios[key])
    reference = (
        f"SciPy's solve_ivp, same method, tolerance and compiled f; smallest of {len(ratios)}: {' '.join(worst)}"
    )
    return [claim(CLAIM, ratios[worst], f"at least {BOUND:g}", ratios[worst] >= BOUND, reference)]


def main() -> int:
    """Compare with the given options and print the claim."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--turns", type=int, default=9, help="of each")
    parser.add_argument("--seconds", type=float, default=0.4, help="length of a turn")
    given = parser.parse_args()
    return show(claims(given.seconds, given.turns))


if __name__ == "__main__":
    sys.exit(main())
