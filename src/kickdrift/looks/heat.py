"""Heat in compiled code: the kinetic energy without the motion of the whole; see ``model.freedom``.

The motion of the whole counts where its energy shows in the kinetic energy's last bit. So a total momentum from
rounding changes no bit of a run. The mass array may be longer than the particles are many.
"""

from kickdrift.jit.compile import as_written, strict
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import flat, masked_load, masked_store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.freedom import BARELY, NONE, TURN

VELOCITY, CENTRE, RATE, MOTION = 0, 3, 6, 9  # places in a motion: of the centre of mass, the centre, the rotation


@as_written
def kinetic_and_momentum(masses, v):
    """Return the kinetic energy of velocities (3, n) and the momentum along each axis, summed in the same order always.
    In two dimensions velocities along z are zero."""
    row, n, total = flat(v), v.shape[1], splat(0.0)
    first, second, third = splat(0.0), splat(0.0), splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        some = masked_load(masses, i, count)
        x, y, z = masked_load(row, i, count), masked_load(row, n + i, count), masked_load(row, 2 * n + i, count)
        total = total + some * (x * x + y * y + z * z)
        first, second, third = first + some * x, second + some * y, third + some * z
    return 0.5 * lane_sum(total), (lane_sum(first), lane_sum(second), lane_sum(third))


@strict
def kinetic(masses, v):
    """Return the kinetic energy of velocities (3, n)."""
    return kinetic_and_momentum(masses, v)[0]


@as_written
def moments(masses, values):
    """Return the sums of the masses times values (3, n), a number for each axis."""
    row, n = flat(values), values.shape[1]
    first, second, third = splat(0.0), splat(0.0), splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        some = masked_load(masses, i, count)
        first = first + some * masked_load(row, i, count)
        second = second + some * masked_load(row, n + i, count)
        third = third + some * masked_load(row, 2 * n + i, count)
    return lane_sum(first), lane_sum(second), lane_sum(third)


@as_written
def carried(x, motion, axis, i, count):
    """Return the velocity along an axis that the motion of the whole gives to the particles i to i + count."""
    row, n, a, b = flat(x), x.shape[1], (axis + 1) % 3, (axis + 2) % 3
    arm_a = masked_load(row, a * n + i, count) - motion[CENTRE + a]
    arm_b = masked_load(row, b * n + i, count) - motion[CENTRE + b]
    return motion[VELOCITY + axis] + (motion[RATE + a] * arm_b - motion[RATE + b] * arm_a)


@strict
def kinetic_apart(masses, x, v, motion):
    """Return the kinetic energy of velocities (3, n) relative to the motion of the whole."""
    row, n, total = flat(v), v.shape[1], splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        squares = splat(0.0)
        for axis in range(3):
            some = masked_load(row, axis * n + i, count) - carried(x, motion, axis, i, count)
            squares = squares + some * some
        total = total + masked_load(masses, i, count) * squares
    return 0.5 * lane_sum(total)


@strict
def find_turn(masses, x, v, motion, total):
    """Fill the centre and the rotation into a motion with its velocity; return the energy of the rotation."""
    n = v.shape[1]
    first, second, third = moments(masses, x)
    motion[CENTRE], motion[CENTRE + 1], motion[CENTRE + 2] = first / total, second / total, third / total
    sx = sy = sz = xx = yy = zz = xy = xz = yz = 0.0
    for i in range(n):
        m, x0, x1, x2 = masses[i], x[0, i] - motion[CENTRE], x[1, i] - motion[CENTRE + 1], x[2, i] - motion[CENTRE + 2]
        v0, v1, v2 = v[0, i] - motion[0], v[1, i] - motion[1], v[2, i] - motion[2]
        sx += m * (x1 * v2 - x2 * v1)
        sy += m * (x2 * v0 - x0 * v2)
        sz += m * (x0 * v1 - x1 * v0)
        xx += m * (x1 * x1 + x2 * x2)
        yy += m * (x0 * x0 + x2 * x2)
        zz += m * (x0 * x0 + x1 * x1)
        xy -= m * x0 * x1
        xz -= m * x0 * x2
        yz -= m * x1 * x2
    trace = xx + yy + zz
    if not trace > 0.0:
        return 0.0
    small = BARELY * trace
    a, b, c = (xx + small) / trace, (yy + small) / trace, (zz + small) / trace
    d, e, f = xy / trace, xz / trace, yz / trace
    aa, bb, cc = b * c - f * f, a * c - e * e, a * b - d * d
    dd, ee, ff = e * f - d * c, d * f - e * b, d * e - a * f
    whole = (a * aa + d * dd + e * ee) * trace
    motion[RATE] = (aa * sx + dd * sy + ee * sz) / whole
    motion[RATE + 1] = (dd * sx + bb * sy + ff * sz) / whole
    motion[RATE + 2] = (ee * sx + ff * sy + cc * sz) / whole
    return 0.5 * (motion[RATE] * sx + motion[RATE + 1] * sy + motion[RATE + 2] * sz)


@strict
def heat_of(masses, total, x, v, apart, motion, energy, momentum):
    """Return the heat of particles with this ``total`` mass, kinetic ``energy`` and ``momentum``, and fill the motion
    of the whole; zeros if there is none, or none that shows."""
    for k in range(MOTION):
        motion[k] = 0.0
    if apart == NONE or not total > 0.0:
        return energy
    first, second, third = momentum
    motion[VELOCITY], motion[VELOCITY + 1], motion[VELOCITY + 2] = first / total, second / total, third / total
    of_whole = 0.5 * (first * first + second * second + third * third) / total
    if apart == TURN:
        of_whole += find_turn(masses, x, v, motion, total)
    if energy - of_whole == energy:
        for k in range(MOTION):
            motion[k] = 0.0
        return energy
    return kinetic_apart(masses, x, v, motion)


@strict
def moves(motion):
    """Tell whether a motion of the whole shows."""
    shows = False
    for k in range(MOTION):
        shows = shows or motion[k] != 0.0
    return shows


@as_written
def scale(v, axes, factor):
    """v <- factor v, (3, n)."""
    row, n = flat(v), v.shape[1]
    for i in range(0, axes * n, WIDTH):
        count = min(WIDTH, axes * n - i)
        masked_store(row, i, factor * masked_load(row, i, count), count)


@strict
def scale_heat(x, v, axes, motion, factor):
    """Scale velocities (3, n) relative to the motion of the whole, which stays."""
    row, n = flat(v), v.shape[1]
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        for axis in range(axes):
            own = carried(x, motion, axis, i, count)
            some = masked_load(row, axis * n + i, count)
            masked_store(row, axis * n + i, own + factor * (some - own), count)
