"""Binding of Coulomb's law to particles: the near part with a pair force or alone, and the far part."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numba import carray, types
from numpy.typing import NDArray

from kickdrift.forces.charges import direct_kernel, far_kernel, mesh_kernel, slab_kernel
from kickdrift.forces.charges.accuracy import Split
from kickdrift.forces.charges.far_kernel import Far
from kickdrift.forces.charges.mesh_kernel import Mesh
from kickdrift.forces.charges.pair_terms import ChargedPairKernel, ChargedPairs, ChargedTables
from kickdrift.forces.charges.radial import ALL_IMAGES, DAMPED_SHIFTED, DIRECT, Radial
from kickdrift.forces.charges.waves import waves_of
from kickdrift.forces.lists.load import volume_of
from kickdrift.forces.lists.row_lanes import row_lanes
from kickdrift.forces.pairs import binding as pair_binding
from kickdrift.forces.pairs.beside_pairs import BesidePairs
from kickdrift.forces.pairs.kernel import PairKernel, PairWork
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.pairs.truncations import AtCutoff, Cut
from kickdrift.forces.seam.kernel import FORCES_AND_SUMS, OK, BoundForce, call_force, run_body
from kickdrift.jit.handle import Handle, handle_at
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.threads.chunks import in_chunks
from kickdrift.model.box.box import Box
from kickdrift.model.box.cell import live_cell
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


class Charges(Protocol):
    """Coulomb's law as its compiled code needs it; see ``Coulomb``."""

    @property
    def method(self) -> str: ...

    def host(self, system: Any) -> PairForce | None:
        """Return the pair force that takes the near part."""

    def scaled_charges(self, system: Subject) -> Floats:
        """Return the charges (n,) times the root of Coulomb's constant."""

    def background(self, system: Subject) -> float:
        """Return the energy of the neutralising background, times the volume."""

    def split(self, system: Subject) -> Split:
        """Return the parameters of the sum."""

    def space(self, system: Subject) -> Box:
        """Return the box of the far part."""

    def radial(self, split: Split) -> Radial:
        """Return the near part."""


class ChargedParts(NamedTuple):
    """Near and far part of Coulomb's law, without a pair force."""

    far: Far | Mesh | slab_kernel.SlabFar
    force: Any  # PairWork of the near part
    address: int  # of its machine code
    work: int


class ChargedKernel(BesidePairs):
    """A bound Coulomb force with its own list: ``parts`` is a ChargedParts."""

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        restore = handle_at(Handle(kind))

        def compute(work, what, n, t, x, v, a, sums):
            force, shape = restore(work), (3, n)
            x, v, a, sums = carray(x, shape), carray(v, shape), carray(a, shape), carray(sums, 3)
            status = call_force(force.address, force.work, what, t, x, v, a, sums)
            if status != OK:
                return status
            if what == FORCES_AND_SUMS:
                return run_body(force.far, t, x, v, a, sums)
            return run_body(force.far, t, x, v, a, None)

        return compute

    def with_list(self, **changes: Any) -> ChargedKernel:
        """See PairKernel."""
        far: Any = self.parts.far
        if "live" in changes and not isinstance(far, slab_kernel.SlabFar):  # barostats refuse slabs
            far = far._replace(cell=live_cell(far.cell, changes["live"]))
        return ChargedKernel(self.parts._replace(far=far), self.own.with_list(**changes))

    @property
    def rows_along(self) -> int:
        """See BoundForce: rows of the far part, then rows of the near part."""
        return BoundForce(self.parts.far).rows_along + self.own.rows_along

    def with_along(self, along: Floats) -> ChargedKernel:
        """See BoundForce."""
        far = BoundForce(self.parts.far)
        own: Any = self.own.with_along(along[far.rows_along :])
        return ChargedKernel(self.parts._replace(far=far.with_along(along[: far.rows_along]).parts), own)


