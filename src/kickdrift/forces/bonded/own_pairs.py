"""Forces that list their own pairs of particles, with parameters for each: the base class, and pairs of a force field.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.seam.arguments import check_massive, is_one, items, number
from kickdrift.forces.seam.group import Grouped
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.molecules.relatives import LONGEST
from kickdrift.model.state import Floats
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

ANY, POSITIVE, NOT_NEGATIVE = "", "positive", "zero or more"  # what the values of a parameter may be


class OwnPairs(Grouped):
    """Base class of forces on pairs that the force itself lists. Each parameter is one number, or one for each pair."""

    name: ClassVar[str]
    kind: ClassVar[str] = "bonds"
    limited: ClassVar[bool] = True
    external: ClassVar[bool] = False
    may_overlap: ClassVar[bool] = True
    joins: ClassVar[bool] = True  # joined bodies may neither merge nor leave
    on_sites: ClassVar[bool] = True
    takes: ClassVar[Mapping[str, str]]  # what the values of each parameter may be
    Parameters: ClassVar[Any]

    pairs: Sequence[tuple[int, int]]

    def __post_init__(self) -> None:
        pairs = tuple(_pair(self.name, k, pair) for k, pair in enumerate(items(self.name, "pairs", self.pairs)))
        if not pairs:
            raise InputError(f"{self.name}: expected one pair or more, got none")
        seen: set[tuple[int, int]] = set()
        for i, j in pairs:
            if i == j:
                raise InputError(f"{self.name}: pair {[i, j]} joins a particle to itself")
            if (min(i, j), max(i, j)) in seen:
                raise InputError(f"{self.name}: pair {[i, j]} is given twice")
            seen.add((min(i, j), max(i, j)))
        object.__setattr__(self, "pairs", pairs)
        for key, least in self.takes.items():
            given = getattr(self, key)
            one = is_one(given)
            values = tuple(number(self.name, key, v) for v in ([given] if one else items(self.name, key, given)))
            if not one and len(values) != len(pairs):
                raise InputError(f"{self.name}: {key}: expected one number or {len(pairs)}, got {len(values)}")
            for value in values:
                if (least and value < 0) or (least == POSITIVE and value == 0):
                    raise InputError(f"{self.name}: {key} must be {least}, got {value}")
            object.__setattr__(self, key, values[0] if one else values)

    def __str__(self) -> str:
        count = len(self.pairs)
        described = [f"1 pair {list(self.pairs[0])}" if count == 1 else f"{count} pairs"]
        for key in self.takes:
            values = np.unique(getattr(self, key))
            described.append(f"{key}={values[0]}" if len(values) == 1 else f"{key}={values[0]} to {values[-1]}")
        return f"{type(self).__name__}({', '.join(described)})"

    def check(self, system: Subject) -> None:
        """Refuse pairs of particles that do not exist or have no mass."""
        n, ids = len(system), np.array(self.pairs)
        for i, j in ids[(ids >= n).any(axis=1)]:
            raise InputError(
                f"{self.name}: pair {[int(i), int(j)]}: there is no particle {max(i, j)}; ids are 0 to {n - 1}"
            )
        check_massive(self.name, system, ids.flat)

    def separations(self, system: Subject) -> Floats:
        """Separations (m, 3) of the pairs at the start, between nearest images."""
        ids, x = np.array(self.pairs), system.state.positions
        return system.box.minimum_image(x[ids[:, 0]] - x[ids[:, 1]])

    def values(self, system: Subject) -> Floats:
        """Parameters (m, k) of the law for each pair."""
        return np.column_stack([np.broadcast_to(getattr(self, key), len(self.pairs)) for key in self.takes])

    def items(self, system: Subject) -> tuple[np.ndarray, list[Any], np.ndarray]:
        """The pairs (m, 2), the different laws, and the law of each pair (m,)."""
        laws, which = np.unique(self.values(system), axis=0, return_inverse=True)
        pairs = np.array(self.pairs, dtype=np.int64)
        return pairs, [self.Parameters(*law) for law in laws.tolist()], which.reshape(-1).astype(np.int64)

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: pairs scale with the box."""
        return ""

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.bonded.kernel import bind

        return bind(self, system)


