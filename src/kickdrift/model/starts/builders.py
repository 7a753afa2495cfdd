"""Initial positions and velocities, and the check that no two particles overlap."""

from __future__ import annotations

import itertools
import math
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.disk.files import unfit
from kickdrift.disk.foreign import is_lammps_data
from kickdrift.errors import InputError
from kickdrift.model.any_cell import oriented, without_rounding
from kickdrift.model.checks.limits import check_particles
from kickdrift.model.checks.values import number, numbers
from kickdrift.model.freedom import free_masses
from kickdrift.model.nearness import any_nearer, nearest_pair
from kickdrift.model.starts.gro import refuse_cut
from kickdrift.model.starts.lammps_data import AtomTable, atom_table
from kickdrift.model.state import Floats
from kickdrift.model.units.file_units import FileUnits, Scale
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS, UnitSystem
from kickdrift.text import shown, suggestion

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


DAMAGED = (
    AttributeError,
    IndexError,
    KeyError,
    NameError,
    RuntimeError,
    TypeError,
)  # readers mean to raise none
# Sites of one cubic cell in units of its edge, moved off the cell's faces so that rounding cannot wrap a particle.
LATTICES: dict[str, tuple[tuple[float, float, float], ...]] = {
    "sc": ((0.5, 0.5, 0.5),),
    "bcc": ((0.25, 0.25, 0.25), (0.75, 0.75, 0.75)),
    "fcc": ((0.25, 0.25, 0.25), (0.25, 0.75, 0.75), (0.75, 0.25, 0.75), (0.75, 0.75, 0.25)),
    "diamond": (
        *((0.125, 0.125, 0.125), (0.125, 0.625, 0.625), (0.625, 0.125, 0.625), (0.625, 0.625, 0.125)),
        *((0.375, 0.375, 0.375), (0.375, 0.875, 0.875), (0.875, 0.375, 0.875), (0.875, 0.875, 0.375)),
    ),
    "rock-salt": (
        *((0.25, 0.25, 0.25), (0.25, 0.75, 0.75), (0.75, 0.25, 0.75), (0.75, 0.75, 0.25)),
        *((0.75, 0.75, 0.75), (0.75, 0.25, 0.25), (0.25, 0.75, 0.25), (0.25, 0.25, 0.75)),
    ),
    "caesium-chloride": ((0.25, 0.25, 0.25), (0.75, 0.75, 0.75)),
}
LATTICES["zincblende"] = LATTICES["diamond"]
COMPOUNDS = (
    "rock-salt",
    "caesium-chloride",
    "zincblende",
)  # one species on the first half of the sites, one on the rest

MOST = 10**8  # most particles on a lattice, whatever the memory
ROUNDING = 1e-9  # part of a cell vector in a structure file: a tilt that is only rounding
OVERLAP = 0.3  # part of a force's shortest length; at 0.3 sigma Lennard-Jones is 7 million epsilon


def lattice(kind: str, count: int, density: float) -> tuple[Floats, tuple[float, float, float]]:
    """Positions (count, 3) on a cubic lattice that fills a cube, and the cube's three equal edges.

    Parameters
    ----------
    kind : one of ``LATTICES``
    count : particles; k^3, 2 k^3, 4 k^3 or 8 k^3, so that the lattice continues across the periodic faces without a gap
    density : particles per volume

    Raises
    ------
    InputError
        For another kind, for a density that is not positive and finite, and for a count that leaves the last cells
        part empty; the message names the nearest counts that fill all cells.
    """
    check_lattice(kind, LATTICES, count, density)
    sites = np.array(LATTICES[kind])
    cells = max(round((count / len(sites)) ** (1 / 3)), 1)
    if len(sites) * cells**3 != count:
        near = sorted({len(sites) * k**3 for k in (cells - 1, cells, cells + 1) if k > 0}, key=lambda n: abs(n - count))
        low, high = sorted(near[:2])
        raise InputError(
            f"count: {count} does not fill a {kind} lattice in a cube; the nearest counts are {low} and {high}"
        )
    edge = math.cbrt(count / density)
    if not 0.0 < edge**3 < math.inf:
        raise InputError(
            f"density: {density:g} gives the box an edge of {edge:g}, whose volume is beyond the range of numbers"
        )
    corners = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    positions = ((corners + sites) * (edge / cells)).reshape(-1, 3)
    return positions, (edge, edge, edge)


