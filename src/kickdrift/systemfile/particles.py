"""Particles from the tables of a system file: on lattices, at positions, on orbits and in clusters; and the box."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.checks.limits import check_particles
from kickdrift.model.fixed import KEY as FIXED
from kickdrift.model.fixed import Fixed
from kickdrift.model.molecules.constraint import Constraint, numbered
from kickdrift.model.molecules.listed import from_file, replaced
from kickdrift.model.molecules.topology import SIZES, Topology
from kickdrift.model.molecules.virtual_sites import KEY as VIRTUAL_SITE
from kickdrift.model.molecules.virtual_sites import VirtualSite
from kickdrift.model.starts import elements
from kickdrift.model.starts.builders import (
    COMPOUNDS,
    LATTICES,
    PLANE_LATTICES,
    Structure,
    generator,
    lattice,
    mixture,
    plane_lattice,
    turned_at_random,
)
from kickdrift.model.starts.chains import random_chains
from kickdrift.model.starts.coordinates import at_barycentre, attracting_masses, to_barycentric
from kickdrift.model.state import Floats
from kickdrift.model.system import body_names
from kickdrift.model.units.quantities import number_density, quantity
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.systemfile.files import prefixed
from kickdrift.systemfile.schema import LatticeTable, PositionsTable, SystemTable, WalksTable
from kickdrift.systemfile.schema_base import (
    ORBIT,
    BodiesTable,
    BodyTable,
    ConstraintTable,
    FixedTable,
    VirtualSiteTable,
)
from kickdrift.text import choices, shown, suggestion


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
    if particles.lattice in COMPOUNDS:
        species = _of_compound(particles)
    elif particles.molecule is not None:
        return _molecules(particles, lengths, units)
    elif isinstance(particles.species, dict):
        names = list(particles.species)
        if len(names) > 1 and particles.seed is None:
            raise InputError("seed: required key is missing; a mixture is placed with a seed, such as seed = 1")
        species = mixture(particles.species, count, particles.seed or 0)
    else:
        species = particles.species
    masses, charges = _masses(particles.mass, species, count, units), charges_of(particles, species)
    if table.box.matrix is not None and box is not None:
        if particles.density is not None:
            raise InputError("density: not allowed with box.matrix, since the lattice fills that box")
        room = float(np.prod(np.diag(box.matrix)[: table.dimensions]))
        positions, edges = fill(particles.lattice, count, count / room)
        positions = (positions / [*edges, 1.0][:3]) @ box.matrix
        return Structure(positions, masses, species, None, periodic=True, charges=charges)
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
    return Structure(positions, masses, species, edges, periodic=True, charges=charges)


def _molecules(particles: LatticeTable, lengths: Sequence[float] | None, units: UnitSystem) -> Structure:
    """Equal molecules on a cubic lattice, each turned at random."""
    shape, count = np.array(particles.molecule), particles.count
    if isinstance(particles.species, dict) or len(particles.species) != len(shape):
        raise InputError(f"species: expected a list of {len(shape)} names, one for each particle of the molecule")
    if particles.seed is None:
        raise InputError("seed: required key is missing; molecules are turned with a seed, such as seed = 1")
    check_particles("count", count * len(shape))
    masses = np.broadcast_to(_masses(particles.mass, particles.species, len(shape), units), len(shape))
    if particles.density is not None:
        density = number_density(particles.density, units, float(np.sum(masses)))
    elif lengths is not None and len(set(lengths)) == 1:
        density = count / lengths[0] ** 3
    else:
        raise InputError("density: required key is missing (or box.lengths with three equal edges)")
    sites, edges = lattice(particles.lattice, count, density)
    turned = turned_at_random(to_barycentric(shape, masses)[0], count, particles.seed)
    positions = (sites[:, None, :] + turned).reshape(-1, 3)
    species = list(particles.species) * count
    charges = charges_of(particles, species)
    return Structure(positions, np.tile(masses, count), species, edges, periodic=True, charges=charges)


def on_walks(particles: WalksTable, table: SystemTable, box: Box | None, units: UnitSystem) -> Structure:
    """Particles on random walks, one along each chain of the topology."""
    if table.dimensions == 2:
        raise InputError("walks: expected 3 dimensions, got 2")
    chains = None if table.topology is None else table.topology.chains
    if chains is None:
        raise InputError("walks: expected [topology] chains = { count = ..., length = ... }, along which to walk")
    total = chains.count * chains.length
    check_particles("topology.chains", total)
    species = list(particles.species) * (chains.length if len(particles.species) == 1 else 1)
    if len(species) != chains.length or (isinstance(particles.species, dict) and len(particles.species) > 1):
        expected = f"one name, or a list of {chains.length} for the particles of a chain"
        raise InputError(f"species: expected {expected}, got {shown(particles.species)}")
    species *= chains.count
    masses, charges = _masses(particles.mass, species, total, units), charges_of(particles, species)
    given = box is not None
    if given == (particles.density is not None):
        raise InputError(f"density: expected density or box.lengths, got {'both' if given else 'neither'}")
    if box is None:
        density = number_density(particles.density, units, float(np.mean(masses)))
        box = Box((float(np.cbrt(total / density)),) * 3)
    walk = particles.walks
    with prefixed("walks."):
        positions = random_chains(chains.count, chains.length, box.matrix, walk.bond, walk.apart, particles.seed)
    return Structure(positions, masses, species, None if given else box.lengths, periodic=True, charges=charges)


def _of_compound(particles: LatticeTable) -> list[str]:
    """Species of the particles on the sites of a compound of two species."""
    parts = particles.species if isinstance(particles.species, dict) else {}
    if len(parts) != 2 or len(set(parts.values())) != 1:
        raise InputError(
            f"species: a {particles.lattice} lattice has two species in equal parts, such as {{Na = 0.5, Cl = 0.5}}, "
            f"got {shown(particles.species)}"
        )
    sites, names = len(LATTICES[particles.lattice]), list(parts)
    cell = [name for name in names for _ in range(sites // 2)]
    return cell * (particles.count // sites)


def as_given(particles: PositionsTable, units: UnitSystem, gravity: float | None) -> Structure:
    """Particles at the positions in the file."""
    n = len(particles.positions)
    if isinstance(particles.species, dict) and len(particles.species) > 1:
        raise InputError(f"species: expected one name or a list of {n}; fractions need a lattice")
    species = list(particles.species) * n if isinstance(particles.species, dict) else particles.species
    if 1 < len(species) < n and n % len(species) == 0:
        species = list(species) * (n // len(species))
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
        charges=charges_of(particles, species), barycentric=particles.barycentric,
    )  # fmt: skip


def _masses(mass: Any, species: Sequence[str], n: int, units: UnitSystem) -> Any:
    if len(species) != n:
        raise InputError(f"species: expected {n} names, got {len(species)}")
    if mass is None:
        if not units.reduced:
            raise InputError(f"mass: required key is missing; units {units.name!r} have no default mass")
        return 1.0
    return _of_species("mass", mass, species)


def _of_species(key: str, given: Any, species: Sequence[str]) -> Any:
    """One number for all particles as it is, and a list for particles from a table by species."""
    if not isinstance(given, dict):
        return given
    missing, unused = sorted(set(species) - set(given)), sorted(set(given) - set(species))
    if missing or unused:
        what = f"species {missing[0]!r} has no {key}" if missing else f"no particle is of species {unused[0]!r}"
        raise InputError(f"{key}: {what}")
    return [given[name] for name in species]


def charges_of(particles: Any, species: Sequence[str]) -> Any:
    """Charges of a table with ``charge``, one number or one for each species, or with ``charges``; None without."""
    listed = getattr(particles, "charges", None)
    if listed is None:
        return _of_species("charge", particles.charge, species)
    if particles.charge is not None:
        raise InputError("charges: expected charge or charges, got both")
    if len(listed) != len(species):
        raise InputError(f"charges: expected {len(species)}, one for each particle, got {len(listed)}")
    return listed


def on_orbits(
    table: BodiesTable,
    gravity: float | None,
    seed: int | None = None,
    key: str = "elements",
    first_at: int = 0,
    *,
    units: UnitSystem,
    folder: Path = Path(),
) -> Structure:
    """Central body and other bodies from a system file's ``elements``, relative to their barycentre.

    The frame sets the origin and the G M of each orbit. "heliocentric": the central body, G times the two masses.
    "jacobi": the centre of mass of the bodies before it, G times their masses and its own. "barycentric": the centre of
    mass of all, G times all masses. With a ``primary``: that body, G times the two masses.

    Parameters
    ----------
    gravity : G in the file's units
    seed : replaces the table's seed
    key, first_at : name of the list in errors, and index of the first body on an orbit in that list
    units : of the file, for states from JPL
    folder : where names of kernels begin
    """
    if gravity is None:
        raise InputError("elements: these units do not set G; give G in [[force]] gravity")
    counts = [1, *(body.count or 1 for body in table.elements)]
    check_particles("elements: count", sum(counts))
    given = [table.central, *table.elements]
    masses = np.repeat([body.mass if body.GM is None else body.GM / gravity for body in given], counts).astype(float)
    if not masses[0] > 0:
        raise InputError("central.mass: expected a positive mass, since the other bodies orbit the central one")
    seed = table.seed if seed is None else seed
    rng = generator(seed or 0)
    attracting = gravity * attracting_masses(masses, table.frame)
    x, v = np.zeros((len(masses), 3)), np.zeros((len(masses), 3))
    names, first, asked = [table.central.called], 1, list[str]()
    for k, (body, count) in enumerate(zip(table.elements, counts[1:], strict=True), first_at):
        rows, mu = slice(first, first + count), attracting[first - 1 : first - 1 + count]
        called = body.called
        names += [called] if body.count is None else [called and f"{called} {i + 1}" for i in range(count)]
        try:
            about = None if body.primary is None else _primary(body.primary, names[:first])
            if about is not None:
                mu = gravity * (masses[about] + masses[rows])
            if body.from_jpl:
                x[rows], v[rows], said = state_from_jpl(body, units, folder)
                asked.append(f"{called}: {said}" if called else said)
            else:
                x[rows], v[rows] = orbit_of(body, count, mu, rng)
            if about:  # row 0 is the central body, the origin of the other rows
                x[rows] += x[about]
                v[rows] += v[about]
        except InputError as error:
            raise InputError(f"{key}[{k}]{f' ({called})' if called else ''}.{error}") from None
        first += count
    named = [name or f"particle {i}" for i, name in enumerate(names)] if any(names) else []
    x, v = (at_barycentre(y, masses, table.frame) for y in (x, v))
    drawn = seed if table.seed is not None else None
    radii = None
    if any(body.radius is not None for body in given):  # bodies without a radius are points
        radii = np.repeat([body.radius or 0.0 for body in given], counts).tolist()
    return Structure(
        x,
        masses,
        ["A"] * len(masses),
        None,
        periodic=False,
        velocities=v,
        names=named,
        seed=drawn,
        radii=radii,
        ephemerides=tuple(asked),
    )


def _primary(name: str, names: list[str | None]) -> int:
    if name not in names:
        known = [each for each in names if each]
        raise InputError(
            f"primary: no earlier body is called {shown(name)}{suggestion(name, known)} "
            f"(earlier: {choices(known, name)})"
        )
    return names.index(name)


def state_from_jpl(body: BodyTable, units: UnitSystem, folder: Path) -> tuple[Floats, Floats, str]:
    """Position and velocity (3,) of a body by JPL Horizons or from a kernel, and what was asked."""
    from kickdrift.model.starts.horizons import from_horizons, from_kernel

    where = body.date, body.plane, body.origin
    if body.spk is None:
        found = from_horizons(str(body.horizons), *where)
    else:
        found = from_kernel(folder / body.spk, int(body.target or 0), *where)
    length, speed = (quantity(text, kind, units) for text, kind in (("1 AU", "length"), ("1 AU/yr", "velocity")))
    return found.position * length, found.velocity * speed, found.said


def orbit_of(
    body: BodyTable, count: int, mu: Floats | float, rng: np.random.Generator, time: float = 0.0
) -> tuple[Floats, Floats]:
    """Positions and velocities (count, 3) on a body's orbit about its primary at a time. mu is G times the masses."""

    def value(key: str) -> Any:
        given = getattr(body, key)
        if isinstance(given, list):
            given = given[0] + (given[1] - given[0]) * rng.random(count)
        return np.radians(given) if key in elements.ANGLES and given is not None else given

    values = {key: value(key) for key in ORBIT}
    period = values.pop("P")
    if period is not None:
        if np.any(np.asarray(values["e"]) >= 1):
            raise InputError("P: only an ellipse (e < 1) has a period; give q")
        if not np.all(np.asarray(period) > 0):
            raise InputError("P: expected a positive period")
        values["a"] = np.cbrt(mu * (np.asarray(period) / elements.TAU) ** 2)
    return elements.states(mu, t=time, **values)


