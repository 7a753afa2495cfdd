"""Pressure tensor: against the engine's trace, ASE's stress, closed forms, and the energy's change under strain."""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis import pressure_tensor
from kickdrift.errors import InputError
from kickdrift.forces import Springs, UniformField
from kickdrift.looks.pressure import instantaneous_pressure
from kickdrift.run.simulation import Simulation

EDGES = (8.0, 7.0, 6.0)


def fluid(force, n=120, species=None, extra=(), seed=1, masses=1.0):
    """Particles on a jittered lattice, partly outside the box, with velocities."""
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(*[np.arange(5) for _ in EDGES], indexing="ij"), axis=-1).reshape(-1, 3)[:n]
    x = (grid + 0.5) / 5 * np.array(EDGES) + rng.uniform(-0.15, 0.15, (n, 3))
    x += np.array(EDGES) * rng.integers(-2, 3, (n, 3))
    return kd.System(x, rng.normal(size=(n, 3)), masses=masses, box=EDGES, forces=[force, *extra], species=species)


def relative(system) -> np.ndarray:
    """Velocities in the frame of the centre of mass."""
    masses, v = system.state.masses, system.state.velocities
    return v - masses @ v / masses.sum()


def engine_pressure(system) -> float:
    return Simulation(system, "velocity-verlet", dt=0.001).sample().pressure


@pytest.mark.parametrize("truncation", ["cut", "shift", "force-shift", "switch"])
def test_the_trace_is_the_engines_pressure(truncation):
    system = fluid(kd.LennardJones(cutoff=2.5, truncation=truncation), masses=np.linspace(0.5, 3, 120))
    p = instantaneous_pressure(system, system.state.positions, relative(system))
    assert np.trace(p) / 3 == pytest.approx(engine_pressure(system), rel=1e-12)
    np.testing.assert_allclose(p, p.T, rtol=1e-12, atol=1e-12)


def test_the_trace_of_mixtures_tails_springs_and_fields():
    mixture = kd.LennardJones(
        cutoff=2.5,
        truncation="cut",
        tail=True,
        species={"A": {"epsilon": 1.0, "sigma": 1.0}, "B": {"epsilon": 0.5, "sigma": 0.88}, "C": {"sigma": 0.95}},
        pairs={("A", "B"): {"epsilon": 1.5, "sigma": 0.8}},
    )
    springs = Springs(pairs=[(0, 1), (3, 90), (5, 7)], stiffness=[3.0, 2.0, 5.0], length=[0.0, 1.0, 0.5])
    system = fluid(
        mixture, species=["ABC"[k % 3] for k in range(120)], extra=[springs, UniformField(acceleration=(0.0, 0.0, 1.0))]
    )
    p = instantaneous_pressure(system, system.state.positions, relative(system))
    assert np.trace(p) / 3 == pytest.approx(engine_pressure(system), rel=1e-12)


def test_equals_ases_stress():
    pytest.importorskip("ase")
    from ase import Atoms
    from ase.calculators.lj import LennardJones

    system = fluid(kd.LennardJones(cutoff=2.5))
    x = system.state.positions
    atoms = Atoms("X120", positions=x, cell=EDGES, pbc=True, calculator=LennardJones(rc=2.5))
    ours = instantaneous_pressure(system, x, np.zeros_like(x))
    np.testing.assert_allclose(ours, -atoms.get_stress(voigt=False), rtol=1e-11, atol=1e-12)


