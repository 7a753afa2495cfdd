"""Contract tests: every registered force is the gradient of its energy, and is found under its public name.

A newly registered force is tested without further code. A pair law's compiled sums are compared with the law in plain
Python; the oracle of tests/oracle, written from the literature, covers Lennard-Jones only.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift import forces
from kickdrift.errors import InputError
from kickdrift.forces import FORCES
from kickdrift.forces.beside.columns import bound_under
from kickdrift.forces.bonded.law import BondedForce
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.pairs.ends import TRUNCATIONS
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.slopes.variations import varied
from kickdrift.integrators.flows.flow import flow_of
from kickdrift_validation import force_gradients
from kickdrift_validation.example_forces import charges, crystal, example, topology
from tests.long import shortened
from tests.systems import liquid

SHIPPED = {name: cls for name, cls in FORCES.items() if cls.__module__.startswith("kickdrift.")}
PAIR_LAWS = [name for name, cls in SHIPPED.items() if issubclass(cls, PairForce)]
GRADIENTS = [name for name in force_gradients.others() if name in SHIPPED]
BONDED = [name for name, cls in SHIPPED.items() if issubclass(cls, BondedForce)]
OF_EACH_KIND = {"harmonic-bond", "harmonic-angle", "opls-dihedral"}  # whose laws share one loop
COMPILED_IN_SHORT = ["lennard-jones", "soft-pair"]  # powers, waves
CUTOFF = 2.5


@pytest.mark.parametrize("name", SHIPPED)
def test_a_force_is_public_under_the_name_of_its_class(name):
    cls = SHIPPED[name]
    assert cls.__name__ in forces.__all__
    assert cls.__name__ in kd.__all__
    assert getattr(kd, cls.__name__) is cls
    assert cls.__doc__


def pair_sums(force, system: kd.System) -> tuple[np.ndarray, float]:
    """Forces (n, 3) and energy of a law with a plain cut: every pair at its minimum image, in plain Python."""
    x, law = system.state.positions, force.law
    found, energy = np.zeros_like(x), 0.0
    edges = np.array(system.box.lengths)
    for i in range(len(x)):
        for j in range(i):
            d = x[i] - x[j]
            d -= edges * np.round(d / edges)
            r2 = float(d @ d)
            if r2 < CUTOFF**2:
                u, over_r = law.law(r2)
                energy += u
                found[i] += over_r * d
                found[j] -= over_r * d
    return found, energy


@pytest.mark.parametrize("name", shortened(PAIR_LAWS, COMPILED_IN_SHORT))
def test_a_compiled_pair_law_is_the_law(name):
    force = example(FORCES[name], cutoff=CUTOFF, truncation="cut")
    start = liquid(216)
    system = kd.System(start.state.positions, masses=start.state.masses, box=start.box, forces=[force])
    sim = kd.Simulation(system, dt=0.001)
    expected, energy = pair_sums(force, system)
    size = np.abs(expected).max()
    np.testing.assert_allclose(sim.forces(), expected, atol=1e-12 * size, rtol=0)
    assert sim.energy().potential == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("name", [*PAIR_LAWS, *BONDED])
def test_a_law_is_the_slope_of_its_energy(name):
    """In plain Python. Central differences, with Richardson's extrapolation to remove the error of h^2."""
    paired, h = name in PAIR_LAWS, 1e-3
    law = example(FORCES[name], cutoff=CUTOFF).law

    def energy(s: float) -> float:
        return law.law(s * s if paired else s)[0]

    angles = {"angles": (2.9,), "dihedrals": (-1.3, 2.9), "impropers": (-1.3, 2.9)}
    angles = () if paired else angles.get(FORCES[name].kind, ())
    for s in (0.95, 1.02, 1.3, 2.0, *angles):
        slopes = [(energy(s + d) - energy(s - d)) / (2 * d) for d in (h, h / 2)]
        slope = (4 * slopes[1] - slopes[0]) / 3
        size = max(abs(slope), abs(energy(s)))
        found = -s * law.law(s * s)[1] if paired else law.law(s)[1]
        assert math.isclose(slope, found, abs_tol=1e-7 * size)


