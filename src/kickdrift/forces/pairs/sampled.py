"""The sum of a pair force, with energy and virial where a sample comes; see `forces.seam.samples`."""

from numba import types

from kickdrift.forces.lists.clusters import BUILT, LANES, unsigned
from kickdrift.forces.lists.sums import Gathering, mean_acceleration
from kickdrift.forces.seam.samples import SUMMED, sums_expected
from kickdrift.jit.compile import jit
from kickdrift.jit.handle import handle
from kickdrift.jit.inner import by_type
from kickdrift.jit.threads.chunks import each_chunk
from kickdrift.model.box.cell import differs


@jit
def sum_forces(force, wanted):
    """Sum the forces of all chunks; if a sample is ``wanted`` or expected, also their energies and virials."""
    if sums_expected(force.looks, wanted):
        each_chunk(force, force.chunks, "chunk_forces_and_sums")
    else:
        each_chunk(force, force.chunks, "chunk_forces")


@jit
def is_summed(force, x):
    """Tell whether the last evaluation has energy and virial at the positions x (3, n), in a box of the same edges."""
    pairs = force.pairs
    if force.looks[SUMMED] == 0 or pairs.counts[BUILT] == 0:
        return False
    if differs(pairs.cell):
        return False
    own, offset, same = pairs.x, pairs.offset, True
    for i in range(pairs.place.size):
        p = unsigned(pairs.place[i])
        y, z = p + LANES, p + LANES + LANES
        same &= x[0, i] - offset[p] == own[p] and x[1, i] - offset[y] == own[y] and x[2, i] - offset[z] == own[z]
    return same


@jit
def gather_again(force, a):
    """Add the accelerations of the last evaluation once more."""
    mean = mean_again(force.mixed, force.pairs)
    gathering = Gathering(force.pairs, force.chunks, force.inverse_masses, a, mean)
    each_chunk(handle(gathering), force.chunks, "gather_chunk")


@by_type
def mean_again(mixed, pairs):
    """Return None; in mixed precision, the mean acceleration from the sums of all chunks."""
    if isinstance(mixed, types.NoneType):
        return lambda mixed, pairs: None
    return lambda mixed, pairs: mean_acceleration(mixed, pairs)