def test_is_the_energys_slope_in_the_strain():
    """A cluster in a large box, strained by (1 + e): all nine components of the configurational part are -dU/de_ab /
    V."""
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(*[np.arange(2)] * 3), axis=-1).reshape(-1, 3)
    x = 10.0 + 1.1 * grid + rng.uniform(-0.1, 0.1, (8, 3))
    force = kd.LennardJones(cutoff=3.0, truncation="switch")

    def energy(strain):
        return Simulation(
            kd.System(10.0 + (x - 10.0) @ (np.eye(3) + strain).T, box=(20.0,) * 3, forces=[force]),
            "velocity-verlet",
            dt=0.001,
        ).energy()[1]

    step, slopes = 1e-5, np.empty((3, 3))
    for a in range(3):
        for b in range(3):
            strain = np.zeros((3, 3))
            strain[a, b] = step
            slopes[a, b] = (energy(strain) - energy(-strain)) / (2 * step)
    system = kd.System(x, box=(20.0,) * 3, forces=[force])
    p = instantaneous_pressure(system, x, np.zeros_like(x))
    np.testing.assert_allclose(p, -slopes / 20.0**3, rtol=1e-7, atol=1e-9 * np.abs(p).max())


def test_two_atoms_across_the_edge():
    """r is along x, through the wall: P_xx = (m v_x^2 + r F) / V; all other components come from the motion."""
    r, v = 1.05, 0.7
    x = [[0.2, 3.0, 3.0], [0.2 - r + 8.0, 3.0, 3.0]]
    system = kd.System(x, [[v, 0, 0], [0, 0, 0]], masses=2.0, box=EDGES, forces=[kd.LennardJones(cutoff=2.5)])
    p = instantaneous_pressure(system, x, [[v, 0, 0], [0, 0, 0]])
    wanted = np.zeros((3, 3))
    wanted[0, 0] = (2 * v * v + 24 * (2 * r**-12 - r**-6)) / math.prod(EDGES)
    np.testing.assert_allclose(p, wanted, rtol=1e-12, atol=1e-15)


def test_an_ideal_gas():
    rng = np.random.default_rng(5)
    x, v = rng.uniform(0, 6, (500, 3)), rng.normal(size=(500, 3))
    system = kd.System(x, v, masses=1.7, box=EDGES)
    p = instantaneous_pressure(system, x, v)
    np.testing.assert_allclose(p, 1.7 * v.T @ v / math.prod(EDGES), rtol=1e-12)


def test_of_a_run(tmp_path):
    """The file alone is enough. The means have errors, and the trace at each frame is the pressure that the run
    wrote."""
    path = tmp_path / "run.h5md"
    Simulation(fluid(kd.LennardJones(cutoff=2.5)), "velocity-verlet", dt=0.002).run(500, every=5, output=path)
    with kd.open(path) as run:
        found = pressure_tensor(run[20:])
        written = run.observables["pressure"][20:]
        np.testing.assert_allclose(np.trace(found.tensors, axis1=1, axis2=2) / 3, written, rtol=1e-11)
        np.testing.assert_allclose(found.times, run.times[20:])
        again = pressure_tensor(run[20:], fluid(kd.LennardJones(cutoff=2.5)))
    np.testing.assert_array_equal(again.tensors, found.tensors)
    assert found.tensors.shape == (81, 3, 3)
    np.testing.assert_allclose(found.tensor, found.tensors.mean(axis=0), rtol=1e-12, atol=1e-14)
    assert found.pressure == pytest.approx(np.mean(written), rel=1e-12)
    assert found.error.shape == (3, 3)
    assert found.pressure_error > 0


def test_what_has_no_pressure():
    x = np.random.default_rng(1).normal(size=(5, 3))
    with pytest.raises(InputError, match="needs a periodic box"):
        instantaneous_pressure(kd.System(x), x, x)

    class Stranger(UniformField):
        external = False

    system = kd.System(x, box=EDGES, forces=[Stranger(acceleration=(0.0, 0.0, 1.0))])
    with pytest.raises(InputError, match="force 'uniform-field' is not a sum over pairs"):
        instantaneous_pressure(system, x, x)


def test_a_system_of_another_size(tmp_path):
    path = tmp_path / "run.h5md"
    Simulation(fluid(kd.LennardJones(cutoff=2.5)), "velocity-verlet", dt=0.002).run(5, every=5, output=path)
    with pytest.raises(InputError, match="the system has 119 particles, the run 120"):
        pressure_tensor(path, fluid(kd.LennardJones(cutoff=2.5), n=119))