def turned_at_random(shape: Floats, count: int, seed: int) -> Floats:
    """Positions (count, m, 3) of a shape (m, 3) about the origin, turned by random rotations: unit quaternions of
    normal deviates, which are uniform (Marsaglia 1972, doi:10.1214/aoms/1177692644)."""
    q = generator(seed).standard_normal((count, 4))
    w, axis = q[:, :1] / np.linalg.norm(q, axis=1, keepdims=True), q[:, 1:] / np.linalg.norm(q, axis=1, keepdims=True)
    twice = 2.0 * np.cross(axis[:, None, :], shape[None, :, :])
    return np.asarray(shape + w[:, :, None] * twice + np.cross(axis[:, None, :], twice))


def check_lattice(kind: str, kinds: Iterable[str], count: int, density: float) -> None:
    """Refuse a lattice that is not among the ``kinds``, a wrong count of particles, and a density that is not positive
    and finite."""
    if kind not in kinds:
        raise InputError(f"lattice: expected one of {', '.join(kinds)}, got {kind!r}{suggestion(kind, kinds)}")
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or not 1 <= count <= MOST:
        raise InputError(f"count: expected a whole number of particles from 1 to {MOST}, got {shown(count)}")
    check_particles("count", int(count))
    if not (math.isfinite(number(density)) and density > 0):
        raise InputError(f"density: expected a positive finite number, got {shown(density)}")


def maxwell_boltzmann(
    masses: ArrayLike,
    temperature: float,
    boltzmann: float,
    seed: int,
    dimensions: int = 3,
    conserved: bool = True,
) -> Floats:
    """Velocities (n, 3) drawn from the Maxwell-Boltzmann distribution, then adjusted to the exact temperature.

    The total momentum is subtracted, and the velocities are scaled so that 2 K = d (N - 1) k_B T holds to rounding. N
    is the number of particles with a mass and d the number of dimensions. Massless particles stand still. The draws are
    from NumPy's PCG64 with ``seed`` and are the same on every machine. NumPy may change its normal deviates between
    versions.

    Parameters
    ----------
    masses : (n,) in units that make m v^2 an energy (``System.coherent_masses``)
    temperature : zero or more
    boltzmann : ``UnitSystem.boltzmann``
    seed : a whole number, zero or more
    dimensions : 3, or 2 for velocities in the x-y plane
    conserved : whether the run conserves the total momentum; else that stays, and 2 K = d N k_B T
    """
    m = numbers("masses", masses)
    if m.ndim != 1 or not np.all(np.isfinite(m) & (m >= 0)):
        raise InputError("masses: expected a list of finite numbers, zero or more")
    if not (math.isfinite(number(temperature)) and temperature >= 0):
        raise InputError(f"temperature: expected a finite number, zero or more, got {shown(temperature)}")
    rng = generator(seed)
    moving = m > 0
    velocities = np.zeros((len(m), 3))
    if temperature == 0:
        return velocities
    if np.count_nonzero(moving) < 1 + conserved:
        if not conserved:
            raise InputError("temperature: needs a particle with mass that is not fixed")
        raise InputError("temperature: needs two or more particles with mass, since the total momentum is removed")
    draws = rng.standard_normal((len(m), dimensions))[moving]
    weight = m[moving, None] / m.max()  # relative masses, since single atoms in kilograms would underflow
    drawn = draws / np.sqrt(weight)
    if conserved:
        drawn -= (weight * drawn).sum(axis=0) / weight.sum()
    wanted = dimensions * (len(drawn) - conserved) * (boltzmann * temperature / m.max())
    velocities[moving, :dimensions] = drawn * np.sqrt(wanted / (weight * drawn**2).sum())
    return velocities


