"""Contract tests: every registered integrator has the order, symplecticity, reversibility and cost of its row.

A newly registered method is tested without further code; tests/conftest.py registers the methods of the docs' page.
"""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.seam.kernel import kernel
from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.splitting.method import ALIASES, Splitting, composed
from kickdrift.integrators.splitting.stormer import Stormer
from kickdrift_validation.measures import fixed, reversal_error, slope, symplecticity_error
from kickdrift_validation.problems import kepler_orbit, measured, pendulum
from tests.long import shortened
from tests.methods import METHODS
from tests.oracle import integrators as oracle_integrators
from tests.oracle.forces import pair_oracle
from tests.systems import liquid

FIXED = fixed()
# Methods that the oracle reads: rows of numbers, and the two positions of Stormer.
ROWS_OF_NUMBERS = [name for name in FIXED if isinstance(integrator(name), (Splitting, Tableau, Stormer))]


LIKE_IT = ("backward-euler", "gauss-legendre4")  # which have the loop of implicit-midpoint


def measured_elsewhere(method) -> bool:
    """Whether test_measured_order.py measures the method's order in the short set."""
    return isinstance(method, Splitting | Tableau) and len(method.source) > 10 and not method.bath


@pytest.mark.parametrize(
    "name",
    shortened(
        FIXED,
        ["velocity-verlet", "rk4", *(n for n in FIXED if not measured_elsewhere(integrator(n)) and n not in LIKE_IT)],
    ),
)
def test_order_is_the_slope_of_the_error(name):
    """The order is at least the stated one on every problem, and equal to it on two or more; some problems converge
    faster."""
    order = integrator(name).order
    slopes = {problem: slope(name, problem) for problem in measured()}
    assert min(slopes.values()) >= order - 0.15, slopes
    assert sum(abs(found - order) <= 0.15 for found in slopes.values()) >= 2, slopes


REVERSIBLE = [name for name in FIXED if integrator(name).reversible]
ONE_WAY = [name for name in FIXED if not integrator(name).reversible]


@pytest.mark.parametrize("subject", [pendulum, kepler_orbit])
@pytest.mark.parametrize("name", REVERSIBLE)
def test_reversible_methods_come_back(name, subject):
    """1000 steps there and back, with compensated summation: rounding alone takes yoshida6 and stormer-verlet to
    1e-12."""
    assert reversal_error(name, subject(), 0.02, 1000) < 1e-12


@pytest.mark.parametrize("name", ONE_WAY)
def test_methods_that_are_not_reversible_do_not_come_back(name):
    assert reversal_error(name, pendulum(), 0.2, 100) > 1e-8


@pytest.mark.parametrize("name", FIXED)
def test_symplectic_methods_keep_the_symplectic_form(name):
    if integrator(name).symplectic:
        assert symplecticity_error(name) < 1e-8
    else:
        assert symplecticity_error(name) > 1e-8


@pytest.mark.parametrize("name", [name for name in FIXED if integrator(name).evaluations])  # other methods iterate
def test_force_evaluations_are_those_stated(name):
    method = integrator(name)
    sim = kd.Simulation(pendulum(), name, dt=0.01)
    start_up = sim.run(10).force_evaluations - 10 * method.evaluations
    assert start_up in (0, 1)  # the force of the first kick, once
    assert sim.run(10).force_evaluations == 20 * method.evaluations + start_up


@pytest.mark.parametrize("name", [n for n in FIXED if "compensated" in integrator(n).tunable])
def test_compensated_summation_loses_less(name):
    """x' = v without a force, in 10^5 steps: the only error is the rounding of sums."""
    free = kd.Problem(lambda t, y: [y[1], 0.0], [0.1, 0.3], separable=True, name="free")
    errors = {}
    for compensated in (False, True):
        sim = kd.Simulation(free, name, dt=0.1, compensated=compensated)
        sim.run(20_000 if integrator(name).family in ("splitting", "Runge-Kutta", "two positions") else 500)
        errors[compensated] = abs(sim.state.y[0] - (0.1 + 0.3 * sim.time)) / sim.state.y[0]
    assert errors[True] < 1e-15
    assert errors[True] <= errors[False]


@pytest.mark.parametrize("name", ROWS_OF_NUMBERS)
def test_compiled_loops_agree_with_the_oracle(name):
    system, dt, steps = liquid(), 0.002, 20

    def acceleration(t, x):
        there = kd.System(x, masses=system.state.masses, box=system.box, forces=system.forces)
        return pair_oracle(there)[0] / system.state.masses[:, None]

    start = system.state
    x, v = oracle_integrators.run(integrator(name), acceleration, start.positions, start.velocities, dt, steps)
    sim = kd.Simulation(system, name, dt=dt)
    sim.run(steps, every=steps)
    assert np.abs(x - start.positions).max() > 0.05
    np.testing.assert_allclose(sim.state.positions, x, atol=1e-11)
    np.testing.assert_allclose(sim.state.velocities, v, atol=1e-10)


