"""On the unit oscillator: what halving a step brings, how fast forward Euler grows, and RK4 against it.

x'' = -x and, for the last, y' = -y. On both a step of any of these methods is a matrix, R(dt A); its powers are the
reference, worked out here by NumPy alone (Hairer & Wanner 1996, IV.2, doi:10.1007/978-3-642-05221-7).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from docs.studies.textbooks.article import Claim, Reading, article, digits, magnitude, near
from kickdrift.odes import harmonic_oscillator

DT, LENGTH = 0.01, 10.0
PERIOD = 2 * math.pi
TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])
DECAY = np.array([[-1.0]])
ROUNDING = 1e-11
POWERS = "powers of its step's matrix"


def step_matrix(method: str, dt: float, slope: np.ndarray = TURN) -> np.ndarray:
    """One step on y' = slope y."""
    h, one = dt * slope, np.eye(len(slope))
    half_kick, drift = np.array([[1.0, 0.0], [-dt / 2, 1.0]]), np.array([[1.0, dt], [0.0, 1.0]])
    if method == "velocity-verlet":
        return half_kick @ drift @ half_kick
    if method == "symplectic-euler":
        return drift @ half_kick @ half_kick
    terms = {"euler": 1, "midpoint": 2, "rk4": 4}[method]  # of the exponential series: their order
    return one + sum(np.linalg.matrix_power(h, k) / math.factorial(k) for k in range(1, terms + 1))


def decay() -> kd.Problem:
    """y' = -y from 1."""

    def f(t, y):
        return (-y[0],)

    return kd.Problem(f, [1.0], exact=lambda t: [math.exp(-t)], name="decay")


class Errors(NamedTuple):
    """The largest of |y - exact| at the end of a run, what it should be, and the largest of |y - matrix's y|."""

    measured: float
    theory: float
    off: float


def errors(problem: kd.Problem, method: str, length: float, steps: int) -> Errors:
    sim = kd.Simulation(problem, method, dt=length / steps)
    sim.run(steps, every=steps)
    assert problem.exact is not None
    exact = np.array(problem.exact(length))
    slope = DECAY if len(problem) == 1 else TURN
    theory = np.linalg.matrix_power(step_matrix(method, length / steps, slope), steps) @ problem.y0
    pairs = ((sim.state.y, exact), (theory, exact), (sim.state.y, theory))
    return Errors(*(float(np.abs(a - b).max()) for a, b in pairs))


def ratio_of(text: str, a: Errors, b: Errors, agrees: Callable[[float], bool], unit: str) -> Reading:
    """A reading of the ratio of two errors, which are of states that must be the matrix's."""
    ratio = a.measured / b.measured
    reading = near(text, ratio, agrees(ratio), a.theory / b.theory, 1e-6, POWERS, unit)
    met = reading.met and max(a.off, b.off) <= ROUNDING
    return reading._replace(bound=f"{reading.bound}, and y to {ROUNDING:g}", met=met)


def halving() -> list[Claim]:
    """What becomes of the error where the step is halved."""
    oscillator, steps = harmonic_oscillator(), round(LENGTH / DT)

    def reading(text: str, method: str, coarse: tuple[float, int], fine: tuple[float, int]) -> Reading:
        a, b = (errors(oscillator, method, *one) for one in (coarse, fine))
        return ratio_of(text, a, b, lambda times: digits(times, "2.0"), "times smaller")

    whole, twice = (LENGTH, steps), (LENGTH, 2 * steps)
    return article(
        "second order “halves” its error with dt",
        "The error of order p goes as dt^p over a given time and as dt^(p + 1) over one step: half the step leaves a "
        "quarter. Halves are for first order.",
        reading("leapfrog, t = 10", "velocity-verlet", whole, twice),
        reading("explicit midpoint, t = 10", "midpoint", whole, twice),
        reading("leapfrog, one step", "velocity-verlet", (DT, 1), (DT / 2, 1)),
        reading("the method is of first order (symplectic Euler)", "symplectic-euler", whole, twice),
        reading("dt is divided by sqrt 2 only", "velocity-verlet", whole, (LENGTH, round(math.sqrt(2) * steps))),
    )