WIDE = {key: {"sigma": 2.1} for key in ("soft-pair", "weeks-chandler-andersen")}  # by default they end too early


@pytest.mark.parametrize("truncation", TRUNCATIONS)
@pytest.mark.parametrize("name", shortened(PAIR_LAWS, ["lennard-jones"]))
def test_a_truncated_pair_law_is_the_gradient_of_its_energy(name, truncation):
    force = example(FORCES[name], **WIDE.get(name, {}), cutoff=CUTOFF, truncation=truncation)
    assert force_gradients.gradient(force, force_gradients.places(), force_gradients.EDGE) < force_gradients.SLOPE


@pytest.mark.parametrize("name", shortened(GRADIENTS, {*GRADIENTS} - {*BONDED} | OF_EACH_KIND))
def test_a_force_is_the_gradient_of_its_energy(name):
    assert force_gradients.gradient_of(name) < force_gradients.SLOPE


UNDIFFERENTIATED = ("beside", "coulomb", "gravity-tree", "tides-spin", "ase", "lammps")
BY_DIFFERENCES = ("cmap", "python")


def one_of(name: str) -> kd.System:
    """A System under one force, which moves."""
    rng, cls = np.random.default_rng(2), FORCES[name]
    if issubclass(cls, ManyBodyForce):
        start = crystal(example(cls))
        x = start.state.positions
        names = [start.species[k] for k in start.species_index]
        return kd.System(
            x, 0.1 * rng.normal(size=x.shape), start.state.masses, start.box, start.forces, "metal", species=names
        )
    if issubclass(cls, PairForce):
        start = liquid(64)
        return start.with_forces(example(cls, cutoff=2.0, truncation="switch"))
    x = rng.normal(size=(6, 3))
    masses = [5.0, *rng.uniform(0.1, 0.2, 5)]
    force = example(cls, G=1.0)
    given = {"topology": topology(force), "charges": charges(force, len(x))}
    return kd.System(x, rng.normal(size=x.shape), masses, forces=[force], units="nbody", **given)


@pytest.mark.parametrize("name", shortened(SHIPPED, [*UNDIFFERENTIATED, "linear-drag"]))
def test_a_force_has_its_slope_or_says_that_it_has_none(name):
    system = one_of(name)
    n, phase = len(system), system.state.phase
    h = 1e-6 if name == "eam" else 2e-4  # the curvature of its tables jumps
    deviations = np.random.default_rng(3).normal(size=(2, 3, n))
    if name in UNDIFFERENTIATED:
        with pytest.raises(InputError, match=f"force {name!r}: .*no variational equations"):
            varied(system, deviations)
        return
    made = varied(system, deviations)
    found = BoundForces(made).measure(0.3, made.state.phase).accelerations[:, n:]
    assert made.forces[0].differs == (name in BY_DIFFERENCES)
    plain = BoundForces(system)

    def there(k: int) -> np.ndarray:
        return plain.measure(0.3, phase + k * h * deviations).accelerations

    wanted = (45 * (there(1) - there(-1)) - 9 * (there(2) - there(-2)) + (there(3) - there(-3))) / (60 * h)
    assert np.abs(wanted).max() > 0.0 or name in ("uniform-field", "driven-field", "reflecting-wall")
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-7 * np.abs(wanted).max() + 1e-12)


@pytest.mark.parametrize("name", shortened(SHIPPED, [*UNDIFFERENTIATED, "linear-drag"]))
def test_a_system_tells_energy_forces_and_pressure_in_one_line(name):
    system = one_of(name)
    bound = BoundForces(bound_under(system))
    y = flow_of(system, 1, jumps=True).array(system.state)
    found = bound.measure(system.state.time, y)
    n = len(system)
    expected = (found.accelerations[:, :n] * system.coherent_masses).T
    np.testing.assert_allclose(system.net_forces(), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
    assert system.energy().potential == pytest.approx(found.potential, rel=1e-12)
    heat = 2.0 * system.energy().kinetic
    assert np.isnan(system.pressure()) or np.isfinite(heat + found.virial)
