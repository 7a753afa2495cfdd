"""Topology of molecules: bonds, angles, dihedrals and impropers, and how strongly near relatives interact."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.checks.values import is_number, listed, whole_number
from kickdrift.model.molecules.listed import from_atoms, from_universe, replaced
from kickdrift.model.molecules.relatives import (
    LONGEST,
    Relatives,
    angles_of,
    dihedrals_of,
    molecules_of,
    shortest_paths,
    whole,
    within,
)
from kickdrift.model.state import Floats
from kickdrift.text import counted, shown

Ids = NDArray[np.int64]
LARGEST = int(np.iinfo(np.int64).max)  # number that an array of particles holds
SIZES = {"bonds": 2, "angles": 3, "dihedrals": 4, "impropers": 4}  # particles of each kind of item
DEFAULT_TYPE = "1"  # of an item without a type, as in LAMMPS
APART = ("bonded", "two bonds apart", "three bonds apart")


class Scaled(NamedTuple):
    """Pairs whose pair forces are scaled: rows (m, 2) with i < j, and a factor (m,) for each."""

    pairs: Ids
    factors: NDArray[np.float64]


@checked_arguments
class Topology:
    """Bonds, angles, dihedrals and impropers of a System, and the pairs that its pair forces leave out or scale.

    Forces such as ``kd.HarmonicBond`` act on these lists. A bond goes to the nearest image of its partner.

    Parameters
    ----------
    bonds : ((i, j), …)
        Particles, counted from 0. No bond may occur twice.
    angles : ((i, j, k), …), with j in the middle; or True for all angles between two bonds
    dihedrals : ((i, j, k, l), …) along a chain of bonds; or True for all such chains of four
    impropers : ((i, j, k, l), …), whose angle is between the planes of i, j, k and of j, k, l
        LAMMPS and CHARMM list the central particle first, AMBER third.
    bond_types, angle_types, dihedral_types, improper_types : a name for each, or one name for all; default "1"
    factors : (bonded, two bonds apart, three bonds apart), optional
        Factors of pair forces between such particles, from 0 (left out) to 1. The shortest path of bonds counts.
        LAMMPS calls them ``special_bonds``. Default: all pairs interact.
    exclusions : ((i, j), …)
        Further pairs that pair forces leave out.

    Raises
    ------
    InputError
        If an item joins a particle to itself or occurs twice, if lists differ in length, and if an exclusion
        contradicts a factor.
    """

    def __init__(
        self,
        bonds: Iterable[Sequence[int]] = (),
        angles: Iterable[Sequence[int]] | bool = (),
        dihedrals: Iterable[Sequence[int]] | bool = (),
        impropers: Iterable[Sequence[int]] = (),
        *,
        bond_types: str | Sequence[str] = DEFAULT_TYPE,
        angle_types: str | Sequence[str] = DEFAULT_TYPE,
        dihedral_types: str | Sequence[str] = DEFAULT_TYPE,
        improper_types: str | Sequence[str] = DEFAULT_TYPE,
        factors: Sequence[float] | None = None,
        exclusions: Iterable[Sequence[int]] = (),
    ) -> None:
        self.bonds = _items("bonds", bonds)
        self.angles = angles_of(self.bonds) if angles is True else _items("angles", angles)
        self.dihedrals = dihedrals_of(self.bonds) if dihedrals is True else _items("dihedrals", dihedrals)
        self.impropers = _items("impropers", impropers)
        self.bond_types = _types("bond_types", bond_types, len(self.bonds))
        self.angle_types = _types("angle_types", angle_types, len(self.angles))
        self.dihedral_types = _types("dihedral_types", dihedral_types, len(self.dihedrals))
        self.improper_types = _types("improper_types", improper_types, len(self.impropers))
        self.factors = None if factors is None else _factors(factors)
        self.exclusions = _items("exclusions", exclusions, 2)
        self._sites: Ids = np.zeros((0, 2), np.int64)
        self._check_exclusions()

    @classmethod
    def chains(cls, count: int, length: int, *, angles: bool = False, dihedrals: bool = False, **more: Any) -> Topology:
        """Topology of equal chains: particles 0 to length - 1 are the first chain, the next ``length`` the second.

        Parameters
        ----------
        count, length : number of chains, and particles in each, two or more
        angles, dihedrals : whether to list all of them
        more : other parameters of Topology, such as ``factors``
        """
        count, length = whole_number("chains.count", count, 1), whole_number("chains.length", length, 2)
        first = np.arange(count * length).reshape(count, length)[:, :-1].ravel()
        return cls(np.column_stack([first, first + 1]), angles, dihedrals, **more)

    def repeated(self, copies: int, least: int = 0) -> Topology:
        """Topology of equal molecules in a row; this one is that of the first, which ends with its last particle and
        has at least ``least`` particles."""
        copies = whole_number("repeated.copies", copies, 1)
        kinds, size = [*SIZES, "exclusions"], self.size(least)
        found: dict[str, Any] = {"factors": self.factors}
        for kind in kinds:
            items = getattr(self, kind)
            found[kind] = (items + size * np.arange(copies)[:, None, None]).reshape(-1, items.shape[1])
            if kind in SIZES:
                found[f"{kind[:-1]}_types"] = list(self.types(kind)) * copies
        return Topology(**found)

    def size(self, least: int = 0) -> int:
        """Number of particles up to the last one in the lists, and at least ``least``."""
        return max(least, 1 + max(int(getattr(self, kind).max(initial=-1)) for kind in (*SIZES, "exclusions")))

    def with_sites(self, joins: Ids) -> Topology:
        """The same lists, and virtual sites with the relatives of particles that bonds ``joins`` (m, 2) join."""
        found = copy(self)
        found._sites = joins
        return found

    @property
    def _paths(self) -> Ids:
        """Bonds (b, 2) by which particles are relatives, those of virtual sites included."""
        return np.concatenate([self.bonds, self._sites])

    @classmethod
    def from_ase(cls, atoms: Any, **more: Any) -> Topology:
        """Topology of an ``ase.Atoms`` that ASE's reader of LAMMPS data files made; ``more`` as for `chains`."""
        return cls(**replaced(from_atoms(atoms), more))

    @classmethod
    def from_mdanalysis(cls, universe: Any, **more: Any) -> Topology:
        """Topology of an ``MDAnalysis.Universe``: its bonds, angles, dihedrals and impropers with their types; ``more``
        as for `chains`."""
        return cls(**replaced(from_universe(universe), more))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Topology) and self.tables() == other.tables()

    def __hash__(self) -> int:
        return hash((*(len(getattr(self, kind)) for kind in SIZES), self.factors))

    def __str__(self) -> str:
        factors = [] if self.factors is None else [f"factors {', '.join(f'{each:g}' for each in self.factors)}"]
        return ", ".join([counts_text(self.counts()), *factors])

    def __repr__(self) -> str:
        return f"<Topology: {self}>"

    def tables(self) -> dict[str, Any]:
        """Table ``[topology]`` of a system file, which makes the same Topology."""
        found: dict[str, Any] = {}
        for kind in SIZES:
            if len(items := getattr(self, kind)):
                found[kind] = items.tolist()
                types = getattr(self, f"{kind[:-1]}_types")
                if set(types) != {DEFAULT_TYPE}:
                    found[f"{kind[:-1]}_types"] = types[0] if len(set(types)) == 1 else list(types)
        if self.factors is not None:
            found["factors"] = list(self.factors)
        if len(self.exclusions):
            found["exclusions"] = self.exclusions.tolist()
        return found

    def counts(self) -> dict[str, int]:
        """Numbers of bonds, angles, dihedrals, impropers and exclusions, without those of which there are none."""
        return {kind: len(items) for kind in (*SIZES, "exclusions") if len(items := getattr(self, kind))}

    def types(self, kind: str) -> tuple[str, ...]:
        """Type of each of the ``kind``: "bonds", "angles", "dihedrals" or "impropers"."""
        found: tuple[str, ...] = getattr(self, f"{kind[:-1]}_types")
        return found

    @property
    def scaled(self) -> Scaled:
        """Pairs whose pair forces are left out or scaled, sorted, and their factors; a factor of 1 is left out."""
        pairs = [np.sort(self.exclusions, axis=1)]
        factors = [np.zeros(len(self.exclusions))]
        scaling = [(k, factor) for k, factor in enumerate(self.factors or ()) if factor != 1.0]
        relatives = self._relatives() if scaling else ()
        for k, factor in scaling:
            pairs.append(relatives[k])
            factors.append(np.full(len(relatives[k]), factor))
        both, values = np.concatenate(pairs), np.concatenate(factors)
        both, first = np.unique(both, axis=0, return_index=True)
        return Scaled(both, values[first])

    def factor_of(self, first: Ids, second: Ids) -> NDArray[np.float64]:
        """Factor of the pair force between particles ``first`` and ``second``, both (m,)."""
        pairs, factors = self.scaled
        found = np.ones(len(first))
        if len(pairs):
            base = int(max(pairs.max(), first.max(initial=0), second.max(initial=0))) + 1
            known = pairs @ np.array([base, 1])
            asked = np.minimum(first, second) * base + np.maximum(first, second)
            at = np.minimum(np.searchsorted(known, asked), len(known) - 1)
            found[known[at] == asked] = factors[at[known[at] == asked]]
        return found

    def far_special(self, box: Box, x: Floats) -> str:
        """Description of the longest pair that pair forces leave out or scale, at positions x (3, n); "" if every such
        pair is short enough for its nearest image to be the one that the bonds join."""

        def apart(i: Ids, j: Ids) -> Floats:
            return box.minimum_image((x[:, j] - x[:, i]).T)

        named, height = box.narrowest
        if not box.periodic or not (len(self.exclusions) or set(self.factors or ()) - {1.0}):
            return ""
        longest = np.linalg.norm(apart(*self._paths.T), axis=1).max(initial=0.0)
        if not len(self.exclusions) and 3.0 * longest < LONGEST * height:
            return ""
        special = self.scaled.pairs
        pairs, along, left = [], [], np.ones(len(special), bool)
        for paths in shortest_paths(self._paths):
            chosen = paths[within(np.sort(paths[:, [0, -1]], axis=1), special)]
            pairs.append(chosen[:, [0, -1]])
            along.append(sum((apart(i, j) for i, j in pairwise(chosen.T)), start=np.zeros((len(chosen), 3))))
            left &= ~within(special, np.sort(pairs[-1], axis=1))
        if left.any():  # exclusions more than three bonds apart
            further, n = special[left], x.shape[1]
            molecule = molecules_of(self._paths, n)
            pairs.append(further[molecule[further[:, 0]] == molecule[further[:, 1]]])
            places = whole(self._paths, n, apart)
            along.append(places[pairs[-1][:, 1]] - places[pairs[-1][:, 0]])
        lengths = np.linalg.norm(np.concatenate(along), axis=1)
        if not (lengths >= LONGEST * height).any():
            return ""
        k = int(np.argmax(lengths))
        i, j = np.sort(np.concatenate(pairs)[k]).tolist()
        return (
            f"particles {i} and {j}, which the topology leaves out or scales, are {lengths[k]:.6g} apart along their "
            f"bonds; they must be under {LONGEST} of the {named}, {LONGEST * height:.6g}, so that the nearest image is "
            "the one that the bonds join"
        )

    def _relatives(self) -> Relatives:
        return Relatives.of(self._paths)

    def check(self, particles: int) -> None:
        """Refuse an item with a particle that does not exist."""
        for key in (*SIZES, "exclusions"):
            items = getattr(self, key)
            wrong = np.flatnonzero((items >= particles).any(axis=1))
            if wrong.size:
                item = items[wrong[0]]
                raise InputError(
                    f"topology: {key}[{wrong[0]}] = {item.tolist()}: there is no particle {item.max()}; "
                    f"particles are 0 to {particles - 1}"
                )

    def _check_exclusions(self) -> None:
        """Refuse an exclusion of a pair whose factor says that the pair interacts."""
        if self.factors is None or not len(self.exclusions):
            return
        own = [tuple(pair) for pair in np.sort(self.exclusions, axis=1).tolist()]
        for k, (found, factor) in enumerate(zip(self._relatives(), self.factors, strict=True)):
            related = set(map(tuple, found.tolist())) if factor != 0.0 else set()
            for e, pair in enumerate(own):
                if pair in related:
                    raise InputError(
                        f"topology: exclusions[{e}] = {list(pair)} leaves the pair out, but its particles are "
                        f"{APART[k]} and factors[{k}] = {factor:g} says that such pairs interact; expected one of both"
                    )


