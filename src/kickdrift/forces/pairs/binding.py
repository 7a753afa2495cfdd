"""Binding of pair forces to particles: laws as numbers, compiled truncations, and a law evaluated at many distances."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from kickdrift.forces.lists.clusters import ClusterList, cluster_list
from kickdrift.forces.lists.load import volume_of
from kickdrift.forces.lists.row_lanes import RowLanes, row_lanes
from kickdrift.forces.lists.special_pairs import special_of
from kickdrift.forces.pairs.ends import End
from kickdrift.forces.pairs.kernel import PairKernel, PairWork
from kickdrift.forces.pairs.truncations import (
    AtCutoff,
    AtOwnCutoff,
    Cut,
    ForceShift,
    PotentialSwitch,
    Shift,
    Switch,
    at_own_cutoff,
    of_pairs,
)
from kickdrift.forces.pairs.upkeep import tables_of
from kickdrift.forces.seam.samples import no_looks
from kickdrift.jit.compile import as_written
from kickdrift.jit.lanes import law_operators as law_operators  # operators of the lanes that a law takes
from kickdrift.jit.threads.chunks import in_chunks
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from collections.abc import Sequence

    from kickdrift.model.subject import Subject


class PairPotential(Protocol):
    """A pair force as its compiled code needs it; see ``PairForce``."""

    @property
    def Parameters(self) -> Any:
        """The law's NamedTuple class."""

    def pair_end(self, a: str, b: str) -> End:
        """Return where and how the pair of species a and b ceases to interact."""

    def ends(self, species: Sequence[str]) -> set[End]:
        """Return the ends of all pairs of these species."""

    def pair_law(self, a: str, b: str) -> Any:
        """Return the law's parameters between species a and b."""

    def tail_corrections(self, system: Subject) -> tuple[float, float]:
        """Return the energy and the virial from beyond the cutoff."""


def law_class(force: PairPotential) -> Any:
    """Class of a force's parameters, prepared for compiled code."""
    cls = force.Parameters
    if "compiled_law" not in vars(cls):
        cls.compiled_law = cls.own_code() if hasattr(cls, "own_code") else as_written(cls.law)
    return cls


def bind(force: PairPotential, system: Subject, threads: int, mixed: bool = False) -> PairKernel:
    """Bind a pair force to a System, on this number of threads."""
    lanes = row_lanes(mixed)
    names = system.species
    cutoff, numbers = float(max(end.cutoff for end in force.ends(names))), pair_numbers(force, names)
    law, at_cutoff = first_pair(force, names)
    pairs = list_of(system, cutoff, lanes, threads, mixed)
    chunks = pairs.force.shape[0]
    work = PairWork(
        law=law,
        at_cutoff=at_cutoff,
        tables=tables_of(numbers, system.species_index, pairs.x.size // 3, lanes),
        truncation=truncation_of(force, names),
        mixed=float(system.coherent_masses.sum()) if mixed else None,
        lanes=lanes,
        cutoff=cutoff,
        tail=force.tail_corrections(system),
        tail_volume=float(volume_of.py_func(pairs.live)),
        inverse_masses=1.0 / system.coherent_masses,
        sums=np.zeros((chunks, 3)),
        looks=no_looks(),
        along=None,
        pairs=pairs,
        chunks=in_chunks(chunks, threads),
    )
    return PairKernel(work)


def list_of(system: Subject, cutoff: float, lanes: RowLanes, threads: int, mixed: bool = False) -> ClusterList:
    """Return an empty list of a System's pairs, which knows the pairs that the topology leaves out or scales."""
    n = len(system)
    pairs = cluster_list(n, system.box, cutoff, lanes, threads, single=mixed)
    special = special_of(system.topology, n, pairs.x.size // 3, pairs.force.shape[0], pairs.near.shape[1])
    return pairs._replace(special=special)


def at_cutoff_of(force: PairPotential, names: Sequence[str], a: str, b: str) -> AtCutoff | AtOwnCutoff:
    """What the truncation of a pair of species needs; ``names`` are the species of the System."""
    law, end = force.pair_law(a, b), force.pair_end(a, b)
    return at_own_cutoff(law, end) if len(force.ends(names)) > 1 else at_common_cutoff(law, end)


def at_common_cutoff(law: Any, end: End) -> AtCutoff:
    """What the truncation needs of a pair with this law, where all pairs have this end."""
    return AtCutoff(*map(float, law.law(float(end.cutoff) ** 2)))


def first_pair(force: PairPotential, names: Sequence[str]) -> tuple[Any, AtCutoff | AtOwnCutoff]:
    """Parameters of the first species with itself, and what its truncation needs."""
    law = force.pair_law(names[0], names[0])
    return law_class(force)(*map(float, law)), at_cutoff_of(force, names, names[0], names[0])


def pair_numbers(force: PairPotential, names: Sequence[str]) -> Floats:
    """Numbers (rows, species, species) of all pairs of species, with the rows of `Tables`."""
    numbers = [[(*force.pair_law(a, b), *at_cutoff_of(force, names, a, b)) for b in names] for a in names]
    return np.array(numbers, dtype=float).transpose(2, 0, 1)


def truncation_of(force: PairPotential, names: Sequence[str]) -> Any:
    """Compiled truncation of a pair force between these species."""
    ends = force.ends(names)
    return of_pairs(ends) if len(ends) > 1 else truncation_at(*ends)


def truncation_at(end: End) -> Any:
    """Compiled truncation of pairs that all have this end."""
    cutoff, start = float(end.cutoff), float(end.switch_start or 0.0)
    return {
        "cut": Cut(),
        "shift": Shift(),
        "force-shift": ForceShift(cutoff),
        "switch": Switch(start**2, 1.0 / (cutoff**2 - start**2)),
        "potential-switch": PotentialSwitch(start, 1.0 / (cutoff - start)),
    }[end.truncation]
