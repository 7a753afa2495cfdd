"""Rigid bonds and angles of a System's constraints, as LAMMPS' fix shake has them."""

import math
from collections.abc import Iterator

import numpy as np

from kickdrift.engines.forces import split
from kickdrift.model.molecules.relatives import Ids
from kickdrift.model.system import System

ROUNDED = 12  # digits of an angle by which rigid angles are of one type


def refusal(system: System) -> str | None:
    """Reason why fix shake cannot keep the System's constraints, or None."""
    if system.constraints is None:
        return None
    bonds, across = _parts(system)
    if missing := sorted(pair for pair, middle in across.items() if middle is None):
        return f"constraints: LAMMPS keeps bonds and angles between rigid bonds, and {list(missing[0])} is neither"
    for force in split(system)[1]:
        items = force.items(system)[0].tolist() if force.kind in ("bonds", "angles") else []
        for item in items:
            ends = min(item[0], item[-1]), max(item[0], item[-1])
            if ends in (bonds if force.kind == "bonds" else across):
                return f"constraints: {force.name} acts on the rigid {item}, and LAMMPS has no force on rigid ones"
    return None


def _parts(system: System) -> tuple[dict[tuple[int, int], float], dict[tuple[int, int], tuple[int, float] | None]]:
    """Lengths of the rigid bonds; and of each other rigid pair the particle between both and the angle in degrees, or
    None if the pair is no angle between rigid bonds."""
    assert system.constraints is not None
    pairs = np.sort(system.constraints.pairs, axis=1).tolist()
    lengths = dict(zip(map(tuple, pairs), system.constraints.lengths.tolist(), strict=True))
    listed = () if system.topology is None else np.sort(system.topology.bonds, axis=1).tolist()
    bonds = {pair: lengths[pair] for pair in map(tuple, listed) if pair in lengths}
    partners: dict[int, set[int]] = {}
    for i, j in bonds:
        partners.setdefault(i, set()).add(j)
        partners.setdefault(j, set()).add(i)
    across: dict[tuple[int, int], tuple[int, float] | None] = {}
    for (i, j), length in lengths.items():
        if (i, j) in bonds:
            continue
        middle = min(partners.get(i, set()) & partners.get(j, set()), default=None)
        across[i, j] = None
        if middle is not None:
            a, b = (bonds[min(end, middle), max(end, middle)] for end in (i, j))
            cosine = (a * a + b * b - length * length) / (2.0 * a * b)
            across[i, j] = middle, math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
    return bonds, across


def rigid_items(system: System, kind: str) -> Iterator[tuple[Ids, float]]:
    """Yield rigid bonds (m, 2) of one length, or rigid angles (m, 3) of one angle in degrees."""
    if system.constraints is None or kind not in ("bonds", "angles"):
        return
    bonds, across = _parts(system)
    found: dict[float, list[tuple[int, ...]]] = {}
    if kind == "bonds":
        assert system.topology is not None
        for i, j in system.topology.bonds.tolist():
            if (pair := (min(i, j), max(i, j))) in bonds:
                found.setdefault(bonds[pair], []).append((i, j))
    else:
        for (i, j), angle in across.items():
            if angle is not None:
                found.setdefault(round(angle[1], ROUNDED), []).append((i, angle[0], j))
    for size, items in found.items():
        yield np.array(items, np.int64), size
