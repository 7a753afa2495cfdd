"""The dielectric constant: dipoles that turn freely, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError

COUNT, EDGE, KELVIN = 64, 20.0, 300.0


def pairs(charge: float = 1.0) -> kd.System:
    """Rigid dipoles of one angstrom that feel no forces, some of them across the edge of the box."""
    rng = np.random.default_rng(3)
    x = np.repeat(rng.uniform(0.0, EDGE, (COUNT, 3)), 2, axis=0)
    x[1::2, 0] = (x[1::2, 0] + 1.0) % EDGE
    held = kd.Constraint(pairs=np.arange(2 * COUNT).reshape(COUNT, 2), distance=1.0)
    charges = np.tile([charge, -1.0], COUNT)
    return kd.System(x, None, 10.0, [EDGE] * 3, charges=charges, constraints=[held], units="metal")


def test_free_dipoles_have_debye_s_constant(tmp_path):
    """Without forces the mean of M^2 is N q^2 d^2 (Debye 1912)."""
    path = tmp_path / "run.h5md"
    sim = kd.Simulation(pairs(), "baoab", dt=0.004, temperature=KELVIN, friction=10.0)
    sim.run(100)
    sim.run(8000, every=10, output=path)
    found = kd.analysis.dielectric_constant(path, KELVIN)
    units = sim.system.units
    expected = 1.0 + 4.0 * np.pi * units.coulomb * COUNT / (3.0 * EDGE**3 * units.boltzmann * KELVIN)
    assert 15.0 < expected < 25.0
    assert abs(found.value - expected) < 4.0 * found.error
    assert found.error < 2.0
    with kd.open(path) as run:
        last = run[-1].positions
        assert kd.analysis.dielectric_constant(run).value == pytest.approx(found.value, rel=0.2)
    np.testing.assert_allclose(found.dipoles[-1], (last[0::2] - last[1::2]).sum(axis=0), atol=1e-10)


def test_ions_and_particles_without_charges_are_refused(tmp_path):
    kd.Simulation(pairs(0.5), "velocity-verlet", dt=0.004).run(2, every=1, output=tmp_path / "ions.h5md")
    with pytest.raises(InputError, match=r"^dielectric_constant: molecule 0 has the charge -0\.5, and the dipole"):
        kd.analysis.dielectric_constant(tmp_path / "ions.h5md")
    system = pairs().remade(charges=None)
    kd.Simulation(system, "velocity-verlet", dt=0.004).run(2, every=1, output=tmp_path / "plain.h5md")
    with pytest.raises(InputError, match=r"^dielectric_constant: the run's particles have no charges"):
        kd.analysis.dielectric_constant(tmp_path / "plain.h5md")
    with pytest.raises(InputError, match=r"^dielectric_constant: expected a run"):
        kd.analysis.dielectric_constant(np.zeros((2, 3, 3)))
