"""Every integrator does what its row in the registry says: order, symplecticity, reversibility, cost."""

from __future__ import annotations

import math
from typing import ClassVar, NamedTuple

import numpy as np
import oracle_integrators
import pytest
from oracle import pair_oracle
from oracle_integrators import kepler

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.kernel import kernel
from kickdrift.integrators import INTEGRATORS, integrator, runge_kutta, splitting
from kickdrift.integrators.runge_kutta import Tableau
from kickdrift.integrators.splitting import ALIASES, Splitting, composed

METHODS = [row.name for row in (*splitting.ROWS, *runge_kutta.ROWS)]
SPLITTINGS = [row.name for row in splitting.ROWS]
MASSES = np.array([0.6, 0.4])
ECCENTRICITY = 0.3
HALF_PERIOD = math.pi
# Steps per half period: large enough for the leading term of the error, small enough to stay above round-off.
STEPS = {
    1: (1024, 2048, 4096, 8192, 16384),
    2: (256, 512, 1024, 2048, 4096),
    3: (512, 1024, 2048, 4096),
    4: (128, 256, 512, 1024),
    6: (45, 64, 91, 128, 181),  # ratios of the square root of two
    8: (45, 64, 91, 128),
    # So accurate that these would end in round-off. Below 200 steps the first one's error falls with the sixth power.
    "blanes-moan4": (204, 228, 256, 288),
    "blanes-moan6": (23, 32, 45, 64, 91),
}


def two_bodies(t: float = 0.0) -> kd.System:
    """Two unequal masses on a Kepler ellipse, at a time after pericentre; G = 1, semi-major axis 1."""
    r, v = kepler(t, ECCENTRICITY)
    shares = np.array([-MASSES[1], MASSES[0]])[:, None]
    return kd.System(shares * r, shares * v, masses=MASSES, forces=[kd.Gravity()], units="nbody")


def three_bodies() -> kd.System:
    x = [[0.0, 0.0, 0.0], [1.0, 0.1, 0.0], [-0.3, 1.5, 0.4]]
    v = [[0.0, -0.1, 0.05], [0.1, 0.9, 0.0], [-0.7, 0.0, -0.2]]
    return kd.System(x, v, masses=[1.0, 0.2, 0.1], forces=[kd.Gravity()], units="nbody")


def liquid(count=64, cutoff=2.0, seed=3) -> kd.System:
    """A disordered Lennard-Jones liquid in a small periodic box."""
    rng = np.random.default_rng(seed)
    edge = round(count ** (1 / 3))
    length = (count / 0.8442) ** (1 / 3)
    grid = np.indices((edge, edge, edge)).reshape(3, -1).T * length / edge
    x = grid + rng.uniform(-0.08, 0.08, (count, 3))
    v = rng.normal(size=(count, 3))
    v -= v.mean(axis=0)
    return kd.System(x, v, box=(length,) * 3, forces=[kd.LennardJones(cutoff=cutoff, truncation="shift")])


def error_at_half_period(name: str, steps: int) -> float:
    sim = kd.Simulation(two_bodies(), name, dt=HALF_PERIOD / steps)
    sim.run(steps, every=steps)
    reached, exact = sim.state, two_bodies(HALF_PERIOD).state
    return float(np.linalg.norm(reached.phase - exact.phase))


# --- what the registry claims, measured ---


def test_keplers_problem_is_solved_in_closed_form():
    """The reference of the order test: it fulfils the equation of motion, and the constants of the ellipse."""
    times, h = np.linspace(0.0, 7.0, 15), 1e-4
    for t in times:
        r, v = kepler(t, ECCENTRICITY)
        acceleration = (kepler(t + h, ECCENTRICITY)[1] - kepler(t - h, ECCENTRICITY)[1]) / (2 * h)
        np.testing.assert_allclose(acceleration, -r / np.linalg.norm(r) ** 3, atol=1e-6)
        assert v @ v / 2 - 1 / np.linalg.norm(r) == pytest.approx(-0.5, abs=1e-14)


@pytest.mark.parametrize("name", METHODS)
def test_order_is_the_slope_of_the_error(name):
    order = integrator(name).order
    steps = STEPS.get(name) or STEPS[order]
    errors = [error_at_half_period(name, n) for n in steps]
    assert errors[-1] > 2e-12  # well above round-off
    slopes = -np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert slopes == pytest.approx(np.full(len(slopes), order), abs=0.15)
    assert np.polyfit(np.log(steps), np.log(errors), 1)[0] == pytest.approx(-order, abs=0.1)


def reversal_error(name: str) -> float:
    """What is left of a run of 20 steps after its velocities are negated and 20 steps more."""
    sim = kd.Simulation(three_bodies(), name, dt=0.1)
    start = sim.state
    sim.run(20, every=20)
    there = sim.state
    assert np.abs(there.phase - start.phase).max() > 0.5  # it went somewhere
    there.phase[1] *= -1.0
    sim.state = there
    sim.run(20, every=20)
    back = sim.state
    back.phase[1] *= -1.0
    return float(np.abs(back.phase - start.phase).max())


@pytest.mark.parametrize("name", METHODS)
def test_reversible_methods_and_no_others_come_back(name):
    if integrator(name).reversible:
        assert reversal_error(name) < 1e-11
    else:
        assert reversal_error(name) > 1e-7


