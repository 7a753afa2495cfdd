"""A System as GROMACS' topology, .top, and coordinates, .gro; `kickdrift.bridges.openmm.files` reads them back.

Runs of equal particles that no term joins to others are molecules, so that water is written once. A topology has no
cutoffs and no methods, which are a run's settings: comments at its top say them in the words of an .mdp file.
"""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.disk.kinds import GROMACS_COORDINATES, GROMACS_FILE, GROMACS_TOPOLOGY
from kickdrift.disk.outputs import checked_target, written_whole
from kickdrift.errors import InputError
from kickdrift.forces import (
    Coulomb,
    HarmonicAngle,
    HarmonicBond,
    HarmonicImproper,
    LennardJones,
    ListedPairs,
    PeriodicDihedral,
    PeriodicImproper,
    RyckaertBellemans,
)
from kickdrift.forces.charges.coulomb import coulomb_of
from kickdrift.model.molecules.relatives import Relatives, molecules_of
from kickdrift.model.system import System
from kickdrift.model.units.constants import SYMBOLS
from kickdrift.systemfile.converting import MOLECULAR
from kickdrift.text import choices, clean

Line = tuple[str, tuple[int, ...], str]  # section, particles, and what follows them
SYMBOL = re.compile(r"[A-Z][a-z]?(?![a-z])")
SAME = 1e-7  # relative, between the factors of charges of all pairs three bonds apart
DIGITS = 12  # of a coordinate, behind the point

TERMS: dict[type, tuple[str, Callable[[Any], tuple[Any, ...]]]] = {  # section, function and parameters of a law
    HarmonicBond: ("bonds", lambda p: (1, p.length, p.stiffness)),
    HarmonicAngle: ("angles", lambda p: (1, p.rest, p.stiffness)),
    PeriodicDihedral: ("dihedrals", lambda p: (9, p.phase, p.barrier, int(p.multiplicity))),
    PeriodicImproper: ("dihedrals", lambda p: (4, p.phase, p.barrier, int(p.multiplicity))),
    HarmonicImproper: ("dihedrals", lambda p: (2, p.rest, p.stiffness)),
    RyckaertBellemans: ("dihedrals", lambda p: (3, *p)),
}
ORDER = ("bonds", "constraints", "pairs", "angles", "dihedrals", "virtual_sites2", "virtual_sites3", "exclusions")
MODIFIERS = {"cut": "none", "shift": "potential-shift", "potential-switch": "potential-switch"}
METHODS = {"auto": "PME", "pme": "PME", "ewald": "Ewald", "reaction-field": "Reaction-Field", "direct": "Cut-off"}


class Written(NamedTuple):
    """Files of a System in GROMACS' formats."""

    top: Path
    gro: Path

    @property
    def files(self) -> tuple[Path, ...]:
        """Both files."""
        return tuple(self)


def to_gromacs(system: System, path: str | os.PathLike[str], overwrite: bool = False) -> Written:
    """Write the files; see `System.to_gromacs`."""
    given = Path(path)
    if given.suffix.lower() not in (".top", ".gro"):
        raise InputError(f"to_gromacs: {given}: expected a name that ends in .top or .gro")
    if system.units.name not in MOLECULAR:
        raise InputError(f"to_gromacs: units {system.units.name!r}: expected {choices(MOLECULAR)}")
    _refuse(system)
    system = system.in_units("gromacs")
    top, gro = "".join(_topology(system)), "".join(_coordinates(system))
    target = Written(given.with_suffix(".top"), given.with_suffix(".gro"))
    for each in target.files:
        checked_target(each, GROMACS_FILE, overwrite)
    for each, text in zip(target.files, (top, gro), strict=True):
        with written_whole(each, GROMACS_FILE, overwrite=overwrite) as part:
            part.write_text(text, encoding="utf-8")
    return target


