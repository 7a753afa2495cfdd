"""Eigenvalues along known solutions, and the warning of a run whose steps are limited by stability."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.compare.stiffness import stiffness
from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from kickdrift.integrators.step_choice.stability_limit import stability_boundary, stability_warning


def robertson(t, y):
    reacted = 1e4 * y[1] * y[2]
    return (-0.04 * y[0] + reacted, 0.04 * y[0] - reacted - 3e7 * y[1] ** 2, 3e7 * y[1] ** 2)


def robertson_jacobian(t, y):
    return [
        [-0.04, 1e4 * y[2], 1e4 * y[1]],
        [0.04, -1e4 * y[2] - 6e7 * y[1], -1e4 * y[1]],
        [0.0, 6e7 * y[1], 0.0],
    ]


def stiff_van_der_pol(t, y):
    return (y[1], 1000.0 * (1.0 - y[0] ** 2) * y[1] - y[0])


def van_der_pol(t, y):
    return (y[1], (1.0 - y[0] ** 2) * y[1] - y[0])


def stiff_linear(t, y):
    return (-1e4 * (y[0] - np.cos(t)), -y[1])


def pendulum(t, y):
    return (y[1], -np.sin(y[0]))


def lorenz(t, y):
    return (10.0 * (y[1] - y[0]), y[0] * (28.0 - y[2]) - y[1], y[0] * y[1] - 8.0 / 3.0 * y[2])


def kepler(t, y):
    r3 = (y[0] ** 2 + y[1] ** 2) ** 1.5
    return (y[2], y[3], -y[0] / r3, -y[1] / r3)


def arenstorf(t, y):
    mu = 0.012277471
    d1, d2 = ((y[0] + mu) ** 2 + y[1] ** 2) ** 1.5, ((y[0] - 1 + mu) ** 2 + y[1] ** 2) ** 1.5
    pull = (1 - mu) / d1 + mu / d2
    return (
        y[2],
        y[3],
        y[0] + 2 * y[3] - (1 - mu) * (y[0] + mu) / d1 - mu * (y[0] - 1 + mu) / d2,
        y[1] - 2 * y[2] - pull * y[1],
    )


def test_eigenvalues_of_a_linear_problem_are_those_of_its_matrix():
    found = stiffness(kd.Problem(stiff_linear, [1.0, 1.0]))[0]
    np.testing.assert_allclose(found.eigenvalues, [-1e4, -1.0], rtol=1e-7)
    assert found.ratio == pytest.approx(1e4, rel=1e-7)
    assert found.fastest == pytest.approx(-1e4, rel=1e-7)
    assert found.step is None
    assert found.step_times_rate is None


def test_an_undamped_problem_has_no_stiffness_ratio():
    found = stiffness(kd.Problem(pendulum, [0.0, 0.5]))[0]
    np.testing.assert_allclose(found.eigenvalues, [-1j, 1j], atol=1e-9)
    assert np.isnan(found.ratio)


@pytest.mark.parametrize("jacobian", [None, robertson_jacobian])
def test_robertsons_conserved_sum_does_not_count(jacobian):
    """At t = 40 of the reference solution: eigenvalues from the characteristic polynomial, without its root 0."""
    y = [0.7158270687194307, 9.185534764558627e-06, 0.2841637457458067]
    problem = kd.Problem(robertson, y, jacobian)
    found = stiffness(problem)[0]
    m = np.array(robertson_jacobian(0.0, y))
    minors = sum(m[i, i] * m[j, j] - m[i, j] * m[j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
    exact = np.sort(np.roots([1.0, -np.trace(m), minors]))
    assert exact[0] / exact[1] == pytest.approx(found.ratio, rel=1e-5)
    assert found.eigenvalues[0].real == pytest.approx(exact[0], rel=1e-8)


def test_states_along_a_run_and_its_step():
    sim = kd.Simulation(kd.Problem(robertson, [1.0, 0.0, 0.0], robertson_jacobian), "radau", rtol=1e-6, atol=1e-12)
    states = []
    sim.run(until=1e4, interval=1e3, observe=lambda sim: states.append(sim.state))
    ratios = [point.ratio for point in stiffness(sim, states)]
    assert len(ratios) == 11
    assert ratios[0] == 1.0  # at rest except for the slow reaction
    assert (np.diff(ratios) > 0).all()
    assert ratios[-1] > 1e6
    now = stiffness(sim)[0]
    assert now.step == sim.integration.stepper.last_step > 0
    assert now.step_times_rate > 1e4  # too large for any explicit method


def test_a_pair_of_particles_swings_at_its_frequency():
    r = 2 ** (1 / 6)
    pair = kd.System([[0.0, 0.0, 0.0], [r, 0.0, 0.0]], forces=[kd.LennardJones(cutoff=2.5)])
    found = stiffness(pair)[0]
    k = 72.0 / r**2  # of the potential well, in epsilon / sigma^2
    assert abs(found.fastest) == pytest.approx(np.sqrt(2 * k), rel=1e-6)


def test_a_state_of_another_problem_is_refused():
    with pytest.raises(InputError, match=r"expected y of shape \(2,\)"):
        stiffness(kd.Problem(pendulum, [0.0, 0.5]), [kd.Problem(robertson, [1.0, 0.0, 0.0]).state])


@pytest.mark.parametrize(
    ("name", "direction", "boundary"),  # Hairer & Wanner 1996, IV.2; dopri5 and dop853 from their figures
    [("euler", -1, 2.0), ("rk4", -1, 2.785), ("rk4", 1j, 2.828), ("dormand-prince45", -1, 3.307)],
)
def test_boundaries_of_stability_are_those_known(name, direction, boundary):
    assert stability_boundary(integrator(name), direction) == pytest.approx(boundary, abs=0.015)


def warning(f, y0, end, name="dormand-prince45", **options):
    points = []
    sim = kd.Simulation(kd.Problem(f, y0), name, **options)

    def keep(sim):
        points.append(
            (sim.integration.stepper.time, sim.integration.stepper.y.copy(), sim.integration.stepper.last_step)
        )

    sim.run(until=end, every=1, observe=keep)
    return stability_warning(sim.integration.flow, sim.method, points)


@pytest.mark.parametrize(
    ("f", "y0", "end"),
    [
        (stiff_van_der_pol, [2.0, 0.0], 0.3),
        (robertson, [1.0, 0.0, 0.0], 1.0),
        (stiff_linear, [0.0, 1.0], 0.2),
    ],
)
def test_a_run_held_back_by_stability_is_warned_of(f, y0, end):
    said = warning(f, y0, end, rtol=1e-6, atol=1e-8)
    assert said is not None
    assert "\n" not in said
    assert "eigenvalue -" in said
    assert "radau" in said


@pytest.mark.parametrize("rtol", [1e-4, 1e-8])
@pytest.mark.parametrize(
    ("f", "y0", "end"),
    [
        (lorenz, [1.0, 1.0, 1.0], 5.0),
        (arenstorf, [0.994, 0.0, 0.0, -2.00158510637908252], 17.06),
        (kepler, [0.4, 0.0, 0.0, 2.0], 10.0),
        (van_der_pol, [2.0, 0.0], 10.0),
        (pendulum, [1.0, 0.3], 10.0),
    ],
)
def test_a_run_held_back_by_accuracy_is_not(f, y0, end, rtol):
    assert warning(f, y0, end, rtol=rtol, atol=rtol) is None


def test_fixed_steps_near_the_boundary_are_warned_of():
    assert warning(stiff_linear, [1.0, 1.0], 0.01, "rk4", dt=2.5e-4) is not None
    assert warning(stiff_linear, [1.0, 1.0], 0.01, "rk4", dt=0.5e-4) is None


def test_methods_without_a_boundary_are_not_watched():
    assert warning(stiff_linear, [1.0, 1.0], 0.1, "rosenbrock") is None
