"""leapfrog-block: shared and own steps, order, energy, restarts, and refused systems."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.model.starts.plummer import plummer


def cluster(n: int = 200, accuracy: float = 1e-3) -> kd.System:
    x, v, masses = plummer(n, 1)
    return kd.System(x, v, masses, forces=[kd.GravityTree(accuracy, softening=0.05)], units="nbody", name="cluster")


def test_shared_steps_are_those_of_velocity_verlet():
    """With steps that no body wants shorter, all have dt."""
    block, plain = (kd.Simulation(cluster(), name, dt=1e-3) for name in ("leapfrog-block", "velocity-verlet"))
    for sim in (block, plain):
        sim.run(20)
    np.testing.assert_allclose(block.state.positions, plain.state.positions, rtol=0, atol=1e-14)
    np.testing.assert_allclose(block.state.velocities, plain.state.velocities, rtol=0, atol=1e-13)


def test_own_steps_keep_the_energy_and_cost_less():
    """Central bodies take an eighth of dt; most take longer steps, so that fewer accelerations are summed."""
    sim = kd.Simulation(cluster(), "leapfrog-block", dt=1 / 8, eta=0.005)
    report = sim.run(until=2.0, every=4)
    levels = sim.integration.stepper._levels
    assert levels.max() - levels.min() >= 2
    assert abs(report.energy.final / report.energy.initial - 1) < 1e-3
    assert report.force_evaluations < 0.9 * 16 * 2 ** levels.max()


def test_cuts_looks_and_restarts_change_no_bits(tmp_path):
    whole, cut, looked = (kd.Simulation(cluster(), "leapfrog-block", dt=1 / 8, eta=0.005) for _ in range(3))
    whole.run(6)
    for _ in range(3):
        cut.run(2)
    looked.run(4, every=1, output=tmp_path / "run.h5md")
    resumed = kd.resume(tmp_path / "run.h5md")
    resumed.run(2)
    for other in (cut, resumed):
        np.testing.assert_array_equal(other.state.phase, whole.state.phase)


@pytest.mark.parametrize(
    ("forces", "options", "expected"),
    [
        ([kd.Gravity(softening=0.1)], {}, "needs one force 'gravity-tree', and 'system' has none; hermite4"),
        ([kd.GravityTree()], {}, "needs a softening of gravity-tree, which sets the steps"),
        ([kd.GravityTree(softening=0.1), kd.LinearDrag(0.1)], {}, "force 'linear-drag' depends on velocity"),
        ([kd.GravityTree(softening=0.1)], {"rtol": 1e-6}, "rtol: leapfrog-block does not take it; it takes dt, eta"),
    ],
)
def test_other_systems_are_refused(forces, options, expected):
    system = kd.System(np.eye(3), forces=forces, units="nbody")
    with pytest.raises(InputError, match=expected):
        kd.Simulation(system, "leapfrog-block", dt=0.1, **options).run(1)


def test_a_problem_is_refused():
    ode = kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0], separable=True, name="spring")
    with pytest.raises(InputError, match="leapfrog-block: needs bodies under gravity-tree; 'spring' is an ODE"):
        kd.Simulation(ode, "leapfrog-block", dt=0.1)
