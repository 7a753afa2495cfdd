"""sei and the force hill: closed form, order, conserved energy, symplectic form, refusals."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.systemfile.reading import loads
from tests.oracle.hill import moved

START = (
    [[1.0, 0.0, 0.0], [0.3, -2.0, 0.4], [0.0, 1.0, -0.2], [-5.0, 1.0, 0.0]],
    [[0.1, -1.5, 0.2], [0.1, 0.4, -0.1], [0.0, 0.3, 0.0], [0.0, 7.5, 0.3]],
)


def patch(omega=1.0, forces=(), masses=(1.0, 1.0, 1.0, 1.0), **options) -> kd.System:
    return kd.System(*START, masses=masses, forces=[*forces, kd.Hill(omega, **options)], units="nbody")


def moonlets(mass=1e-3) -> kd.System:
    """Two bodies that pass each other, and massless ones between them; lengths are of their order of Hill radii."""
    x = [[0.3, 3.0, 0.02], [-0.2, -1.0, 0.0], [0.05, 1.5, 0.01], [0.1, 0.0, -0.01]]
    v = [[0.0, -0.45, 0.0], [0.01, 0.3, 0.01], [0.0, -0.07, 0.0], [0.01, -0.15, 0.0]]
    return kd.System(
        x, v, masses=[mass, mass, 0.0, 0.0], forces=[kd.Gravity(softening=0.05), kd.Hill(1.0)], units="nbody"
    )


@pytest.mark.parametrize(("omega", "vertical", "dt"), [(1.0, 1.0, 0.3), (0.7, 3.6, 0.05), (-1.0, 1.3, 2.0)])
def test_epicycles_are_exact_over_ten_thousand_orbits(omega, vertical, dt):
    """Rounding does not grow: the phase comes from the step's number, and what rounding loses of y is carried on."""
    sim = kd.Simulation(patch(omega, vertical=vertical), "sei", dt=dt)
    steps = round(2 * np.pi * 1e4 / dt / abs(omega))
    sim.run(steps, every=steps)
    exact = Fraction(dt) * steps
    time = mpmath.fraction(exact.numerator, exact.denominator)
    x, v = moved(*START, time, omega, vertical)
    np.testing.assert_allclose(sim.state.positions[:, ::2], x[:, ::2], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(sim.state.positions[:, 1], x[:, 1], rtol=2e-15, atol=1e-13)
    np.testing.assert_allclose(sim.state.velocities, v, rtol=0.0, atol=1e-13)


def test_other_methods_move_alike():
    x, v = moved(*START, 3.0, 0.8, 1.5)
    for name in ("gauss-radau15", "dop853"):
        sim = kd.Simulation(patch(0.8, vertical=1.5), name, rtol=1e-12)
        sim.run(until=3.0)
        np.testing.assert_allclose(sim.state.positions, x, atol=1e-9)
        np.testing.assert_allclose(sim.state.velocities, v, atol=1e-9)
        assert sim.energy().total == pytest.approx(
            kd.Simulation(patch(0.8, vertical=1.5), "sei", dt=0.1).energy().total
        )


def test_the_tide_is_the_gradient_of_its_energy():
    """At rest there is no Coriolis force."""
    system = kd.System([[0.3, -0.2, 0.5]], masses=[2.0], forces=[kd.Hill(1.3, vertical=0.7)], units="nbody")
    pull = kd.Simulation(system, "rk4", dt=0.1).forces()[0]
    assert pull == pytest.approx([2.0 * 3.0 * 1.69 * 0.3, 0.0, -2.0 * (0.7 * 1.3) ** 2 * 0.5])
    assert kd.Simulation(system, "rk4", dt=0.1).energy().potential == pytest.approx(
        2.0 * (-1.5 * 1.69 * 0.09 + 0.5 * (0.7 * 1.3) ** 2 * 0.25)
    )


def errors(dt: float, truth: kd.State) -> float:
    sim = kd.Simulation(moonlets(), "sei", dt=dt)
    sim.run(round(6.0 / dt), every=round(6.0 / dt))
    return float(np.abs(sim.state.positions - truth.positions).max())


def test_order_is_two_and_the_error_goes_with_the_masses():
    truth = kd.Simulation(moonlets(), "dop853", rtol=1e-13, atol=1e-13)
    truth.run(until=6.0)
    coarse, fine = (errors(dt, truth.state) for dt in (0.04, 0.02))
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.15)
    assert fine < 1e-6


