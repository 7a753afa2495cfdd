"""Protocols of a System for forces and events."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.fixed import FixedParticles
from kickdrift.model.molecules.constraints import Constraints
from kickdrift.model.molecules.topology import Topology
from kickdrift.model.molecules.virtual_sites import VirtualSites
from kickdrift.model.state import Floats, State
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import choices, shown, suggestion


class Particles(Protocol):
    """Particles with their species, names, box and units, shared by a System and a run's file."""

    @property
    def box(self) -> Box: ...

    @property
    def units(self) -> UnitSystem: ...

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def species(self) -> tuple[str, ...]: ...

    @property
    def species_index(self) -> NDArray[Any]: ...


class Subject(Particles, Protocol):
    """Particles that forces act on; see ``System``."""

    @property
    def name(self) -> str: ...

    @property
    def state(self) -> State: ...

    @property
    def dimensions(self) -> int: ...

    @property
    def volume(self) -> float: ...

    @property
    def forces(self) -> tuple[Any, ...]: ...

    @property
    def coherent_masses(self) -> Floats: ...

    @property
    def topology(self) -> Topology | None: ...

    @property
    def charges(self) -> Floats | None: ...

    @property
    def constraints(self) -> Constraints | None: ...

    @property
    def virtual_sites(self) -> VirtualSites | None: ...

    @property
    def fixed(self) -> FixedParticles | None: ...

    @property
    def tied_by(self) -> str: ...

    @property
    def held_by(self) -> str: ...

    def __len__(self) -> int: ...

    def body(self, i: int) -> str:
        """Name of a particle, for messages."""


class Bodies(Subject, Protocol):
    """Particles that events may watch; see ``System``."""

    @property
    def radii(self) -> Floats | None: ...

    def acting(self, trait: str) -> list[str]:
        """Names of the forces that have a trait."""


def index_of(system: Subject, body: str | int, key: str) -> int:
    """Row of a body, by name or by id. Raises an InputError that begins with ``key`` for an unknown body."""
    if isinstance(body, str) and body in system.names:
        return system.names.index(body)
    if isinstance(body, int | np.integer) and not isinstance(body, bool):
        found = np.flatnonzero(system.state.ids == body)
        if found.size:
            return int(found[0])
    if not system.names:
        raise InputError(f"{key}: there is no particle {shown(body)}; expected a number from 0 to {len(system) - 1}")
    known = choices(system.names, body)
    hint = suggestion(body, system.names) if isinstance(body, str) else ""
    raise InputError(f"{key}: there is no body {shown(body)}{hint} (known: {known})")
