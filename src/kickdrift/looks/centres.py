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
def turn_within(molecules, masses, values, matrix):
    """Multiply values (3, n), less those of the centre of their molecule, by a matrix (3, 3) from the right."""
    count, centre, own = int(molecules[0]), np.empty(3), np.empty(3)
    for k in range(count):
        begin, end = int(molecules[1 + k]), int(molecules[2 + k])
        mass, centre[:] = 0.0, 0.0
        for place in range(begin, end):
            i = int(molecules[2 + count + place])
            mass += masses[i]
            for axis in range(3):
                centre[axis] += masses[i] * values[axis, i]
        for axis in range(3):
            centre[axis] /= mass
        for place in range(begin, end):
            i = int(molecules[2 + count + place])
            for axis in range(3):
                own[axis] = values[axis, i] - centre[axis]
            for axis in range(3):
                turned = own[0] * matrix[0, axis] + own[1] * matrix[1, axis] + own[2] * matrix[2, axis]
                values[axis, i] = centre[axis] + turned


@strict
def add_tensor_within(molecules, masses, x, v, a, found):
    """Subtract from the symmetric tensor ``found`` (3, 3) what is within molecules: the sums of m (v - V) (v - V) and
    of m (x - X) a, made symmetric; see `add_within`. Return twice the kinetic energy within."""
    count, moving = int(molecules[0]), 0.0
    means = np.empty((2, 3))
    for k in range(count):
        begin, end = int(molecules[1 + k]), int(molecules[2 + k])
        mass, means[:] = 0.0, 0.0
        for place in range(begin, end):
            i = int(molecules[2 + count + place])
            mass += masses[i]
            for axis in range(3):
                means[0, axis] += masses[i] * x[axis, i]
                means[1, axis] += masses[i] * v[axis, i]
        for axis in range(3):
            means[0, axis] /= mass
            means[1, axis] /= mass
        for place in range(begin, end):
            i = int(molecules[2 + count + place])
            for p in range(3):
                for q in range(3):
                    squares = (v[p, i] - means[1, p]) * (v[q, i] - means[1, q])
                    arms = (x[p, i] - means[0, p]) * a[q, i] + (x[q, i] - means[0, q]) * a[p, i]
                    found[p, q] -= masses[i] * (squares + 0.5 * arms)
                    moving += masses[i] * squares if p == q else 0.0
    return moving


@strict
def add_within(molecules, masses, x, v, a, found):
    """found[k] <- found[k] - sum of m ((v - V)^2 + (x - X) a) along axis k, for the centres X of ``molecules`` and
    their velocities V; x, v and accelerations a are (3, n). Return the sum of m (v - V)^2."""
    count, whole = int(molecules[0]), 0.0
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
                whole += masses[i] * own * own
            found[axis] -= within
    return whole