class Shaken(NamedTuple):
    """Bound form of a force per mass of amplitude x sin(7 t)."""

    amplitude: float
    direction: np.ndarray  # (3,)


@kernel(Shaken)
def shaken(force, t, x, v, a, sums):
    for k in range(3):
        for i in range(x.shape[1]):
            a[k, i] += force.amplitude * force.direction[k] * math.sin(7.0 * t)
    return 0


class Shaking:
    """A force that depends on time alone, as a test of an integrator's clock."""

    name: ClassVar[str] = "shaking"

    def check(self, system): ...

    def bind(self, system, threads=1):
        return Shaken(3.0, np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("name", ROWS_OF_NUMBERS)
def test_clock_of_every_stage(name):
    system = kd.System([[0.0, 0.0, 0.0]], [[0.2, 0.0, 0.0]], forces=[Shaking()])

    def acceleration(t, x):
        return np.array([[3.0 * math.sin(7.0 * t), 0.0, 0.0]])

    x, v = oracle_integrators.run(
        integrator(name), acceleration, system.state.positions, system.state.velocities, 0.05, 30
    )
    sim = kd.Simulation(system, name, dt=0.05)
    for _ in range(3):
        sim.run(10)
    np.testing.assert_allclose(sim.state.positions, x, atol=1e-13)
    np.testing.assert_allclose(sim.state.velocities, v, atol=1e-13)


@pytest.mark.parametrize("name", METHODS)
def test_every_row_is_complete(name):
    method = integrator(name)
    assert method.name == name
    assert method.source
    assert method.use
    assert method.family
    assert method.order >= 1 or method.bounces  # hits at their exact times have no order
    assert method.evaluations >= 0
    assert method.adaptive == ("rtol" in method.tunable)


def test_composition_is_leapfrog_after_leapfrog():
    outer, inner = (3.0 - 1.0) / 4, -0.5
    halves, wholes = composed((inner, outer))
    assert wholes == (0.5, -0.5, 1.0, -0.5, 0.5)
    assert halves == (0.25, 0.0, 0.25, 0.25, 0.0, 0.25)
    assert composed(()) == ((0.5, 0.5), (1.0,))


def test_aliases_are_the_same_row():
    for alias, name in ALIASES.items():
        assert INTEGRATORS[alias] is INTEGRATORS[name]
    assert integrator("leapfrog") is integrator("velocity-verlet")
    assert kd.integrators() == list(INTEGRATORS)
    assert "leapfrog" in kd.integrators()


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("velocity-verlt", "velocity-verlet"),
        ("Yoshida-4", "yoshida4"),
        ("rk44", "rk4"),
        ("frog", "leapfrog"),
    ],
)
def test_unknown_name_suggests_the_nearest(wrong, meant):
    with pytest.raises(InputError, match=f"'{wrong}' is unknown; did you mean .*{meant}"):
        integrator(wrong)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"word": "BXB"}, "no flow has the letter 'X'; letters are A (drift), B (kick)"),
        ({"word": "BABA"}, "4 letters and 3 weights"),
        ({"weights": (0.5, 1.0, 0.4)}, "kick weights add up to 0.9, not 1"),
        ({"weights": (0.5, 1.5, 0.5)}, "drift weights add up to 1.5, not 1"),
        ({"weights": (0.5, math.nan, 0.5)}, "drift weights add up to nan, not 1"),
        ({"word": "BBB"}, "drift weights add up to 0.0, not 1"),
        ({"word": "", "weights": ()}, "drift weights add up to 0.0, not 1"),
    ],
)
def test_splitting_refuses_bad_words(change, message):
    row = {"name": "mine", "word": "BAB", "weights": (0.5, 1.0, 0.5), "order": 2, "source": "me"}
    assert Splitting(**row).reversible
    with pytest.raises(InputError, match="mine: ") as caught:
        Splitting(**{**row, **change})
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("a", "b", "message"),
    [
        (((0.5,),), (0.5, 0.4), "b adds up to 0.9, not 1"),
        (((0.5,),), (0.5, math.nan), "b adds up to nan, not 1"),
        (((0.5, 0.5),), (0.0, 1.0), "rows of 1, 2, … entries below the diagonal"),
        ((), (0.0, 1.0), "rows of 1, 2, … entries below the diagonal"),
        (((0.5,), (0.5,)), (0.0, 0.0, 1.0), "rows of 1, 2, … entries below the diagonal"),
    ],
)
def test_tableau_refuses_bad_rows(a, b, message):
    with pytest.raises(InputError, match="mine: ") as caught:
        Tableau("mine", a, b, 2, "me")
    assert message in str(caught.value)
