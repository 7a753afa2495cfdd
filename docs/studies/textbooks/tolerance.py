"""On tolerances: is an rtol below 1e-12 meaningless?

Kepler's ellipse of e = 0.5 against its closed form, rtol = atol from 1e-10 down to the smallest that is taken. The
steps go as the error estimate's power of the tolerance, so the error goes as the tolerance itself, where rounding does
not decide (Hairer, Nørsett & Wanner 1993, II.4, doi:10.1007/978-3-540-78862-1).
"""

import numpy as np

import kickdrift as kd
from docs.studies.textbooks.article import Claim, Reading, article
from kickdrift.odes import kepler

TOLERANCES = 10.0 ** -np.array([10.0, 10.5, 11.0, 11.5, 12.0, 12.5, 13.0, 13.5])
LIMIT = 1e-12
EPSILON = float(np.finfo(float).eps)


def error(method: str, rtol: float, length: float) -> float:
    """Error of the state at the end."""
    problem = kepler(0.5)
    assert problem.exact is not None
    options = {} if method == "gauss-radau15" else {"atol": rtol}
    sim = kd.Simulation(problem, method, rtol=rtol, **options)
    sim.run(until=length, interval=length)
    return float(np.abs(sim.state.y - problem.exact(length)).max())


def gained(method: str, length: float) -> Reading:
    """How much smaller the error is at 10^-13.5 than at 1e-12."""
    errors = np.array([error(method, float(rtol), length) for rtol in TOLERANCES])
    power = float(np.polyfit(np.log(TOLERANCES), np.log(errors), 1)[0])
    times = float(errors[np.argmin(np.abs(TOLERANCES - LIMIT))] / errors[-1])
    text = f"{method}, t = {length:g}: error from rtol = 1e-12 to 10^-13.5"
    bound = f"error as rtol^1 to ±0.2 from 1e-10 on: rtol^{power:.3f}"
    return Reading(text, times, times < 2, bound, abs(power - 1) <= 0.2, "Hairer et al. 1993, II.4", "times smaller")


def at_rounding(length: float) -> Reading:
    """A method whose error is rounding at any of these tolerances."""
    errors = np.array([error("gauss-radau15", float(rtol), length) for rtol in (1e-9, LIMIT, TOLERANCES[-1])])
    times = float(errors[1] / errors[2])
    steps_of_rounding = 10 * EPSILON * (length * length)  # an error of the period grows the phase's as t^2
    bound, met = f"all of them below 10 eps t^2 = {steps_of_rounding:.1e}", bool((errors < steps_of_rounding).all())
    text = f"gauss-radau15, t = {length:g}: error from rtol = 1e-12 to 10^-13.5"
    return Reading(text, times, times < 2, bound, met, "rounding of the energy, Brouwer 1937", "times smaller")


def claims(long: bool = False) -> list[Claim]:
    return article(
        "rtol below 1e-12 is meaningless",
        "The error of one step may lie far below the rounding of y, for the step adds a small change to it: from 1e-12 "
        "to 3e-14 the error goes on falling in proportion. Only where the method's own error is below rounding, as "
        "that of gauss-radau15 is here, nothing is left to gain.",
        gained("dop853", 500.0),
        gained("dormand-prince45", 500.0),
        gained("dormand-prince45", 5.0),
        at_rounding(500.0),
    )