def _refuse(system: System) -> None:
    """Refuse what GROMACS' topology does not have, or kickdrift does not write."""
    if system.dimensions != 3 or (system.box.periodic and not all(system.box.periodic_axes)):
        raise InputError("to_gromacs: boxes are periodic along three axes, or open")
    if system.fixed is not None:
        raise InputError("to_gromacs: fixed particles: GROMACS holds them by freezegrps of its .mdp")
    for force in system.forces:
        if type(force) not in (*TERMS, LennardJones, Coulomb, ListedPairs):
            raise InputError(f"to_gromacs: force {force.name!r} has no counterpart in the topology that is written")
    if sum(isinstance(force, LennardJones) for force in system.forces) > 1:
        raise InputError("to_gromacs: lennard-jones: the system has several, and GROMACS one")
    if (force := _lennard_jones(system)) is not None and len(force.ends(system.species)) > 1:
        raise InputError("to_gromacs: lennard-jones: its pairs have several cutoffs, and GROMACS has one")


def _lennard_jones(system: System) -> Any:
    return next((force for force in system.forces if isinstance(force, LennardJones)), None)


def _names(system: System) -> list[str]:
    """A name of one word for each species, which begins with a letter."""
    found: list[str] = []
    for species in system.species:
        name = re.sub(r"\W", "_", species, flags=re.ASCII)
        name = name if name[:1].isalpha() else f"T{name}"
        found.append(name if name not in found else f"{name}_{len(found)}")
    return found


def _number(species: str) -> int:
    """The atomic number of the element whose symbol begins a species such as "C1"; 0 if there is none."""
    found = SYMBOL.match(species)
    return SYMBOLS.index(found[0]) if found and found[0] in SYMBOLS else 0


def _row(*values: Any) -> str:
    """Numbers with all digits, and words."""
    return " ".join(each if isinstance(each, str) else repr(each) for each in values)


def _topology(system: System) -> Iterator[str]:
    """Yield the text of the .top."""
    yield f"{GROMACS_TOPOLOGY}: {clean(system.name, 80)}\n; {_settings(system)}\n\n"
    pairs, factor = _pairs(system)
    yield f"[ defaults ]\n1 2 no 1.0 {factor!r}\n\n[ atomtypes ]\n"
    names, lennard_jones = _names(system), _lennard_jones(system)
    masses = system.state.masses
    sites = set(system.virtual_sites.particles.tolist()) if system.virtual_sites is not None else set()
    for k, (name, species) in enumerate(zip(names, system.species, strict=True)):
        law = None if lennard_jones is None else lennard_jones.pair_law(species, species)
        own = np.flatnonzero(system.species_index == k)
        kind = "V" if own.size and sites.issuperset(own.tolist()) else "A"
        well = (0.1, 0.0) if law is None else (float(law.sigma), float(law.epsilon))
        yield _row(name, _number(species), float(masses[own[0]]) if own.size else 0.0, 0.0, kind, *well) + "\n"
    if lennard_jones is not None and lennard_jones.pairs:
        yield "\n[ nonbond_params ]\n"
        for a, b in lennard_jones.pairs:
            law = lennard_jones.pair_law(a, b)
            first, second = (names[list(system.species).index(each)] for each in (a, b))
            yield _row(first, second, 1, float(law.sigma), float(law.epsilon)) + "\n"
    yield from _molecules(system, names, [*_lines(system), *pairs])


def _settings(system: System) -> str:
    """The .mdp's words for cutoffs and methods."""
    lennard_jones, coulomb = _lennard_jones(system), coulomb_of(system)
    found = []
    if lennard_jones is not None:
        end = lennard_jones.truncation
        known = f"vdw-modifier = {MODIFIERS.get(end)}" if end in MODIFIERS else f"no vdw-modifier is truncation {end}"
        found += [f"rvdw = {lennard_jones.cutoff:g}", known]
        found += [f"rvdw-switch = {lennard_jones.switch_start:g}"] if end == "potential-switch" else []
        found += ["DispCorr = EnerPres"] if lennard_jones.tail else []
    if coulomb is not None:
        method = coulomb.method
        known = f"coulombtype = {METHODS[method]}" if method in METHODS else f"no coulombtype is method {method}"
        found += [known, *([f"rcoulomb = {coulomb.cutoff:g}"] if coulomb.cutoff else [])]
        found += [f"epsilon-rf = {coulomb.surroundings or 0.0:g}"] if method == "reaction-field" else []
        found += [f"epsilon-r = {coulomb.dielectric:g}"] if coulomb.dielectric != 1.0 else []
    return f"settings for the .mdp: {', '.join(found) or 'none'}"