def log_growth(dt: float, steps: int = 60_000) -> float:
    """Growth of the logarithm of forward Euler's amplitude, per step."""
    sim = kd.Simulation(harmonic_oscillator(), "euler", dt=dt)
    sim.run(steps, every=steps)
    return math.log(math.hypot(*sim.state.y)) / steps


def growth() -> list[Claim]:
    """Forward Euler's amplitude: times sqrt(1 + dt^2) in every step."""
    law = "(1 + dt^2)^(steps / 2)"
    rates = {dt: log_growth(dt) for dt in (DT, DT * PERIOD)}

    def grown(text: str, steps: float, dt: float = DT, power: int = 1) -> Reading:
        percent = 100 * math.expm1(power * steps * rates[dt])
        theory = 100 * math.expm1(power * steps / 2 * math.log1p(dt * dt))
        return near(text, percent, digits(percent, "0.5"), theory, 1e-9, law, "%")

    def doubled(text: str, steps: float, unit: str) -> Reading:
        count, theory = math.log(2) / rates[DT] / steps, 2 * math.log(2) / math.log1p(DT * DT) / steps
        return near(text, count, magnitude(count, 1000), theory, 1e-9, law, unit)

    rows = article(
        "forward Euler's amplitude on the unit oscillator at dt = 0.01 grows 0.5 % a period",
        "A step multiplies the amplitude by sqrt(1 + dt^2), a period by exp(pi dt): 3.2 %. 0.5 % is exp(dt / 2), "
        "the growth over one unit of time, a radian: 2 pi went missing.",
        grown("a period, 2 pi", PERIOD / DT),
        grown("dt is 0.01 of a period", 100, DT * PERIOD),
        grown("its energy, a period", PERIOD / DT, power=2),
        grown("a unit of time stands for a period", 1 / DT),
    )
    return rows + article(
        "… and doubles in 1000",
        "ln 2 / (pi dt) = 22 periods; 0.5 % a period would double in 139, not in 1000: the two numbers of this "
        "sentence exclude each other under every reading.",
        doubled("1000 periods", PERIOD / DT, "periods"),
        doubled("1000 units of time", 1 / DT, "units"),
        doubled("1000 steps", 1, "steps"),
    )


def runge_kutta() -> list[Claim]:
    """RK4 at 0.1 against Euler."""
    cases = {
        "decay y' = -y, t = 1": (decay(), 1.0),
        "oscillator, t = 1": (harmonic_oscillator(), 1.0),
        "oscillator, t = 10": (harmonic_oscillator(), 10.0),
    }
    fourth = {text: errors(problem, "rk4", length, round(length / 0.1)) for text, (problem, length) in cases.items()}

    def euler(text: str, dt: float) -> Errors:
        problem, length = cases[text]
        return errors(problem, "euler", length, round(length / dt))

    def better(text: str, dt: float, how: str) -> Reading:
        return ratio_of(f"{text}, {how}", euler(text, dt), fourth[text], lambda times: magnitude(times, 1e4), "times")

    rows = article(
        "RK4 at dt = 0.1 is ~10^4 times better than Euler",
        "The errors are about dt / 2 and dt^4 / 120 on these problems: 6 10^4 at the same step, and more with time on "
        "the oscillator, where Euler's grows exponentially. At the same cost, four steps of Euler to one, it is 10^4.",
        *(better(text, 0.1, "the same step") for text in cases),
        *(better(text, 0.025, "the same cost") for text in cases),
    )

    def still_better(text: str) -> Reading:
        return ratio_of(text, euler(text, 0.001), fourth[text], lambda times: times > 1, "times better")

    return rows + article(
        "RK4 at dt = 0.1 is better than Euler at 0.001",
        "A hundredth of the step gains Euler, of first order, a factor of 100 only, and costs 25 times as much as RK4.",
        *(still_better(text) for text in cases),
    )


def claims(long: bool = False) -> list[Claim]:
    return [*halving(), *growth(), *runge_kutta()]
