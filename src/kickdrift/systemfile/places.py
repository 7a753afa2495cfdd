"""Positions, masses, species and box from the tables [particles] and [box] of a system file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.checks.limits import check_particles
from kickdrift.model.starts.builders import LATTICES, PLANE_LATTICES, Structure, lattice, mixture, plane_lattice
from kickdrift.model.system import body_names
from kickdrift.model.units.quantities import number_density
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.systemfile.schema import LatticeTable, PositionsTable, SystemTable
from kickdrift.text import shown


def edges_given(table: SystemTable) -> Box | None:
    """Box with the lengths or the matrix in the file; None if it has neither."""
    for key, given in (("lengths", table.box.lengths), ("matrix", table.box.matrix)):
        if given is not None:
            if not table.dimensions <= len(given) <= 3:
                raise InputError(f"box.{key}: expected {table.dimensions} items, got {len(given)}")
            return Box(given, periodic=_along(table.box.periodic, table.dimensions))
    return None


def box_of(table: SystemTable, start: Structure) -> Box | None:
    """Box from the file, or filled by its particles; None for open space."""
    given, edges = edges_given(table), start.edges
    if given is not None:
        extents = (0.0,) * 3 if edges is None else edges
        for axis, (length, edge) in enumerate(zip(table.box.lengths or (), extents, strict=False)):
            if length < edge * (1 - 1e-9):
                raise InputError(
                    f"box.lengths[{axis}]: expected at least {edge:.9g}, the extent of the particles, got {length:g}"
                )
        return given
    periodic = start.periodic if table.box.periodic is None else table.box.periodic
    if periodic in (False, [False] * 3):
        return None
    if edges is None:
        raise InputError("box.lengths: required key is missing; nothing else sets the edges of this periodic box")
    return Box(edges, periodic=_along(periodic, table.dimensions))


def _along(periodic: bool | Sequence[bool] | None, dimensions: int) -> Sequence[bool]:
    """The axes of a periodic box, from three values or one."""
    return periodic if isinstance(periodic, Sequence) else (True, True, dimensions == 3)


def on_lattice(particles: LatticeTable, table: SystemTable, box: Box | None, units: UnitSystem) -> Structure:
    """Particles on a lattice. A box with a matrix is filled by the lattice."""
    count, lengths, plane = particles.count, table.box.lengths, table.dimensions == 2
    kinds = PLANE_LATTICES if plane else LATTICES
    if particles.lattice not in kinds:
        raise InputError(
            f"lattice: expected {' or '.join(kinds)} in {table.dimensions} dimensions, got {shown(particles.lattice)}"
        )
    fill: Any = plane_lattice if plane else lattice
    check_particles("count", count)
    if isinstance(particles.species, dict):
        names = list(particles.species)
        if len(names) > 1 and particles.seed is None:
            raise InputError("seed: required key is missing; a mixture is placed with a seed, such as seed = 1")
        species = mixture(particles.species, count, particles.seed or 0)
    else:
        species = particles.species
    masses = _masses(particles.mass, species, count, units)
    if table.box.matrix is not None and box is not None:
        if particles.density is not None:
            raise InputError("density: not allowed with box.matrix, since the lattice fills that box")
        room = float(np.prod(np.diag(box.matrix)[: table.dimensions]))
        positions, edges = fill(particles.lattice, count, count / room)
        return Structure((positions / [*edges, 1.0][:3]) @ box.matrix, masses, species, None, periodic=True)
    if particles.density is not None:
        if plane and isinstance(particles.density, str):
            raise InputError(f"density: expected a number of particles per area, got {shown(particles.density)}")
        density = number_density(particles.density, units, float(np.mean(masses)))
    elif lengths is not None and len(set(lengths[: table.dimensions])) == 1 and particles.lattice != "hexagonal":
        density = count / lengths[0] ** table.dimensions
    else:
        equal = "two equal edges for a square lattice" if plane else "three equal edges"
        raise InputError(f"density: required key is missing (or box.lengths with {equal})")
    positions, edges = fill(particles.lattice, count, density)
    return Structure(positions, masses, species, edges, periodic=True)


def as_given(particles: PositionsTable, units: UnitSystem, gravity: float | None) -> Structure:
    """Particles at the positions in the file."""
    n = len(particles.positions)
    if isinstance(particles.species, dict) and len(particles.species) > 1:
        raise InputError(f"species: expected one name or a list of {n}; fractions need a lattice")
    species = list(particles.species) * n if isinstance(particles.species, dict) else particles.species
    if len(species) != n:
        raise InputError(f"species: expected one name or {n}, got {len(particles.species)}")
    if particles.GM is not None:
        if gravity is None or particles.mass is not None or particles.masses is not None:
            raise InputError("GM: excludes mass and masses, and needs units that set G")
        masses = [gm / gravity for gm in particles.GM]
        if len(masses) != n:
            raise InputError(f"GM: expected {n}, one for each position, got {len(masses)}")
    elif particles.masses is None:
        masses = _masses(particles.mass, species, n, units)
    elif particles.mass is not None:
        raise InputError("masses: expected mass or masses, got both")
    elif len(particles.masses) != n:
        raise InputError(f"masses: expected {n}, one for each position, got {len(particles.masses)}")
    else:
        masses = particles.masses
    positions = np.array(particles.positions, dtype=float)
    names = body_names(particles.names, n)
    return Structure(
        positions, masses, species, None, periodic=False, names=names, radii=particles.radii,
        barycentric=particles.barycentric,
    )  # fmt: skip


def _masses(mass: Any, species: Sequence[str], n: int, units: UnitSystem) -> Any:
    if len(species) != n:
        raise InputError(f"species: expected {n} names, got {len(species)}")
    if mass is None:
        if not units.reduced:
            raise InputError(f"mass: required key is missing; units {units.name!r} have no default mass")
        return 1.0
    if not isinstance(mass, dict):
        return mass
    missing, unused = sorted(set(species) - set(mass)), sorted(set(mass) - set(species))
    if missing or unused:
        what = f"species {missing[0]!r} has no mass" if missing else f"no particle is of species {unused[0]!r}"
        raise InputError(f"mass: {what}")
    return [mass[name] for name in species]
