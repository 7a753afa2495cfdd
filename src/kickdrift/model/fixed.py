"""Fixed particles: groups that stay where they are, or move at a given velocity, whatever forces act on them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.checks.values import is_number, listed
from kickdrift.model.molecules.constraint import Joined, numbered
from kickdrift.model.molecules.constraints import Constraints
from kickdrift.model.molecules.relatives import Ids
from kickdrift.model.molecules.topology import is_index
from kickdrift.model.molecules.virtual_sites import VirtualSites
from kickdrift.model.state import Floats
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import choices, counted, shown, suggestion

KEY = "fixed"
NAME = "[[fixed]]"  # among the names of forces that change the momentum


@checked_arguments
@dataclass(frozen=True, eq=False)
class Fixed:
    """Particles that do not move, or move at a given velocity: a frozen layer of a slab, a wall, an anchor.

    Forces on them are known, and act on nothing. They have no degrees of freedom, so temperatures and heat baths leave
    them out. A System with fixed particles does not conserve its momentum. If they move, they do work.

    Parameters
    ----------
    particles : particles, counted from 0
    species : a species or a list of species, in place of ``particles``
    velocity : (x, y, z), default at rest; numbers, or texts such as "1 angstrom/ps"

    Raises
    ------
    InputError
        If these contradict each other. A System refuses further what its particles do not allow.
    """

    particles: Any = None
    species: Any = None
    velocity: Any = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        put = object.__setattr__
        given = [key for key in ("particles", "species") if getattr(self, key) is not None]
        if len(given) != 1:
            raise InputError(f"{KEY}: expected particles or species, got {' and '.join(given) or 'neither'}")
        if self.particles is not None:
            one = [self.particles] if is_index(self.particles) else self.particles
            found = listed(f"{KEY}: particles", one, "the numbers of particles")
            if not found or not all(map(is_index, found)):
                raise InputError(f"{KEY}: particles: expected the numbers of particles, got {shown(self.particles)}")
            put(self, "particles", np.array(found, np.int64))
        else:
            names = [self.species] if isinstance(self.species, str) else self.species
            names = listed(f"{KEY}: species", names, "a species, or a list of species")
            if not names or not all(isinstance(name, str) for name in names):
                raise InputError(f"{KEY}: species: expected a species, or a list of species, got {shown(self.species)}")
            put(self, "species", tuple(names))
        along = listed(f"{KEY}: velocity", self.velocity, "three numbers")
        if len(along) != 3 or not all(isinstance(v, str) or (is_number(v) and np.isfinite(v)) for v in along):
            raise InputError(f"{KEY}: velocity: expected three finite numbers, got {shown(self.velocity)}")
        put(self, "velocity", tuple(v if isinstance(v, str) else float(v) for v in along))

    def in_units(self, units: UnitSystem) -> Fixed:
        """The same group with numbers in these units in place of texts."""
        return replace(self, velocity=tuple(quantity(v, "velocity", units, f"{KEY}: velocity") for v in self.velocity))

    def rows(self, system: Joined) -> Ids:
        """The particles of a System in this group."""
        if self.species is None:
            if (far := int(self.particles.max())) >= len(system.state):
                raise InputError(f"{KEY}: there is no particle {far}; particles are 0 to {len(system.state) - 1}")
            return np.asarray(self.particles)
        for name in self.species:
            if name not in system.species:
                known = choices(system.species, name)
                raise InputError(f"{KEY}: no species {shown(name)}{suggestion(name, system.species)} (known: {known})")
        kinds = [system.species.index(name) for name in self.species]
        return np.flatnonzero(np.isin(system.species_index, kinds))


class FixedParticles:
    """All fixed particles of one System.

    Attributes
    ----------
    particles : (f,) rows of the particles, which rise
    velocities : (3, f) of each
    tables : tables ``[[fixed]]`` of a system file, which make the same
    """

    def __init__(self, groups: Iterable[Fixed], system: Joined) -> None:
        rows, velocities, self.tables = [], [], []
        for k, each in enumerate(groups):
            with numbered(k, KEY):
                own = each.in_units(system.units)
                rows.append(own.rows(system))
                velocities.append(np.tile(np.array(own.velocity)[:, None], len(rows[-1])))
                self.tables.append(_table(rows[-1], own.velocity))
        together, columns = np.concatenate(rows), np.concatenate(velocities, axis=1)
        order = np.argsort(together, kind="stable")
        self.particles: Ids = together[order]
        self.velocities: Floats = np.ascontiguousarray(columns[:, order])
        if (twice := np.flatnonzero(np.diff(self.particles) == 0)).size:
            raise InputError(f"{KEY}: {system.body(int(self.particles[twice[0]]))} is given twice")

    def __len__(self) -> int:
        return len(self.particles)

    def __str__(self) -> str:
        moving = int(self.velocities.any(axis=0).sum())
        return counted(len(self), "particle", ",") + (f", {moving:,} at a given velocity" if moving else "")

    @property
    def move(self) -> bool:
        """Whether any of the particles moves."""
        return bool(self.velocities.any())

    def settled(self, phase: Floats) -> Floats:
        """Phase (2, 3, n) in which the particles have their velocities."""
        found = phase.copy()
        found[1][:, self.particles] = self.velocities
        return found

    def heat(self, masses: Floats) -> float:
        """Kinetic energy of the particles, which is no heat; ``masses`` (n,) are those of all."""
        return 0.5 * float(masses[self.particles] @ (self.velocities**2).sum(axis=0))

    def free(self, masses: Floats) -> Floats:
        """Masses (n,) without those of the fixed particles, which have none of the heat."""
        found = masses.copy()
        found[self.particles] = 0.0
        return found

    def check(self, system: Joined, constraints: Constraints | None, sites: VirtualSites | None) -> None:
        """Refuse particles that other particles hold, and a way out of the plane."""
        pairs = [] if constraints is None else [(constraints.pairs, "a constraint holds")]
        pairs += [] if sites is None else [(sites.of, "a virtual site follows"), (sites.particles, "it is a site;")]
        for rows, why in pairs:
            if (both := np.intersect1d(rows, self.particles)).size:
                raise InputError(f"{KEY}: {system.body(int(both[0]))} cannot be fixed, because {why} it")
        if system.dimensions == 2 and self.velocities[2].any():
            raise InputError(f"{KEY}: velocity: leads out of the plane of a two-dimensional system")


def _table(rows: Ids, velocity: tuple[float, ...]) -> dict[str, Any]:
    """Table ``[[fixed]]`` of a system file."""
    return {"particles": rows.tolist()} | ({"velocity": list(velocity)} if any(velocity) else {})


def fixed_of(system: Joined, given: Iterable[Fixed] | FixedParticles | None) -> FixedParticles | None:
    """The fixed particles of a System from a list of `Fixed`. `FixedParticles` and None stay as they are."""
    if given is None or isinstance(given, FixedParticles):
        return given
    stated = [given] if isinstance(given, Fixed) else listed(KEY, given, "a list of Fixed")
    for each in stated:
        if not isinstance(each, Fixed):
            raise InputError(f"{KEY}: expected kickdrift.Fixed, got {type(each).__name__}")
    return FixedParticles(stated, system) if stated else None
