"""Binding of many-body forces to particles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.lists.clusters import cluster_list
from kickdrift.forces.lists.neighbours import neighbours_of
from kickdrift.forces.lists.row_lanes import Wide
from kickdrift.forces.many_body import embedded_atom_kernel as embedded_atom_kernel  # these four register laws' bodies
from kickdrift.forces.many_body import stillinger_weber_kernel as stillinger_weber_kernel
from kickdrift.forces.many_body import tersoff_forms_kernel as tersoff_forms_kernel
from kickdrift.forces.many_body import tersoff_kernel as tersoff_kernel
from kickdrift.forces.many_body.kernel import ManyBodyKernel, ManyBodyWork
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.threads.chunks import in_chunks
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


class ManyBodyPotential(Protocol):
    """A many-body force as its compiled code needs it; see ``ManyBodyForce``."""

    @property
    def cutoff(self) -> float: ...

    def law(self, species: tuple[str, ...]) -> Any:
        """Return the law's parts for these species."""


def bind(force: ManyBodyPotential, system: Subject, threads: int, mixed: bool) -> ManyBodyKernel:
    """Bind a many-body force to a System, on this number of threads, in float64 or ``mixed`` precision."""
    pairs = cluster_list(len(system), system.box, force.cutoff, Wide())
    law = force.law(system.species)
    if mixed:
        law = law._replace(**{name: in_single(getattr(law, name)) for name in law.tables})
    rows = neighbours_of(pairs, system.box, system.species_index.astype(np.int64), law.pairs_once)
    chunks = pairs.force.shape[0]
    return ManyBodyKernel(
        ManyBodyWork(
            law=law.with_room(*rows.near.shape, chunks),
            cutoff=force.cutoff,
            inverse_masses=1.0 / system.coherent_masses,
            sums=np.zeros((chunks, 3)),
            along=None,
            rows=rows,
            pairs=pairs,
            chunks=in_chunks(chunks, threads),
        )
    )


def in_single(table: Floats) -> NDArray[np.float32]:
    """A table as float32, where numbers that are too small for float32 become its smallest."""
    made = aligned(table.shape, None, np.float32)
    made[...] = np.where(table > 0.0, np.maximum(table, np.finfo(np.float32).tiny), table)
    return made
