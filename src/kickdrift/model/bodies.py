"""One body of a System, by its name."""

from __future__ import annotations

from dataclasses import dataclass, field

from kickdrift.errors import InputError
from kickdrift.model.orbits import Orbit, central_row, gravity_of, in_degrees
from kickdrift.model.starts.elements import elements
from kickdrift.model.state import Floats, read_only
from kickdrift.model.subject import Bodies, index_of


@dataclass(frozen=True, eq=False)
class Body:
    """A body of a System, in the system's units; a read-only copy.

    Attributes
    ----------
    name, species : str
    id : int
    mass : float
    radius : float, or None if the bodies have no radii
    charge : float, or None if the bodies have no charges
    position, velocity : (3,)
    """

    name: str
    id: int
    species: str
    mass: float
    radius: float | None
    charge: float | None
    position: Floats
    velocity: Floats
    system: Bodies = field(repr=False)

    def elements(self, primary: str | int | None = None) -> Orbit:
        """The `Orbit` of this body about another, with G times both masses.

        Parameters
        ----------
        primary : name or id of the other body; default the body that dominates the system

        Raises
        ------
        InputError
            If no body dominates, and for a body about itself.
        """
        system, state = self.system, self.system.state
        here, there = index_of(system, self.id, "elements"), primary_row(system, primary, "elements: primary")
        if here == there:
            raise InputError(f"elements: {self.name} does not orbit itself; give a primary")
        mu = gravity_of(system, "elements") * (self.mass + float(state.masses[there]))
        if not mu > 0:
            raise InputError(f"elements: {self.name} and {system.body(there)} have no mass")
        x, v = (rows[:, here] - rows[:, there] for rows in state.phase)
        return Orbit(*map(float, in_degrees(elements(x, v, mu), mu)))


def body_of(system: Bodies, key: str | int) -> Body:
    """Body of that name or id. Raises an InputError that suggests the nearest name for an unknown one."""
    i, state = index_of(system, key, system.name), system.state
    position, velocity = (read_only(rows[:, i].copy()) for rows in state.phase)
    return Body(
        name=system.body(i),
        id=int(state.ids[i]),
        species=system.species[system.species_index[i]],
        mass=float(state.masses[i]),
        radius=None if system.radii is None else float(system.radii[i]),
        charge=None if system.charges is None else float(system.charges[i]),
        position=position,
        velocity=velocity,
        system=system,
    )


def primary_row(system: Bodies, primary: str | int | None, key: str) -> int:
    """Row of the body that others orbit: the named body, else the dominant body."""
    if primary is not None:
        return index_of(system, primary, key)
    row = central_row(system.state.masses)
    if row is None or not system.state.masses[row] > 0:
        raise InputError(f"{key}: required, since no body of {system.name!r} has half of all mass")
    return row
