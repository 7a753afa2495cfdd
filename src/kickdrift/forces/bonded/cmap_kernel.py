"""Compiled sum of CMAP's energies. It runs on one thread, so every sum has a fixed order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bonded.kernel import BLOCK, dihedral_pulls, fill_separations, note_along, planes, prepare
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.jit.compile import inlined, never_inline
from kickdrift.model.box.cell import Cell, cell_of
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

TURN = 2.0 * math.pi


class CmapKernel(NamedTuple):
    """CMAP, bound to a System."""

    patches: NDArray[np.float64]  # (patches of all maps, 16)
    first: NDArray[np.int64]  # (m,) first patch of each term's map
    size: NDArray[np.int64]  # (m,) points along an angle of each term's map
    items: NDArray[np.int64]  # (m, 8) particles
    cell: Cell
    longest2: NDArray[np.float64]  # as for other bonded forces; infinite
    inverse_masses: NDArray[np.float64]  # (n,)
    room: NDArray[np.float64]  # (18, BLOCK)
    along: Any = None  # virial of one chunk, for a barostat; see `lists.along`


def bind(force: Any, system: Subject) -> CmapKernel:
    """Bind a `Cmap` to a System."""
    sizes = np.array([len(each) for each in force.maps])
    begins = np.concatenate(([0], np.cumsum(sizes**2)))
    which = np.broadcast_to(force.map, len(force.chains))
    masses = system.coherent_masses
    return CmapKernel(
        patches=np.concatenate([patches(each) for each in force.maps]),
        first=begins[which],
        size=sizes[which],
        items=force.particles,
        cell=cell_of(system.box),
        longest2=np.array([np.inf]),
        inverse_masses=np.divide(1.0, masses, where=masses > 0, out=0.0 * masses),
        room=np.zeros((18, BLOCK)),
    )


def patches(energies: Sequence[Sequence[float]]) -> Floats:
    """Coefficients (n * n, 16) of the periodic bicubic spline through a map (n, n), one row for each patch.

    Within a patch, U is the sum of c[4 a + b] t^a w^b, where t and w run from 0 to 1 along phi and psi."""
    from scipy.interpolate import CubicSpline

    closed = np.pad(np.array(energies, dtype=float), (0, 1), mode="wrap")
    at = np.arange(len(closed), dtype=float)
    along_phi = CubicSpline(at, closed, axis=0, bc_type="periodic").c[::-1]  # (a, n, n + 1)
    both = CubicSpline(at, along_phi, axis=2, bc_type="periodic").c[::-1]  # (b, n of psi, a, n of phi)
    n = len(at) - 1
    return np.ascontiguousarray(both.transpose(3, 1, 2, 0)).reshape(n * n, 16)


@kernel(CmapKernel)
def cmap_forces(force, t, x, v, a, sums):
    """Two dihedrals for each term. Dihedrals do not change with the size of the system, so the virial is zero."""
    never_inline()
    prepare(force, sums)
    items, room = force.items, force.room
    energies = 0.0
    for begin in range(0, items.shape[0], BLOCK):
        count = min(BLOCK, items.shape[0] - begin)
        for half in range(2):
            one, row = 4 * half, 9 * half
            fill_separations(force, room, x, begin, count, one, one + 1, row)
            fill_separations(force, room, x, begin, count, one + 1, one + 2, row + 3)
            fill_separations(force, room, x, begin, count, one + 3, one + 2, row + 6)
        for k in range(count):
            item = begin + k
            first, second = sides(room, 0, k), sides(room, 9, k)
            phi, psi = planes(first[0], first[1], first[2]), planes(second[0], second[1], second[2])
            energy, slope, other = on_map(force.patches, force.first[item], force.size[item], phi[5], psi[5])
            push(force, a, sums, item, 0, first, dihedral_pulls(slope, first[0], first[1], first[2], phi))
            push(force, a, sums, item, 4, second, dihedral_pulls(other, second[0], second[1], second[2], psi))
            energies += energy
    if sums is not None:
        sums[0] += energies
    return OK


@inlined
def sides(room, row, k):
    """The three separations of a dihedral."""
    return (
        (room[row, k], room[row + 1, k], room[row + 2, k]),
        (room[row + 3, k], room[row + 4, k], room[row + 5, k]),
        (room[row + 6, k], room[row + 7, k], room[row + 8, k]),
    )


@inlined
def on_map(patches, first, size, phi, psi):
    """Energy of a map at two angles, and its slopes by both; nan where an angle is no number."""
    scale = size / TURN
    u, w = phi * scale, psi * scale
    u, w = u + size if u < 0.0 else u, w + size if w < 0.0 else w
    if not (0.0 <= u <= size and 0.0 <= w <= size):
        return math.nan, math.nan, math.nan
    i, j = min(int(u), size - 1), min(int(w), size - 1)
    u, w, at = u - i, w - j, first + i * size + j
    energy = by_u = by_w = 0.0
    for k in range(3, -1, -1):
        c0, c1, c2, c3 = patches[at, 4 * k], patches[at, 4 * k + 1], patches[at, 4 * k + 2], patches[at, 4 * k + 3]
        by_u = by_u * u + energy
        energy = energy * u + (c0 + w * (c1 + w * (c2 + w * c3)))
        by_w = by_w * u + (c1 + w * (2.0 * c2 + w * 3.0 * c3))
    return energy, by_u * scale, by_w * scale


@inlined
def push(force, a, sums, item, at, three, pulls):
    """Add the accelerations of one dihedral, whose particles stand from column ``at`` on."""
    i, j, m, o = (
        force.items[item, at], force.items[item, at + 1], force.items[item, at + 2], force.items[item, at + 3]
    )  # fmt: skip
    first, last, inner = pulls
    for axis in range(3):
        a[axis, i] -= first[axis] * force.inverse_masses[i]
        a[axis, j] -= (inner[axis] - first[axis]) * force.inverse_masses[j]
        a[axis, m] += (inner[axis] + last[axis]) * force.inverse_masses[m]
        a[axis, o] -= last[axis] * force.inverse_masses[o]
        if sums is not None:
            note_along(force.along, axis, first[axis], three[0])
            note_along(force.along, axis, inner[axis], three[1])
            note_along(force.along, axis, last[axis], three[2])
