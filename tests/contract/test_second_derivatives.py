"""Contract tests: every integrator that carries derivatives of gravity carries them to second order.

A newly registered method is tested without further code. The reference is the first-order matrix of the same method.
"""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.tangents.mapped import has_map
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS, integrator
from tests.long import shortened
from tests.systems import planets_that_meet

DT, TIME = 0.05, 0.4
SHEET = ["sei"]  # methods for the frame of Hill, whose force has no second derivatives
# Methods that choose their steps stop at their tolerance, and differences would show that.
NAMED = [name for name, method in INTEGRATORS.items() if method.name == name]
CARRYING = [name for name in NAMED if (integrator(name).carries or has_map(integrator(name))) and name not in SHEET]
SMOOTH = [name for name in CARRYING if not integrator(name).chooses_steps or name == "gauss-radau15"]
OTHERS = [name for name in NAMED if name not in [*CARRYING, *SHEET]]
SHORT = ["velocity-verlet", "gauss-radau15"]


def derivatives(name: str, system: kd.System, bodies: list[str], second: bool = True) -> kd.TransitionMatrix:
    dt = None if integrator(name).chooses_steps else DT
    return kd.transition_matrix(system, TIME, name, dt, bodies=bodies, second=second)


@pytest.mark.parametrize("name", shortened(SMOOTH, SHORT))
def test_second_derivatives_are_slopes_of_the_first(name):
    """By all coordinates of b and c: beside differences of order 4, and with the two directions in either order."""
    bodies, h = ["b", "c"], 1e-3
    found = derivatives(name, planets_that_meet(), bodies)
    plain = derivatives(name, planets_that_meet(), bodies, second=False)
    size = np.abs(plain.matrix).max()
    np.testing.assert_allclose(found.matrix, plain.matrix, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(found.end.phase, plain.end.phase, rtol=0, atol=1e-14)
    assert found.second.shape == (18, 12, 12)
    largest = np.abs(found.second).max()
    for half, body, axis, column in ((0, 1, 0, 0), (1, 2, 1, 10)):

        def matrix(by, at=(half, body, axis)):
            return derivatives(name, planets_that_meet((*at, by)), bodies, second=False).matrix

        one, two = ((matrix(k * h) - matrix(-k * h)) / (2 * k * h) for k in (1, 2))
        np.testing.assert_allclose(found.second[:, :, column], (4 * one - two) / 3, rtol=0, atol=1e-9 * largest)
    turned, order = derivatives(name, planets_that_meet(), bodies[::-1]), [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    np.testing.assert_allclose(turned.second[:, order][:, :, order], found.second, rtol=0, atol=1e-13 * largest)


@pytest.mark.parametrize("name", OTHERS)
def test_methods_without_derivatives_say_which_have_them(name):
    with pytest.raises(InputError, match=f"{name} carries no variations; gauss-radau15 does"):
        derivatives(name, planets_that_meet(), ["b"])


@pytest.mark.parametrize("name", shortened(CARRYING, ["yoshida4", "wisdom-holman"]))
def test_other_forces_than_gravity_are_refused(name):
    flat = planets_that_meet().with_forces(kd.Gravity(G=1.0), kd.Oblateness(j2=1e-3, radius=0.1, G=1.0))
    with pytest.raises(InputError, match="force 'j2': has no variational equations of second order; gravity alone"):
        derivatives(name, flat, ["b"])