def molecules_of(table: SystemTable, folder: Path) -> tuple[Topology | None, list[VirtualSite]]:
    """Topology and virtual sites of a checked file, of all copies of the first molecule. Names of files are relative to
    ``folder``."""
    sites = [virtual_site_of(given, k) for k, given in enumerate(table.virtual_site)]
    if table.topology is None:
        return None, sites
    given = table.topology.model_dump(exclude_none=True)
    if (copies := given.pop("copies", None)) is None:
        return topology_of(given, folder), sites
    if "chains" in given or "file" in given:
        raise InputError("topology.copies: goes with lists of one molecule, not with chains or file")
    one, least = Topology(**given), 1 + max((each.last for each in sites), default=-1)
    particles = table.particles
    if isinstance(particles, LatticeTable) and particles.molecule is not None:
        size, count = len(particles.molecule), particles.count
        for k, each in enumerate(sites):
            if each.last >= size:
                with numbered(k, VIRTUAL_SITE):
                    raise InputError(
                        f"{VIRTUAL_SITE}: there is no particle {each.last} in a molecule of {size} particles, which "
                        f"are 0 to {size - 1}"
                    )
        if copies != count or one.size(least) > size:
            raise InputError(
                f"topology.copies: the lattice has {count} molecules of {size} particles, and the topology has "
                f"{copies} copies of {one.size(least)}"
            )
        least = size
    return one.repeated(copies, least), [each.repeated(copies, one.size(least)) for each in sites]