def drawn_velocities(system: Subject, temperature: float | str | None, seed: int | None) -> Floats:
    """Velocities (n, 3) of a System at a temperature, in its units or as text with a unit; see `maxwell_boltzmann`."""
    if temperature is None or seed is None:
        raise InputError("seed and temperature need each other: velocities are drawn with a seed, such as seed = 1")
    value = quantity(temperature, "temperature", system.units, "temperature")
    masses = free_masses(system)
    drawn = maxwell_boltzmann(
        masses, value, system.units.boltzmann, seed, system.dimensions, conserved=system.fixed is None
    )
    return drawn if system.constraints is None else _tangent(system, masses, drawn, value)


def _tangent(system: Subject, masses: Floats, drawn: Floats, temperature: float) -> Floats:
    """Drawn velocities (n, 3) as they are under constraints, at the exact temperature; ``masses`` (n,) carry heat."""
    held = system.constraints
    assert held is not None
    _, v, _ = held.projected(system.coherent_masses, system.state.phase[0], drawn.T)
    freedom = system.dimensions * (np.count_nonzero(masses) - (system.fixed is None)) - len(held)
    twice = float(masses @ (v * v).sum(axis=0))
    if not freedom:
        raise InputError("temperature: the constraints leave no motion besides that of the centre of mass")
    return np.asarray(v.T * math.sqrt(freedom * system.units.boltzmann * temperature / twice) if twice else v.T)


class Structure(NamedTuple):
    """Particles of an initial state. ``masses`` and ``charges`` are one number or one for each. Edges (three
    lengths or a matrix), velocities and charges are None if unknown, ``seed`` if nothing was drawn. With
    ``barycentric``, the particles must still be moved to their centre of mass. ``ephemerides`` say what
    JPL was asked, and ``fixed`` which particles stay in place."""

    positions: Floats
    masses: Any
    species: Sequence[str]
    edges: Sequence[float] | Floats | None
    periodic: bool | Sequence[bool]
    velocities: Floats | None = None
    names: Sequence[str] = ()
    radii: Sequence[float] | None = None
    charges: Any = None
    seed: int | None = None
    barycentric: bool = False
    ephemerides: tuple[str, ...] = ()
    fixed: Sequence[int] = ()


def fixed_atoms(atoms: Any) -> tuple[list[int], list[str]]:
    """Atoms that ASE's FixAtoms holds, and the names of the other constraints of ``ase.Atoms``."""
    kinds = [(type(each).__name__, each) for each in atoms.constraints]
    held = [int(i) % len(atoms) for kind, each in kinds if kind == "FixAtoms" for i in each.get_indices()]
    return sorted(set(held)), [kind for kind, _ in kinds if kind != "FixAtoms"]


NEEDS_ASE = "reading structure files needs ASE: pip install 'kickdrift[ase]'"