def _lines(system: System) -> Iterator[Line]:
    """Yield the terms of bonds, angles, dihedrals, constraints and virtual sites."""
    acting = set()
    for force in system.forces:
        if type(force) in TERMS:
            section, parameters = TERMS[type(force)]
            items, laws, which = force.items(system)
            texts = [_row(*parameters(law)) for law in laws]
            for item, law in zip(items.tolist(), which.tolist(), strict=True):
                acting.add(tuple(sorted(item)))
                yield section, tuple(item), texts[law]
    topology = system.topology
    bonds = dict.fromkeys(() if topology is None else (tuple(sorted(pair)) for pair in topology.bonds.tolist()))
    rigid: set[tuple[int, ...]] = set()
    if system.constraints is not None:
        for pair, length in zip(system.constraints.pairs.tolist(), system.constraints.lengths.tolist(), strict=True):
            key = tuple(sorted(pair))
            rigid.add(key)
            yield "constraints", tuple(pair), _row(1 if key in bonds else 2, length)
    for pair in bonds:
        if pair not in acting and pair not in rigid:  # a bond without a force
            yield "bonds", pair, _row(1, 0.1, 0.0)
    if system.virtual_sites is not None:
        sites = system.virtual_sites
        for site, of, shares, normal in zip(*(each.tolist() for each in (sites.particles, sites.of, sites.shares,
                                                                       sites.normal)), strict=True):  # fmt: skip
            if of[1] == of[2]:
                yield "virtual_sites2", (site, *of[:2]), _row(1, float(sum(shares)))
            else:
                yield "virtual_sites3", (site, *of), _row(*((4, *shares, normal) if normal else (1, *shares)))


def _pairs(system: System) -> tuple[list[Line], float]:
    """The pairs with a force of their own, and those that all pair forces leave out, as lines; and the factor of the
    charges of the first."""
    terms: dict[tuple[int, int], tuple[float, float, float]] = {}
    charges = np.zeros(len(system)) if system.charges is None else system.charges
    left: set[tuple[int, int]] = set()
    lennard_jones = _lennard_jones(system)
    if system.topology is not None:
        for (i, j), factor in zip(*(part.tolist() for part in system.topology.scaled), strict=True):
            left.add((i, j))
            if factor:
                a, b = (system.species[system.species_index[each]] for each in (i, j))
                law = None if lennard_jones is None else lennard_jones.pair_law(a, b)
                well = (0.1, 0.0) if law is None else (law.sigma, factor * law.epsilon)
                terms[i, j] = factor * float(charges[i] * charges[j]), *well
    for force in system.forces:
        if isinstance(force, ListedPairs):
            values = (np.broadcast_to(given, len(force.pairs)).tolist() for given in
                      (force.charges, force.sigma, force.epsilon))  # fmt: skip
            for (i, j), *term in zip(force.pairs, *values, strict=True):
                key = min(i, j), max(i, j)
                if key not in left or key in terms:
                    raise InputError(
                        f"to_gromacs: listed-pairs: pair {[i, j]} is not left out of the other pair forces, and a "
                        "topology has one term for each pair"
                    )
                terms[key] = float(term[0]), float(term[1]), float(term[2])
    factor = _factor(terms, charges)
    found: list[Line] = [("pairs", pair, _row(1, sigma, epsilon)) for pair, (_, sigma, epsilon) in terms.items()]
    return found + [("exclusions", pair, "") for pair in sorted(left)], factor


def _factor(terms: dict[tuple[int, int], tuple[float, float, float]], charges: Any) -> float:
    """The factor of the charges of all pairs with a force of their own: fudgeQQ."""
    first = None
    for (i, j), (product, *_) in terms.items():
        whole = float(charges[i] * charges[j])
        if whole and first is None:
            first = product / whole
        if abs(product - (first or 0.0) * whole) > SAME * max(abs(whole), abs(product)):
            raise InputError(
                f"to_gromacs: the charges of pair {[i, j]} are not scaled as those of others: a topology has one factor"
            )
    return 1.0 if first is None else first


def _blocks(system: System, lines: list[Line]) -> list[tuple[int, int]]:
    """First particle and end of each molecule: particles in a row that terms join."""
    joined = [(items[0], each) for _, items, _ in lines for each in items[1:]]
    labels = molecules_of(np.array(joined, np.int64).reshape(-1, 2), len(system))
    last = np.zeros(int(labels.max(initial=0)) + 1, np.int64)
    np.maximum.at(last, labels, np.arange(len(system)))
    found, begin, end = [], 0, 0
    for i, label in enumerate(labels.tolist()):
        if i > end or i == 0:
            if i:
                found.append((begin, i))
            begin, end = i, i
        end = max(end, int(last[label]))
    return [*found, (begin, len(system))]