def test_energy_stays():
    sim = kd.Simulation(moonlets(), "sei", dt=0.02)
    start, found = sim.energy().total, []
    sim.run(2000, every=20, observe=lambda sim: found.append(sim.energy().total))
    size = float(sim.energy().kinetic)
    assert np.abs(np.array(found) - start).max() < 1e-5 * size


def test_a_step_is_symplectic():
    """J^T S J = S for the momenta v - (0, 2 x, 0) omega / 2 …: in canonical momenta p_x = v_x - y, p_y = v_y + x."""
    system = moonlets(0.3)
    masses = system.state.masses[:2]

    def stepped(z):
        x, p = z.reshape(2, 2, 3)
        v = p / masses[:, None] + np.stack([x[:, 1], -x[:, 0], 0 * x[:, 0]], axis=1)
        sim = kd.Simulation(kd.System(x, v, masses, forces=system.forces, units="nbody"), "sei", dt=0.3)
        sim.run(1)
        x, v = sim.state.positions, sim.state.velocities
        p = masses[:, None] * (v - np.stack([x[:, 1], -x[:, 0], 0 * x[:, 0]], axis=1))
        return np.concatenate([x.ravel(), p.ravel()])

    x, v = system.state.positions[:2], system.state.velocities[:2]
    p = masses[:, None] * (v - np.stack([x[:, 1], -x[:, 0], 0 * x[:, 0]], axis=1))
    z, h = np.concatenate([x.ravel(), p.ravel()]), 1e-3
    columns = []
    for k in range(len(z)):
        d = np.eye(len(z))[k]
        slopes = [(stepped(z + e * d) - stepped(z - e * d)) / (2 * e) for e in (h, h / 2)]
        columns.append((4 * slopes[1] - slopes[0]) / 3)
    jacobian, form = np.array(columns).T, np.kron([[0, 1], [-1, 0]], np.eye(6))
    assert np.abs(jacobian.T @ form @ jacobian - form).max() < 1e-8


def test_a_file_says_hill():
    text = patch(0.5, vertical=3.6, forces=[kd.Gravity()]).to_toml()
    assert loads(text).forces == patch(0.5, vertical=3.6, forces=[kd.Gravity()]).forces


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: patch(0.0), "hill: omega must not be zero"),
        (lambda: patch(vertical=0.0), "hill: vertical must be positive, got 0.0"),
        (
            lambda: kd.System(*START, box=(9, 9, 9), forces=[kd.Hill(1.0)], units="nbody"),
            "hill: Hill's frame is periodic along y at most, but the box is periodic along x or z",
        ),
        (lambda: kd.Simulation(patch().with_forces(kd.Gravity()), "sei", dt=0.1), "sei: needs one force 'hill', and"),
        (lambda: kd.Simulation(patch(forces=[kd.Hill(1.0)]), "sei", dt=0.1), "sei: needs one force 'hill', and"),
        (lambda: kd.Simulation(patch(forces=[kd.LinearDrag(0.1)]), "sei", dt=0.1), "sei: force 'linear-drag' depends"),
        (lambda: kd.Simulation(patch(), "velocity-verlet", dt=0.1), "force 'hill' depends on velocity"),
        (
            lambda: kd.Simulation(kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0], name="spring"), "sei", dt=0.1),
            "sei: needs particles in Hill's frame; 'spring' is an ODE",
        ),
    ],
)
def test_bad_input(make, message):
    with pytest.raises(InputError, match=message):
        make()
