"""On stiffness: how much longer an implicit method's steps are, and from which ratio of rates on.

Explicit: Dormand and Prince's method, whose steps a stiff problem holds at 3.3066 over its largest rate: the length of
the real stability interval, the one number that the measured steps are compared with (Hairer & Wanner 1996, IV.2,
doi:10.1007/978-3-642-05221-7). Implicit: Radau IIA of order 5.
"""

import math
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from docs.studies.textbooks.article import Claim, Reading, article, magnitude, near
from kickdrift.errors import RunError
from kickdrift.odes import hires, orego, robertson, van_der_pol

EXPLICIT, IMPLICIT, TOLERANCE = "dormand-prince45", "radau", 1e-6
INTERVAL = 3.3066
LOOKS = 2000  # at the largest rate
RATIOS = (3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 3e3, 1e4)
FAR = 1e5  # the ratio at which the explicit method's steps are compared with theory
THEORY = "∫ largest rate dt / 3.3066"
SHORT = 40.0  # of Robertson's reaction, the time of the first books; the test set goes to LONG
LONG = 1e11
A_YEAR = 365.25 * 86400


class Case(NamedTuple):
    """A stiff problem and how far to go, and the absolute tolerance."""

    problem: kd.Problem
    length: float
    atol: float
    end: tuple[float, ...] = ()  # published


CASES = {
    "HIRES": Case(hires(), 321.8122, 1e-8, (0.7371312573325668e-3,)),
    "Robertson to t = 40": Case(robertson(), SHORT, 1e-10),
    "van der Pol, mu = 1000": Case(van_der_pol(1000.0), 2000.0, 1e-8),
    "Oregonator": Case(orego(), 360.0, 1e-8, (0.1000814870318523e1,)),
}


def rate(problem: kd.Problem, t: float, y: np.ndarray) -> float:
    """The fastest decay."""
    assert problem.jacobian is not None
    return max(0.0, -float(np.linalg.eigvals(np.array(problem.jacobian(t, y))).real.min()))


def steps_of(case: Case, method: str) -> int:
    sim = kd.Simulation(case.problem, method, rtol=TOLERANCE, atol=case.atol)
    return sim.run(until=case.length, interval=case.length).steps


def held(case: Case) -> tuple[int, float, float]:
    """The explicit method's steps to the end, those that stability asks for, and the first unknown at the end."""
    sim = kd.Simulation(case.problem, EXPLICIT, rtol=TOLERANCE, atol=case.atol)
    rates = []
    sim.run(
        until=case.length, interval=case.length / LOOKS,
        observe=lambda sim: rates.append(rate(case.problem, sim.time, sim.state.y)),
    )  # fmt: skip
    return sim.record.steps, float(np.mean(rates)) * case.length / INTERVAL, float(sim.state.y[0])


def asked_for(case: Case, length: float) -> float:
    """The steps that stability asks of the explicit method, along the implicit method's solution, at times evenly in
    their logarithm."""
    sim = kd.Simulation(case.problem, IMPLICIT, rtol=TOLERANCE, atol=1e-14)
    times = np.geomspace(1e-3, length, 120)
    rates = []
    for t in times:
        sim.run(until=float(t), interval=float(t))
        rates.append(rate(case.problem, float(t), sim.state.y))
    return float(np.trapezoid(rates, times)) / INTERVAL


def blow_up(case: Case, implicit: int) -> Reading:
    """RK4 at the implicit method's mean step."""
    dt = case.length / implicit
    sim, done = kd.Simulation(case.problem, "rk4", dt=dt), -1
    try:
        sim.run(100, every=1)
    except RunError:
        done = sim.steps_done
    fastest = rate(case.problem, 0.0, case.problem.y0)
    bound = f"unstable: rate x dt = {fastest * dt:.3g} > 2.785"
    return Reading(
        f"RK4 at the implicit method's mean step {dt:.2g}, van der Pol", float(done), done >= 0, bound,
        done >= 0 and fastest * dt > 2.785, "real stability interval of RK4", "steps, then it blows up",
    )  # fmt: skip


