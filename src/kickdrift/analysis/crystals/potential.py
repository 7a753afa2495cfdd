"""What a file of a potential holds, and the crystals that its elements form under it."""

from __future__ import annotations

import itertools
import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces import EmbeddedAtom, StillingerWeber, Tersoff
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.many_body.tables import STYLES
from kickdrift.model.starts.builders import LATTICES, lattice
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.text import clean

SUFFIXES = (*STYLES, *StillingerWeber.forms, *Tersoff.forms)
KINDS = ("fcc", "bcc", "sc", "diamond")
BONDS = {"fcc": 0.5**0.5, "bcc": 0.75**0.5, "sc": 1.0, "diamond": 0.1875**0.5}  # distance of neighbours over a
NEAREST = np.linspace(1.2, 4.4, 65)  # distances of neighbours in angstroms at which an energy is looked for
NOTE = 300  # letters of the first line that are shown
DIGITS = 1e-7  # of a lattice constant
BOUND = -0.05  # eV; an element whose crystals bind less has none here, such as helium


class Crystal(NamedTuple):
    """A crystal of one element, and its energy over the lattice constant.

    Attributes
    ----------
    element : name in the file
    kind : fcc, bcc, sc or diamond
    constant : lattice constant in angstroms
    energy : of an atom, in eV
    constants, energies : (m,) lattice constants, and energies of an atom there
    """

    element: str
    kind: str
    constant: float
    energy: float
    constants: Floats
    energies: Floats


class PotentialFile(NamedTuple):
    """A file of a potential.

    Attributes
    ----------
    path : of the file
    force : the force with this file
    note : first line of the file
    crystals : of each element, the lowest energy first; none for elements that form none of the four
    """

    path: Path
    force: ManyBodyForce
    note: str
    crystals: tuple[Crystal, ...]

    def lines(self) -> list[tuple[str, str]]:
        """Lines of what the file holds, as pairs of a key and a text."""
        found = [
            ("potential", f"{self.path.name}: force {self.force.name!r}, units metal"),
            ("note", self.note),
            ("elements", ", ".join(self.force.known)),
            ("cutoff", f"{self.force.cutoff:.6g} angstrom"),
        ]
        for element, crystals in itertools.groupby(self.crystals, key=lambda each: each.element):
            first, *others = crystals
            found.append((element, f"{first.kind}, a = {first.constant:.5f} angstrom, {first.energy:.5f} eV an atom"))
            found += [
                ("", f"{each.kind}, a = {each.constant:.5f} angstrom, {each.energy - first.energy:+.5f} eV")
                for each in others
            ]
        without = [name for name in self.force.known if name not in {each.element for each in self.crystals}]
        return [*found, *((name, "no fcc, bcc, sc or diamond crystal alone") for name in without)]


def is_potential(path: str | os.PathLike[str]) -> bool:
    """Whether a name ends as a file of a potential that kickdrift reads."""
    return str(path).endswith(SUFFIXES)


def potential_file(path: str | os.PathLike[str]) -> PotentialFile:
    """What a file of embedded atoms, Stillinger-Weber or Tersoff holds, with the crystals of each element.

    Lattice constants are those of least energy, to 1e-7, among crystals at rest. Raises InputError for other files."""
    path = Path(path)
    kind: Any = next((kind for kind, ends in _kinds() if str(path).endswith(ends)), None)
    if kind is None:
        raise InputError(f"{path}: expected the name of a potential's file, which ends in {', '.join(SUFFIXES)}")
    force = kind(file=str(path))
    with open(path, encoding="utf-8", errors="replace") as file:
        note = clean(" ".join(file.readline(NOTE).lstrip("# ").split()), NOTE)
    found = []
    for element in force.known:
        crystals = (_crystal(force, element, kind) for kind in KINDS)
        found += sorted(filter(None, crystals), key=lambda each: each.energy)
    return PotentialFile(path, force, note, tuple(found))


def _kinds() -> tuple[tuple[Any, tuple[str, ...]], ...]:
    return (
        (EmbeddedAtom, tuple(STYLES)),
        (StillingerWeber, tuple(StillingerWeber.forms)),
        (Tersoff, tuple(Tersoff.forms)),
    )


def _crystal(force: ManyBodyForce, element: str, kind: str) -> Crystal | None:
    """The crystal of least energy; None where no distance between the first and the last binds atoms."""
    from scipy.optimize import minimize_scalar

    energy = _Energy(force, element, kind)
    constants = NEAREST[force.cutoff > NEAREST] / BONDS[kind]
    try:
        energies = np.array([energy(a) for a in constants])
    except InputError:  # the parameters lack the element alone
        return None
    k = int(np.argmin(energies))
    if k in (0, len(constants) - 1) or energies[k] > BOUND:
        return None
    found = minimize_scalar(
        energy, bounds=(constants[k - 1], constants[k + 1]), method="bounded", options={"xatol": DIGITS}
    )
    return Crystal(element, kind, float(found.x), float(found.fun), constants, energies)


class _Energy:
    """Energy of an atom in a crystal by its lattice constant."""

    def __init__(self, force: ManyBodyForce, element: str, kind: str) -> None:
        self.force, self.element, self.kind = force, element, kind

    def __call__(self, a: float) -> float:
        from kickdrift.forces.bound.forces import BoundForces  # which compiles

        sites = len(LATTICES[self.kind])
        cells = int(np.ceil(2.0001 * self.force.cutoff / a))
        x, edges = lattice(self.kind, sites * cells**3, sites / a**3)
        system = System(x, masses=1.0, box=edges, forces=[self.force], units="metal", species=[self.element] * len(x))
        measured = BoundForces(system, thin=True).measure(0.0, system.state.phase)
        assert measured is not None
        return measured.potential / len(x)
