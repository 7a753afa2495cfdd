"""Slopes of forces along many deviations at once: beside differences, and beside one deviation at a time."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.slopes.variations import varied
from tests.long import shortened

N, ALONG = 5, 11


@kd.field_law
class Whirl(NamedTuple):
    """A field law with most of what a field law may use."""

    k: float
    w: tuple[float, float, float]

    velocity_dependent = works = True
    varies = ("k",)

    def law(p, x, v, m, t):
        r = math.sqrt(x @ x + 0.1)
        push = -p.k * x / r**3 + np.cross(p.w, v) - 0.1 * v * math.exp(-r) + np.where(r < 1.0, 0.1, 1.0 / r) * x
        return None, (push[0] + math.sin(x[1]), push[1] - max(x[0], 0.2), push[2] + 2.0)


@kd.body_law
class Shells(NamedTuple):
    """A body law with branches, powers and a number that becomes a dual."""

    k: float

    works = True

    def law(p, x, v, m, t, a):
        for i in range(x.shape[1]):
            r2 = 0.01
            for k in range(3):
                r2 += (x[k, i] - x[k, 0]) ** 2
            weight = r2**-1.5 if r2 > 1.0 else math.log(r2)
            if i == 1:
                weight = 0.3
            for k in range(3):
                a[k, i] += p.k * weight * (x[k, i] - x[k, 0])


FORCES = {
    "gravity": kd.Gravity(softening=0.3),
    "trap": kd.HarmonicTrap(stiffness=(1.0, 2.0, 0.5), centre=(0.1, 0.0, 0.0)),
    "bonds": kd.HarmonicBond(stiffness=2.0, length=0.4),
    "angles": kd.HarmonicAngle(stiffness=1.5, rest=1.9),
    "dihedrals": kd.PeriodicDihedral(barrier=0.7, multiplicity=2.0, phase=0.3),
    "springs": kd.Springs(pairs=[(0, 1), (1, 2)], stiffness=2.0, length=0.4),
    "field law": Whirl(k=[1.0, 1.2, 1.4, 1.6, 1.8], w=(0.1, 0.2, 0.3)),
    "body law": Shells(k=0.7),
    "workspace": kd.EinsteinInfeldHoffmann(c=10.0, G=1.0),
}


def system_of(force) -> kd.System:
    x, v = np.random.default_rng(4).normal(size=(2, N, 3))
    chain = kd.Topology(bonds=[(0, 1), (1, 2), (2, 3)], angles=[(0, 1, 2), (1, 2, 3)], dihedrals=[(0, 1, 2, 3)])
    return kd.System(x, v, np.linspace(0.5, 1.5, N), forces=[force], units="nbody", topology=chain)


def accelerations(system: kd.System, deviations: np.ndarray):
    """Accelerations of the particles (3, n), their slopes (3, n, along), and whether these came from differences."""
    made = varied(system, deviations.reshape(2, 3, -1))
    found = BoundForces(made).measure(0.3, made.state.phase).accelerations
    return found[:, :N], found[:, N:].reshape(3, N, -1), made.forces[0].differs


@pytest.mark.parametrize(
    "name", shortened(FORCES, [*FORCES.keys() - {"angles", "springs", "bonds", "dihedrals", "field law", "workspace"}])
)
def test_slopes_are_exact_along_any_number_of_deviations(name):
    system = system_of(FORCES[name])
    deviations = np.random.default_rng(5).normal(size=(2, 3, N, ALONG))
    own, slopes, differs = accelerations(system, deviations)
    assert not differs
    plain, h = BoundForces(system), 1e-3
    phase = system.state.phase
    np.testing.assert_array_equal(own, plain.measure(0.3, phase).accelerations)
    for k in (0, 7, 8, ALONG - 1):
        one, two = (
            (
                plain.measure(0.3, phase + step * deviations[..., k]).accelerations
                - plain.measure(0.3, phase - step * deviations[..., k]).accelerations
            )
            / (2 * step)
            for step in (h, 2 * h)
        )
        np.testing.assert_allclose(slopes[..., k], (4 * one - two) / 3, rtol=0, atol=1e-7 * np.abs(slopes).max())
        alone = accelerations(system, deviations[..., k : k + 1])[1][..., 0]
        np.testing.assert_allclose(slopes[..., k], alone, rtol=0, atol=1e-14 * np.abs(slopes).max())


def pulled(positions, velocities, time, box):
    return -positions * np.abs(positions), float((np.abs(positions) ** 3).sum() / 3.0)


@pytest.mark.long
def test_a_python_function_takes_central_differences():
    system = system_of(kd.PythonForce(pulled))
    deviations = np.random.default_rng(5).normal(size=(2, 3, N, 2))
    _, slopes, differs = accelerations(system, deviations)
    assert differs
    x, masses = system.state.phase[0], system.state.masses
    wanted = (-2.0 * np.abs(x) / masses)[..., None] * deviations[0]
    np.testing.assert_allclose(slopes, wanted, rtol=0, atol=1e-8)
