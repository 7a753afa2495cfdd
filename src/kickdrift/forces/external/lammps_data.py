"""Text of LAMMPS' data files: box, masses, particles, velocities and lists of bonds, angles, dihedrals and impropers.

Kickdrift writes this text itself: MDAnalysis' writer rounds to float32, and ASE's writer has no angles.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import repeat
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.state import Floats
from kickdrift.text import clean

FARTHEST = 511  # image that LAMMPS holds in 10 bits


def flags_of(images: NDArray[np.int64], molecules: NDArray[np.int64]) -> NDArray[np.int64]:
    """LAMMPS' image flags of particles (n, 3). Where these are beyond LAMMPS' own limit, each molecule begins anew: its
    flags are from the image of its first particle."""
    if np.abs(images).max(initial=0) <= FARTHEST:
        return images
    _, first, which = np.unique(molecules, return_index=True, return_inverse=True)
    moved: NDArray[np.int64] = images - images[first[which.reshape(-1)]]
    return moved


class DataFile(NamedTuple):
    """Content of a data file of atom style "molecular", or "full" with charges. Types, particles and molecules are
    counted from 1.

    Attributes
    ----------
    heading : the first line
    bounds : lowest and highest place of the box along each axis, (3, 2)
    tilts : (xy, xz, yz); empty for a box that does not lean
    masses : by type
    labels : a comment for each type, or nothing
    ids, types, molecules : (n,) each
    positions, velocities : (n, 3)
    lists : for each kind, such as "bonds", rows of a type and particles
    counts : number of types of each kind
    names : names of these types, for a comment; nothing where the numbers say all
    images : (n, 3) whole edges of the box from the positions to unwrapped ones; None to leave them out
    charges : (n,); None without charges
    """

    heading: str
    bounds: Floats
    tilts: Sequence[float]
    masses: Sequence[float]
    labels: Sequence[str]
    ids: NDArray[np.int64]
    types: NDArray[np.int64]
    molecules: NDArray[np.int64]
    positions: Floats
    velocities: Floats
    lists: Mapping[str, NDArray[np.int64]]
    counts: Mapping[str, int]
    names: Mapping[str, Sequence[str]]
    images: NDArray[np.int64] | None = None
    charges: Floats | None = None

    def lines(self) -> Iterator[str]:
        """Yield the lines of the file, each with its end."""
        for line in self._lines():
            yield f"{line}\n"

    def _lines(self) -> Iterator[str]:
        yield from (self.heading, "", f"{len(self.ids)} atoms", f"{len(self.masses)} atom types")
        for kind, rows in self.lists.items():
            yield f"{len(rows)} {kind}"
            known = ", ".join(f"{k} {clean(name, 80)}" for k, name in enumerate(self.names.get(kind, ()), 1))
            yield f"{self.counts[kind]} {kind[:-1]} types" + (f" # {known}" if known else "")
        for axis, (low, high) in zip("xyz", self.bounds.tolist(), strict=True):
            yield f"{low!r} {high!r} {axis}lo {axis}hi"
        if self.tilts:
            yield f"{' '.join(map(repr, self.tilts))} xy xz yz"
        yield from ("", "Masses", "")
        for number, mass in enumerate(self.masses, 1):
            yield f"{number} {mass!r}" + (f" # {clean(self.labels[number - 1], 80)}" if self.labels else "")
        yield from ("", "Atoms # molecular" if self.charges is None else "Atoms # full", "")
        charges = repeat("") if self.charges is None else (f"{charge!r} " for charge in self.charges.tolist())
        flags = repeat("") if self.images is None else (f" {x} {y} {z}" for x, y, z in self.images.tolist())
        columns = (self.ids, self.molecules, self.types, self.positions)
        for (i, molecule, type_, (x, y, z)), flag, charge in zip(
            zip(*(each.tolist() for each in columns), strict=True), flags, charges, strict=False
        ):
            yield f"{i} {molecule} {type_} {charge}{x!r} {y!r} {z!r}{flag}"
        yield from ("", "Velocities", "")
        for i, (x, y, z) in zip(self.ids.tolist(), self.velocities.tolist(), strict=True):
            yield f"{i} {x!r} {y!r} {z!r}"
        for name, items in self.lists.items():
            yield from ("", name.capitalize(), "")
            for k, item in enumerate(items.tolist(), 1):
                yield f"{k} {' '.join(map(str, item))}"
