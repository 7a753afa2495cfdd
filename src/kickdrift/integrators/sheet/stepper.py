"""Steps of ``sei``: its elements, the forces that kick, and the compiled loop of epicycles and kicks.

With P = v_x / Omega, Hill's motion has a guiding centre x_g = 4 x + 2 v_y / Omega, y_g = y - 2 P, which moves with the
speed -3/2 Omega x_g along y. About this centre X = x - x_g and P turn at the rate Omega: X = C cos + S sin, P = S cos -
C sin of Omega t. The motion along z is an oscillation of its own.
"""

from __future__ import annotations

import math
from copy import copy
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.bound.table import fill_accelerations
from kickdrift.forces.fields.shipped import Hill
from kickdrift.forces.seam.kernel import OK
from kickdrift.forces.slopes.variations import unvaried
from kickdrift.integrators.stepping.loops import STAGE, STEP
from kickdrift.integrators.stepping.stepping import FixedStepper
from kickdrift.jit.compile import driver, strict
from kickdrift.jit.handle import handle
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options


# Rows of the elements: x and y of the guiding centre; C and S of the motion about the centre, and of that along z; what
# rounding loses of y.
X_GUIDING, Y_GUIDING, COSINE, SINE, COSINE_Z, SINE_Z, LOST = range(7)
ROOM = 4  # arrays of y's shape in the workspace: the accelerations, and nine rows for the elements
FULL_TURN = 2.0 * math.pi
WHOLE = 2.0**-64  # of a turn, for the last binary digit of a phase


class Epicycles(NamedTuple):
    """Rates of a run, and the phase that half a step adds, in two parts."""

    omega: float
    vertical: float  # angular frequency along z
    phase: NDArray[np.uint64]  # (2,) of the motions in the plane and along z, in 2^-64 turns
    rest: NDArray[np.float64]  # (2,) what is below 2^-64 turns, in these


@strict
def angle(epicycles, half_steps, which):
    """Angle after a number of half steps. The product wraps around at whole turns, so nothing is lost but rounding."""
    whole = np.uint64(half_steps) * epicycles.phase[which]
    turns = float(whole >> np.uint64(11)) * 2.0**-53 + float(half_steps) * epicycles.rest[which] * WHOLE
    if turns > 0.5:
        turns -= 1.0
    return FULL_TURN * turns


@strict
def drift_centres(epicycles, elements, h):
    """Move the guiding centres for a time h, with compensated sums: equal steps are rounded alike."""
    moved = -1.5 * epicycles.omega * h
    for i in range(elements.shape[1]):
        before = elements[Y_GUIDING, i]
        change = elements[LOST, i] + moved * elements[X_GUIDING, i]
        elements[Y_GUIDING, i] = before + change
        elements[LOST, i] = change + (before - elements[Y_GUIDING, i])


@strict
def fill_phase(epicycles, elements, half_steps, x, v):
    """x, v <- positions and velocities (3, n) after a number of half steps."""
    turn, tilt = angle(epicycles, half_steps, 0), angle(epicycles, half_steps, 1)
    c, s, c_z, s_z = math.cos(turn), math.sin(turn), math.cos(tilt), math.sin(tilt)
    omega, vertical = epicycles.omega, epicycles.vertical
    for i in range(elements.shape[1]):
        centre, along, across = elements[X_GUIDING, i], elements[COSINE, i], elements[SINE, i]
        apart, speed = along * c + across * s, across * c - along * s
        x[0, i], v[0, i] = centre + apart, omega * speed
        x[1, i], v[1, i] = elements[Y_GUIDING, i] + 2.0 * speed, -1.5 * omega * centre - 2.0 * omega * apart
        x[2, i] = elements[COSINE_Z, i] * c_z + elements[SINE_Z, i] * s_z
        v[2, i] = vertical * (elements[SINE_Z, i] * c_z - elements[COSINE_Z, i] * s_z)


@strict
def kick(epicycles, elements, half_steps, h, a):
    """Change the velocities by h a, at fixed positions."""
    turn, tilt = angle(epicycles, half_steps, 0), angle(epicycles, half_steps, 1)
    c, s, c_z, s_z = math.cos(turn), math.sin(turn), math.cos(tilt), math.sin(tilt)
    in_plane, upright = h / epicycles.omega, h / epicycles.vertical
    for i in range(elements.shape[1]):
        speed, centre = in_plane * a[0, i], 2.0 * in_plane * a[1, i]
        elements[X_GUIDING, i] += centre
        elements[Y_GUIDING, i] -= 2.0 * speed
        elements[COSINE, i] -= centre * c + speed * s
        elements[SINE, i] += speed * c - centre * s
        elements[COSINE_Z, i] -= upright * a[2, i] * s_z
        elements[SINE_Z, i] += upright * a[2, i] * c_z


