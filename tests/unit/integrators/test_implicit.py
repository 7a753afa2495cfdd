"""Implicit and stiff methods: order, structure, stiff decay, end values, and error messages."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift.integrators.flows.flow import flow_of
from kickdrift.integrators.flows.jacobian import difference_jacobian
from kickdrift.integrators.implicit import method as implicit
from kickdrift.integrators.implicit import rosenbrock
from kickdrift.integrators.implicit.method import ImplicitTableau
from kickdrift.integrators.implicit.stepper import ImplicitStepper
from kickdrift.integrators.runge_kutta.tableaus import lower
from tests.long import rest, shortened

GAUSS = ("implicit-midpoint", "gauss-legendre4")
IMPLICIT = ("backward-euler", *GAUSS)
SCIPY = ("bdf", "radau", "lsoda")
STIFF = ("rosenbrock", *SCIPY)


def pendulum(t, y):
    return (y[1], -np.sin(y[0]))


def pendulum_jacobian(t, y):
    return [[0.0, 1.0], [-np.cos(y[0]), 0.0]]


def driven(t, y):
    return (y[1], -np.sin(y[0]) - 0.2 * y[1] + 0.7 * np.cos(1.3 * t))


def pendulum_energy(t, y):
    return y[1] ** 2 / 2 - np.cos(y[0])


def stiff_decay(t, y):
    return (-1e6 * (y[0] - np.cos(t)),)


def hires(t, y):
    reacted = 280.0 * y[5] * y[7]
    return (
        -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007,
        1.71 * y[0] - 8.75 * y[1],
        -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4],
        8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3],
        -1.745 * y[4] + 0.43 * y[5] + 0.43 * y[6],
        -reacted + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6],
        reacted - 1.81 * y[6],
        -reacted + 1.81 * y[6],
    )


def oregonator(t, y):
    return (
        77.27 * (y[1] + y[0] * (1.0 - 8.375e-6 * y[0] - y[1])),
        (y[2] - (1.0 + y[0]) * y[1]) / 77.27,
        0.161 * (y[0] - y[2]),
    )


def robertson(t, y):
    reacted = 1e4 * y[1] * y[2]
    return (-0.04 * y[0] + reacted, 0.04 * y[0] - reacted - 3e7 * y[1] ** 2, 3e7 * y[1] ** 2)


# Test Set for IVP Solvers (Mazzia & Magherini 2008, Bari): start, end, reference solution at the end, absolute
# tolerance.
TEST_SET = {
    "hires": (
        hires, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0057], 321.8122,
        [0.7371312573325668e-3, 0.1442485726316185e-3, 0.5888729740967575e-4, 0.1175651343283149e-2,
         0.2386356198831331e-2, 0.6238968252742796e-2, 0.2849998395185769e-2, 0.2850001604814231e-2], 1e-12,
    ),
    "orego": (
        oregonator, [1.0, 2.0, 3.0], 360.0, [1.000814870318523, 1228.178521549917, 132.0554942846706], 1e-10,
    ),
    "rober": (
        robertson, [1.0, 0.0, 0.0], 1e11,
        [0.2083340149701255e-7, 0.8333360770334713e-13, 0.9999999791665050], 1e-18,
    ),
}  # fmt: skip


def reference(f, y0, end):
    sim = kd.Simulation(kd.Problem(f, y0), "dop853", rtol=1e-13, atol=1e-14)
    sim.run(until=end)
    return sim.state.y


def solved(f, y0, name, steps, end, **options):
    sim = kd.Simulation(f if isinstance(f, kd.Problem) else kd.Problem(f, y0), name, dt=end / steps, **options)
    sim.run(steps)
    return sim.state.y


# --- claims of the rows ---


@pytest.mark.parametrize("f", [pendulum, driven])
def test_order_of_the_rosenbrock_method(f):
    """Fixed steps: the tolerance accepts every step. Without df/dt a driven problem would have order 2."""
    exact = reference(f, [1.0, 0.3], 4.0)
    errors = []
    for steps in (40, 80, 160):
        stepper = kd.Simulation(kd.Problem(f, [1.0, 0.3]), "rosenbrock", rtol=1e10, atol=1e10).integration.stepper
        for _ in range(steps):
            stepper._next = 4.0 / steps
            stepper.advance(1)
        errors.append(np.abs(stepper.y - exact).max())
    assert -np.diff(np.log2(errors)) == pytest.approx(np.full(2, 4.0), abs=0.15)


def test_rodas_fulfils_the_order_conditions():
    """Hairer & Wanner 1996, table IV.7.1: order 4 of the solution and 3 of the embedded one; alpha and gamma_i as
    printed."""
    row = rosenbrock.ROWS[0]
    s = len(row.m)
    gamma = np.linalg.inv(np.eye(s) / row.gamma - lower(row.c))
    alpha = lower(row.a) @ gamma
    beta = alpha + gamma
    a, b = alpha.sum(axis=1), beta.sum(axis=1)
    np.testing.assert_allclose(row.sums[0], [0.0, 0.386, 0.21, 0.63, 1.0, 1.0], atol=1e-14)
    np.testing.assert_allclose(row.sums[1], [0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0], atol=1e-14)
    weights = np.array(row.m) @ gamma
    embedded = (np.array(row.m) - row.errors) @ gamma
    third = [(np.ones(s), 1), (b, 1 / 2), (a**2, 1 / 3), (beta @ b, 1 / 6)]
    fourth = [(a**3, 1 / 4), (a * (alpha @ b), 1 / 8), (beta @ a**2, 1 / 12), (beta @ beta @ b, 1 / 24)]
    for tree, value in third:
        assert weights @ tree == pytest.approx(value, abs=1e-14)
        assert embedded @ tree == pytest.approx(value, abs=1e-14)
    for tree, value in fourth:
        assert weights @ tree == pytest.approx(value, abs=1e-14)
    assert max(abs(embedded @ tree - value) for tree, value in fourth) > 1e-3


@pytest.mark.parametrize("iteration", shortened(implicit.ITERATIONS, ["newton"]))
def test_energy_does_not_drift(iteration):
    """The energy must not drift even at the level of rounding. Stages solved less accurately drift by 2e-16 per unit of
    time (Hairer, McLachlan & Razakarivony 2008, doi:10.1007/s10543-008-0170-3)."""
    problem = kd.Problem(pendulum, [1.0, 0.3], energy=pendulum_energy)
    report = kd.Simulation(problem, "implicit-midpoint", dt=0.1, iteration=iteration).run(5000, every=5)
    assert abs(report.energy.drift_per_unit_time) < 1e-16
    assert report.energy.max_relative_error < 1e-3


# --- the iteration ---


@pytest.mark.parametrize("name", IMPLICIT)
@pytest.mark.parametrize("separable", [False, True])
def test_newton_and_fixed_point_find_the_same_stages(name, separable):
    problem = kd.Problem(pendulum, [1.0, 0.3], separable=separable)
    one, other = (solved(problem, None, name, 100, 5.0, iteration=way) for way in implicit.ITERATIONS)
    np.testing.assert_allclose(one, other, rtol=0, atol=2e-14)


@pytest.mark.parametrize("name", [*IMPLICIT, *STIFF])
def test_analytic_and_difference_jacobians_agree(name):
    problems = [kd.Problem(pendulum, [1.0, 0.3], jacobian) for jacobian in (None, pendulum_jacobian)]
    sims = [kd.Simulation(problem, name, dt=0.05) for problem in problems]
    reports = [sim.run(until=5.0) for sim in sims]
    close = 2e-14 if name in IMPLICIT else 1e-6
    np.testing.assert_allclose(sims[0].state.y, sims[1].state.y, rtol=0, atol=close)
    if name != "lsoda":  # lsoda keeps its method for problems that are not stiff
        assert reports[1].force_evaluations < reports[0].force_evaluations
        assert all(sim.integration.stepper.counts.jacobians > 0 for sim in sims)


def test_every_evaluation_is_counted():
    calls = []

    def f(t, y):
        calls.append(t)
        return (y[1], -np.sin(y[0]))

    for name in (*IMPLICIT, *STIFF):
        sim = kd.Simulation(kd.Problem(f, [1.0, 0.3], compiled=False), name, dt=0.05)
        sim.integration.prepare()
        calls.clear()
        sim.run(20)
        assert sim.integration.stepper.counts.evaluations == len(calls), name


def test_backward_euler_takes_steps_a_million_times_the_decay():
    sim = kd.Simulation(kd.Problem(stiff_decay, [0.0]), "backward-euler", dt=0.1)
    sim.run(20)
    assert sim.state.y[0] == pytest.approx(np.cos(2.0), abs=2e-6)


def test_gauss_legendre_does_not_damp_but_stays_stable():
    """|R(z)| -> 1 for z -> -oo: the distance from the solution oscillates and does not grow."""
    sim = kd.Simulation(kd.Problem(stiff_decay, [1.1]), "implicit-midpoint", dt=0.1)
    sim.run(20)
    assert abs(sim.state.y[0] - np.cos(2.0)) == pytest.approx(0.1, rel=0.05)


@pytest.mark.parametrize("name", IMPLICIT)
def test_fixed_point_iteration_on_a_stiff_problem_says_what_to_do(name):
    sim = kd.Simulation(kd.Problem(stiff_decay, [0.0]), name, dt=0.1, iteration="fixed-point")
    with pytest.raises(RunError) as error:
        sim.run(10)
    assert str(error.value) == (
        f"{name}, dt = 0.1: stopped at step 1 (t = 0): the fixed-point iteration for the stages does not converge with "
        'dt = 0.1; take a smaller dt, or iteration="newton"'
    )


def test_newton_that_does_not_converge_says_what_to_do():
    """y' = y^2 leaves for infinity at t = 1: y = Y - dt Y^2 has no real solution Y once y > 1 / (4 dt)."""
    sim = kd.Simulation(kd.Problem(lambda t, y: (y[0] ** 2,), [1.0]), "backward-euler", dt=0.1)
    with pytest.raises(RunError) as error:
        sim.run(100)
    said = str(error.value)
    assert "\n" not in said
    assert said.startswith("backward-euler, dt = 0.1: stopped at step ")
    assert said.endswith("the newton iteration for the stages does not converge with dt = 0.1; take a smaller dt")
    assert np.isfinite(sim.state.y).all()


