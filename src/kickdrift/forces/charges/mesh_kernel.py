"""Smooth particle-mesh Ewald (Essmann et al. 1995, doi:10.1063/1.470117): Ewald's far part on a mesh.

B-splines spread the charges over the mesh (`mesh_ions`). Fourier transforms of its planes (`mesh_planes`) and the
influence of the charges (`mesh_waves`) follow. Then the splines' slopes give the forces.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.bonded.kernel import clear_along
from kickdrift.forces.charges import mesh_planes as mesh_planes  # tasks of chunks
from kickdrift.forces.charges import mesh_waves as mesh_waves  # likewise
from kickdrift.forces.charges.accuracy import Split
from kickdrift.forces.charges.far_kernel import add_forces, invert, leave_out, note_even, tilts_of
from kickdrift.forces.charges.fourier import POINT, Plan, plan_of
from kickdrift.forces.charges.mesh_ions import COLOUR, WANTED, bring_positions, sort_ions
from kickdrift.forces.charges.splines import column_order, moduli
from kickdrift.forces.lists.clusters import chunk_count
from kickdrift.forces.seam.kernel import FORCES, OK, BoundForce, call_force, kernel
from kickdrift.jit.compile import driver, jit, never_inline, strict
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, each_chunk, in_chunks
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import Cell, cell_of
from kickdrift.model.state import Floats

SHARES = 16  # chunks of the planes, and of the lines across all planes


class Mesh(NamedTuple):
    """Ewald's far part on a mesh, and pairs that the near part leaves out or scales, bound to a System.

    Row (x, y) of the mesh has ``row`` numbers, the last ones a copy of the first. The spectrum of a row has ``half``
    real and ``half`` imaginary parts, and all spectra of a plane x have ``plane`` numbers."""

    alpha: float  # splitting parameter
    alone: float  # energy of the charges with their own clouds
    background: float  # times 1 / volume, the energy of the neutralising background
    charges: NDArray[np.float64]  # (n,) scaled by the root of Coulomb's constant
    inverse_masses: NDArray[np.float64]  # (n,)
    cell: Cell
    tilts: Floats  # (3,) see `far_kernel.tilts_of`
    edges: Floats  # (3, 3) edge vectors of now, see `far_kernel.take_edges`
    inverse: NDArray[np.float64]  # (3, 3) fractional coordinates are positions times this matrix
    pairs: NDArray[np.int64]  # (m, 2) pairs that the near part leaves out or scales
    factors: NDArray[np.float64]  # (m,)
    order: int  # of the splines
    first: Plan  # along x
    second: Plan
    third: Plan
    row: int
    half: int
    plane: int
    first_moduli: Floats  # (x,) squared moduli of the splines' transforms; 0 for a wave that is left out
    second_moduli: Floats  # (y,)
    third_moduli: Floats  # (half,)
    weights: Floats  # (half,) number of waves, of k and -k, for which a number of the spectrum stands
    mesh: Floats  # (x y row,)
    spectrum: Floats  # (x plane,)
    influence: Floats  # (y half x,) potential over density of each wave, in the order of lines along x
    made_for: Floats  # (3, 3) edge vectors at which the influence was made
    place: Floats  # (4, n + WIDTH) mesh coordinates of the ions, and their charges, in sorted order
    unsorted: Floats  # (3, n) mesh coordinates
    home: NDArray[np.int32]  # (n,) column of each ion
    ions: NDArray[np.int64]  # (n,) ions in sorted order
    column: NDArray[np.int32]  # (x y,) number of each column: columns of a block follow one another
    filled: NDArray[np.int64]  # (columns + 1,) ions in front of each column
    blocks: NDArray[np.int64]  # (blocks + 1,) the first column of each block
    colours: NDArray[np.int64]  # (colours + 1,) the first block of each colour
    s: Floats  # (3, n) forces
    own: Floats  # (threads, room)
    sums: Floats  # (1 + chunks, 2) energy and virial of each chunk of lines; the first row is empty
    state: NDArray[np.int64]  # (2,)
    some: Chunks  # of the ions
    planes: Chunks
    lines: Chunks
    coloured: Chunks  # of the blocks of a colour
    along: Any = None  # virial of each chunk of lines, and in the first row of all else; see `lists.along`


def bind(
    alpha: float,
    order: int,
    shape: tuple[int, ...],
    alone: float,
    background: float,
    charges: Floats,
    masses: Floats,
    box: Box,
    special: tuple[NDArray[np.int64], Floats],
    threads: int,
) -> Mesh:
    """Parts for charges and coherent masses (n,), and ``special`` pairs with their factors."""
    n, (nx, ny, nz) = len(charges), shape
    half = WIDTH * (nz // 2 // WIDTH + 1)
    row = WIDTH * -(-nz // WIDTH) + WIDTH
    plane = 2 * half * ny + WIDTH
    column, blocks, colours = column_order(nx, ny, order)
    kept = np.zeros(half)
    kept[: nz // 2] = moduli(nz, order)[: nz // 2]
    weights = np.full(half, 2.0)
    weights[0] = 1.0
    shares = min(SHARES, nx), min(SHARES, ny)
    return Mesh(
        alpha=alpha,
        alone=alone,
        background=background,
        charges=charges,
        inverse_masses=1.0 / masses,
        cell=cell_of(box),
        tilts=tilts_of(box),
        edges=np.zeros((3, 3)),
        inverse=np.zeros((3, 3)),
        pairs=special[0],
        factors=special[1],
        order=order,
        first=plan_of(nx),
        second=plan_of(ny),
        third=plan_of(nz),
        row=row,
        half=half,
        plane=plane,
        first_moduli=moduli(nx, order),
        second_moduli=moduli(ny, order),
        third_moduli=kept,
        weights=weights,
        mesh=aligned((nx * ny * row,)),
        spectrum=aligned((nx * plane,)),
        influence=aligned((nx * ny * half,)),
        made_for=np.zeros((3, 3)),
        place=aligned((4, WIDTH * (-(-n // WIDTH) + 1))),
        unsorted=np.zeros((3, n)),
        home=np.zeros(n, np.int32),
        ions=np.zeros(n, np.int64),
        column=column,
        filled=np.zeros(nx * ny + 1, np.int64),
        blocks=blocks,
        colours=colours,
        s=np.zeros((3, n)),
        own=aligned((threads, 4 * POINT * (max(shape) + WIDTH))),
        sums=np.zeros((1 + shares[1], 2)),
        state=np.zeros(2, np.int64),
        some=in_chunks(4 * chunk_count(n), threads),
        planes=in_chunks(shares[0], threads),
        lines=in_chunks(shares[1], threads),
        coloured=in_chunks(int(colours[1]), threads),
    )


@kernel(Mesh)
def mesh_body(force, t, x, v, a, sums):
    return add_mesh(force, x, a, sums)


@jit
def add_mesh(force, x, a, sums):
    """Add the accelerations (3, n) to a and, unless ``sums`` is None, energy and virial to sums. Return a status."""
    volume = invert(force)
    if has_changed(force):
        each_chunk(force, force.lines, "mesh_influence")
    force.state[WANTED] = 0 if sums is None else 1
    bring_positions(force, x)
    each_chunk(force, force.some, "mesh_places")
    sort_ions(force)
    for colour in range(force.colours.size - 1):
        force.state[COLOUR] = colour
        each_chunk(force, force.coloured, "mesh_spread")
    each_chunk(force, force.planes, "mesh_forward")
    if sums is not None:
        clear_along(force.along)
    each_chunk(force, force.lines, "mesh_lines")
    each_chunk(force, force.planes, "mesh_backward")
    each_chunk(force, force.some, "mesh_gather")
    add_forces(force, a)
    if sums is None:
        leave_out(force, x, a, None)
    else:
        energy, virial = leave_out(force, x, a, force.along)
        energy += force.alone + force.background / volume
        virial += 3.0 * force.background / volume
        even = force.background / volume
        for c in range(1, force.sums.shape[0]):
            energy += force.sums[c, 0]
            virial += force.sums[c, 1]
            even += force.sums[c, 0]
        note_even(force.along, even)
        sums[0] += energy
        sums[1] += virial
    return OK


@strict
def has_changed(force):
    """Tell whether the box is another one than that of the influence."""
    never_inline()
    changed = False
    for k in range(3):
        for m in range(3):
            changed = changed or force.made_for[k, m] != force.edges[k, m]
            force.made_for[k, m] = force.edges[k, m]
    return changed


def mesh_forces(charges: Floats, x: Floats, box: Box, split: Split) -> Floats:
    """Far forces (n, 3) by the mesh at positions x (n, 3), without the terms of pairs left out."""
    n, none = len(charges), (np.zeros((0, 2), np.int64), np.zeros(0))
    parts = bind(split.alpha, split.order, split.mesh, 0.0, 0.0, charges, np.ones(n), box, none, threads=1)
    rows, found, bound = np.ascontiguousarray(x.T), np.zeros((3, n)), BoundForce(parts)
    _evaluate((ready := bound.ready()).address, ready.work, rows, found)
    return np.asarray(found.T)


@driver
def _evaluate(address, work, x, a):
    call_force(address, work, FORCES, 0.0, x, x, a, None)
