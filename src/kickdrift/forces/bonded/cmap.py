"""CMAP: energies of two dihedrals at once, from maps on a grid.

This module does not import numba, so reading and checking a system file stays fast; ``bind`` compiles.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.seam.arguments import check_massive, is_one, items, number
from kickdrift.forces.seam.group import Grouped
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

SMALLEST = 4  # points along an angle


@checked_arguments
@dataclass(frozen=True)
class Cmap(Grouped):
    """CMAP, the correction of proteins' backbones in CHARMM and AMBER: an energy U(phi, psi) of two dihedrals.

    A map has the energies on a grid of both angles. Between its points runs the bicubic spline that is periodic in
    both, so energy, force and slope are continuous. Source: MacKerell, Feig & Brooks 2004, doi:10.1002/jcc.20065.

    Attributes
    ----------
    chains : ((i, j, k, l, m), …) or ((i, j, k, l, m, n, o, p), …)
        Particles of each term, counted from 0: five along a chain, whose dihedrals are i-j-k-l and j-k-l-m, or the
        four of phi and the four of psi.
    maps : (((energy, …), …), …)
        The maps. Each has n rows of n energies: row r, column c is the energy at phi = 360 r / n and psi = 360 c / n
        degrees. The files of CHARMM and GROMACS begin at -180 degrees.
    map : int, or one for each term
        Number of a term's map, counted from 0; default 0.
    """

    chains: Sequence[Sequence[int]]
    maps: Sequence[Sequence[Sequence[float]]]
    map: int | Sequence[int] = 0

    name: ClassVar[str] = "cmap"
    on_sites: ClassVar[bool] = True
    external: ClassVar[bool] = False
    may_overlap: ClassVar[bool] = True
    joins: ClassVar[bool] = True  # joined bodies may neither merge nor leave
    dimensions: ClassVar[dict[str, str]] = {"maps": "energy"}

    def __post_init__(self) -> None:
        chains = tuple(_chain(self.name, k, chain) for k, chain in enumerate(items(self.name, "chains", self.chains)))
        maps = tuple(_map(self.name, k, rows) for k, rows in enumerate(items(self.name, "maps", self.maps)))
        if not chains or not maps:
            raise InputError(f"{self.name}: {'maps' if chains else 'chains'}: expected one or more, got none")
        one = is_one(self.map)
        which: list[Any] = [self.map] if one else items(self.name, "map", self.map)
        if not one and len(which) != len(chains):
            raise InputError(f"{self.name}: map: expected one number or {len(chains)}, got {len(which)}")
        for k in which:
            if not isinstance(k, int | np.integer) or isinstance(k, bool) or not 0 <= k < len(maps):
                raise InputError(
                    f"{self.name}: map: expected the number of a map, 0 to {len(maps) - 1}, got {shown(k)}"
                )
        object.__setattr__(self, "chains", chains)
        object.__setattr__(self, "maps", maps)
        object.__setattr__(self, "map", int(which[0]) if one else tuple(map(int, which)))

    def __str__(self) -> str:
        sizes = sorted({len(each) for each in self.maps})
        grids = " and ".join(f"{n} x {n}" for n in sizes)
        return f"{type(self).__name__}({len(self.chains)} terms, {len(self.maps)} maps of {grids})"

    def acting_on(self, system: Subject) -> dict[Any, str] | None:
        """The listed chains."""
        return {tuple(row): f"cmap {'-'.join(map(str, row))}" for row in self.particles.tolist()}

    @property
    def particles(self) -> np.ndarray:
        """Particles (m, 8) of the two dihedrals of each term."""
        return np.array([(*row[:4], *row[-4:]) for row in self.chains], np.int64)

    def check(self, system: Subject) -> None:
        """Refuse particles that do not exist or have no mass, and two dimensions, which the force would leave."""
        n, ids = len(system), self.particles
        for k in np.flatnonzero((ids >= n).any(axis=1)):
            raise InputError(f"{self.name}: chains[{k}]: there is no particle {ids[k].max()}; ids are 0 to {n - 1}")
        if system.dimensions == 2:
            raise InputError(f"{self.name}: needs three dimensions; its dihedrals push particles out of a plane")
        check_massive(self.name, system, np.unique(ids))

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: dihedrals keep with the box."""
        return ""

    def bind(self, system: Subject, threads: int = 1) -> Any:
        """Bind this force to a System: a NamedTuple with a compiled body."""
        from kickdrift.forces.bonded.cmap_kernel import bind

        return bind(self, system)


def _chain(name: str, k: int, values: Any) -> tuple[int, ...]:
    given = [] if isinstance(values, str) or not isinstance(values, Iterable) else list(values)
    whole = all(isinstance(i, int | np.integer) and not isinstance(i, bool) and i >= 0 for i in given)
    fours = [set(given[:4]), set(given[-4:])] if whole else []
    if len(given) not in (5, 8) or not whole or any(len(four) < 4 for four in fours):
        raise InputError(
            f"{name}: chains[{k}]: expected the ids of five particles, or of two dihedrals with four each, got "
            f"{shown(values)}"
        )
    return tuple(map(int, given))


def _map(name: str, k: int, rows: Any) -> tuple[tuple[float, ...], ...]:
    given = [items(name, f"maps[{k}]", row) for row in items(name, f"maps[{k}]", rows)]
    n = len(given)
    if n < SMALLEST or any(len(row) != n for row in given):
        sizes = f"{n} rows of {', '.join(map(str, sorted({len(row) for row in given})))}"
        raise InputError(f"{name}: maps[{k}]: expected n rows of n energies, n = {SMALLEST} or more, got {sizes}")
    return tuple(tuple(number(name, f"maps[{k}]", value) for value in row) for row in given)