def wins() -> list[Claim]:
    """On the problems of the literature."""
    longer, ends = [], []
    counts = {}
    for name, case in CASES.items():
        explicit, theory, first = held(case)
        implicit = counts[name] = steps_of(case, IMPLICIT)
        times = explicit / implicit
        longer.append(near(name, times, 1e3 <= times <= 1e6, theory / implicit, 0.02, THEORY, "times"))
        if case.end:
            off = abs(first / case.end[0] - 1)
            ends.append(
                Reading(
                    f"{name}, Dormand-Prince's error at the end", off, off > 1e-3, "at most 1e-5", off <= 1e-5,
                    "Mazzia & Magherini 2008, Test Set for IVP Solvers",
                )
            )  # fmt: skip
    reaction = CASES["Robertson to t = 40"]
    far = asked_for(reaction, LONG)
    sim = kd.Simulation(reaction.problem, IMPLICIT, rtol=TOLERANCE, atol=1e-14)
    implicit = sim.run(until=LONG, interval=LONG).steps
    near_by, explicit = asked_for(reaction, SHORT), steps_of(reaction, EXPLICIT)
    met = abs(explicit / near_by - 1) <= 0.02
    bound = f"the same estimate to t = 40, {near_by:.5g}, is the {explicit} measured to 2 %"
    times, years = far / implicit, far / 1e6 / A_YEAR
    longer.append(Reading("Robertson to 1e11, extrapolated", times, 1e3 <= times <= 1e6, bound, met, THEORY, "times"))
    ends.append(
        Reading(
            "Robertson to 1e11, extrapolated, at 10^6 steps a second", years, years > 1, bound, met, THEORY, "years"
        )
    )
    return [
        *article(
            "explicit methods fail on stiff problems",
            "One that watches its error only slows down to the edge of stability and arrives with the accuracy asked "
            "for. A step fixed without regard to the fastest rate blows up, and Robertson's full time is out of reach.",
            blow_up(CASES["van der Pol, mu = 1000"], counts["van der Pol, mu = 1000"]),
            *ends,
        ),
        *article(
            "implicit methods win 10^3 to 10^6 in step on stiff problems",
            "The gain is the largest rate times the length of an implicit step, over 3.3: it has no range of its own, "
            f"and goes from 67 to 6 10^11 on these problems at rtol = {TOLERANCE:g}.",
            *longer,
        ),
    ]


def two_rates(ratio: float) -> kd.Problem:
    """y1' = -y1, y2' = -ratio y2; the ratio is the third unknown, so that one compiled function serves all."""
    return kd.Problem(slopes, [1.0, 1.0, ratio], slopes_jacobian, name="two rates")


def slopes(t, y):
    return (-y[0], -y[2] * y[1], 0.0)


def slopes_jacobian(t, y):
    return [[-1.0, 0.0, 0.0], [0.0, -y[2], -y[1]], [0.0, 0.0, 0.0]]


def crossing(length: float, tolerance: float) -> Reading:
    """The ratio from which on the explicit method takes more steps."""

    def steps(method: str, ratio: float) -> int:
        sim = kd.Simulation(two_rates(ratio), method, rtol=tolerance, atol=tolerance / 100)
        return sim.run(until=length, interval=length).steps

    excess: list[float] = []  # of the explicit method's steps, as a logarithm
    for ratio in RATIOS:
        excess.append(math.log(steps(EXPLICIT, ratio) / steps(IMPLICIT, ratio)))
        if excess[-1] > 0:
            break
    if excess[0] > 0 or excess[-1] <= 0:
        raise ArithmeticError(f"no crossing between the ratios {RATIOS[0]:g} and {RATIOS[-1]:g}")
    begins = float(np.exp(np.interp(0.0, excess, np.log(RATIOS[: len(excess)]))))
    last, measured = FAR * length / INTERVAL, steps(EXPLICIT, FAR)
    bound, met = f"at the ratio {FAR:g}, {last:.4g} steps to 2 %: {measured}", abs(measured / last - 1) <= 0.02
    text = f"more steps, t = {length:g}, rtol = {tolerance:g}"
    return Reading(text, begins, magnitude(begins, 1e3), bound, met, "ratio x t / 3.3066")


def begins() -> list[Claim]:
    return article(
        "stiffness begins near a ratio of 10^3",
        "It begins where stability asks for more steps, ratio x t / 3.3, than accuracy does: the earlier, the longer "
        "the time and the lower the accuracy. The ratio alone does not say.",
        crossing(10.0, 1e-6),
        crossing(10.0, 1e-3),
        crossing(1.0, 1e-6),
        crossing(0.1, 1e-6),
        crossing(10.0, 1e-10),
    )


def claims(long: bool = False) -> list[Claim]:
    return [*wins(), *begins()]