def bind(force: Charges, system: Subject, threads: int, mixed: bool = False) -> BoundForce:
    """Bind Coulomb's law to a System, without the near part if a pair force has that. ``mixed`` is its precision."""
    if force.method == DIRECT:
        charges = force.scaled_charges(system)
        return BoundForce(direct_kernel.bind(charges, system.coherent_masses, special_pairs(system), threads))
    far = bind_far(force, system, threads)
    if force.host(system) is not None:
        return BoundForce(far)
    near = bind_near(force, None, system, threads, mixed)
    return ChargedKernel(ChargedParts(far, near.parts, 0, 0), near)


def bind_near(force: Charges, host: PairForce | None, system: Subject, threads: int, mixed: bool = False) -> PairKernel:
    """Bind the near part and the pair force ``host``, if there is one, as one sum over pairs."""
    radial = force.radial(split := force.split(system))
    own: Any = None if host is None else pair_binding.bind(host, system, threads, mixed).parts
    reach = split.cutoff if own is None else max(own.cutoff, split.cutoff)
    lanes = row_lanes(mixed)
    pairs = pair_binding.list_of(system, reach, lanes, threads, mixed)
    slots, chunks = pairs.x.size // 3, pairs.force.shape[0]
    law = ChargedPairs(own and own.law, own.cutoff**2 if own else 0.0, radial)
    single = (aligned((slots,), dtype=np.float32), aligned((4 * slots,), dtype=np.float32)) if mixed else ()
    tables = ChargedTables(own and own.tables, force.scaled_charges(system), aligned((slots,)), *single)
    if own is not None:
        return ChargedPairKernel(own._replace(law=law, tables=tables, cutoff=reach, pairs=pairs))
    return ChargedPairKernel(
        PairWork(
            law=law,
            at_cutoff=AtCutoff(0.0, 0.0),
            tables=tables,
            truncation=Cut(),
            mixed=float(system.coherent_masses.sum()) if mixed else None,
            lanes=lanes,
            cutoff=reach,
            tail=(0.0, 0.0),
            tail_volume=float(volume_of.py_func(pairs.live)),
            inverse_masses=1.0 / system.coherent_masses,
            sums=np.zeros((chunks, 3)),
            looks=np.zeros(4, np.int64),
            along=None,
            pairs=pairs,
            chunks=in_chunks(chunks, threads),
        )
    )


def bind_far(force: Charges, system: Subject, threads: int) -> Far | Mesh | slab_kernel.SlabFar:
    """Bind what is beside the sum over near pairs: waves or a mesh, the energies of single charges, pairs left out, and
    the correction of a slab."""
    space = force.space(system)
    far = bind_waves(force, system, space, threads)
    if space == system.box:
        return far
    return slab_kernel.bind(far, space, force.scaled_charges(system), system.coherent_masses)


def bind_waves(force: Charges, system: Subject, space: Box, threads: int) -> Far | Mesh:
    """Bind the far part in the box ``space``."""
    charges, split = force.scaled_charges(system), force.split(system)
    squares = float(charges @ charges)
    alone, background = 0.0, 0.0
    if force.method in ALL_IMAGES:
        alone = -split.alpha / math.sqrt(math.pi) * squares
        background = force.background(system)
    elif force.method == DAMPED_SHIFTED:
        alone = -squares * (
            0.5 * math.erfc(split.alpha * split.cutoff) / split.cutoff + split.alpha / math.sqrt(math.pi)
        )
    given = alone, background, charges, system.coherent_masses, space, special_pairs(system), threads
    if split.mesh:
        return mesh_kernel.bind(split.alpha, split.order, split.mesh, *given)
    alpha = split.alpha if force.method in ALL_IMAGES else 0.0
    return far_kernel.bind(alpha, waves_of(space, split.waves), *given)


def special_pairs(system: Subject) -> tuple[NDArray[np.int64], Floats]:
    """Pairs (m, 2) that the System's topology leaves out or scales, and their factors."""
    if system.topology is None:
        return np.zeros((0, 2), np.int64), np.zeros(0)
    pairs, factors = system.topology.scaled
    return pairs, factors
