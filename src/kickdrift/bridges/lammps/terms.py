"""Bonds, angles, dihedrals and impropers of LAMMPS as terms of kickdrift's laws."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

from kickdrift.bridges.lammps.reading import Read, Row
from kickdrift.bridges.openmm.terms import Molecules
from kickdrift.errors import InputError
from kickdrift.forces import (
    CosineAngle,
    Fene,
    HarmonicAngle,
    HarmonicBond,
    HarmonicImproper,
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
    stiffness, rest, across, _ = values
    if across:
        raise _Lacking("its Urey-Bradley term, a spring across the angle")
    return [(HarmonicAngle, (2.0 * stiffness, rest))]


def _charmm_dihedral(values: list[float]) -> list[Term]:
    barrier, multiplicity, phase, weight = values
    if weight:
        raise _Lacking("its weight of pairs three bonds apart")
    return [(PeriodicDihedral, (barrier, multiplicity, phase))]


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


def molecules_of(read: Read, number: dict[int, int], rigid: Mapping[str, Collection[int]]) -> Molecules:
    """All terms between listed particles. ``number`` gives the row of an id. Types of bonds and angles that are
    ``rigid`` have no force, as in LAMMPS."""
    lists = {kind: read.arrays[kind] for kind in KINDS if len(read.arrays.get(kind, ()))}
    bonds = [(number[i], number[j]) for _, i, j in lists.get("bonds", ())]
    found = Molecules(bonds)
    for kind, items in lists.items():
        terms = _terms(read, kind, set(items[:, 0].tolist()), rigid.get(kind, ()))
        into = getattr(found, kind)
        for which, *ids in items.tolist():
            item = tuple(number[each] for each in ids)
            for cls, values in terms[which]:
                into.add(item, cls, *values)
    return found


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
