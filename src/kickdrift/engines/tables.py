"""Pair forces as tables for LAMMPS: Lennard-Jones with a switch, which it has not, and tables of the user's.

LAMMPS' ``pair_style table spline`` takes cubic splines of energy and force. The tables are dense enough that these
differ from the formula by rounding where particles are: see ``ERROR``.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.forces.pairs.ends import End
from kickdrift.model.state import Floats

POINTS = 20_000  # of a table, evenly in r^2
INNER = 0.5  # of sigma: no table holds nearer distances, at which LAMMPS stops
ERROR = 1e-12  # largest relative error of forces and energies in a liquid, as tests/contract/test_engines.py measures


class PairTable(NamedTuple):
    """Energy and force of a pair of types, counted from 1, at distances r."""

    types: tuple[int, int]
    r: Floats
    energy: Floats
    force: Floats


def table_of(law: Any, types: tuple[int, int], end: End) -> PairTable:
    """Table of a truncated law: of Lennard-Jones, or of a table of the user's."""
    cutoff = float(end.cutoff)
    r2 = np.linspace((law.start if hasattr(law, "start") else INNER * float(law.sigma)) ** 2, cutoff**2, POINTS)
    if hasattr(law, "start"):
        energy, over_r = np.array([law.law(each) for each in r2.tolist()]).T
    else:
        s6 = (float(law.sigma) ** 2 / r2) ** 3
        energy = 4.0 * float(law.epsilon) * (s6 * s6 - s6)
        over_r = 24.0 * float(law.epsilon) * (2.0 * s6 * s6 - s6) / r2
    r = np.sqrt(r2)
    return PairTable(types, r, *_truncated(end, r, energy, over_r))


def _truncated(end: End, r: Floats, energy: Floats, over_r: Floats) -> tuple[Floats, Floats]:
    """Energy and force; see ``forces.pairs.truncations``."""
    cutoff, start = float(end.cutoff), float(end.switch_start or 0.0)
    if end.truncation == "cut":
        return energy, over_r * r
    if end.truncation == "shift":
        return energy - energy[-1], over_r * r
    if end.truncation == "force-shift":
        last = over_r[-1] * cutoff
        return energy - energy[-1] + (r - cutoff) * last, over_r * r - last
    if end.truncation == "potential-switch":
        u = np.maximum((r - start) / (cutoff - start), 0.0)
        w = 1.0 - u
        factor = w**3 * (1.0 + u * (3.0 + u * 6.0))
        return energy * factor, over_r * factor * r + energy * 30.0 * (u * w) ** 2 / (cutoff - start)
    width = cutoff**2 - start**2
    u = np.maximum((r * r - start**2) / width, 0.0)
    w = 1.0 - u
    factor = w**5 * (1.0 + u * (5.0 + u * (15.0 + u * (35.0 + u * 70.0))))
    return energy * factor, (over_r * factor + energy * 1260.0 * (u * w) ** 4 / width) * r


def written(table: PairTable, path: Path) -> None:
    """Write a table as LAMMPS reads it, with the slopes of the force at both ends."""
    first, last = (float(np.gradient(table.force[part], table.r[part], edge_order=2)[at])
                   for part, at in ((slice(3), 0), (slice(-3, None), -1)))  # fmt: skip
    with path.open("w", encoding="ascii") as file:
        file.write(f"# written by kickdrift\n\npair\nN {POINTS} RSQ {float(table.r[0])!r} {float(table.r[-1])!r} ")
        file.write(f"FPRIME {first!r} {last!r}\n\n")
        for k, row in enumerate(zip(table.r.tolist(), table.energy.tolist(), table.force.tolist(), strict=True), 1):
            file.write(f"{k} {row[0]!r} {row[1]!r} {row[2]!r}\n")
