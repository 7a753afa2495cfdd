"""Compiled sums over listed bonds, angles, dihedrals and impropers, of any law. Their cost is linear in the list.

They run on one thread, so every sum has a fixed order. Items go in blocks: separations and laws of a whole block first,
in loops that LLVM turns into SIMD where the law has no functions beside square roots, then the forces one by one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.lists.along import ALL
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.jit.compile import as_written, inlined, never_inline
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.memory import named_numbers
from kickdrift.model.box.cell import Cell, along, cell_of, follow, leaning_image, least_height
from kickdrift.model.molecules.relatives import LONGEST

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

BLOCK = 64  # items at once


class Listed(NamedTuple):
    """A law on listed items, bound to a System."""

    law: Any  # NamedTuple of the law's parameters, for the first type
    table: Any  # None for one type, else (types, parameters)
    which: NDArray[np.int64]  # (m,) type of each item
    items: NDArray[np.int64]  # (m, 2 to 4) particles
    cell: Cell
    longest2: NDArray[np.float64]  # (1,) squared length from which a bond's nearest image is uncertain, or infinity
    inverse_masses: NDArray[np.float64]  # (n,)
    room: NDArray[np.float64]  # (numbers of an item, BLOCK)
    along: Any = None  # virial of one chunk, for a barostat; see `lists.along`


class BondKernel(Listed):
    """A law of bonds."""

    __slots__ = ()


class AngleKernel(Listed):
    """A law of angles."""

    __slots__ = ()


class DihedralKernel(Listed):
    """A law of dihedrals, or of impropers: both are the angle between two planes."""

    __slots__ = ()


KERNELS = {"bonds": BondKernel, "angles": AngleKernel, "dihedrals": DihedralKernel, "impropers": DihedralKernel}
ROOM = {"bonds": 5, "angles": 11, "dihedrals": 16, "impropers": 16}  # numbers of an item


class BondedPotential(Protocol):
    """A bonded force as its compiled code needs it; see ``BondedForce`` and ``Springs``."""

    kind: ClassVar[str]
    limited: ClassVar[bool]  # whether a bond has no value where its nearest image is uncertain
    Parameters: ClassVar[Any]

    def items(self, system: Subject) -> tuple[NDArray[np.int64], list[Any], NDArray[np.int64]]:
        """Return the listed particles, the laws of the types, and the law of each item."""


def bind(force: BondedPotential, system: Subject) -> Any:
    """Bind a bonded force to a System."""
    cls = force.Parameters
    if "compiled_law" not in vars(cls):
        cls.compiled_law = cls.own_code() if hasattr(cls, "own_code") else as_written(cls.law)
    items, laws, which = force.items(system)
    table = np.array([tuple(map(float, law)) for law in laws])
    masses = system.coherent_masses
    return KERNELS[force.kind](
        law=cls(*table[0].tolist()),
        table=table if len(laws) > 1 else None,
        which=which,
        items=np.ascontiguousarray(items).copy(),
        cell=cell_of(system.box),
        longest2=np.array([(LONGEST * system.box.narrowest[1]) ** 2 if force.limited else np.inf]),
        inverse_masses=np.divide(1.0, masses, where=masses > 0, out=0.0 * masses),
        room=np.zeros((ROOM[force.kind], BLOCK)),
    )


@by_type(forceinline=True)
def law_of(law, table, which, item):
    """Return the parameters of the law of an item."""
    if isinstance(table, types.NoneType):
        return lambda law, table, which, item: law
    return lambda law, table, which, item: named_numbers(law, table, which[item])


@by_type(forceinline=True)
def energy_and_slope(law, value):
    """Return the energy and the slope of a law."""
    compiled = law.instance_class.compiled_law

    def terms(law, value):
        energy, slope = compiled(law, value)
        return 1.0 * energy, 1.0 * slope

    return terms


@by_type(forceinline=True)
def room_for(room, x):
    """Room for the numbers of a block: the force's own, or for positions that are duals room for duals."""
    if x.dtype == types.float64:
        return lambda room, x: room
    return lambda room, x: np.empty(room.shape, x.dtype)


@inlined
def prepare(listed, sums):
    """Begin an evaluation: follow a box that has changed, and clear the virial along each axis."""
    if follow(listed.cell) and listed.longest2[0] < math.inf:
        listed.longest2[0] = (LONGEST * least_height(listed.cell.matrix)) ** 2
    if sums is not None:
        clear_along(listed.along)