def test_full_newton_helps_where_simplified_newton_fails(monkeypatch):
    """Robertson's reaction in steps a thousand times its shortest time scale, which make Gauss methods oscillate."""

    def run():
        return solved(robertson, [1.0, 0.0, 0.0], "gauss-legendre4", 20, 20.0)

    assert run().sum() == pytest.approx(1.0, abs=1e-13)
    monkeypatch.setattr(ImplicitStepper, "_newton", ImplicitStepper._simplified)
    with pytest.raises(RunError, match="newton iteration"):
        run()


def test_a_right_hand_side_that_begins_at_the_start():
    """sqrt(t) is undefined before t = 0, where df/dt is needed."""
    sim = kd.Simulation(kd.Problem(lambda t, y: (np.sqrt(t),), [0.0]), "rosenbrock", rtol=1e-8, atol=1e-8)
    sim.run(until=1.0)
    assert sim.state.y[0] == pytest.approx(2 / 3, abs=1e-6)


# SciPy's solvers are SciPy's: each with one problem in the short set.
OF_EACH = [("rosenbrock", problem) for problem in TEST_SET] + [*zip(SCIPY, ("orego", "rober", "hires"), strict=True)]


@pytest.mark.parametrize(
    ("name", "problem"),
    [each if each in OF_EACH else rest(*each) for each in product(STIFF, TEST_SET)],
)
def test_end_values_of_the_test_set(name, problem):
    f, y0, end, values, atol = TEST_SET[problem]
    sim = kd.Simulation(kd.Problem(f, y0), name, rtol=1e-6, atol=atol)
    report = sim.run(until=end, every=10**6)
    close = {"rosenbrock": 1e-5, "radau": 2e-5, "bdf": 1e-3, "lsoda": 1e-3}[name]
    np.testing.assert_allclose(sim.state.y, values, rtol=close)
    assert report.time == end


