"""The compiled direct sum: every particle against eight at a time, threads over particles, each sum in one order."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.chunks import Parallel, Serial, chunk_task, each_chunk
from kickdrift.forces.compiling import jit, never_inline
from kickdrift.forces.kernel import OK, kernel
from kickdrift.forces.simd import WIDTH, lane_numbers, lane_sum, load, select, splat

if TYPE_CHECKING:
    from kickdrift.forces.gravity import Gravity
    from kickdrift.system import System


class GravityKernel(NamedTuple):
    """Direct gravity bound to a System; sources are padded with massless ones to a multiple of eight."""

    softening2: float
    gm: NDArray[np.float64]  # (slots,) G m
    masses: NDArray[np.float64]  # (n,) coherent
    x: NDArray[np.float64]  # (3, slots)
    a: NDArray[np.float64]  # (3, n)
    sums: NDArray[np.float64]  # (n, 2) each particle's share of energy and virial
    threads: Serial | Parallel


def bind(force: Gravity, system: System, threads: int) -> GravityKernel:
    """The force for this System, on this many threads."""
    n = len(system)
    slots = WIDTH * -(-n // WIDTH)
    gravity = force.G if force.G is not None else system.units.gravity
    gm = np.zeros(slots)
    gm[:n] = float(gravity or 0.0) * system.state.masses
    share = Parallel(n) if threads > 1 else Serial(n)
    x = np.zeros((3, slots))
    return GravityKernel(force.softening**2, gm, system.coherent_masses, x, np.zeros((3, n)), np.zeros((n, 2)), share)


@kernel(GravityKernel)
def gravity_forces(force, t, x, v, a, sums):
    n, sources = x.shape[1], force.x
    for k in range(3):
        for i in range(n):
            sources[k, i] = x[k, i]
    if sums is None:
        each_chunk(force, force.threads, "pull")
    else:
        each_chunk(force, force.threads, "pull_and_sums")
        for i in range(n):
            sums[0] += force.sums[i, 0]
            sums[1] += force.sums[i, 1]
        sums[2] += 0.5 * n * (n - 1)
    pulls = force.a
    for k in range(3):
        for i in range(n):
            a[k, i] += pulls[k, i]
    return OK


@chunk_task
def pull(force, i):
    """The acceleration of particle i."""
    never_inline()
    sum_sources(force, None, i)


@chunk_task
def pull_and_sums(force, i):
    """The same, and particle i's half of each pair's energy and virial."""
    never_inline()
    sum_sources(force, force.sums, i)


@jit
def sum_sources(force, sums, i):
    x, y, z = force.x
    gm, softening2 = force.gm, force.softening2
    xi, yi, zi = splat(x[i]), splat(y[i]), splat(z[i])
    zero = splat(0.0)
    ax, ay, az, energy, virial = zero, zero, zero, zero, zero
    for j in range(0, gm.size, WIDTH):
        dx, dy, dz = load(x, j) - xi, load(y, j) - yi, load(z, j) - zi
        separation2 = dx * dx + dy * dy + dz * dz
        source = select(lane_numbers() == float(i - j), zero, load(gm, j))  # all but the particle itself
        pulling = source > 0.0
        inverse = 1.0 / math.sqrt(separation2 + softening2)
        gm_over_r = select(pulling, source * inverse, zero)
        w = select(pulling, gm_over_r * inverse * inverse, zero)
        ax, ay, az = ax + w * dx, ay + w * dy, az + w * dz
        if sums is not None:
            energy = energy - gm_over_r
            virial = virial - w * separation2
    force.a[0, i], force.a[1, i], force.a[2, i] = lane_sum(ax), lane_sum(ay), lane_sum(az)
    if sums is not None:
        sums[i, 0] = 0.5 * force.masses[i] * lane_sum(energy)
        sums[i, 1] = 0.5 * force.masses[i] * lane_sum(virial)