@inlined
def clear_along(along):
    """Set the virial along each axis to zero, if it is asked."""
    if along is not None:
        along[:] = 0.0


@by_type(forceinline=True)
def note_along(along, axis, pull, d):
    """Subtract a pull along an axis times the displacement d (3,) from the virial, if it is asked."""
    if isinstance(along, types.NoneType):
        return lambda along, axis, pull, d: None
    if along.ndim == ALL:

        def note_all(along, axis, pull, d):
            along[0, 0, axis] -= pull * d[axis]
            if axis == 0:
                along[0, 1, 1] -= pull * d[2]
                along[0, 1, 2] -= pull * d[1]
            elif axis == 1:
                along[0, 1, 0] -= pull * d[2]

        return note_all

    def note(along, axis, pull, d):
        along[0, axis] -= pull * d[axis]

    return note


@inlined
def fill_separations(listed, room, x, begin, count, a, b, row):
    """room[row : row + 3] <- separations between nearest images from particle b to particle a of each item."""
    items, edges = listed.items, listed.cell.edges
    for k in range(count):
        i, j = items[begin + k, a], items[begin + k, b]
        for axis in range(3):
            room[row + axis, k] = x[axis, i] - x[axis, j]
    if listed.cell.leans:
        d = np.empty(3, x.dtype)
        for k in range(count):
            for axis in range(3):
                d[axis] = room[row + axis, k]
            leaning_image(listed.cell, d)
            for axis in range(3):
                room[row + axis, k] = d[axis]
    else:
        for axis in range(3):
            edge = edges[axis]
            if edge > 0.0:
                for k in range(count):
                    room[row + axis, k] = along(edge, room[row + axis, k])


@kernel(BondKernel)
def bond_forces(force, t, x, v, a, sums):
    never_inline()
    prepare(force, sums)
    items, room, inverse_masses = force.items, room_for(force.room, x), force.inverse_masses
    longest2 = force.longest2[0]
    energies = virial = 0.0
    for begin in range(0, items.shape[0], BLOCK):
        count = min(BLOCK, items.shape[0] - begin)
        fill_separations(force, room, x, begin, count, 0, 1, 0)
        for k in range(count):
            dx, dy, dz = room[0, k], room[1, k], room[2, k]
            r2 = dx * dx + dy * dy + dz * dz
            r = math.sqrt(r2)
            energy, slope = energy_and_slope(law_of(force.law, force.table, force.which, begin + k), r)
            slope = slope if r2 < longest2 else math.nan
            room[3, k] = slope / r if r > 0.0 else 0.0  # a bond of length 0 has no direction, so no force
            if sums is not None:
                room[4, k] = energy
                virial -= slope * r
        for k in range(count):
            i, j, over_r = items[begin + k, 0], items[begin + k, 1], room[3, k]
            for axis in range(3):
                pull = over_r * room[axis, k]
                a[axis, i] -= pull * inverse_masses[i]
                a[axis, j] += pull * inverse_masses[j]
                if sums is not None:
                    note_along(force.along, axis, pull, (room[0, k], room[1, k], room[2, k]))
            if sums is not None:
                energies += room[4, k]
    if sums is not None:
        sums[0] += energies
        sums[1] += virial
        sums[2] += items.shape[0]
    return OK


@kernel(AngleKernel)
def angle_forces(force, t, x, v, a, sums):
    """The gradients of the angle at particle j are d1 x n / (d1^2 |n|) and n x d2 / (d2^2 |n|), with n = d1 x d2.

    An angle does not change with the size of the system, so its virial is zero."""
    never_inline()
    prepare(force, sums)
    items, room, inverse_masses = force.items, room_for(force.room, x), force.inverse_masses
    energies = 0.0
    for begin in range(0, items.shape[0], BLOCK):
        count = min(BLOCK, items.shape[0] - begin)
        fill_separations(force, room, x, begin, count, 0, 1, 0)
        fill_separations(force, room, x, begin, count, 2, 1, 3)
        for k in range(count):
            d, e = (room[0, k], room[1, k], room[2, k]), (room[3, k], room[4, k], room[5, k])
            n = cross(d, e)
            d2, e2, n1 = dot(d, d), dot(e, e), math.sqrt(dot(n, n))
            law = law_of(force.law, force.table, force.which, begin + k)
            energy, slope = energy_and_slope(law, math.atan2(n1, dot(d, e)))
            one = slope / (d2 * n1) if n1 > 0.0 else 0.0  # in a line, the angle has no direction, so no force
            two = slope / (e2 * n1) if n1 > 0.0 else 0.0
            first, last = cross(d, n), cross(n, e)
            for axis in range(3):
                room[axis, k], room[3 + axis, k] = one * first[axis], two * last[axis]
                if sums is not None:
                    note_along(force.along, axis, room[axis, k], d)
                    note_along(force.along, axis, room[3 + axis, k], e)
            if sums is not None:
                energies += energy
        for k in range(count):
            i, j, m = items[begin + k, 0], items[begin + k, 1], items[begin + k, 2]
            for axis in range(3):
                first_pull, last_pull = room[axis, k], room[3 + axis, k]
                a[axis, i] -= first_pull * inverse_masses[i]
                a[axis, j] += (first_pull + last_pull) * inverse_masses[j]
                a[axis, m] -= last_pull * inverse_masses[m]
    if sums is not None:
        sums[0] += energies
    return OK