def _molecules(system: System, names: list[str], lines: list[Line]) -> Iterator[str]:
    """Yield the types of molecules and their numbers."""
    blocks = _blocks(system, lines)
    of = np.zeros(len(system), np.int64)
    for k, (begin, end) in enumerate(blocks):
        of[begin:end] = k
    parts: list[list[Line]] = [[] for _ in blocks]
    for section, items, text in lines:
        k = int(of[items[0]])
        parts[k].append((section, tuple(each - blocks[k][0] for each in items), text))
    charges = np.zeros(len(system)) if system.charges is None else system.charges
    atoms = list(zip((names[k] for k in system.species_index.tolist()), charges.tolist(),
                     system.state.masses.tolist(), strict=True))  # fmt: skip
    known: dict[Any, str] = {}
    numbers: list[list[Any]] = []
    for (begin, end), own in zip(blocks, parts, strict=True):
        key = (tuple(atoms[begin:end]), tuple(own))
        if key not in known:
            known[key] = f"M{len(known) + 1}"
            yield from _molecule(known[key], atoms[begin:end], own)
        if numbers and numbers[-1][0] == known[key]:
            numbers[-1][1] += 1
        else:
            numbers.append([known[key], 1])
    yield f"\n[ system ]\n{clean(system.name, 80)}\n\n[ molecules ]\n"
    yield from (f"{name} {count}\n" for name, count in numbers)


def _molecule(name: str, atoms: list[tuple[str, float, float]], lines: list[Line]) -> Iterator[str]:
    """Yield the text of one type of molecule. Relatives by bonds, up to three bonds apart, are left out by the number
    of bonds if all of them are, and others one by one."""
    sections: dict[str, list[str]] = defaultdict(list)
    out = {tuple(sorted(items)) for section, items, _ in lines if section == "exclusions"}
    bonds = [items for section, items, text in lines
             if section == "bonds" or (section == "constraints" and text.startswith("1 "))]  # fmt: skip
    near = 0
    for relatives in Relatives.of(np.array(bonds, np.int64).reshape(-1, 2)):
        pairs = set(map(tuple, relatives.tolist()))
        if not pairs <= out:
            break
        near, out = near + 1, out - pairs
    for section, items, text in lines:
        if section != "exclusions" or tuple(sorted(items)) in out:
            sections[section].append(f"{' '.join(str(each + 1) for each in items)} {text}".rstrip())
    yield f"\n[ moleculetype ]\n{name} {near}\n\n[ atoms ]\n"
    for k, (kind, charge, mass) in enumerate(atoms, 1):
        yield _row(str(k), kind, "1", name, kind[:5], str(k), charge, mass) + "\n"
    for section in ORDER:
        if sections[section]:
            yield f"\n[ {section} ]\n" + "".join(f"{line}\n" for line in sections[section])


def _coordinates(system: System) -> Iterator[str]:
    """Yield the text of the .gro."""
    names = [name[:5] for name in _names(system)]
    yield f"{GROMACS_COORDINATES}: {clean(system.name, 80)}\n{len(system)}\n"
    width = DIGITS + 5
    for k, (kind, x, v) in enumerate(zip(system.species_index.tolist(), system.state.positions.tolist(),
                                         system.state.velocities.tolist(), strict=True), 1):  # fmt: skip
        places = "".join(f"{each:{width}.{DIGITS}f}" for each in x)
        speeds = "".join(f"{each:{width}.{DIGITS + 1}f}" for each in v)
        yield f"{1:5d}{'MOL':<5}{names[kind]:>5}{k % 100000:5d}{places}{speeds}\n"
    if not system.box.periodic:
        yield "0.0 0.0 0.0\n"
        return
    edges = system.box.matrix
    leaning = [edges[0, 1], edges[0, 2], edges[1, 0], edges[1, 2], edges[2, 0], edges[2, 1]]
    yield _row(*map(float, [*np.diag(edges), *(leaning if np.any(leaning) else [])])) + "\n"
