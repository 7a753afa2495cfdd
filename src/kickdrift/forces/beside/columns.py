"""Unknowns beside the bodies, as further columns of y: which force adds which columns, and the other forces beside.

y of such a System has n columns for the bodies, then those of each force of ``COLUMNS``. An unknown is a velocity
there, so every method integrates its equation y' = f as it integrates v' = a. Only the force of the columns sees them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.seam.group import ListedForce
from kickdrift.model.state import Floats


class Bodies(NamedTuple):
    """The bodies as the equations of unknowns see them."""

    x: Floats  # (3, n) positions
    v: Floats  # (3, n) velocities
    m: Floats  # (n,) masses, as in mass x acceleration = force


class Columns(NamedTuple):
    """The further columns of one kind of force.

    Attributes
    ----------
    key : field of a State that holds their values, (k,) or (3, k)
    first : values at the start, from the force and its System
    begun : the force that begins with other values, from the force and these
    moments : weight of each column in the angular momentum, from the force and its System; None for none
    listed : name, unit and shape of each column of a run's file, and its value from the field of a State
    """

    key: str
    first: Callable[[Any, Any], Floats]
    begun: Callable[[Any, Floats], Any]
    listed: Callable[[Any, Any], list[tuple[str, str, tuple[int, ...], Callable[[Floats], Any]]]]
    moments: Callable[[Any, Any], Floats] | None = None


COLUMNS: dict[str, Columns] = {}  # by the name of the force


class Own(NamedTuple):
    """A force of a System with its further columns."""

    force: Any
    columns: Columns


def further(system: Any) -> list[Own]:
    """The forces of a System that have further columns, in the order of the columns."""
    found = [force for force in getattr(system, "forces", ()) if force.name in COLUMNS]
    names = [force.name for force in found]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{name}: a system takes one force of this kind; give the values of all in it")
    return sorted((Own(force, COLUMNS[force.name]) for force in found), key=lambda own: own.columns.moments is None)


def with_values(system: Any, values: Mapping[str, Floats | None]) -> Any:
    """The system whose further columns begin with these values of a State's fields, where they are not None."""
    kinds = [(force, COLUMNS.get(force.name)) for force in system.forces]
    return system.under(
        force if kind is None or values.get(kind.key) is None else kind.begun(force, values[kind.key])  # type: ignore[arg-type]
        for force, kind in kinds
    )


def values_in(state: Any) -> dict[str, Floats | None]:
    """The values of further columns that a State holds."""
    return {kind.key: getattr(state, kind.key) for kind in COLUMNS.values()}


class _Bound:
    """A force of a System with further columns: on the bodies alone, unless the columns are the force's own."""

    def __init__(self, force: Any, system: Any, names: str) -> None:
        if isinstance(force, ListedForce):
            raise InputError(f"force {force.name!r}: does not go with {names}, which takes gravity and fields")
        self.force, self.system, self.name = force, system, force.name

    def bind(self, system: Any, threads: int = 1) -> Any:
        """Return the parts: a NamedTuple with a compiled body."""
        from kickdrift.forces.beside.bodies_kernel import OnBodies

        if self.name in COLUMNS:
            return self.force.bind(self.system, threads)
        n = len(self.system)
        return OnBodies(self.force.bind(self.system, threads), np.zeros((2, 3, n)), np.zeros((3, n)))


class UnderColumns:
    """The forces of a System with further columns, for its bodies and these columns. See ``BoundForces``."""

    def __init__(self, system: Any) -> None:
        self.name, self.fixed = system.name, getattr(system, "fixed", None)
        names = " and ".join(own.force.name for own in further(system))
        self.forces = tuple(_Bound(force, system, names) for force in system.forces)


def bound_under(system: Any) -> Any:
    """The System as ``BoundForces`` takes it."""
    return UnderColumns(system) if further(system) else system
