"""Coulomb's law in open space, every pair summed: each particle against all, eight at a time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.charges.far_kernel import leave_out
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.jit.compile import never_inline
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_sum, multiply_add, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import aligned, load
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.jit.threads.chunks import Chunks, chunk_task, each_chunk, in_chunks
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import Cell, cell_of
from kickdrift.model.state import Floats

PARTICLES_PER_CHUNK = 128


class DirectCharges(NamedTuple):
    """Coulomb's law of all pairs, bound to a System."""

    alpha: float  # infinite: pairs that are left out lose all of their law
    charges: NDArray[np.float64]  # (n,) scaled by the root of Coulomb's constant
    inverse_masses: NDArray[np.float64]  # (n,)
    cell: Cell
    places: NDArray[np.float64]  # (3, slots)
    q: NDArray[np.float64]  # (slots,) the charges; padding has none
    forces: NDArray[np.float64]  # (3, slots)
    sums: NDArray[np.float64]  # (chunks,) twice the energy
    pairs: NDArray[np.int64]  # (m, 2) pairs that are left out or scaled
    factors: NDArray[np.float64]  # (m,)
    chunks: Chunks


def bind(charges: Floats, masses: Floats, special: tuple[NDArray[np.int64], Floats], threads: int) -> DirectCharges:
    """Parts for charges and coherent masses (n,), and ``special`` pairs with their factors."""
    n = len(charges)
    slots, chunks = WIDTH * -(-n // WIDTH), -(-n // PARTICLES_PER_CHUNK)
    q = aligned((slots,))
    q[:n] = charges
    return DirectCharges(
        alpha=np.inf,
        charges=charges,
        inverse_masses=1.0 / masses,
        cell=cell_of(Box()),
        places=aligned((3, slots)),
        q=q,
        forces=aligned((3, slots)),
        sums=np.zeros(chunks),
        pairs=special[0],
        factors=special[1],
        chunks=in_chunks(chunks, threads),
    )


@kernel(DirectCharges)
def direct_forces(force, t, x, v, a, sums):
    for k in range(3):
        for i in range(x.shape[1]):
            force.places[k, i] = x[k, i]
    each_chunk(force, force.chunks, "chunk_direct_charges")
    energy = 0.0
    for c in range(force.chunks.number):
        energy += 0.5 * force.sums[c]
    virial = energy
    for k in range(3):
        for i in range(x.shape[1]):
            a[k, i] += force.forces[k, i] * force.inverse_masses[i]
    found = leave_out(force, x, a, None)
    if sums is not None:
        sums[0] += energy + found[0]
        sums[1] += virial + found[1]
        sums[2] += 0.5 * x.shape[1] * (x.shape[1] - 1)
    return OK


@chunk_task
def chunk_direct_charges(force, c):
    """Sum the forces on the particles of a chunk, and twice the energy of these particles."""
    never_inline()
    n, count, total = force.charges.size, force.chunks.number, 0.0
    x, y, z = force.places[0], force.places[1], force.places[2]
    for i in range(c * n // count, (c + 1) * n // count):
        xi, yi, zi = x[i], y[i], z[i]
        fx, fy, fz, energy = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
        for j in range(0, force.q.size, WIDTH):
            dx, dy, dz = xi - load(x, j), yi - load(y, j), zi - load(z, j)
            r2 = dx * dx + dy * dy + dz * dz
            inverse = select(r2 > 0.0, inverse_sqrt(r2), 0.0)
            u = load(force.q, j) * inverse
            g = u * (inverse * inverse)
            energy = energy + u
            fx, fy, fz = multiply_add(g, dx, fx), multiply_add(g, dy, fy), multiply_add(g, dz, fz)
        q = force.q[i]
        total += q * lane_sum(energy)
        force.forces[0, i], force.forces[1, i] = q * lane_sum(fx), q * lane_sum(fy)
        force.forces[2, i] = q * lane_sum(fz)
    force.sums[c] = total
