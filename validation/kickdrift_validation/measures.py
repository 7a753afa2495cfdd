"""What the integrators of the registry are measured by: order, symplecticity, reversibility, stability, tolerance.

Both the contract tests and kickdrift_validation.integrators measure with these functions.
"""

import math
from functools import cache

import numpy as np

import kickdrift as kd
from kickdrift.integrators import INTEGRATORS, Method, integrator
from kickdrift_validation.problems import SOLVED, henon_heiles, measured

EXPLICIT = ("splitting", "Runge-Kutta", "two positions")  # families whose steps cost next to nothing
FLOOR = 2e-12  # errors below are rounding
MOST_STEPS = 20_000
MOST_STEPS_IN_PYTHON = 2_000  # of methods that solve equations in every step, or are compiled from Python
POINTS = 4  # steps that a slope is taken over

# What the contract tests and the claims ask for.
ORDER = 0.15
COMES_BACK = 1e-12
SYMPLECTIC = 1e-8
NOT_SYMPLECTIC = 1e-6  # rk4 at the step of the test

PART = 100  # steps between two scalings of what grows
TOLERANCES = np.logspace(-5, -10, 11)
LOOKS = 40  # at an adaptive run's error


def fixed() -> list[str]:
    """The methods of fixed steps that run a Problem, without aliases; those registered so far included.

    Those that take particles alone have tests of their own."""
    rows = INTEGRATORS.items()
    return [
        name for name, method in rows if method.name == name and not method.chooses_steps and not method.particles_only
    ]


def adaptive() -> list[str]:
    """The methods that choose their steps."""
    return [name for name, method in INTEGRATORS.items() if method.name == name and method.adaptive]


def made(subject: kd.Problem | kd.System, name: str, dt: float, careful: bool = True) -> kd.Simulation:
    """A Simulation that sums as carefully as the method can, unless told otherwise."""
    return kd.Simulation(subject, name, dt=dt, compensated=careful and "compensated" in integrator(name).tunable)


def error_of(name: str, problem: str, steps: int) -> float:
    """The largest of |y - exact| at the end of one of the four problems."""
    made_problem, length, end = measured()[problem]
    sim = made(made_problem(), name, length / steps)
    sim.run(steps, every=steps)
    return float(np.abs(sim.state.y - end).max())


def slope(name: str, problem: str) -> float:
    """Slope of the error against the step: a line through the finest four steps above round-off, from 8 steps on."""
    method = integrator(name)
    ratio = math.sqrt(2.0) if method.order >= 6 else 2.0
    most = MOST_STEPS if method.family in EXPLICIT else MOST_STEPS_IN_PYTHON
    steps, errors, exact = [], [], 8.0 if method.order > 1 else 128.0
    while exact <= most:
        steps.append(round(exact))
        errors.append(error_of(name, problem, steps[-1]))
        if errors[-1] < FLOOR:
            break
        exact *= ratio
    while errors[-1] < FLOOR:
        steps.pop(), errors.pop()
    if len(steps) < POINTS:
        raise ArithmeticError(f"{name}, {problem}: only {len(steps)} steps above round-off")
    return -float(np.polyfit(np.log(steps[-POINTS:]), np.log(errors[-POINTS:]), 1)[0])


def reversal_error(name: str, subject: kd.Problem | kd.System, dt: float, steps: int, careful: bool = True) -> float:
    """What is left of a run after its velocities are negated and as many steps more."""
    sim = made(subject, name, dt, careful)
    start = sim.state
    sim.run(steps, every=steps)
    sim.state = negated(sim.state)
    sim.run(steps, every=steps)
    return float(np.abs(vector(negated(sim.state)) - vector(start)).max())


def vector(state):
    """Positions and velocities in one row."""
    return state.phase.reshape(-1) if hasattr(state, "phase") else state.y


