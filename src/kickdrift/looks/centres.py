"""Motion within molecules in compiled code, and the pressure of their centres of mass.

A box that changes its size carries the centres of rigid molecules along, and each molecule moves as a whole. So the
pressure is that of the centres: 2 K + W without the kinetic energy within molecules, and with the forces on molecules
at their centres (Ciccotti & Ryckaert 1986, doi:10.1016/0167-7977(86)90022-5). Forces of constraints act within
molecules and drop out. With them, the sum over particles has the same mean, and the same value for rigid molecules.
"""

import numpy as np

from kickdrift.jit.compile import strict
from kickdrift.model.molecules.constraints import Constraints
from kickdrift.model.state import Floats


def parted(constraints: Constraints | None) -> Floats:
    """Molecules with constraints as numbers for compiled code: how many, where each begins, and their particles."""
    if constraints is None:
        return np.zeros(0)
    members, begins = constraints.members
    return np.concatenate([[len(begins) - 1], begins, members]).astype(float)


@strict
def restore_within(molecules, masses, values, axis, factor):
    """Scale values (3, n) along an axis by a factor about the centre of each molecule."""
    count = int(molecules[0])
    for k in range(count):
        begin, end = int(molecules[1 + k]), int(molecules[2 + k])
        mass, centre = 0.0, 0.0
        for place in range(begin, end):
            i = int(molecules[2 + count + place])
            mass += masses[i]
            centre += masses[i] * values[axis, i]
        centre /= mass
        for place in range(begin, end):
            i = int(molecules[2 + count + place])
            values[axis, i] = centre + factor * (values[axis, i] - centre)


@strict
def add_within(molecules, masses, x, v, a, found):
    """found[k] <- found[k] - sum of m ((v - V)^2 + (x - X) a) along axis k, for the centres X of ``molecules`` and
    their velocities V; x, v and accelerations a are (3, n)."""
    count = int(molecules[0])
    for k in range(count):
        begin, end = int(molecules[1 + k]), int(molecules[2 + k])
        for axis in range(3):
            mass, centre, moving = 0.0, 0.0, 0.0
            for place in range(begin, end):
                i = int(molecules[2 + count + place])
                mass += masses[i]
                centre += masses[i] * x[axis, i]
                moving += masses[i] * v[axis, i]
            centre, moving = centre / mass, moving / mass
            within = 0.0
            for place in range(begin, end):
                i = int(molecules[2 + count + place])
                own = v[axis, i] - moving
                within += masses[i] * (own * own + (x[axis, i] - centre) * a[axis, i])
            found[axis] -= within
