"""Bonds, angles, dihedrals and impropers of LAMMPS as terms of kickdrift's laws."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

from kickdrift.bridges.lammps.reading import Read, Row
from kickdrift.bridges.openmm.terms import Molecules
from kickdrift.errors import InputError
from kickdrift.forces import (
    CosineAngle,
    Fene,
    HarmonicAngle,
    HarmonicBond,
    HarmonicImproper,
    ListedPairs,
    MorseBond,
    OplsDihedral,
    PeriodicDihedral,
    PeriodicImproper,
    RyckaertBellemans,
)

Term = tuple[Any, tuple[float, ...]]
KINDS = {"bonds": "Bond", "angles": "Angle", "dihedrals": "Dihedral", "impropers": "Improper"}
ZERO = ("zero", "none")  # styles without a force


class _Lacking(Exception):
    """kickdrift has no such term, for the given reason."""


def _fene(values: list[float]) -> list[Term]:
    stiffness, length, epsilon, sigma = values
    return [(Fene, (stiffness, length, epsilon, sigma if epsilon else 1.0))]


def _charmm_angle(values: list[float]) -> list[Term]:
    stiffness, rest, across, length = values
    urey_bradley = [(HarmonicBond, (2.0 * across, length))] if across else []
    return [(HarmonicAngle, (2.0 * stiffness, rest)), *urey_bradley]


def _charmm_dihedral(values: list[float]) -> list[Term]:
    barrier, multiplicity, phase, weight = values
    pairs = [(ListedPairs, (weight,))] if weight else []  # between the ends, by CHARMM's 1-4 parameters
    return [(PeriodicDihedral, (barrier, multiplicity, phase)), *pairs]


def _harmonic_dihedral(values: list[float]) -> list[Term]:
    barrier, sign, multiplicity = values[:3]
    return [(PeriodicDihedral, (barrier, multiplicity, 0.0 if sign > 0 else 180.0))]


def _fourier_dihedral(values: list[float]) -> list[Term]:
    return [(PeriodicDihedral, tuple(values[k : k + 3])) for k in range(1, len(values), 3)]


def _multi_harmonic(values: list[float]) -> list[Term]:
    a, b, c, d, e = values
    return [(RyckaertBellemans, (a, -b, c, -d, e, 0.0))]


STYLES: dict[str, dict[str, Callable[[list[float]], list[Term]]]] = {
    "bonds": {
        "harmonic": lambda v: [(HarmonicBond, (2.0 * v[0], v[1]))],
        "fene": _fene,
        "morse": lambda v: [(MorseBond, tuple(v[:3]))],
    },
    "angles": {
        "harmonic": lambda v: [(HarmonicAngle, (2.0 * v[0], v[1]))],
        "cosine": lambda v: [(CosineAngle, (v[0],))],
        "charmm": _charmm_angle,
    },
    "dihedrals": {
        "charmm": _charmm_dihedral,
        "harmonic": _harmonic_dihedral,
        "fourier": _fourier_dihedral,
        "opls": lambda v: [(OplsDihedral, tuple(v[:4]))],
        "multi/harmonic": _multi_harmonic,
    },
    "impropers": {
        "harmonic": lambda v: [(HarmonicImproper, (2.0 * v[0], v[1]))],
        "cvff": lambda v: [(PeriodicImproper, (v[0], v[2], 0.0 if v[1] > 0 else 180.0))],
    },
}


def molecules_of(
    read: Read, number: dict[int, int], rigid: Mapping[str, Collection[int]]
) -> tuple[Molecules, list[ListedPairs]]:
    """All terms between listed particles, and the force between the ends of dihedrals. ``number`` gives the row of an
    id. Types of bonds and angles that are ``rigid`` have no force, as in LAMMPS."""
    lists = {kind: read.arrays[kind] for kind in KINDS if len(read.arrays.get(kind, ()))}
    bonds = [(number[i], number[j]) for _, i, j in lists.get("bonds", ())]
    found, ends = Molecules(bonds), dict[tuple[int, int], float]()
    for kind, items in lists.items():
        terms = _terms(read, kind, set(items[:, 0].tolist()), rigid.get(kind, ()))
        into = getattr(found, kind)
        for which, *ids in items.tolist():
            item = tuple(number[each] for each in ids)
            for cls, values in terms[which]:
                if cls is ListedPairs:
                    pair = min(item[0], item[-1]), max(item[0], item[-1])
                    ends[pair] = ends.get(pair, 0.0) + values[0]
                elif kind == "angles" and cls is HarmonicBond:
                    found.bonds.add((item[0], item[-1]), cls, *values)
                else:
                    into.add(item, cls, *values)
    return found, _pairs_of_ends(read, ends)


def _pairs_of_ends(read: Read, weights: Mapping[tuple[int, int], float]) -> list[ListedPairs]:
    """The force between the ends of CHARMM's dihedrals, with these weights; none without a weight."""
    acting = {pair: weight for pair, weight in weights.items() if weight}
    if not acting:
        return []
    if not all(f"pair_{key}" in read.arrays for key in ("lj14_3", "lj14_4")):
        raise InputError(
            "dihedral_style charmm: its weights of pairs three bonds apart need a pair_style with parameters for them, "
            "such as lj/charmm/coul/long"
        )
    i, j = np.array([*acting]).T
    kinds, weight = read.arrays["type"].astype(np.int64), np.array([*acting.values()])
    twelve, six = (read.arrays[f"pair_{key}"][kinds[i], kinds[j]] for key in ("lj14_3", "lj14_4"))
    well = (six > 0) & (twelve > 0)
    safe, over = np.where(well, six, 1.0), np.where(well, twelve, 1.0)
    epsilon, sigma = np.where(well, safe**2 / (4.0 * over), 0.0), (over / safe) ** (1.0 / 6.0)
    charges = read.arrays.get("q", np.zeros(len(kinds)))
    products = weight * charges[i] * charges[j]
    return [ListedPairs([*acting], (weight * epsilon).tolist(), sigma.tolist(), products.tolist())]


def _terms(read: Read, kind: str, used: Collection[int], rigid: Collection[int]) -> dict[int, list[Term]]:
    """The terms of each type that is used. Raises InputError for a style that kickdrift lacks."""
    word = KINDS[kind]
    asked = read.last(f"{word.lower()}_style")[:1]
    rows = {row.types[0]: row for row in read.rows(word)}
    found: dict[int, list[Term]] = {}
    for which in sorted(used):
        if which in rigid or (asked and asked[0] in ZERO):
            found[which] = []
        elif which not in rows:
            named = asked[0] if asked else "none"
            raise InputError(f"{word.lower()}_style {named}: LAMMPS does not tell the coefficients of type {which}")
        else:
            found[which] = _of_row(word.lower(), STYLES[kind], rows[which])
    return found


def _of_row(word: str, styles: dict[str, Callable[[list[float]], list[Term]]], row: Row) -> list[Term]:
    if row.style in ZERO:
        return []
    style = row.style.split("/omp")[0]
    try:
        if style not in styles:
            raise _Lacking("")
        return styles[style](row.numbers())
    except _Lacking as lacking:
        what = f"; {lacking}" if str(lacking) else f"; it has {', '.join(styles)}"
        raise InputError(
            f"{word}_style {row.style}: type {row.types[0]} has no counterpart in kickdrift{what}"
        ) from None
    except ValueError:
        raise InputError(
            f"{word}_coeff {row.types[0]}: LAMMPS tells {' '.join(row.values)}, and not all numbers"
        ) from None