def negated(state):
    """The same place, with every velocity the other way."""
    turned = vector(state).copy()
    turned[len(turned) // 2 :] *= -1.0
    if not hasattr(state, "phase"):
        return type(state)(turned)
    return kd.State(turned.reshape(state.phase.shape), state.masses, state.ids, state.box)


@cache
def symplecticity_error(name: str) -> float:
    """The largest entry of J^T S J - S, J the Jacobian of ten steps of Henon and Heiles' problem by central
    differences of sixth order."""
    sim = kd.Simulation(henon_heiles(), name, dt=0.25)
    start, h = sim.state.y.copy(), 3e-3

    def flow(y):
        sim.state = type(sim.state)(y)
        sim.run(10, every=10)
        return sim.state.y

    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    columns = [
        sum(w * (flow(start + k * h * unit) - flow(start - k * h * unit)) for k, w in weights.items()) / h
        for unit in np.eye(4)
    ]
    jacobian = np.transpose(columns)
    form = np.kron([[0, 1], [-1, 0]], np.eye(2))
    return float(np.abs(jacobian.T @ form @ jacobian - form).max())


def evaluations(name: str, subject: kd.Problem, dt: float = 0.01) -> tuple[float, int]:
    """Evaluations of the force for each step under way, and further ones at the start."""
    sim = kd.Simulation(subject, name, dt=dt)
    first = sim.run(10).force_evaluations
    then = sim.run(10).force_evaluations - first
    return then / 10, first - then


@cache
def oscillators(low: float, high: float, count: int) -> kd.Problem:
    """x_i'' = -omega_i^2 x_i, omega_i evenly from ``low`` to ``high``, each released at 1."""
    width = (high - low) / (count - 1)

    def f(t, y):
        slopes = np.empty_like(y)
        for i in range(count):
            slopes[i] = y[count + i]
            slopes[count + i] = -((low + i * width) ** 2) * y[i]
        return slopes

    return kd.Problem(f, np.repeat([1.0, 0.0], count), separable=True, name="oscillators")


@cache
def decays(low: float, high: float, count: int) -> kd.Problem:
    """y_i' = -rate_i y_i, rate_i evenly from ``low`` to ``high``, each from 1."""
    width = (high - low) / (count - 1)

    def f(t, y):
        slopes = np.empty_like(y)
        for i in range(count):
            slopes[i] = -(low + i * width) * y[i]
        return slopes

    return kd.Problem(f, np.ones(count), name="decays")


def first_blow_up(
    name: str, dt: float, steps: int, factor: float, *, rates: tuple[float, float, int], decaying: bool = False
) -> float | None:
    """The smallest of ``rates`` (low, high, count), times dt, that has grown by ``factor`` after so many steps, if any:
    of oscillators that many, |(x, v / omega)|, or of decays |y|.

    Every hundred steps they are scaled back to 1, so that none overflows.
    """
    low, high, count = rates
    rate = np.linspace(low, high, count)
    sim = kd.Simulation((decays if decaying else oscillators)(*rates), name, dt=dt)
    growth = np.zeros(count)
    for _ in range(0, steps, PART):
        sim.run(PART, every=PART)
        y = sim.state.y.reshape(-1, count)
        size = np.abs(y[0]) if decaying else np.hypot(y[0], y[1] / rate)
        size = np.maximum(size, 1e-100)  # what has decayed is as good as gone
        growth += np.log(size)
        sim.state = type(sim.state)((y / size).reshape(-1))
    grown = growth > math.log(factor)
    return float(rate[grown][0]) * dt if grown.any() else None


def error_at_tolerance(name: str, problem: str, tolerance: float) -> float:
    """The largest of |y - exact| at any of LOOKS times, with rtol = atol."""
    subject, exact, length = SOLVED[problem]
    errors = []

    def look(sim: kd.Simulation) -> None:
        errors.append(float(np.abs(sim.state.y - exact(sim.time)).max()))

    sim = kd.Simulation(subject(), name, rtol=tolerance, atol=tolerance)
    sim.run(until=length, interval=length / LOOKS, observe=look)
    return max(errors)


def tolerance_slope(name: str, problem: str) -> float:
    """The power of the tolerance that the error is proportional to: a line through TOLERANCES."""
    errors = [error_at_tolerance(name, problem, float(tolerance)) for tolerance in TOLERANCES]
    return float(np.polyfit(np.log(TOLERANCES), np.log(errors), 1)[0])


def stable_steps(method: Method) -> tuple[float | None, float | None]:
    """The largest omega dt on the oscillator and the largest -lambda dt on a decay, from the coefficients; None where
    the method does not run it, or its steps are not known by numbers."""
    from kickdrift.integrators.splitting.method import Splitting
    from kickdrift.integrators.splitting.stormer import Stormer
    from kickdrift.integrators.step_choice.stability import imaginary_interval, real_interval, stability_interval

    if method.overdamped:  # no oscillation
        return None, None
    if isinstance(method, Splitting):
        return stability_interval(method), None
    if isinstance(method, Stormer):  # the positions of velocity-verlet
        return stable_steps(integrator("velocity-verlet"))
    if method.butcher is None:
        return None, None
    return imaginary_interval(method), real_interval(method)