def counts_text(counts: Mapping[str, int]) -> str:
    """Numbers of bonds and so on as text."""
    return ", ".join(counted(count, kind[:-1], ",") for kind, count in counts.items()) or "nothing joined"


def _items(key: str, values: Any, size: int = 0) -> Ids:
    return items_of(f"topology: {key}", values, size or SIZES[key])


def is_index(value: Any) -> bool:
    """Whether the value is a whole number from 0 to the largest that arrays hold; True and False are not."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool) and 0 <= int(value) <= LARGEST


def items_of(key: str, values: Any, size: int) -> Ids:
    """Checked rows of ``size`` particles: whole numbers, no particle twice in a row, no row twice in either
    direction. Messages begin with ``key``."""
    if isinstance(values, bool) and not values:
        values = ()
    if isinstance(values, bool | Mapping | str):
        raise InputError(f"{key}: expected a list, got {shown(values)}")
    given = values if isinstance(values, np.ndarray) else listed(key, values, "a list")
    try:
        found = np.array(given)
    except ValueError:
        found = np.empty(0, object)
    if not len(given):
        return _read_only(np.zeros((0, size), np.int64))
    if found.ndim != 2 or found.shape[1] != size or found.dtype.kind not in "iu" or (found < 0).any():
        for k, row in enumerate(given):
            whole = isinstance(row, Sequence | np.ndarray) and len(row) == size
            if not (whole and all(map(is_index, row))):
                raise InputError(f"{key}[{k}]: expected the numbers of {size} particles, got {shown(row)}")
        raise InputError(f"{key}: expected lists of {size} particles, got {shown(values)}")
    found = found.astype(np.int64)
    ordered = np.sort(found, axis=1)
    same = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if same.size:
        row = found[same[0]].tolist()
        words = "joins a particle to itself" if size == 2 else "names a particle twice"
        raise InputError(f"{key}[{same[0]}] = {row} {words}")
    forward = np.where((found[:, :1] < found[:, -1:]), found, found[:, ::-1])
    _, first, inverse = np.unique(forward, axis=0, return_index=True, return_inverse=True)
    again = np.flatnonzero(first[inverse.reshape(-1)] != np.arange(len(found)))
    if again.size:
        k = int(again[0])
        before = first[inverse.reshape(-1)[k]]
        raise InputError(
            f"{key}[{k}] = {found[k].tolist()} is given twice, first as {key.rpartition(' ')[2]}[{before}]"
        )
    return _read_only(found)


def _read_only(array: Ids) -> Ids:
    array.flags.writeable = False
    return array


def _types(key: str, values: str | Sequence[str], count: int) -> tuple[str, ...]:
    if isinstance(values, str):
        return (values,) * count
    found = listed(f"topology: {key}", values, "a list of names")
    found = [str(each) if isinstance(each, int | np.integer) else each for each in found]
    wrong = [each for each in found if not (isinstance(each, str) and each.strip())]
    if wrong:
        raise InputError(f"topology: {key}: expected names, got {shown(wrong[0])}")
    if len(found) != count:
        raise InputError(f"topology: {key}: expected one name or {count}, got {len(found)}")
    return tuple(map(str, found))


def _factors(values: Any) -> tuple[float, ...]:
    found = listed("topology: factors", values, "three numbers")
    if len(found) != 3 or not all(is_number(each) and 0.0 <= each <= 1.0 for each in found):
        raise InputError(f"topology: factors: expected three numbers from 0 to 1, got {shown(values)}")
    return tuple(map(float, found))