def read_structure(
    path: Path,
    units: UnitSystem,
    periodic: bool | Sequence[bool] | None = None,
    boxed: bool = False,
    atom_style: str | None = None,
) -> Structure:
    """Last structure in any file that ASE reads: positions, cell, masses, symbols as species, momenta and charges
    if any.

    ASE's units are angstrom, u and eV, so ``units`` must be metal, real or gromacs. Two kinds of files have numbers
    that stand as they are: exports of runs in the units of `nominal_units`, and data files of LAMMPS in metal, real, lj
    or si. In data files, species are the comments beside the masses of all types; without these the elements of the
    masses in metal and real units, else the numbers of the types. The cell may have any shape. Where the cell has not
    the form of a `Box`, positions and velocities are turned with the cell.

    Parameters
    ----------
    periodic : axes along which the box is to be periodic, default those of the file
    boxed : whether the box is known from elsewhere; positions then stay as they are in the file
    atom_style : style of the atoms in a data file of LAMMPS, default the one in the file or a guess from its columns
    """
    if why := unfit(path):
        raise InputError(f"{why}: {path}")
    lammps = is_lammps_data(path)
    known = ("metal", "real", "lj", "si") if lammps else ("metal", "real", "gromacs", nominal_units(path))
    if units.name not in known:
        if lammps:
            raise InputError(f'data files of LAMMPS are in lj, metal, real or si units; got units = "{units.name}"')
        raise InputError(
            f'structure files are in angstrom and u; expected units = "metal", "real" or "gromacs", got "{units.name}"'
        )
    if atom_style and not lammps:
        raise InputError(f"atom_style is for data files of LAMMPS, and {path} is none")
    style = atom_style or (_style_with_bonds(path) if lammps else None)
    if lammps and (table := atom_table(path, style)) is not None:
        return _of_table(table, path, units, periodic, boxed)
    try:
        from ase.io import read
    except ImportError:
        raise InputError(NEEDS_ASE) from None
    if path.suffix.lower() in (".xyz", ".extxyz"):
        _check_xyz(path)
    if path.suffix.lower() == ".gro":
        refuse_cut(path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # ASE warns of keys that are not used here
            more = {"format": "lammps-data", "atom_style": style} if lammps else {}
            atoms = read(path.absolute(), **more)  # ASE would take a name such as postgres… for a database
    except Exception as error:  # each of ASE's readers raises errors of its own
        why = shown(str(error) or type(error).__name__)
        if "atom_style cannot be guessed" in why:
            raise InputError(f"{path} does not say its atom_style, such as charge; give it beside file") from None
        if isinstance(error, DAMAGED):
            why = f"it may be cut off or damaged ({why})"
        raise InputError(f"ASE cannot read {path}: {why}") from None
    if len(atoms) == 0:
        raise InputError(f"{path} holds no atoms")
    along = tuple(bool(there) for there in atoms.pbc)
    axes = np.broadcast_to(along if periodic is None else periodic, 3)
    scale = Scale.of(UNIT_SYSTEMS["lj"] if lammps else units)  # the numbers of LAMMPS' files stand as they are
    edges, rotation = _edges(np.array(atoms.cell.array, dtype=float) * scale.length, axes, boxed, path)
    masses = atoms.get_masses()
    velocities = None
    if lammps and atoms.has("momenta"):  # the numbers of the file, whatever its units
        from ase.calculators.lammps import convert
        from ase.units import fs

        masses = masses / convert(1.0, "mass", "metal", "ASE")
        velocities = atoms.get_velocities() * (1000.0 * fs)
    elif atoms.has("momenta"):  # in u angstrom over ASE's unit of time, in which a mass of 1 u is coherent
        velocities = atoms.get_momenta() / masses[:, None] / math.sqrt(units.coherent_mass / scale.energy)
    positions, symbols = atoms.positions * scale.length, atoms.get_chemical_symbols()
    if lammps:
        symbols = _species_of_types(atoms.arrays["type"], path, units) or symbols
    if rotation is not None:
        positions = positions @ rotation.T
        velocities = None if velocities is None else velocities @ rotation.T
    if "kind" in atoms.arrays and units.name == nominal_units(path):
        symbols = [str(kind) for kind in atoms.arrays["kind"]]
    results = {} if atoms.calc is None else atoms.calc.results  # where ASE keeps a column "charge"
    charges = atoms.arrays.get("initial_charges", results.get("charges"))
    charges = charges if charges is not None and charges.any() else None
    periodic_along = along if len(set(along)) > 1 else along[0]
    fixed, others = fixed_atoms(atoms)
    if others:
        warnings.warn(f"{path}: the constraint {others[0]} has no equivalent and is left out", stacklevel=2)
    return Structure(positions, masses, symbols, edges, periodic_along, velocities, charges=charges, fixed=fixed)


def nominal_units(path: Path) -> str:
    """Name of the units of a run whose export an .extxyz file is, where its numbers stand as angstrom, u and eV: lj,
    nbody or astro. "" for any other file."""
    if path.suffix.lower() != ".extxyz" or unfit(path):
        return ""
    with path.open("rb") as file:
        comment = file.read(4096).split(b"\n")[1:2]
    said = re.search(rb" time_unit=(\w+)", comment[0]) if comment else None
    time = said[1].decode() if said else None
    return next((u.name for u in UNIT_SYSTEMS.values() if u.time == time and FileUnits.of(u).nominal), "")


def _of_table(
    table: AtomTable, path: Path, units: UnitSystem, periodic: bool | Sequence[bool] | None, boxed: bool
) -> Structure:
    """The same from the atoms of a data file of LAMMPS, whose box is periodic along all axes."""
    edges, rotation = _edges(table.cell, np.broadcast_to(True if periodic is None else periodic, 3), boxed, path)
    x, v, charges = table.positions, table.velocities, table.charges
    if rotation is not None:
        x, v = x @ rotation.T, None if v is None else v @ rotation.T
    species = _species_of_types(table.types, path, units) or elements_of(table.types, table.masses)
    charges = charges if charges is not None and charges.any() else None
    return Structure(x, table.masses, species, edges, True, v, charges=charges)


def _species_of_types(types: NDArray[np.int64], path: Path, units: UnitSystem) -> list[str]:
    """Species of atoms of these types: the names in the file, else the numbers; [] where masses may say elements."""
    names = _names_of_types(path)
    known = all(each in names for each in np.unique(types).tolist())
    if not known and units.name in ("metal", "real"):
        return []
    return [names[each] if known else str(each) for each in types.tolist()]


def elements_of(types: NDArray[np.int64], masses: Floats) -> list[str]:
    """Elements of the nearest masses, for atoms whose mass follows from their type."""
    try:
        from ase.data import atomic_masses, chemical_symbols
    except ImportError:
        raise InputError(NEEDS_ASE) from None
    kinds, first = np.unique(types, return_index=True)
    nearest = np.abs(atomic_masses - masses[first, None]).argmin(axis=1)
    symbols = dict(zip(kinds.tolist(), (chemical_symbols[each] for each in nearest), strict=True))
    return [symbols[each] for each in types.tolist()]


def _style_with_bonds(path: Path) -> str | None:
    """Atom style "molecular" for a data file of LAMMPS with bonds whose atoms have one column more than "atomic": they
    name a molecule, since style "charge" has no bonds. Else None, and where the file says its style."""
    bonds = False
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            words, _, style = line.partition("#")
            match words.split():
                case [count, "bonds"]:
                    bonds = count != "0"
                case ["Atoms"]:
                    first = next((row.partition("#")[0].split() for row in file if row.strip()), [])
                    return "molecular" if bonds and not style.strip() and len(first) in (6, 9) else None
    return None


def _names_of_types(path: Path) -> dict[int, str]:
    """Names of the types of a data file of LAMMPS: the comments beside their masses, as other programs write them."""
    found, within = {}, False
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            words, _, name = line.partition("#")
            if within and words.strip() and not words.split()[0].isdigit():
                break
            if within and name.strip():
                found[int(words.split()[0])] = " ".join(name.split())
            within = within or words.strip() == "Masses"
    return found


def _edges(cell: Floats, axes: NDArray[np.bool_], boxed: bool, path: Path) -> tuple[Any, Floats | None]:
    """The lengths or the matrix of a box with this cell (3, 3), and the rotation into the axes of the box; None where
    there is no box, and None where nothing turns."""
    if not np.isfinite(cell).all():
        raise InputError(f"the cell of {path} has numbers that are not finite: {shown(cell.tolist())}")
    cell = without_rounding(cell, ROUNDING)
    lengths = np.diag(cell)
    if np.array_equal(cell, np.diag(lengths)) and lengths.min() >= 0:
        return lengths.tolist() if lengths.any() else None, None
    if boxed or not axes.any():
        return None, None
    box, rotation = oriented(cell, axes)
    return box.matrix, None if np.array_equal(rotation, np.eye(3)) else rotation


def _check_xyz(path: Path) -> None:
    """Refuse an xyz file that claims more atoms or columns than its bytes can hold; ASE would collect these for
    ever."""
    size, frame = path.stat().st_size, 0
    with path.open("rb") as file:
        while (head := file.readline().strip()).isdigit():
            claimed = int(head[:20])
            if 2 * claimed > size:
                raise InputError(f"{path}: frame {frame} claims {shown(claimed)} atoms, but the file has {size} bytes")
            for columns in re.findall(rb":[A-Za-z]:(\d+)", file.readline()):
                if int(columns[:20]) > size:
                    raise InputError(f"{path}: frame {frame} claims {shown(int(columns[:20]))} columns of one property")
            for _ in range(claimed):
                file.readline()
            frame += 1


def generator(seed: int) -> np.random.Generator:
    """NumPy's PCG64 with this seed. Raises InputError unless the seed is a whole number, zero or more."""
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed: expected a whole number, zero or more, got {shown(seed)}")
    return np.random.Generator(np.random.PCG64(int(seed)))


def mixture(fractions: Mapping[str, float], count: int, seed: int) -> list[str]:
    """List of ``count`` names in the given fractions, as near as whole particles allow, in a random order by the
    seed."""
    share = {name: part * count for name, part in fractions.items()}
    whole = {name: int(part + 1e-9) for name, part in share.items()}
    most_cut = sorted(share, key=lambda name: whole[name] - share[name])
    for name in most_cut[: count - sum(whole.values())]:
        whole[name] += 1
    names = [name for name, number in whole.items() for _ in range(number)]
    order = generator(seed).permutation(count) if len(fractions) > 1 else range(count)
    return [names[k] for k in order]


def check_overlaps(system: Subject, near: bool = True) -> None:
    """Raise an InputError that names the closest pair and its distance if two particles overlap.

    Particles overlap if they are nearer than ``OVERLAP`` times the smallest length in any force's ``shortest()``; if no
    force has such a length, only at the very same place. Distances are between nearest images. Without forces, and if
    all forces have ``may_overlap``, nothing overlaps. Massless particles do not act on each other and may be at one
    place. Virtual sites, and species on which no pair law acts, may be near others. Without ``near``, only particles at
    the very same place are refused; a minimization moves others apart.
    """
    if all(getattr(force, "may_overlap", False) for force in system.forces) or len(system) < 2:
        return
    sized = [force for force in system.forces if getattr(force, "shortest", lambda: None)()]
    lengths = [force.shortest() for force in sized]
    wrapped = np.asarray(system.state.wrapped())
    massless = system.state.masses == 0
    order = np.lexsort((massless, *wrapped.T))  # at one place, massive particles come first
    same = np.flatnonzero(np.all(wrapped[order[1:]] == wrapped[order[:-1]], axis=1) & ~massless[order[:-1]])
    if same.size:
        first, second = sorted((int(order[same[0]]), int(order[same[0] + 1])))
        which = f"{system.body(first)} and {system.body(second)}" if system.names else f"particles {first} and {second}"
        raise InputError(f"positions: {which} are at the same place, distance 0")
    if not lengths or not near:
        return
    limit = OVERLAP * min(lengths)
    named = set().union(*(force.cores(system) if hasattr(force, "cores") else system.species for force in sized))
    cored = np.array([name in named for name in system.species])[system.species_index]
    if system.virtual_sites is not None:
        cored[system.virtual_sites.particles] = False  # such as a lone pair, a charge that may come near
    rows, wrapped = np.flatnonzero(cored), wrapped[cored]
    apart = None
    if system.topology is not None:  # the pair force of these is left out or scaled
        pairs = system.topology.scaled.pairs
        apart = (np.cumsum(cored) - 1)[pairs[cored[pairs].all(axis=1)]]
    found = nearest_pair(wrapped, system.box, limit, apart) if any_nearer(wrapped, system.box, limit) else None
    if found is None:
        return
    first, second, distance = int(rows[found[0]]), int(rows[found[1]]), found[2]
    unit = "" if system.units.reduced else f" {system.units.length}"
    raise InputError(
        f"positions: particles {first} and {second} overlap: distance {distance:.6g}{unit}, "
        f"less than {OVERLAP} of the shortest sigma, {min(lengths):.6g}{unit}; "
        "kickdrift relax (sim.minimize) moves them apart"
    )


# Sites of one rectangular cell in units of its edges, moved off its sides, and the ratio of height to width.
PLANE_LATTICES: dict[str, tuple[tuple[tuple[float, float], ...], float]] = {
    "square": (((0.5, 0.5),), 1.0),
    "hexagonal": (((0.25, 0.25), (0.75, 0.75)), math.sqrt(3.0)),
}
LONGEST = 1.5  # largest ratio of the edges of a hexagonal lattice, which cannot fill a square


def plane_lattice(kind: str, count: int, density: float) -> tuple[Floats, tuple[float, float]]:
    """Positions (count, 3) at z = 0 on a lattice that fills a rectangle, and the rectangle's two edges.

    Parameters
    ----------
    kind : "square" or "hexagonal"
        Hexagonal: each particle has six nearest neighbours. The rows lie along x.
    count : particles
        k^2 for a square. 2 a b for the hexagonal lattice, which fills a rectangle as near to a square as a and b allow;
        the longer edge is at most 1.5 times the shorter one.
    density : particles per area

    Raises
    ------
    InputError
        For another kind, for a density that is not positive and finite, and for a count that leaves the last cells
        part empty; the message names the nearest counts that fill all cells.
    """
    check_lattice(kind, PLANE_LATTICES, count, density)
    sites, height = PLANE_LATTICES[kind]
    cells = _cells(kind, count)
    if cells is None:
        below = next((n for n in range(count - 1, 0, -1) if _cells(kind, n)), None)
        above = next(n for n in itertools.count(count + 1) if _cells(kind, n))
        near = f"counts are {below} and {above}" if below else f"count is {above}"
        raise InputError(f"count: {count} does not fill a {kind} lattice; the nearest {near}")
    width = math.sqrt(len(sites) / (density * height))
    shape = width * np.array([1.0, height])
    corners = np.indices(cells).reshape(2, -1).T[:, None]
    positions = ((corners + np.array(sites)) * shape).reshape(-1, 2)
    edge_x, edge_y = (float(edge) for edge in cells * shape)
    if not 0.0 < edge_x * edge_y < math.inf:
        raise InputError(
            f"density: {density:g} gives the box edges of {edge_x:g} and {edge_y:g}; the area is not a number"
        )
    return np.column_stack([positions, np.zeros(count)]), (edge_x, edge_y)


def _cells(kind: str, count: int) -> tuple[int, int] | None:
    """Numbers of cells along x and y in the rectangle nearest to a square; None if there is none."""
    sites, height = PLANE_LATTICES[kind]
    cells, rest = divmod(count, len(sites))
    if rest or not cells:
        return None
    best = None
    for ny in (n for n in range(1, math.isqrt(cells) + 1) if cells % n == 0):
        for pair in ((cells // ny, ny), (ny, cells // ny)):
            long = abs(math.log(pair[0] / (pair[1] * height)))
            if best is None or long < best[0]:
                best = (long, pair)
    assert best is not None
    most = math.log(LONGEST) if kind == "hexagonal" else 0.0
    return best[1] if best[0] <= most else None