def topology_of(given: dict[str, Any], folder: Path) -> Topology:
    """Topology of a checked table without copies."""
    sources = [key for key in ("chains", "file", "bonds") if key in given]
    listed = any(isinstance(given.get(kind), list) for kind in (*SIZES, "exclusions"))
    if len(sources) > 1 or not (sources or listed):
        raise InputError(
            f"topology: expected exactly one of chains, file and bonds, got {' and '.join(sources) or 'none'}"
        )
    if (chains := given.pop("chains", None)) is not None:
        return Topology.chains(**chains, **given)
    if (name := given.pop("file", None)) is not None:
        if "\0" in name:
            raise InputError("topology.file: expected the name of a file")
        try:
            found = from_file(folder / name)
        except InputError as error:
            raise InputError(f"topology.file: {error}") from None
        return Topology(**replaced(found, given))
    return Topology(**given)


def constraint_of(table: ConstraintTable, k: int) -> Constraint:
    """Constraint of the checked table ``[[constraint]]`` number k."""
    with numbered(k):
        return Constraint(**table.model_dump(exclude_none=True))


def fixed_of(table: FixedTable, k: int) -> Fixed:
    """Fixed of the checked table ``[[fixed]]`` number k."""
    with numbered(k, FIXED):
        return Fixed(**table.model_dump(exclude_none=True))


def virtual_site_of(table: VirtualSiteTable, k: int) -> VirtualSite:
    """VirtualSite of the checked table ``[[virtual_site]]`` number k."""
    with numbered(k, VIRTUAL_SITE):
        return VirtualSite(**table.model_dump())
