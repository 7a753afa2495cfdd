"""Basis of the claims: sums in NumPy, quadrature, anomalies, matrices. Nothing here compiles a loop."""

import math
from decimal import Decimal
from importlib import import_module

import mpmath
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces import FORCES
from kickdrift.forces.pairs.law import PairForce
from kickdrift_validation import closed_forms, force_gradients, lennard_jones, lj_lammps_melt, oscillator
from tests.oracle.forces import pair_oracle


def fluid(n=64, edge=5.2):
    random = np.random.default_rng(2)
    sites = np.stack(np.meshgrid(*[np.arange(4)] * 3), -1).reshape(-1, 3)[:n] * (edge / 4)
    return sites + random.uniform(-0.15, 0.15, (n, 3)), np.array([edge] * 3)


@pytest.mark.parametrize("truncation", ["cut", "shift"])
def test_direct_sums_are_the_oracles(truncation):
    x, edges = fluid()
    found = lennard_jones.direct(x, edges, 2.5, truncation)
    forces, energy, virial, _ = pair_oracle(
        kd.System(x, box=edges, forces=[kd.LennardJones(cutoff=2.5, truncation=truncation)])
    )
    assert found.energies.sum() == pytest.approx(energy, rel=1e-13)
    assert found.virial == pytest.approx(virial, rel=1e-12)
    np.testing.assert_allclose(found.forces, forces, atol=1e-11 * np.abs(forces).max())


def test_the_linearised_force_is_the_forces_change():
    x, edges = fluid()
    d = np.random.default_rng(3).standard_normal(x.shape)
    h = 1e-6
    after, before = (lennard_jones.direct(x + step * d, edges, 2.5).forces for step in (h, -h))
    change = (after - before) / (2 * h)
    found = lennard_jones.pulled(x, d, edges, 2.5)
    np.testing.assert_allclose(found, change, atol=1e-6 * np.abs(found).max())


def test_a_deviation_grows_as_two_runs_part():
    x, edges = fluid()
    dt, h, steps = 0.002, 1e-6, 30
    d = np.random.default_rng(4).standard_normal(x.shape)

    def run(x):
        frames, v, a = [x], np.zeros_like(x), lennard_jones.direct(x, edges, 2.5).forces
        for _ in range(steps):
            v = v + 0.5 * dt * a
            x = x + dt * v
            a = lennard_jones.direct(x, edges, 2.5).forces
            v = v + 0.5 * dt * a
            frames.append(x)
        return np.array(frames)

    frames, other = run(x), run(x + h * d)
    expected = np.sqrt(((other - frames) ** 2).sum(axis=(1, 2))) / h
    assert np.exp(lennard_jones.tangent(frames, d, dt, edges, 2.5)) == pytest.approx(expected, rel=1e-4)


def test_nudges_are_one_rounding():
    x, _ = fluid()
    moved = lennard_jones.nudged(x, 0)
    assert (np.abs(moved - x) <= np.spacing(np.abs(x))).all()
    assert (moved != x).all()


def test_rates_are_slopes():
    assert lennard_jones.rate(1e-15 * np.exp(4.0 * 0.005 * np.arange(500)), 0.005, 100) == pytest.approx(4.0)


def test_the_lattice_sum_is_the_published_one():
    """-6.7733681 and, with the kinetic part at T* = 1.44, -5.0197073 in LAMMPS' log of bench/in.lj."""
    energy, virial = lj_lammps_melt.shells(2.5)
    assert energy == pytest.approx(-6.77336805325309, rel=1e-14)
    assert virial == pytest.approx(-6.23531727, abs=1e-8)


def test_the_period_of_a_small_swing():
    """omega^2 = U'' / mu, U'' = 72 / 2^(1/3) at the minimum, mu = 1/2."""
    swing = closed_forms.swing(2 ** (1 / 6), 1e-3)
    assert swing == pytest.approx(2 * math.pi / math.sqrt(2 * 72 / 2 ** (1 / 3)), rel=1e-4)
    assert closed_forms.swing(1.2, 0.5, 200) == pytest.approx(closed_forms.swing(1.2, 0.5), rel=1e-13)


