"""Instantaneous pressure tensor, from the forces between pairs."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.forces import Restraint
from kickdrift.forces.bonded.law import BondedForce, value_of
from kickdrift.forces.bonded.own_pairs import OwnPairs
from kickdrift.forces.charges.coulomb import Coulomb
from kickdrift.forces.charges.sampled import virial_tensor
from kickdrift.forces.pairs.law import PairForce
from kickdrift.looks.observers import bodies_collide
from kickdrift.model.nearness import pairs_nearer
from kickdrift.model.state import Floats
from kickdrift.model.system import System


def instantaneous_pressure(system: System, positions: ArrayLike, velocities: ArrayLike) -> Floats:
    """Return the pressure tensor (3, 3) of a System at these positions and velocities, both (n, 3).

    In two dimensions the pressure is a force over a length, and the z row and column are zero.
    """
    if not np.isfinite(system.volume):
        raise InputError("pressure: needs a periodic box; open space has no volume")
    if system.constraints is not None:
        raise InputError("pressure: the tensor lacks the forces of constraints; samples have their pressure")
    if bodies_collide(system):
        raise InputError("pressure: the tensor lacks the pushes of collisions; samples of event-driven have them")
    x, v = np.asarray(positions, dtype=float), np.asarray(velocities, dtype=float)
    total = np.einsum("n,na,nb->ab", system.coherent_masses, v, v)
    for force in system.forces:
        if isinstance(force, PairForce):
            each = np.arange(3) < system.dimensions
            total += np.diag(each * force.tail_corrections(system)[1] / system.dimensions)
        if isinstance(force, Coulomb):
            total += virial_tensor(force, system, x)
            continue
        if isinstance(force, Restraint) and force.scales:
            apart = force.apart(system, x)
            total -= np.einsum("ma,mb->ab", force.stiffness * apart, apart)
            continue
        for apart, over_r in _pair_forces(force, system, x):
            total += np.einsum("m,ma,mb->ab", over_r, apart, apart)
    return total / system.volume


def _pair_forces(force: object, system: System, x: Floats) -> Iterator[tuple[Floats, Floats]]:
    """Yield pair separations (m, 3) and forces over r (m,), positive for repulsion."""
    if isinstance(force, PairForce):
        yield from _pair_law(force, system, x)
    elif isinstance(force, BondedForce | OwnPairs) and force.kind == "bonds":
        items, laws, which = force.items(system)
        apart = system.box.minimum_image(x[items[:, 0]] - x[items[:, 1]])
        r = np.linalg.norm(apart, axis=1)
        slope = np.array([value_of(laws[law], each)[1] for law, each in zip(which.tolist(), r.tolist(), strict=True)])
        yield apart, -np.divide(slope, r, out=np.zeros_like(r), where=r > 0)
    elif not getattr(force, "external", False):
        name = getattr(force, "name", type(force).__name__)
        raise InputError(f"pressure: force {name!r} is not a sum over pairs")


def _pair_law(force: PairForce, system: System, x: Floats) -> Iterator[tuple[Floats, Floats]]:
    from kickdrift.forces.pairs.terms import force_over_r

    cutoff = float(force.cutoff or 0.0)
    # Slightly beyond the cutoff: the test below then decides alone, whatever the rounding in the search.
    i, j = pairs_nearer(x, system.box, cutoff * (1 + 1e-12)).T
    apart = system.box.minimum_image(x[i] - x[j])
    r2 = np.einsum("ma,ma->m", apart, apart)
    scale = np.ones(len(i)) if system.topology is None else system.topology.factor_of(i, j)
    inside = (r2 < cutoff**2) & (scale > 0)
    kinds: NDArray[np.int32] = system.species_index
    first, second = np.minimum(kinds[i], kinds[j]), np.maximum(kinds[i], kinds[j])
    for a, name in enumerate(system.species):
        for b, other in enumerate(system.species[a:], start=a):
            some = inside & (first == a) & (second == b)
            if some.any():
                some &= r2 < float(force.pair_end(name, other).cutoff) ** 2
                yield apart[some], scale[some] * force_over_r(force, name, other, r2[some])
