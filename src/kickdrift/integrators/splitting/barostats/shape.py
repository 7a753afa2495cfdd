"""A box that changes its shape, in compiled code: strains of its edges, the pressure tensor, and a wanted stress.

A change of shape is a symmetric strain S. Edge vectors h, one a row, become h exp(S), positions x exp(S) and velocities
v exp(-S). Then the frame turns, so that a lies along x and b in the x-y plane again. Nothing but the frame sees this
rotation Q, so the strain is the whole change: h' = h F, x' = x F and v' = v F^-T for F = exp(S) Q^T, lower triangular.

All barostats sample exp(-(K + U + P V + H) / k_B T) V dm for the edge vectors h. The measure dm = dh / V^d is that of
the general linear group, which favours no frame, no basis of the lattice and no shape. For a box that keeps its shape
V dm is dV. With it the mean of the pressure tensor is the wanted one, for each component (Martyna, Tobias & Klein 1994,
J. Chem. Phys. 101, 4177, doi:10.1063/1.467468, whose measure dh V^(1 - d) is V dm).

H is the work against a stress that is wanted beside the pressure, of Parrinello & Rahman 1981, J. Appl. Phys. 52, 7182,
doi:10.1063/1.328693: H = -V0 tr(s E), with E = (G G^T - 1) / 2 for G = h0^-1 h and reference edges h0 of volume V0. Its
stress is (V0 / V) G^T s G, so it is s where the box is the reference.

Molecules with constraints keep their shape: F moves their centres, and Q^T turns them with the frame. Their pressure
tensor is that of the centres, and its symmetric part counts.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import types

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.splitting.barostats.piston import (
    STOPPED,
    TOO_SHORT,
    TOO_STRAINED,
    TOO_TILTED,
    Piston,
    volume,
)
from kickdrift.integrators.splitting.baths.bath import heat_now
from kickdrift.jit.compile import as_written, strict
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import lane_sum, splat
from kickdrift.jit.lanes.memory import flat, masked_load, masked_store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.looks.centres import add_tensor_within, turn_within
from kickdrift.model.box.cell import put_edges
from kickdrift.model.state import Floats

LARGEST = 0.2  # norm of a strain at once; lists know a change of edges from it, see `lists.load.alike`
TERMS = 20  # of the series of exp(S), which then has all digits
KEPT, NEW, STRAIN, FOUND, WANTED, EDGES, GROWN, TURN = range(8)  # matrices of a Shape
BEGUN, START = 0, 1  # numbers of a Shape


class Shape(NamedTuple):
    """A box that changes its shape."""

    piston: Piston
    least: float  # height that the forces allow
    keeps: bool  # whether a force is tied to these edges, so that others of the same lattice are not taken
    stress: Floats  # (3, 3) wanted beside the pressure; positive pulls
    reference: Floats  # (6,) edges h0, in the order of a live box
    state: Floats  # (3, 3) what the barostat keeps: velocities of the strain, or a part of the next strain
    notes: Floats  # (2,)
    room: Floats  # (8, 3, 3)


def shape_of(piston: Piston, least: float, keeps: bool, stress: Floats) -> Shape:
    """A box at rest, whose reference is the box of now."""
    rooms = np.zeros((3, 3)), np.zeros(2), np.zeros((8, 3, 3))
    return Shape(piston, least, keeps, stress, piston.lengths.copy(), *rooms)


# --- matrices (3, 3) ---


@strict
def multiply(a, b, found):
    """found <- a b."""
    for i in range(3):
        for j in range(3):
            found[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@strict
def multiply_transposed(a, b, found):
    """found <- a b^T."""
    for i in range(3):
        for j in range(3):
            found[i, j] = a[i, 0] * b[j, 0] + a[i, 1] * b[j, 1] + a[i, 2] * b[j, 2]


@strict
def norm(a):
    """Root of the sum of squares."""
    total = 0.0
    for i in range(3):
        for j in range(3):
            total += a[i, j] * a[i, j]
    return math.sqrt(total)


@strict
def exponential(s, found):
    """found <- exp(s) of a matrix with components of one or less, by the series."""
    term, further = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            term[i, j] = found[i, j] = 1.0 if i == j else 0.0
    for n in range(1, TERMS):
        multiply(term, s, further)
        for i in range(3):
            for j in range(3):
                term[i, j] = further[i, j] / n
                found[i, j] += term[i, j]


@strict
def turn_tensor(q, a):
    """a <- q a q^T: the tensor a in the frame whose axes are the rows of q."""
    half = np.empty((3, 3))
    multiply(q, a, half)
    multiply_transposed(half, q, a)


@strict
def inverse_of(h, found):
    """found <- inverse of lower triangular edge vectors."""
    for k in range(3):
        for m in range(3):
            found[k, m] = 1.0 / h[k, k] if k == m else 0.0
    found[1, 0] = -h[1, 0] * found[0, 0] * found[1, 1]
    found[2, 1] = -h[2, 1] * found[1, 1] * found[2, 2]
    found[2, 0] = -(h[2, 0] * found[0, 0] + h[2, 1] * found[1, 0]) * found[2, 2]


@strict
def rows_of(numbers, h):
    """h <- edge vectors of a live box (6,); in a plane the third is a unit vector."""
    put_edges(numbers, h)
    if h[2, 2] == 0.0:
        h[2, 2] = 1.0


# --- pressure and stress ---


@as_written
def sum_across(masses, v, a, b, still_a, still_b):
    """Return twice the kinetic energy across two axes, of velocities (3, n) less ``still``."""
    row, n, total = flat(v), v.shape[1], splat(0.0)
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        one, other = masked_load(row, a * n + i, count) - still_a, masked_load(row, b * n + i, count) - still_b
        total = total + masked_load(masses, i, count) * (one * other)
    return lane_sum(total)


@strict
def virial_of(piston, a, b):
    """Virial of the last evaluation across two axes."""
    total, trace, side = 0.0, 0.0, 3 - a - b  # the slot of xy is that of z, and so on
    for c in range(piston.along.shape[0]):
        total += piston.along[c, 0, a] if a == b else piston.along[c, 1, side]
        trace += piston.along[c, 0, 0] + piston.along[c, 0, 1] + piston.along[c, 0, 2]
    if a == b:  # tail corrections are the same along all axes
        total += (piston.sums[1] - trace) / piston.bath.axes
    return total


@strict
def pressure_tensor(shape, x, v):
    """Fill FOUND with the pressure tensor of velocities (3, n), and return the heat that acts on the box: without the
    motion within molecules."""
    piston = shape.piston
    bath, found, v_now = piston.bath, shape.room[FOUND], volume(piston)
    heat, still = heat_now(bath, x, v), bath.motion
    for a in range(bath.axes):
        for b in range(a, bath.axes):
            across = sum_across(bath.masses, v, a, b, still[a], still[b])
            found[a, b] = found[b, a] = (across + virial_of(piston, a, b)) / v_now
    return heat - add_tensor_of_motion_within(piston.molecules, piston, x, v, found)


@by_type
def add_tensor_of_motion_within(molecules, piston, x, v, found):
    """Make the pressure tensor ``found`` that of the centres of molecules. Return the kinetic energy within these."""
    if isinstance(molecules, types.NoneType):
        return lambda molecules, piston, x, v, found: 0.0

    def each(molecules, piston, x, v, found):
        within = np.zeros((3, 3))
        heat = 0.5 * add_tensor_within(molecules, piston.bath.masses, x, v, piston.felt, within)
        v_now = volume(piston)
        for a in range(piston.bath.axes):
            for b in range(piston.bath.axes):
                found[a, b] += within[a, b] / v_now
        return heat

    return each


@strict
def wanted_pressure(shape):
    """Fill WANTED with the pressure tensor that the box of now is to have: P - (V0 / V) G^T s G."""
    piston, wanted = shape.piston, shape.room[WANTED]
    growth, half = np.empty((3, 3)), np.empty((3, 3))
    ratio = grown(shape, growth) / volume(piston)
    multiply(shape.stress, growth, half)
    for i in range(3):
        for j in range(3):
            pull = growth[0, i] * half[0, j] + growth[1, i] * half[1, j] + growth[2, i] * half[2, j]
            wanted[i, j] = (piston.pressure if i == j else 0.0) - ratio * pull


@strict
def grown(shape, growth):
    """growth <- G = h0^-1 h; return the volume of the reference."""
    h, inverse = np.empty((3, 3)), np.empty((3, 3))
    rows_of(shape.reference, h)
    first = h[0, 0] * h[1, 1] * h[2, 2]
    inverse_of(h, inverse)
    rows_of(shape.piston.lengths, h)
    multiply(inverse, h, growth)
    return first


@strict
def box_energy(shape):
    """P V and the work against the wanted stress, H."""
    growth, square = np.empty((3, 3)), np.empty((3, 3))
    first = grown(shape, growth)
    multiply_transposed(growth, growth, square)
    total = shape.piston.pressure * volume(shape.piston)
    for i in range(3):
        for j in range(3):
            total -= 0.5 * first * shape.stress[i, j] * (square[i, j] - (1.0 if i == j else 0.0))
    return total


# --- strains ---


@strict
def strain(shape, x, v):
    """Change the box by the symmetric STRAIN, with positions and, unless v is None, velocities. Fill TURN with the
    rotation of the frame, in which tensors of the barostat must turn too.

    Return a status: nothing changes if the box would be too narrow, or change too much at once."""
    piston, s, h, turn = shape.piston, shape.room[STRAIN], shape.room[EDGES], shape.room[TURN]
    if not norm(s) <= LARGEST:
        piston.trouble[0], piston.trouble[1] = TOO_STRAINED, norm(s)
        return STOPPED
    grow, new, inverse, f = np.empty((3, 3)), shape.room[GROWN], np.empty((3, 3)), np.empty((3, 3))
    rows_of(piston.lengths, h)
    inverse_of(h, inverse)
    exponential(s, grow)
    multiply(h, grow, new)
    triangle(new, turn)
    if too_narrow(shape, new):
        return STOPPED
    multiply(inverse, new, f)
    if v is not None:
        heat_now(piston.bath, x, v)
        inverse_of(f, inverse)
        deform_velocities(v, inverse, piston.bath.motion)
    deform_positions(x, f)
    turn_molecules(piston.molecules, piston, x, v, f, turn)
    keep_edges(new, piston.lengths)
    return 0


@by_type
def turn_molecules(molecules, piston, x, v, f, turn):
    """Give molecules their shape back after a change x f of positions and v f^-T of velocities, and turn them and the
    motion within them with the frame; v may be None."""
    if isinstance(molecules, types.NoneType):
        return lambda molecules, piston, x, v, f, turn: None

    def each(molecules, piston, x, v, f, turn):
        inverse, whole = np.empty((3, 3)), np.empty((3, 3))
        inverse_of(f, inverse)
        multiply_transposed(inverse, turn, whole)  # f^-1 Q^T
        turn_within(molecules, piston.bath.masses, x, whole)
        if v is not None:
            for i in range(3):
                for j in range(3):
                    inverse[i, j] = f[j, i]
            multiply_transposed(inverse, turn, whole)  # f^T Q^T
            turn_within(molecules, piston.bath.masses, v, whole)

    return each


@by_type
def turn_motion(molecules, piston, v, turn):
    """Turn the motion within molecules, whose places the frame of a move has turned; the centres move as before."""
    if isinstance(molecules, types.NoneType):
        return lambda molecules, piston, v, turn: None

    def each(molecules, piston, v, turn):
        turned = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                turned[i, j] = turn[j, i]
        turn_within(molecules, piston.bath.masses, v, turned)

    return each


@strict
def triangle(rows, turn):
    """rows <- the lower triangle L of rows = L Q, with a positive diagonal; turn <- the rotation Q."""
    a, b = rows[0], rows[1]
    x = math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])
    for k in range(3):
        turn[0, k] = a[k] / x
    bx = b[0] * turn[0, 0] + b[1] * turn[0, 1] + b[2] * turn[0, 2]
    for k in range(3):
        turn[1, k] = b[k] - bx * turn[0, k]
    by = math.sqrt(turn[1, 0] ** 2 + turn[1, 1] ** 2 + turn[1, 2] ** 2)
    for k in range(3):
        turn[1, k] /= by
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        turn[2, k] = turn[0, i] * turn[1, j] - turn[0, j] * turn[1, i]
    c = np.empty(3)
    for k in range(3):
        c[k] = rows[2, 0] * turn[k, 0] + rows[2, 1] * turn[k, 1] + rows[2, 2] * turn[k, 2]
    rows[0, 0], rows[1, 0], rows[1, 1] = x, bx, by
    rows[2, 0], rows[2, 1], rows[2, 2] = c[0], c[1], c[2]
    rows[0, 1] = rows[0, 2] = rows[1, 2] = 0.0


@strict
def too_narrow(shape, h):
    """Tell whether the box is less high between two faces than the forces allow, and note the trouble then."""
    inverse = np.empty((3, 3))
    inverse_of(h, inverse)
    for k in range(shape.piston.bath.axes):
        height = 1.0 / math.sqrt(inverse[0, k] ** 2 + inverse[1, k] ** 2 + inverse[2, k] ** 2)
        if not height >= shape.least:
            trouble = shape.piston.trouble
            trouble[0], trouble[1], trouble[2] = TOO_SHORT, k, height
            return True
    return False


@strict
def keep_edges(h, numbers):
    """Write edge vectors to a live box (6,). The third edge of a plane stays zero."""
    flat_box = numbers[2] == 0.0
    numbers[0], numbers[1], numbers[5] = h[0, 0], h[1, 1], h[1, 0]
    if not flat_box:
        numbers[2], numbers[3], numbers[4] = h[2, 2], h[2, 1], h[2, 0]


@as_written
def deform_positions(x, f):
    """x <- x f for a lower triangular f (3, 3) and x (3, n)."""
    row, n = flat(x), x.shape[1]
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        a, b, c = masked_load(row, i, count), masked_load(row, n + i, count), masked_load(row, 2 * n + i, count)
        masked_store(row, i, f[0, 0] * a + f[1, 0] * b + f[2, 0] * c, count)
        masked_store(row, n + i, f[1, 1] * b + f[2, 1] * c, count)
        masked_store(row, 2 * n + i, f[2, 2] * c, count)


@as_written
def deform_velocities(v, f, still):
    """v <- still + (v - still) f^T for a lower triangular f (3, 3) and v (3, n)."""
    row, n = flat(v), v.shape[1]
    for i in range(0, n, WIDTH):
        count = min(WIDTH, n - i)
        a, b = masked_load(row, i, count) - still[0], masked_load(row, n + i, count) - still[1]
        c = masked_load(row, 2 * n + i, count) - still[2]
        masked_store(row, i, still[0] + f[0, 0] * a, count)
        masked_store(row, n + i, still[1] + (f[1, 0] * a + f[1, 1] * b), count)
        masked_store(row, 2 * n + i, still[2] + (f[2, 0] * a + f[2, 1] * b + f[2, 2] * c), count)


@strict
def choose_edges(shape):
    """Replace edges that lean by more than half an edge by other edges of the same lattice, in the reference too.
    Return a status: STOPPED if a force is tied to the edges of now.

    No particle moves, since positions do not depend on the choice of edges."""
    now, first = shape.room[EDGES], shape.room[GROWN]
    rows_of(shape.piston.lengths, now)
    rows_of(shape.reference, first)
    changed = False
    for k, m in ((2, 1), (2, 0), (1, 0)):
        if abs(now[k, m]) > 0.5 * now[m, m]:
            if shape.keeps:
                trouble = shape.piston.trouble
                trouble[0], trouble[1], trouble[2] = TOO_TILTED, 3 - k - m, now[k, m] / now[m, m]
                return STOPPED
            count = np.rint(now[k, m] / now[m, m])
            for j in range(m + 1):
                now[k, j] -= count * now[m, j]
                first[k, j] -= count * first[m, j]
            changed = True
    if changed:
        keep_edges(now, shape.piston.lengths)
        keep_edges(first, shape.reference)
    return OK
