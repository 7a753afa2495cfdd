"""Bonds, angles, dihedrals and impropers in LAMMPS' terms: styles, coefficients and the lists of a data file."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.bridges.lammps_data import DataFile
from kickdrift.engines.bonded import LAWS, split, strange
from kickdrift.model.molecules.relatives import measured
from kickdrift.model.molecules.topology import SIZES
from kickdrift.model.state import Floats
from kickdrift.model.system import System

ROOM = 1.6  # particles of one item may come this much further apart than at the start


class Bonded(NamedTuple):
    """Bonded part of a model.

    Attributes
    ----------
    commands : styles, coefficients and factors
    lists : for each kind, rows of a type and particles, both from 1
    types : number of types of each kind
    reach : distance over which processes must know each other's particles
    """

    commands: tuple[str, ...]
    lists: dict[str, NDArray[np.int64]]
    types: dict[str, int]
    reach: float


def refusal(system: System) -> str | None:
    """Reason why LAMMPS cannot run the System's topology, or None."""
    if reason := strange(system, "LAMMPS"):
        return reason
    if system.topology is not None and len(system.topology.exclusions):
        return "exclusions: LAMMPS leaves out only particles up to three bonds apart (topology.factors)"
    for force in split(system)[1]:
        for law in force.items(system)[1]:
            if LAWS[type(force)].coefficients(law) is None:
                return f"force {force.name!r}: LAMMPS has no such parameters, {law._asdict()}"
    return None


def bonded_of(system: System) -> Bonded | None:
    """Bonded part of the model of a System; None without a topology."""
    topology = system.topology
    if topology is None:
        return None
    commands: list[str] = []
    lists, types, longest = {}, {}, 0.0
    for kind, size in SIZES.items():
        word = kind[:-1]
        rows, styles = [np.zeros((0, size + 1), np.int64)], list[str]()
        lines: list[tuple[str, Any]] = []
        for force in (each for each in split(system)[1] if each.kind == kind):
            items, laws, which = force.items(system)
            terms = LAWS[type(force)]
            styles.append(terms.style)
            rows.append(np.column_stack([len(lines) + 1 + which, items + 1]))
            lines += [(terms.style, terms.coefficients(law)) for law in laws]
        every = getattr(topology, kind)
        free = every[~np.isin(np.arange(len(every)), _listed(every, rows))] + 1
        if kind == "bonds" and len(free):  # they count for the factors of pairs
            styles.append("zero")
            rows.append(np.column_stack([np.full(len(free), len(lines) + 1), free]))
            lines.append(("zero", ()))
        if not lines:
            continue
        hybrid = len(set(styles)) > 1
        commands.append(f"{word}_style {'hybrid ' if hybrid else ''}{' '.join(dict.fromkeys(styles))}")
        for number, (style, values) in enumerate(lines, 1):
            text = " ".join(map(repr, values or ()))
            commands.append(f"{word}_coeff {number} {f'{style} ' if hybrid else ''}{text}")
        lists[kind], types[kind] = np.concatenate(rows), len(lines)
        for force in (each for each in split(system)[1] if type(each).__name__ == "Fene"):
            longest = max(longest, *(float(law.length) for law in force.items(system)[1]))
        bonds = np.concatenate([every[:, k : k + 2] for k in range(size - 1)])
        longest = max(longest, float(measured(system.box, system.state.phase[0], bonds, "bonds").max(initial=0.0)))
    factors = " ".join(map(repr, topology.factors or (1.0, 1.0, 1.0)))
    commands.insert(0, f"special_bonds lj {factors}")
    most = max((SIZES[kind] for kind in lists), default=2)
    return Bonded(tuple(commands), lists, types, ROOM * (most - 1) * longest)


def _listed(every: NDArray[np.int64], rows: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Numbers of the items that some force has."""
    number = {tuple(item): k for k, item in enumerate((every + 1).tolist())}
    return np.array([number[tuple(row[1:])] for part in rows for row in part.tolist()], np.int64)


def read_particles(lmp: Any, model: Any, edges: Sequence[float], x: Floats, v: Floats) -> None:
    """Make the box, the particles and their lists in LAMMPS, through a data file in a temporary folder."""
    bonded = model.bonded
    data = DataFile(
        "kickdrift", np.reshape(edges, (3, 2)), model.box.tilts, model.masses, (), np.arange(1, len(x) + 1),
        model.types, np.ones(len(x), np.int64), x, v, bonded.lists, bonded.types, {},
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "start.data"
        with path.open("w", encoding="ascii") as file:
            file.writelines(data.lines())
        lmp.command(f"read_data {path}")