def symplecticity_error(name: str) -> float:
    """The largest entry of J^T S J - S, J the Jacobian of ten steps in positions and momenta by central differences."""
    sim = kd.Simulation(three_bodies(), name, dt=0.1)
    start = sim.state
    masses = np.tile(start.masses, 3)
    h = 1e-5

    def flow(y):
        state = start.copy()
        state.phase[:] = (y / np.concatenate([np.ones_like(masses), masses])).reshape(2, 3, -1)
        sim.state = state
        sim.run(10, every=10)
        x, v = sim.state.phase.reshape(2, -1)
        return np.concatenate([x, masses * v])

    x, v = start.phase.reshape(2, -1)
    y = np.concatenate([x, masses * v])
    jacobian = np.transpose([(flow(y + h * unit) - flow(y - h * unit)) / (2 * h) for unit in np.eye(y.size)])
    zero, one = np.zeros((masses.size,) * 2), np.eye(masses.size)
    form = np.block([[zero, one], [-one, zero]])
    return float(np.abs(jacobian.T @ form @ jacobian - form).max())


@pytest.mark.parametrize("name", METHODS)
def test_symplectic_methods_and_no_others_keep_the_symplectic_form(name):
    if integrator(name).symplectic:
        assert symplecticity_error(name) < 3e-8
    else:
        assert symplecticity_error(name) > 1e-6


@pytest.mark.parametrize("name", METHODS)
def test_force_evaluations_are_those_stated(name):
    method = integrator(name)
    kick_last = isinstance(method, Splitting) and method.first == "kick" and len(method.kick) > len(method.drift)
    sim = kd.Simulation(two_bodies(), name, dt=0.01)
    sim.run(10)
    assert sim.run(10).force_evaluations == 20 * method.evaluations + kick_last  # the first kick's force, once


# --- against the oracle ---


@pytest.mark.parametrize("name", METHODS)
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
    """The bound form of a force per mass of amplitude x sin(7 t)."""

    amplitude: float
    direction: np.ndarray  # (3,)


@kernel(Shaken)
def shaken(force, t, x, v, a, sums):
    for k in range(3):
        for i in range(x.shape[1]):
            a[k, i] += force.amplitude * force.direction[k] * math.sin(7.0 * t)
    return 0


class Shaking:
    """A force that depends on time alone: what an integrator makes of its clock."""

    name: ClassVar[str] = "shaking"

    def check(self, system): ...

    def bind(self, system, threads=1):
        return Shaken(3.0, np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("name", METHODS)
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


# --- the tables ---


@pytest.mark.parametrize("name", METHODS)
def test_every_row_is_complete(name):
    method = integrator(name)
    assert method.name == name
    assert method.source
    assert method.use
    assert method.evaluations >= 1
    assert method.adaptive is False
    assert method.family == ("splitting" if name in SPLITTINGS else "Runge-Kutta")


@pytest.mark.parametrize("name", METHODS)
def test_weights_add_up_to_one(name):
    method = integrator(name)
    rows = (method.kick, method.drift) if isinstance(method, Splitting) else (method.b,)
    for row in rows:
        assert math.fsum(row) == pytest.approx(1.0, abs=2e-15)


def test_claims_of_symmetry():
    assert [name for name in METHODS if integrator(name).symplectic] == SPLITTINGS
    assert [name for name in METHODS if not integrator(name).reversible] == [
        "symplectic-euler", "symplectic-euler-dk", "ruth3", "euler", "midpoint", "rk4",
    ]  # fmt: skip


def test_composition_is_leapfrog_after_leapfrog():
    outer, inner = (3.0 - 1.0) / 4, -0.5
    halves, wholes = composed((inner, outer))
    assert wholes == (0.5, -0.5, 1.0, -0.5, 0.5)
    assert halves == (0.25, 0.0, 0.25, 0.25, 0.0, 0.25)
    assert composed(()) == ((0.5, 0.5), (1.0,))


def test_triple_jump_kick_first_and_drift_first():
    forest_ruth, yoshida4 = integrator("forest-ruth"), integrator("yoshida4")
    assert (forest_ruth.kick, forest_ruth.drift) == (yoshida4.drift, yoshida4.kick)
    assert (forest_ruth.first, yoshida4.first) == ("drift", "kick")
    w = 1.0 / (2.0 - 2.0 ** (1 / 3))
    assert yoshida4.drift == pytest.approx((w, 1 - 2 * w, w), abs=1e-15)


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
        ("rk-4", "rk4"),
        ("frog", "leapfrog"),
    ],
)
def test_unknown_name_suggests_the_nearest(wrong, meant):
    with pytest.raises(InputError, match=f"'{wrong}' is unknown; did you mean .*{meant}"):
        integrator(wrong)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"first": "kickdrift"}, "first must be kick or drift, got 'kickdrift'"),
        ({"kick": (0.5, 0.4)}, "kick weights add up to 0.9, not 1"),
        ({"drift": (1.5,)}, "drift weights add up to 1.5, not 1"),
        ({"drift": (math.nan,)}, "drift weights add up to nan, not 1"),
        ({"first": "drift"}, "2 kicks and 1 drifts cannot alternate"),
        ({"kick": (0.25, 0.5, 0.25)}, "3 kicks and 1 drifts cannot alternate"),
        ({"kick": (), "drift": ()}, "kick weights add up to 0.0, not 1"),
    ],
)
def test_splitting_refuses_bad_rows(change, message):
    row = {"name": "mine", "kick": (0.5, 0.5), "drift": (1.0,), "first": "kick", "order": 2, "source": "me"}
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
