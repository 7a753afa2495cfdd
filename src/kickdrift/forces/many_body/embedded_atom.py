"""The embedded-atom method of metals, with tables from a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.many_body.tables import Potential, read_potential, style_of_file
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.checks.values import path_text
from kickdrift.text import shown


@checked_arguments
@dataclass(frozen=True)
class EmbeddedAtom(ManyBodyForce):
    """Embedded-atom method: U = sum F(rho_i) + 1/2 sum phi(r_ij), where rho_i is the density of i's neighbours.

    Source: Daw & Baskes 1984, doi:10.1103/PhysRevB.29.6443; with densities for each pair of elements (eam.fs) Finnis &
    Sinclair 1984, doi:10.1080/01418618408244210.

    The tables are joined by the same cubics as in LAMMPS. Species are the file's elements, and units are ``metal``.

    Attributes
    ----------
    file : path
        Name of a file ``.eam.alloy``, ``.eam.fs``, ``.eam.he`` or ``.eam`` (one element, funcfl), kept as an absolute
        path. In a system file, the name is relative to that file.
    digest : str
        SHA-256 of the file, kept with a run: a file that has changed is refused. Default: of the file as it is.
    elements : {species: element}, optional
        The file's name of a species that is called otherwise here.
    """

    file: str
    digest: str = ""
    elements: Mapping[str, str] | None = None

    name: ClassVar[str] = "eam"
    dimensions: ClassVar[dict[str, str]] = {}

    def __post_init__(self) -> None:
        object.__setattr__(self, "file", path_text(f"{self.name}: file", self.file))
        potential = read_potential(self.name, self.file)
        if self.digest and self.digest != potential.digest:
            raise InputError(f"{self.name}: file: {self.file} has changed: its SHA-256 is not {shown(self.digest)}")
        object.__setattr__(self, "file", os.path.abspath(self.file))  # found again by a run that goes on elsewhere
        object.__setattr__(self, "digest", potential.digest)
        object.__setattr__(self, "_potential", potential)
        self.check_elements()

    @property
    def potential(self) -> Potential:
        """Content of the file."""
        found: Potential = self._potential  # type: ignore[attr-defined]
        return found

    @property
    def cutoff(self) -> float:
        """Largest distance of atoms that interact, in angstroms."""
        return self.potential.cutoff

    @property
    def known(self) -> tuple[str, ...]:
        """Elements in the file."""
        return self.potential.elements

    @property
    def style(self) -> str:
        """LAMMPS' pair style of the file."""
        return style_of_file(self.name, self.file)

    @property
    def source(self) -> str:
        """The file."""
        return self.file

    def law(self, species: tuple[str, ...]) -> Any:
        """See ManyBodyForce."""
        from kickdrift.forces.many_body.embedded_atom_kernel import EmbeddedAtomLaw
        from kickdrift.jit.lanes.memory import aligned

        found = self.potential
        these = [found.elements.index(name) for name in self.named(species)]
        density, rphi = (table[np.ix_(these, these)] for table in (found.density, found.rphi))
        parts = [density, rphi] if len(these) == 1 else [density, rphi, density.swapaxes(0, 1)]
        joined = np.concatenate(parts, axis=-1)
        by_distance = aligned(joined.shape, fill=None)
        by_distance[...] = joined
        by_density = np.ascontiguousarray(found.embedding[these])
        return EmbeddedAtomLaw(
            by_distance,
            joined.shape[2],
            1.0 / found.dr,
            by_density,
            1.0 / found.drho,
            found.first_density,
            found.lowest_density,
            found.first_density + by_density.shape[1] * found.drho,
            densities=np.zeros((0, 0)),
            at=np.zeros(0),
            shifted=np.zeros((0, 0)),
            row=np.zeros((0, 0)),
            close=np.zeros((0, 0), np.int64),
            kept=np.zeros(0),
            forces=np.zeros((0, 0)),
        )