@pytest.mark.parametrize("name", ["circle", "ellipse, e = 0.9", "parabola", "hyperbola, e = 3"])
def test_anomalies_solve_keplers_problem(name):
    """Energy and angular momentum are constant, and the velocity is the derivative of the position."""
    q, v = closed_forms.CONICS[name]
    with mpmath.workdps(closed_forms.DIGITS):
        for t in (0.3, 2.0):
            (x, u), h = closed_forms.anomalies(mpmath, q, v, t), 1e-5
            assert u @ u / 2 - 1 / np.linalg.norm(x) == pytest.approx(v * v / 2 - 1 / q, abs=1e-13)
            assert x[0] * u[1] - x[1] * u[0] == pytest.approx(q * v, rel=1e-14)
            before, after = (closed_forms.anomalies(mpmath, q, v, t + step)[0] for step in (-h, h))
            assert (after - before) / (2 * h) == pytest.approx(u, abs=1e-7)


def test_the_time_to_pericentre():
    with mpmath.workdps(closed_forms.DIGITS):
        x, u = closed_forms.anomalies(mpmath, 0.5, math.sqrt(3.0), 2 * math.pi - 0.02)
    assert closed_forms.to_pericentre(x, u, 1.0) == pytest.approx(0.02, rel=1e-9)


def test_velocity_verlets_matrix_turns_by_its_angle():
    many = oscillator.power(oscillator.step("velocity-verlet", Decimal("0.1"))[0], 1000)
    assert float(many[0][0]) == pytest.approx(math.cos(2000 * math.asin(0.05)), abs=1e-12)


@pytest.mark.parametrize("name", ["ruth3", "yoshida4", "yoshida6", "yoshida8", "pefrl", "rk4", "gauss-legendre4"])
def test_matrices_have_their_order_and_symplectic_ones_their_area(name):
    errors = []
    for dt in (0.2, 0.1):
        (a, b), (c, d) = ((float(number) for number in row) for row in oscillator.step(name, Decimal(str(dt)))[0])
        errors.append(max(abs(a - math.cos(dt)), abs(b - math.sin(dt)), abs(c + math.sin(dt)), abs(d - math.cos(dt))))
    order = oscillator.integrator(name).order
    assert errors[1] < 1e-12 or math.log2(errors[0] / errors[1]) == pytest.approx(order + 1, abs=0.3)
    if name != "rk4":
        assert a * d - b * c == pytest.approx(1.0, abs=1e-14)


def test_every_force_of_the_registry_is_looked_at_or_named():
    pair_forces = {force.name for force in FORCES.values() if issubclass(force, PairForce)}
    assert {*force_gradients.others(), *force_gradients.NOT_GRADIENTS, *pair_forces} == set(FORCES)
    assert {*force_gradients.OPEN, *force_gradients.NOT_GRADIENTS} <= set(FORCES)


def test_slopes_and_places():
    assert force_gradients.slope(lambda s: math.exp(3 * s)) == pytest.approx(3.0, rel=1e-12)
    x = force_gradients.places()
    i, j = np.triu_indices(len(x), 1)
    separation = x[i] - x[j]
    r = np.linalg.norm(separation - force_gradients.EDGE * np.round(separation / force_gradients.EDGE), axis=1)
    assert np.abs(r - force_gradients.CUTOFF).min() > force_gradients.CLEAR


@pytest.mark.parametrize("name", ["lj_ase", "solar_system_rebound"])
def test_a_missing_peer_is_not_a_failure(monkeypatch, name):
    module = import_module(f"kickdrift_validation.{name}")
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    (row,) = module.claims()
    assert row["verdict"] == "not run"
    assert "pip install" in row["value"]