@kernel(DihedralKernel)
def dihedral_forces(force, t, x, v, a, sums):
    """A dihedral does not change with the size of the system, so its virial is zero."""
    never_inline()
    prepare(force, sums)
    items, room, inverse_masses = force.items, room_for(force.room, x), force.inverse_masses
    energies = 0.0
    for begin in range(0, items.shape[0], BLOCK):
        count = min(BLOCK, items.shape[0] - begin)
        fill_separations(force, room, x, begin, count, 0, 1, 0)
        fill_separations(force, room, x, begin, count, 1, 2, 3)
        fill_separations(force, room, x, begin, count, 3, 2, 6)
        for k in range(count):
            f, g, h = (room[0, k], room[1, k], room[2, k]), (room[3, k], room[4, k], room[5, k]), (
                room[6, k], room[7, k], room[8, k]
            )  # fmt: skip
            turned = planes(f, g, h)
            energy, slope = energy_and_slope(law_of(force.law, force.table, force.which, begin + k), turned[5])
            first, last, inner = dihedral_pulls(slope, f, g, h, turned)
            for axis in range(3):
                room[axis, k], room[3 + axis, k], room[6 + axis, k] = first[axis], last[axis], inner[axis]
                if sums is not None:
                    note_along(force.along, axis, room[axis, k], f)
                    note_along(force.along, axis, room[6 + axis, k], g)
                    note_along(force.along, axis, room[3 + axis, k], h)
            if sums is not None:
                energies += energy
        for k in range(count):
            i, j, m, o = items[begin + k, 0], items[begin + k, 1], items[begin + k, 2], items[begin + k, 3]
            for axis in range(3):
                one, two, mixed = room[axis, k], room[3 + axis, k], room[6 + axis, k]
                a[axis, i] -= one * inverse_masses[i]
                a[axis, j] -= (mixed - one) * inverse_masses[j]
                a[axis, m] += (mixed + two) * inverse_masses[m]
                a[axis, o] -= two * inverse_masses[o]
    if sums is not None:
        sums[0] += energies
    return OK


@inlined
def planes(f, g, h):
    """The normals p and q of a dihedral's two planes, their squares, the length of its axis, and its angle."""
    p, q = cross(f, g), cross(h, g)
    p2, q2, g1 = dot(p, p), dot(q, q), math.sqrt(dot(g, g))
    return p, q, p2, q2, g1, math.atan2(-dot(q, f) * g1, dot(p, q))


@inlined
def dihedral_pulls(slope, f, g, h, turned):
    """Gradients of a dihedral's energy by its first and its last particle, and the part that its inner two share.

    Blondel & Karplus 1996, doi:10.1002/(SICI)1096-987X(19960715)17:9<1132::AID-JCC5>3.0.CO;2-T, eq. 27, with their F,
    G, H, A and B."""
    p, q, p2, q2, g1, _ = turned
    straight = not (p2 > 0.0 and q2 > 0.0)  # three in a line: the dihedral has no direction, so no force
    one = 0.0 if straight else slope * g1 / p2
    two = 0.0 if straight else slope * g1 / q2
    mixed = 0.0 if straight else slope * dot(f, g) / (p2 * g1)
    other = 0.0 if straight else slope * dot(h, g) / (q2 * g1)
    first, last = (-one * p[0], -one * p[1], -one * p[2]), (two * q[0], two * q[1], two * q[2])
    inner = (
        mixed * p[0] - other * q[0], mixed * p[1] - other * q[1], mixed * p[2] - other * q[2]
    )  # fmt: skip
    return first, last, inner


@inlined
def cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