def _pair(name: str, k: int, values: Any) -> tuple[int, int]:
    given = [] if isinstance(values, str) or not isinstance(values, Iterable) else list(values)
    whole = all(isinstance(i, int | np.integer) and not isinstance(i, bool) and i >= 0 for i in given)
    if len(given) != 2 or not whole:
        raise InputError(f"{name}: pairs[{k}]: expected the ids of two particles, got {shown(values)}")
    return int(given[0]), int(given[1])


class NonbondedPair(NamedTuple):
    """U(r) = 4 epsilon ((sigma/r)^12 - (sigma/r)^6) + strength / r, without a cutoff."""

    epsilon: float
    sigma: float
    strength: float

    dimensions = {"epsilon": "energy", "sigma": "length"}  # type: ignore[misc]  # noqa: RUF012

    def law(p, r):
        s6 = (p.sigma / r) ** 6
        repulsion, attraction, charges = 4.0 * p.epsilon * s6 * s6, 4.0 * p.epsilon * s6, p.strength / r
        return repulsion - attraction + charges, (6.0 * attraction - 12.0 * repulsion - charges) / r


@checked_arguments
@dataclass(frozen=True)
class ListedPairs(OwnPairs):
    """Lennard-Jones and Coulomb between listed pairs alone: U = 4 epsilon ((sigma/r)^12 - (sigma/r)^6) + C qq / r.

    Force fields of proteins treat particles three bonds apart (1-4 pairs) in this way, with their own parameters. The
    topology then leaves these pairs out of all other pair forces (``exclusions``). There is no cutoff, and in a
    periodic box r is the distance between nearest images. Such lists are GROMACS' ``[ pairs ]`` and OpenMM's
    exceptions.

    Attributes
    ----------
    pairs : ((i, j), …)
        Ids of particles, counted from 0. No pair may occur twice, in either order.
    epsilon : float, or one for each pair
        Depth of the well, default 0.
    sigma : float, or one for each pair
        Distance at which the Lennard-Jones energy is zero, zero or more.
    charges : float, or one for each pair
        Product qq of the two charges, in the square of the unit of charge; default 0. The particles' own charges do
        not count here. C is Coulomb's constant of the unit system.
    """

    pairs: Sequence[tuple[int, int]]
    epsilon: float | Sequence[float] = 0.0
    sigma: float | Sequence[float] = 1.0
    charges: float | Sequence[float] = 0.0

    name: ClassVar[str] = "listed-pairs"
    Parameters: ClassVar[Any] = NonbondedPair
    takes: ClassVar[Mapping[str, str]] = {"epsilon": ANY, "sigma": NOT_NEGATIVE, "charges": ANY}
    may_overlap: ClassVar[bool] = False
    dimensions: ClassVar[dict[str, str]] = {"epsilon": "energy", "sigma": "length"}

    def check(self, system: Subject) -> None:
        """Refuse pairs that do not exist, have no mass or begin at one place, and charges in units without charge."""
        super().check(system)
        if np.any(self.charges) and system.units.coulomb is None:
            raise InputError(f"{self.name}: units {system.units.name!r} have no Coulomb constant; leave out charges")
        apart, (edge, height) = np.sqrt((self.separations(system) ** 2).sum(axis=1)), system.box.narrowest
        for k in np.flatnonzero((apart == 0) | (apart >= LONGEST * height)):
            i, j = self.pairs[int(k)]
            far = f"{apart[k]:.6g} apart; it must be under {LONGEST} of the {edge}, {height:.6g}"
            raise InputError(f"{self.name}: particles {i} and {j} are {far if apart[k] else 'at the same place'}")

    def values(self, system: Subject) -> Floats:
        """See OwnPairs: the charges become energies times length."""
        found = super().values(system)
        found[:, 2] *= system.units.coulomb or 0.0
        return found