@driver
def fill_elements(epicycles, y, steps, elements):
    """elements <- those of positions and velocities y (2, 3, n) after a number of steps."""
    turn, tilt = angle(epicycles, 2 * steps, 0), angle(epicycles, 2 * steps, 1)
    c, s, c_z, s_z = math.cos(turn), math.sin(turn), math.cos(tilt), math.sin(tilt)
    omega = epicycles.omega
    for i in range(elements.shape[1]):
        speed = y[1, 0, i] / omega
        shear = 2.0 * (y[1, 1, i] / omega + 1.5 * y[0, 0, i])  # x_g - x
        elements[X_GUIDING, i] = y[0, 0, i] + shear
        elements[Y_GUIDING, i] = y[0, 1, i] - 2.0 * speed
        elements[COSINE, i] = -shear * c - speed * s
        elements[SINE, i] = speed * c - shear * s
        z, w = y[0, 2, i], y[1, 2, i] / epicycles.vertical
        elements[COSINE_Z, i] = z * c_z - w * s_z
        elements[SINE_Z, i] = z * s_z + w * c_z
        elements[LOST, i] = 0.0


@driver
def sei_loop(forces, y, carry, work, epicycles, dt, start, first, steps, cursor):
    """Take steps; see ``loops``. ``work`` (ROOM, 3, n) holds accelerations, then the elements."""
    bound = handle(forces)
    n = y.shape[2]
    a, elements = work[0], work[1:].reshape((-1, n))
    if steps == 0:
        return OK
    while cursor[STEP] < steps:
        done = first + cursor[STEP]
        if cursor[STAGE] == 0:
            drift_centres(epicycles, elements, 0.5 * dt)
            cursor[STAGE] = 1
        fill_phase(epicycles, elements, 2 * done + 1, y[0], y[1])
        status = fill_accelerations(bound, start + (done + 0.5) * dt, y[0], y[1], a, None, cursor)
        if status != OK:
            return status
        kick(epicycles, elements, 2 * done + 1, dt, a)
        drift_centres(epicycles, elements, 0.5 * dt)
        cursor[STAGE] = 0
        cursor[STEP] += 1
    fill_phase(epicycles, elements, 2 * (first + cursor[STEP]), y[0], y[1])
    return OK


BITS = 256
TURN = 2 * Fraction("3.14159265358979323846264338327950288419716939937510582097494")


class SeiStepper(FixedStepper):
    """Integration whose workspace holds the elements of the epicycles, so a checkpoint does too."""

    def __init__(self, flow: Flow, options: Options) -> None:
        system: Any = flow.subject
        (hill,) = (force for force in system.forces if isinstance(unvaried(force), Hill))
        kicks = copy(flow)
        others = system.under(force for force in system.forces if force is not hill)
        kicks.forces = BoundForces(others, flow.forces.threads, jumps=False)
        self._hill = unvaried(hill)
        assert options.dt is not None
        super().__init__(
            kicks,
            sei_loop,
            _epicycles(self._hill, options.dt),
            lambda shape: np.zeros((ROOM, *shape[1:])),
            options,
            kept=True,
        )

    def retimed(self, dt: float) -> Self:
        """This stepper with steps of another length. Call ``reset`` before the next step."""
        self.dt, self._stages = dt, _epicycles(self._hill, dt)
        return self

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """See Stepper."""
        super().reset(y, time, steps)
        fill_elements(self._stages, y, steps, self._work[1:].reshape(-1, y.shape[2]))


def _epicycles(hill: Any, dt: float) -> Epicycles:
    """Rates and phases of a run; half a step adds ``dt`` Omega / 2 to the phase, here exact to far beyond rounding."""
    omega, vertical = float(hill.omega), Fraction(abs(hill.omega)) * Fraction(hill.vertical)
    above, below = dt.as_integer_ratio()
    units = [_units(Fraction(rate)) * above // below for rate in (omega, vertical)]  # 2^-BITS turns
    phase = np.array([each >> (BITS - 64) & (2**64 - 1) for each in units], np.uint64)
    rest = np.array([(each & (2 ** (BITS - 64) - 1)) / 2 ** (BITS - 64) for each in units])
    return Epicycles(omega, float(vertical), phase, rest)


@lru_cache
def _units(rate: Fraction) -> int:
    """Turns in half a unit of time at a rate, in 2^-BITS turns."""
    return int(rate / 2 / TURN * 2**BITS)
