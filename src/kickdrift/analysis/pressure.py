"""The pressure tensor of a run's frames, from the forces between pairs of particles."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import cKDTree

from kickdrift.analysis.vectors import vectors_of
from kickdrift.errors import InputError
from kickdrift.forces import Springs
from kickdrift.forces.pair_law import PairForce
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.statistics.blocks import block_average
from kickdrift.trajectory import reader
from kickdrift.trajectory.frames import Frames
from kickdrift.trajectory.record import system_of


class PressureTensor(NamedTuple):
    """The pressure tensor over time, in energy per volume.

    ``tensors`` (f, 3, 3) at ``times`` (f,), their mean ``tensor`` and its standard error ``error``, both (3, 3);
    ``pressure`` is a third of the mean's trace, with ``pressure_error`` of its own. Errors are by block averages over
    frames, infinite where there are too few to tell.
    """

    times: Floats
    tensors: Floats
    tensor: Floats
    error: Floats
    pressure: float
    pressure_error: float


def pressure_tensor(run: Frames | str | os.PathLike[str], system: System | None = None) -> PressureTensor:
    """P = (sum of m v v + sum over pairs of r F) / V at the frames of a run in a periodic box.

    Allen & Tildesley 2017, eqs. 2.60 and 2.67, doi:10.1093/oso/9780198803195.001.0001, with velocities as they are, so
    that of a moving centre of mass included. The stress tensor is its negative. A third of the trace is the pressure
    that the run itself reports. Pair forces act as in the run, by the same compiled law, truncation and tail; springs
    too; fields act on single particles and have no share.

    Parameters
    ----------
    run : open or by its path, or some of its frames, ``run[::10]``
    system : whose forces act; default the run's own, from the file

    Raises InputError for an open box, or where a force is neither between pairs nor a field.
    """
    positions = vectors_of(run, "positions")
    velocities = vectors_of(run, "velocities")
    if not isinstance(positions.source, reader.Run):
        raise InputError("pressure_tensor: takes a run, whose forces it needs; got an array")
    assert positions.times is not None
    system = system_of(positions.source) if system is None else system
    if len(system) != positions.particles:
        raise InputError(f"pressure_tensor: the system has {len(system)} particles, the run {positions.particles}")
    pairs = zip(positions.each(), velocities.each(), strict=True)
    tensors = np.array([instantaneous_pressure(system, x, v) for x, v in pairs])
    mean = block_average(tensors)
    trace = block_average(np.trace(tensors, axis1=1, axis2=2) / 3)
    return PressureTensor(positions.times, tensors, mean.value, mean.error, float(trace.value), float(trace.error))


def instantaneous_pressure(system: System, positions: ArrayLike, velocities: ArrayLike) -> Floats:
    """(3, 3) the pressure tensor of a System's particles at these positions and velocities, both (n, 3)."""
    if not system.box.periodic:
        raise InputError("pressure: needs a periodic box; an open one has no volume")
    x, v = np.asarray(positions, dtype=float), np.asarray(velocities, dtype=float)
    total = np.einsum("n,na,nb->ab", system.coherent_masses, v, v)
    for force in system.forces:
        if isinstance(force, PairForce):
            total += np.eye(3) * force.tail_corrections(system)[1] / 3
        for apart, pull in _pulls(force, system, x):
            total += np.einsum("m,ma,mb->ab", pull, apart, apart)
    return total / system.box.volume


def _pulls(force: object, system: System, x: Floats) -> Iterator[tuple[Floats, Floats]]:
    """(m, 3) separations of pairs and (m,) the force over r between them, positive where they repel."""
    if isinstance(force, PairForce):
        yield from _pair_law(force, system, x)
    elif isinstance(force, Springs):
        i, j = np.array(force.pairs).T
        apart = system.box.minimum_image(x[i] - x[j])
        r = np.linalg.norm(apart, axis=1)
        stretch = np.array(force.stiffness) * (r - np.array(force.length))
        yield apart, -np.divide(stretch, r, out=np.zeros_like(r), where=r > 0)
    elif not getattr(force, "external", False):
        name = getattr(force, "name", type(force).__name__)
        raise InputError(f"pressure: force {name!r} has no pairs to sum over here")


def _pair_law(force: PairForce, system: System, x: Floats) -> Iterator[tuple[Floats, Floats]]:
    from kickdrift.analysis.pair_terms import force_over_r

    cutoff = float(force.cutoff or 0.0)
    tree = cKDTree(system.box.wrap(x), boxsize=system.box.lengths)
    # A hair beyond the cutoff, so that rounding here and there decides alike: below.
    i, j = tree.query_pairs(cutoff * (1 + 1e-12), output_type="ndarray").T
    apart = system.box.minimum_image(x[i] - x[j])
    r2 = np.einsum("ma,ma->m", apart, apart)
    inside = r2 < cutoff**2
    kinds: NDArray[np.int32] = system.species_index
    first, second = np.minimum(kinds[i], kinds[j]), np.maximum(kinds[i], kinds[j])
    for a, name in enumerate(system.species):
        for b, other in enumerate(system.species[a:], start=a):
            some = inside & (first == a) & (second == b)
            if some.any():
                yield apart[some], force_over_r(force, name, other, r2[some])
