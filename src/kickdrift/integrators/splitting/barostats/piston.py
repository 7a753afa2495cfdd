"""The box of a run at constant pressure in compiled code: its edge lengths, and the pressure on its faces.

The edges of one *group* scale together: all three, the two of the x-y plane, or each alone. A group that scales its
edges by a factor s moves positions along them by s and velocities by 1 / s. The work of that at the lengths of now is
the pressure (2 K + W) / V along these axes, with the heat K and the virial W of the moment. The motion of the centre of
mass is no heat where the run conserves it (``model.freedom``), and no change of the box changes it. So particles whose
total momentum is conserved have the kinetic pressure of N - 1 particles, here and in every sample. The ensemble is
exp(-(K + U + P V) / k_B T) dLx dLy dLz, in which the mean of this pressure is P.

Molecules with constraints keep their shape: the box carries their centres along. The pressure is then that of the
centres (``looks.centres``).
"""

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.integrators.splitting.baths.bath import Bathed, heat_now
from kickdrift.jit.compile import as_written, strict
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import flat, masked_load, masked_store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.looks.centres import add_within, restore_within
from kickdrift.model.freedom import NONE
from kickdrift.model.state import Floats

STOPPED = 3  # see integrators.stepper
MOST = 2.0  # largest factor of the volume in one action
TOO_SHORT, TOO_FAST, TOO_STRAINED, TOO_TILTED = 1.0, 2.0, 3.0, 4.0  # causes in ``trouble``


class Piston(NamedTuple):
    """The box of a run, and what acts on it."""

    bath: Bathed
    lengths: Floats  # (3,) lengths ax, by and cz now, which the forces read; 0 along open axes
    group: NDArray[np.int64]  # (3,) of each axis; -1 along open axes
    sizes: Floats  # (groups,) axes of each
    pressure: float
    shortest: Floats  # (3,) least lengths that the forces allow
    sums: Floats  # (3,) potential energy, virial and pairs at the particles
    along: Any  # (rows, 3) virial along each axis, in parts; None if all edges scale together
    trouble: Floats  # (3,) cause of a stop, the axis and the length, or the factor
    work: Floats  # (1,) energy that the particles have got
    state: Floats  # (slots,) of the barostat
    room: Floats  # (8,) numbers from the proposal to the decision
    centres: float  # particles and molecules that move on their own, one less where the total momentum is conserved
    molecules: Any = None  # molecules with constraints, see `looks.centres`; None if all particles are free
    felt: Any = None  # (3, n) accelerations of the last evaluation, for molecules


@as_written
def sums_along(masses, v, axis, still):
    """Return kinetic energy and momentum along an axis of velocities (3, n) less ``still``."""
    row, n, squares, moments = flat(v), v.shape[1], splat(0.0), splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        some, mass = masked_load(row, axis * n + i, count) - still, masked_load(masses, i, count)
        squares, moments = squares + mass * (some * some), moments + mass * some
    return 0.5 * lane_sum(squares), lane_sum(moments)


@strict
def heat_along(bath, v, axis):
    """Return the kinetic energy along an axis without the motion of the centre of mass."""
    energy, momentum = sums_along(bath.masses, v, axis, 0.0)
    if bath.apart == NONE or energy - 0.5 * momentum * momentum / bath.mass == energy:
        return energy
    return sums_along(bath.masses, v, axis, momentum / bath.mass)[0]


@as_written
def scale_axis(x, axis, factor, still):
    """x <- still + factor (x - still) along an axis, (3, n)."""
    row, n = flat(x), x.shape[1]
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        some = masked_load(row, axis * n + i, count)
        masked_store(row, axis * n + i, still + factor * (some - still) if still != 0.0 else factor * some, count)


@strict
def volume(piston):
    """Volume of the box; area in two dimensions."""
    found = 1.0
    for k in range(3):
        if piston.group[k] >= 0:
            found *= piston.lengths[k]
    return found


