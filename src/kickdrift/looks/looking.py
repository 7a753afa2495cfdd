"""One look at particles: energies, momenta and centre of mass, summed by compiled code into a row of a table."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bound.table import fill_accelerations
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.jit.compile import driver, inlined, is_finite
from kickdrift.jit.handle import address_of, handle, unowned
from kickdrift.looks import columns
from kickdrift.looks.centres import add_within, parted
from kickdrift.looks.heat import MOTION, heat_of
from kickdrift.looks.observers import bodies_collide, particles_interact
from kickdrift.model.freedom import NONE, apart_of, fixed_heat, freedom_of
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.forces.bound.forces import BoundForces
    from kickdrift.model.system import System

# Head of the desk: the total mass, degrees of freedom times Boltzmann's constant, the volume times the number of
# dimensions. A nan marks an undefined temperature or pressure. Then the volume of a box that a barostat changes, the
# motion that is no heat (`model.freedom`), the kinetic energy of fixed particles, and room for the motion
# (`looks.heat`). Masses follow, then room for accelerations, then molecules with constraints (`looks.centres`), if any.
MASS, FREEDOM, VOLUMES, CHANGING, APART, GIVEN, MOVING = range(7)
HEAD = MOVING + MOTION

NO_ENERGY = 5  # status: forces are finite, but the energy is not
BLOCK = 256  # particles summed before they join the total, which limits the rounding error of many particles


class Looking(NamedTuple):
    """Arguments of compiled looks: forces, the particles' desk, a cursor."""

    forces: BoundForces
    desk: Floats
    cursor: NDArray[np.int64]

    def address(self, *args: Any) -> int:
        """Return the address of ``look`` for these forces and further arguments like ``args``."""
        return address_of(look, self.forces.table, *args)


def desk_of(system: System, bath: bool = False, drags: bool = False, hits: bool = False) -> Floats:
    """Return the desk: the particles' constants and workspace, in the layout of the constants above. A ``bath`` gives
    particles a temperature that do not act on each other; ``drags`` tells whether it changes the total momentum.
    ``hits`` tells whether the method adds the pressure of collisions, which else leave no pressure."""
    masses, freedom = system.coherent_masses, freedom_of(system, drags)
    collide = (bath or particles_interact(system)) and freedom > 0
    desk = np.zeros(HEAD + 4 * len(masses))
    desk[MASS] = masses.sum()
    desk[FREEDOM] = freedom * system.units.boltzmann if collide else np.nan
    asked = collide or np.isfinite(system.volume)  # else neither temperature nor pressure needs the heat
    desk[APART] = apart_of(system, drags) if asked else NONE
    pressed = np.isfinite(system.volume) and (hits or not bodies_collide(system))
    desk[VOLUMES] = system.dimensions * system.volume if pressed else np.nan
    desk[CHANGING] = np.nan
    desk[GIVEN] = fixed_heat(system)
    desk[HEAD : HEAD + len(masses)] = masses
    return np.concatenate([desk, parted(system.constraints)])


@inlined
def sum_moments(m, x, v, row):
    """row <- kinetic energy, momentum, angular momentum and mass moment of all particles.

    Return whether x and v are finite."""
    kinetic, bad = 0.0, 0.0
    px, py, pz, lx, ly, lz, cx, cy, cz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for begin in range(0, m.size, BLOCK):
        k, b = 0.0, 0.0
        p0, p1, p2, l0, l1, l2, c0, c1, c2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(begin, min(begin + BLOCK, m.size)):
            mass, x0, x1, x2, v0, v1, v2 = m[i], x[0, i], x[1, i], x[2, i], v[0, i], v[1, i], v[2, i]
            k += mass * (v0 * v0 + v1 * v1 + v2 * v2)
            p0 += mass * v0
            p1 += mass * v1
            p2 += mass * v2
            l0 += mass * (x1 * v2 - x2 * v1)
            l1 += mass * (x2 * v0 - x0 * v2)
            l2 += mass * (x0 * v1 - x1 * v0)
            c0 += mass * x0
            c1 += mass * x1
            c2 += mass * x2
            b += 0.0 * x0 + 0.0 * x1 + 0.0 * x2 + 0.0 * v0 + 0.0 * v1 + 0.0 * v2
        kinetic, bad = kinetic + k, bad + b
        px, py, pz = px + p0, py + p1, pz + p2
        lx, ly, lz = lx + l0, ly + l1, lz + l2
        cx, cy, cz = cx + c0, cy + c1, cz + c2
    row[columns.KINETIC] = 0.5 * kinetic
    row[columns.MOMENTUM], row[columns.MOMENTUM + 1], row[columns.MOMENTUM + 2] = px, py, pz
    row[columns.ANGULAR], row[columns.ANGULAR + 1], row[columns.ANGULAR + 2] = lx, ly, lz
    row[columns.CENTRE], row[columns.CENTRE + 1], row[columns.CENTRE + 2] = cx, cy, cz
    return bad == 0.0


@driver
def look(forces, t, y, desk, last, rows, at, cursor):
    """rows[at] <- one look at y (2, 3, n) at time t; last <- y; return a status.

    If the status is not OK, the row is meaningless and ``last`` is unchanged."""
    y, desk, last, rows = unowned(y), unowned(desk), unowned(last), unowned(rows)
    x, v, n = y[0], y[1], y.shape[2]
    row = rows[at]
    for k in range(columns.COLUMNS):
        row[k] = 0.0
    room, molecules = desk[HEAD + n : HEAD + 4 * n].reshape((3, n)), desk[HEAD + 4 * n :]
    status = fill_accelerations(handle(forces), t, x, v, room, row[columns.POTENTIAL : columns.PAIRS + 1], cursor)
    if status != OK:
        return status
    if not sum_moments(desk[HEAD : HEAD + n], x, v, row):
        return BLOWN_UP
    total = row[columns.KINETIC] + row[columns.POTENTIAL]
    if not is_finite(total):
        return NO_ENERGY
    row[columns.TIME], row[columns.TOTAL] = t, total
    heat, apart = row[columns.KINETIC] - desk[GIVEN], int(desk[APART])
    if apart != NONE:
        momentum = row[columns.MOMENTUM], row[columns.MOMENTUM + 1], row[columns.MOMENTUM + 2]
        heat = heat_of(desk[HEAD : HEAD + n], desk[MASS], x, v, apart, desk[MOVING:HEAD], heat, momentum)
    row[columns.TEMPERATURE] = 2.0 * heat / desk[FREEDOM]
    row[columns.VOLUME] = desk[CHANGING]
    if molecules.size:
        within = np.zeros(3)
        add_within(molecules, desk[HEAD : HEAD + n], x, v, room, within)
        row[columns.VIRIAL] += within[0] + within[1] + within[2]
    row[columns.PRESSURE] = (2.0 * heat + row[columns.VIRIAL]) / desk[VOLUMES]
    for k in range(3):
        row[columns.VELOCITY + k] = row[columns.MOMENTUM + k] / desk[MASS]
        row[columns.CENTRE + k] = row[columns.CENTRE + k] / desk[MASS]
    for half in range(2):
        for k in range(3):
            for i in range(n):
                last[half, k, i] = y[half, k, i]
    return OK