def cluster() -> kd.System:
    """27 Lennard-Jones atoms in open space, warm."""
    rng = np.random.default_rng(5)
    x = np.indices((3, 3, 3)).reshape(3, -1).T * 1.15 + rng.uniform(-0.05, 0.05, (27, 3))
    return kd.System(x, rng.normal(size=(27, 3)) * 0.3, forces=[kd.LennardJones(cutoff=4.0, truncation="shift")])


def test_particles_move_as_with_velocity_verlet():
    system = cluster()
    runs = {}
    for name in ("velocity-verlet", "implicit-midpoint"):
        for dt in (0.002, 0.001):
            sim = kd.Simulation(system, name, dt=dt)
            report = sim.run(until=0.2, every=20)
            runs[name, dt] = sim.state.positions
    assert report.energy.max_relative_error < 1e-4
    assert report.momentum_error < 1e-14
    extrapolated = {name: (4 * runs[name, 0.001] - runs[name, 0.002]) / 3 for name in ("velocity-verlet", name)}
    np.testing.assert_allclose(*extrapolated.values(), rtol=0, atol=1e-7)
    assert np.abs(runs["velocity-verlet", 0.002] - runs["implicit-midpoint", 0.002]).max() > 1e-6


def test_newton_on_particles_agrees_with_fixed_point():
    system = cluster()
    sims = [kd.Simulation(system, "gauss-legendre4", dt=0.01, iteration=way) for way in implicit.ITERATIONS]
    for sim in sims:
        sim.run(4)
    np.testing.assert_allclose(sims[0].state.phase, sims[1].state.phase, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", STIFF)
def test_the_solution_between_steps(name):
    exact = reference(driven, [1.0, 0.3], 3.21)
    sim = kd.Simulation(kd.Problem(driven, [1.0, 0.3]), name, rtol=1e-8, atol=1e-8)
    sim.run(until=3.21)
    assert sim.time == 3.21
    np.testing.assert_allclose(sim.state.y, exact, rtol=0, atol=2e-6)
    looks = []
    sim.run(until=6.0, interval=0.1, observe=lambda sim: looks.append((sim.time, sim.state.y)))
    plain = kd.Simulation(kd.Problem(driven, [1.0, 0.3]), name, rtol=1e-8, atol=1e-8)
    plain.run(until=6.0)
    np.testing.assert_array_equal(sim.integration.stepper.y, plain.integration.stepper.y)
    assert len(looks) == 29
    np.testing.assert_allclose(looks[10][1], reference(driven, [1.0, 0.3], looks[10][0]), rtol=0, atol=2e-6)


# --- bad input ---


@pytest.mark.parametrize("name", [*IMPLICIT, *STIFF])
def test_more_unknowns_than_a_jacobian_holds_are_refused(name):
    problem = kd.Problem(lambda t, y: -y, np.ones(3001))
    options = {"dt": 0.1} if name in IMPLICIT else {}
    with pytest.raises(InputError, match=f"{name}: needs the Jacobian of 3001 unknowns; the limit is 3000"):
        kd.Simulation(problem, name, **options)
    if name in IMPLICIT:
        kd.Simulation(problem, name, iteration="fixed-point", dt=0.1).run(1)


@pytest.mark.parametrize("name", [*IMPLICIT, *STIFF])
def test_an_error_in_f_is_told(name):
    def f(t, y):
        if t > 0.5:
            raise ValueError("no further")
        return -y

    sim = kd.Simulation(kd.Problem(f, [1.0], compiled=False), name, dt=0.1)
    with pytest.raises(RunError, match="f raised ValueError: no further"):
        sim.run(until=2.0)


@pytest.mark.parametrize("name", [*IMPLICIT, *STIFF])
def test_a_solution_that_leaves_for_infinity_is_one_line(name):
    """y' = y^2, with y -> oo at t = 1. No warning of NumPy or SciPy may escape, since the tests turn warnings into
    errors."""
    sim = kd.Simulation(kd.Problem(lambda t, y: (y[0] ** 2,), [1.0]), name, dt=0.01)
    with pytest.raises(RunError) as error:
        sim.run(until=2.0)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith(name)


def test_an_error_in_the_jacobian_is_told():
    def jacobian(t, y):
        if t > 0.5:
            raise ZeroDivisionError("no further")
        return [[-3.0 * y[0] ** 2]]

    for name in ("rosenbrock", "radau"):
        sim = kd.Simulation(kd.Problem(lambda t, y: (-(y[0] ** 3),), [1.0], jacobian), name, rtol=1e-10)
        with pytest.raises(RunError, match="the Jacobian raised ZeroDivisionError: no further"):
            sim.run(until=5.0)


@pytest.mark.parametrize(
    ("a", "b", "said"),
    [
        (((0.5,), (0.5, 0.5)), (0.5, 0.5), "2 rows of 2 entries"),
        (((0.5, 0.0), (0.5, 0.5)), (0.5, 0.4), "b adds up to 0.9, not 1"),
        (((0.0, 0.0), (0.5, 0.5)), (0.5, 0.5), "a is singular"),
    ],
)
def test_tableaus_that_make_no_sense_are_refused(a, b, said):
    with pytest.raises(InputError, match=said):
        ImplicitTableau("mine", a, b, 1, "nobody")


def test_a_tableau_of_ones_own_runs():
    """Radau IIA of order 3 (Hairer & Wanner 1996, table IV.5.5)."""
    radau3 = ImplicitTableau("radau3", ((5 / 12, -1 / 12), (3 / 4, 1 / 4)), (3 / 4, 1 / 4), 3, "Ehle 1969")
    assert not radau3.symplectic
    assert not radau3.reversible
    flow = flow_of(kd.Problem(pendulum, [1.0, 0.3]), 1, jumps=True)
    exact, errors = reference(pendulum, [1.0, 0.3], 4.0), []
    for steps in (40, 80, 160):
        options = radau3.checked(kd.Simulation(flow.subject, "rk4", dt=4.0 / steps).options, asked=_nothing())
        stepper = radau3.stepper(flow, options)
        stepper.reset(flow.array(flow.subject.state), 0.0, 0)
        stepper.advance(steps)
        errors.append(np.abs(stepper.y - exact).max())
    assert -np.diff(np.log2(errors)) == pytest.approx([3.0, 3.0], abs=0.15)


def _nothing():
    from kickdrift.integrators.options import Options

    return Options()


def test_difference_jacobian_is_good_to_nine_digits():
    problem = kd.Problem(oregonator, [10.0, 300.0, 50.0])
    y = np.array(problem.y0)
    exact = np.array(
        [
            [77.27 * (1 - 2 * 8.375e-6 * y[0] - y[1]), 77.27 * (1 - y[0]), 0.0],
            [-y[1] / 77.27, -(1 + y[0]) / 77.27, 1 / 77.27],
            [0.161, 0.0, -0.161],
        ]
    )
    found = difference_jacobian(flow_of(problem, 1, jumps=True).derivative, 0.0, y.reshape(1, 1, -1))
    np.testing.assert_allclose(found, exact, atol=1e-9 * np.abs(exact).max())


def test_derivatives_of_states_that_lie_scattered_in_memory():
    """SciPy's differences pass columns of a matrix."""
    from kickdrift.integrators.flows.flow import flow_of

    for problem in (
        kd.Problem(lambda t, y: [y[1], -2 * y[0], 3 * y[2]], [1.0, 2.0, 5.0]),
        kd.Problem(lambda t, y: [y[2], y[3], -y[0], -4 * y[1]], [1.0, 2.0, 3.0, 4.0], separable=True),
    ):
        flow = flow_of(problem, 1, jumps=True)
        whole = flow.array(problem.state)
        scattered = np.repeat(whole, 2, axis=-1)[..., ::2]
        assert not scattered.flags.c_contiguous
        np.testing.assert_array_equal(flow.derivative(0.0, scattered), flow.derivative(0.0, whole))


@pytest.mark.parametrize("name", ["bdf", "radau", "lsoda"])
def test_without_a_jacobian_scipy_takes_its_own_differences(name):
    sim = kd.Simulation(kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0]), name, rtol=1e-4, atol=1e-6)
    sim.run(until=3.0)
    np.testing.assert_allclose(sim.state.y, [np.cos(3.0), -np.sin(3.0)], atol=5e-3)