@strict
def pressures(piston, v, found):
    """found[a] <- pressure on the faces of group a; velocities (3, n). Return their heat: the kinetic energy without
    the motion of the centre of mass."""
    v_now, total = volume(piston), 0.0
    for a in range(piston.sizes.size):
        found[a] = 0.0
    for k in range(3):
        a = piston.group[k]
        if a >= 0:
            heat = heat_along(piston.bath, v, k)
            total += heat
            found[a] += (2.0 * heat + virial_along(piston.along, piston, k)) / (piston.sizes[a] * v_now)
    return total


@by_type
def add_motion_within(molecules, piston, x, v, found):
    """Make the pressures on the groups ``found`` those of the centres of molecules, which the box carries along. Return
    the kinetic energy within molecules."""
    if isinstance(molecules, types.NoneType):
        return lambda molecules, piston, x, v, found: 0.0

    def each(molecules, piston, x, v, found):
        within = np.zeros(3)
        heat = 0.5 * add_within(molecules, piston.bath.masses, x, v, piston.felt, within)
        v_now = volume(piston)
        for k in range(3):
            a = piston.group[k]
            if a >= 0:
                found[a] += within[k] / (piston.sizes[a] * v_now)
        return heat

    return each


@by_type
def keep_shapes(molecules, piston, x, v, axis, factor):
    """Give molecules their shape and their inner motion back, after positions along an axis were scaled by a factor and
    velocities by one over it; v may be None."""
    if isinstance(molecules, types.NoneType):
        return lambda molecules, piston, x, v, axis, factor: None

    def each(molecules, piston, x, v, axis, factor):
        restore_within(molecules, piston.bath.masses, x, axis, 1.0 / factor)
        if v is not None:
            restore_within(molecules, piston.bath.masses, v, axis, factor)

    return each


@by_type
def slow_centres(molecules, piston, v, factor):
    """Scale the velocities of free particles and of the centres of molecules along all axes."""
    if isinstance(molecules, types.NoneType):

        def free(molecules, piston, v, factor):
            for k in range(piston.bath.axes):
                scale_axis(v, k, factor, piston.bath.motion[k])

        return free

    def each(molecules, piston, v, factor):
        for k in range(piston.bath.axes):
            scale_axis(v, k, factor, piston.bath.motion[k])
            restore_within(molecules, piston.bath.masses, v, k, 1.0 / factor)

    return each


@strict
def virial_along(along, piston, axis):
    """Virial of the last evaluation along an axis."""
    if along is None:
        return piston.sums[1] / piston.bath.axes
    whole = own = 0.0
    for k in range(3):
        part = 0.0
        for c in range(along.shape[0]):
            part += along[c, k]
        whole += part
        own = part if k == axis else own
    return own + (piston.sums[1] - whole) / piston.bath.axes  # tail corrections are the same along all axes


@strict
def stretch(piston, x, v, factors):
    """Scale edges and positions by the ``factors`` of their groups, and velocities by one over these unless v is None.
    The velocity of the centre of mass stays where it is no heat, and stands in ``piston.bath.motion`` then.

    Return a status: nothing changes if an edge would be too short."""
    for k in range(3):
        if piston.group[k] >= 0:
            length = piston.lengths[k] * factors[piston.group[k]]
            if not length >= piston.shortest[k]:
                piston.trouble[0], piston.trouble[1], piston.trouble[2] = TOO_SHORT, k, length
                return STOPPED
    if v is not None:
        heat_now(piston.bath, x, v)
    for k in range(3):
        if piston.group[k] >= 0:
            factor = factors[piston.group[k]]
            piston.lengths[k] *= factor
            scale_axis(x, k, factor, 0.0)
            if v is not None:
                scale_axis(v, k, 1.0 / factor, piston.bath.motion[k])
            keep_shapes(piston.molecules, piston, x, v, k, factor)
    return 0
