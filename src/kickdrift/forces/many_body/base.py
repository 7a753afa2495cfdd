"""Common parts of all many-body forces: their checks and their binding."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.lists.listed import ListedForce
from kickdrift.forces.seam.group import Grouped

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


class ManyBodyForce(ListedForce, Grouped):
    """A force whose energy depends on the neighbourhood of each particle; its numbers are in eV and angstroms."""

    name: ClassVar[str]

    @property
    def stands_for(self) -> str:  # type: ignore[override]
        """What the force is a model of: itself."""
        return self.name

    @property
    def cutoff(self) -> float:
        """Largest distance of particles that interact, in angstroms."""
        raise NotImplementedError

    @property
    def elements(self) -> tuple[str, ...]:
        """Names of the species with parameters."""
        raise NotImplementedError

    @property
    def source(self) -> str:
        """The source of the parameters, for messages."""
        raise NotImplementedError

    def law(self, species: tuple[str, ...]) -> Any:
        """Return the law's parts for compiled code: parameters of these species, as yet without workspace."""
        raise NotImplementedError

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support."""
        if system.units.name != "metal":
            raise InputError(
                f"{self.name}: its parameters are in eV and angstroms, which needs units 'metal', not "
                f"{system.units.name!r}"
            )
        if system.dimensions != 3:
            raise InputError(f"{self.name}: works in three dimensions, and the system has {system.dimensions}")
        for species in system.species:
            if species not in self.elements:
                raise InputError(
                    f"{self.name}: species {species!r} has no parameters in {self.source}, which has "
                    f"{', '.join(self.elements)}"
                )
        if system.topology is not None and len(system.topology.scaled.pairs):
            raise InputError(f"{self.name}: acts on all particles; a topology can leave out or scale only pair forces")
        system.box.check_cutoff(self.name, self.cutoff)
        massless = np.flatnonzero(system.state.masses == 0)
        if massless.size:
            raise InputError(
                f"{self.name}: particle {massless[0]} has no mass, and this force would move it infinitely fast"
            )

    def bind(self, system: Subject, threads: int = 1, mixed: bool = False) -> Any:
        """Bind this force to a System, with its list of neighbours."""
        from kickdrift.forces.many_body.binding import bind

        if mixed:
            raise InputError(f"precision: mixed is for pair forces, and {self.name!r} is a many-body force")
        return bind(self, system, threads)
