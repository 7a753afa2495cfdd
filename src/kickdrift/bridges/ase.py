"""ASE's Atoms and a System, each in its own units, and an ASE calculator that runs our forces.

ASE's units are angstrom, eV and u, so its unit of time is angstrom sqrt(u / eV), 10.18 fs. In ``metal`` and ``si`` the
numbers are converted. In ``lj``, ``nbody`` and ``astro`` the numbers stay the same, as in ASE's Lennard-Jones examples
and in our files: an angstrom is one sigma, an eV one epsilon, a u one m, ASE's unit of time one tau.

Velocities are converted with our own constants (``model.units.quantities``), so that m v^2 is the same energy on both
sides. ASE's fs comes from CODATA 2014, so times differ from ``ase.units`` by 5e-9, relative.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any
from warnings import warn

import numpy as np
from ase import Atoms
from ase.calculators.calculator import Calculator as AseCalculator
from ase.calculators.calculator import all_changes
from ase.calculators.lj import LennardJones as AseLennardJones
from ase.calculators.singlepoint import SinglePointCalculator
from ase.constraints import FixAtoms
from ase.data import atomic_numbers
from ase.stress import full_3x3_to_voigt_6_stress

from kickdrift.errors import InputError, RunError
from kickdrift.forces import CalculatorForce, LennardJones
from kickdrift.looks.doubts import nearest_pair
from kickdrift.model.any_cell import oriented, without_rounding
from kickdrift.model.box.box import Box, Oriented
from kickdrift.model.fixed import Fixed
from kickdrift.model.molecules.topology import SIZES, Topology
from kickdrift.model.starts.builders import fixed_atoms
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.file_units import Scale, elementary_charge
from kickdrift.model.units.unit_systems import UnitSystem, unit_system
from kickdrift.text import choices, shown

INITIAL_CHARGES = "initial_charges"
NAMES, RADII = "names", "radii"  # arrays of Atoms for data without a place in ASE
UNKNOWN = "X"  # ASE's symbol for no element; info["species"] then names the species, by the atoms' tags
DIMENSIONS = "dimensions"  # 2 in info, for particles in a plane
SQUARE = 1e-12  # tilt of a cell vector, relative to its length, that counts as rounding


def system_of(
    atoms: Any, forces: Iterable[Any] | None, units: str | UnitSystem, species: Iterable[str] | None = None
) -> System:
    """Return a System; see `System.from_ase`."""
    system, _ = _system(atoms, forces, units, species)
    fixed, others = fixed_atoms(atoms)
    if others:
        raise InputError(
            f"atoms: the constraint {others[0]} has no equivalent in kickdrift; FixAtoms has one; remove it: "
            "del atoms.constraints"
        )
    return system.with_fixed(Fixed(fixed)) if fixed else system


def _system(
    atoms: Any,
    forces: Iterable[Any] | None,
    units: str | UnitSystem,
    species: Any = None,
    topology: Topology | None = None,
) -> tuple[System, Floats | None]:
    """Return the System, and the rotation (3, 3) of ASE's axes into its own; None if the axes are the same."""
    if not isinstance(atoms, Atoms):
        raise InputError(f"atoms: expected ase.Atoms, got {type(atoms).__name__}")
    units = unit_system(units) if isinstance(units, str) else units
    scale, arrays = Scale.of(units), atoms.arrays
    species = None if species is None else list(species)
    masses, momenta = atoms.get_masses(), atoms.get_momenta()
    stray = np.flatnonzero((masses == 0) & momenta.any(axis=1))
    if stray.size:
        raise InputError(f"atoms: atom {stray[0]} has a momentum but no mass, so its velocity is unknown")
    velocities = np.divide(momenta, masses[:, None], out=np.zeros_like(momenta), where=masses[:, None] != 0)
    positions = atoms.positions
    box, turn = _box(atoms, scale)
    rotation = None if np.array_equal(turn, np.eye(3)) else turn
    if rotation is not None:
        positions, velocities = positions @ rotation.T, velocities @ rotation.T
    system = System(
        positions * scale.length,
        velocities * scale.velocity,
        masses * scale.mass,
        box,
        _forces_of(atoms, units, scale, species) if forces is None else forces,
        units,
        _species(atoms) if species is None else species,
        atoms.get_chemical_formula(),
        names=_names(atoms),
        radii=arrays[RADII] * scale.length if RADII in arrays else None,
        dimensions=_dimensions(atoms),
        topology=_topology(atoms) if topology is None else topology,
        charges=_charges(atoms, units),
    )
    return system, rotation


def _topology(atoms: Any) -> Topology | None:
    """Return the topology of the atoms' calculator, or of lists that ASE's reader of LAMMPS data files stored."""
    if (kept := getattr(atoms.calc, "topology", None)) is not None and isinstance(kept, Topology):
        return kept
    return Topology.from_ase(atoms) if any(kind in atoms.arrays for kind in SIZES) else None


def _charges(atoms: Any, units: UnitSystem) -> Floats | None:
    """Return the initial charges, which are in elementary charges, in the units; None without any."""
    found = atoms.arrays.get(INITIAL_CHARGES)
    return None if found is None or not found.any() else found * elementary_charge(units)


def _dimensions(atoms: Any) -> int:
    """Return 2 for atoms whose ``info`` says so, as `atoms_of` and exports write it; else 3."""
    given = atoms.info.get(DIMENSIONS)
    return 2 if isinstance(given, int | np.integer) and given == 2 else 3


def _species(atoms: Any) -> list[str]:
    """Return the chemical symbols; for atoms X, the species that an export or `atoms_of` stored."""
    symbols, known = atoms.get_chemical_symbols(), list(atoms.info.get("species", ()))
    return [
        str(known[tag]) if symbol == UNKNOWN and 0 <= tag < len(known) else symbol
        for symbol, tag in zip(symbols, atoms.get_tags(), strict=True)
    ]


def symbols_of(species: Sequence[str], given: Mapping[str, str]) -> dict[str, str]:
    """Chemical symbol of each species: the ``given`` one, else its own name if all others are elements, else X. So the
    species A and B of a mixture are no boron."""
    known = all(kind in atomic_numbers for kind in species if kind not in given)
    return {kind: given.get(kind, kind if known else UNKNOWN) for kind in species}


def _names(atoms: Any) -> list[str]:
    """Return the names of the bodies; an exported file has them in ``info``."""
    names = list(atoms.arrays.get(NAMES, atoms.info.get(NAMES, ())))
    return names if len(names) == len(atoms) else []


def _box(atoms: Any, scale: Scale) -> Oriented:
    """Return the cell as a Box, and the rotation of the atoms into its axes."""
    axes = np.array(atoms.pbc, dtype=bool)
    if not axes.any():
        return Oriented(Box(), np.eye(3))
    cell = np.array(atoms.cell, dtype=float) * scale.length
    if not np.isfinite(cell).all():
        raise InputError(f"atoms: cell: expected finite numbers, got {shown(cell.tolist())}")
    return oriented(without_rounding(cell, SQUARE), axes)


def _forces_of(atoms: Any, units: UnitSystem, scale: Scale, species: list[str] | None) -> tuple[Any, ...]:
    """Return the forces of the atoms' calculator."""
    calculator = atoms.calc
    if calculator is None:
        raise InputError("forces: needed (forces=[] means no forces), or give the atoms ASE's LennardJones calculator")
    if isinstance(calculator, Calculator):
        if calculator.units != units:
            raise InputError(
                f"forces: the calculator's forces are in units {calculator.units.name!r}, not {units.name!r}"
            )
        return calculator.forces
    if isinstance(calculator, SinglePointCalculator):
        raise InputError(
            f"forces: the calculator {type(calculator).__name__} only holds results of one configuration; give forces"
        )
    if type(calculator) is not AseLennardJones or calculator.parameters.smooth:
        _check_plain(atoms)
        symbols = None if species is None else dict(zip(species, atoms.get_chemical_symbols(), strict=False))
        return (CalculatorForce(calculator, symbols=symbols),)
    given = calculator.parameters
    return (
        LennardJones(  # type: ignore[call-arg]
            epsilon=float(given.epsilon) * scale.energy,
            sigma=float(given.sigma) * scale.length,
            cutoff=float(given.rc) * scale.length,
            truncation="shift",
        ),
    )


def _check_plain(atoms: Any) -> None:
    """Refuse charges and magnetic moments, which a calculator would no longer see."""
    for key in (INITIAL_CHARGES, "initial_magmoms"):
        if key in atoms.arrays and atoms.arrays[key].any():
            raise InputError(f"atoms: {key} have no place in a System, so its calculator would not see them")


def atoms_of(system: System, symbols: Mapping[str, str] | None = None, calculator: bool = True) -> Any:
    """Return ASE Atoms; see `System.to_ase`."""
    scale, state = Scale.of(system.units), system.state
    symbol = symbols_of(system.species, symbols or {})
    for kind in symbols or ():
        if kind not in system.species:
            raise InputError(f"symbols: no species {shown(kind)}; known are {choices(system.species, kind)}")
        if symbol[kind] not in atomic_numbers:
            raise InputError(f"symbols: {shown(symbol[kind])} for species {kind!r} is not a chemical element")
    if system.constraints is not None:
        warn("constraints: ASE's Atoms are without them; ASE has FixBondLengths", stacklevel=3)
    if system.fixed is not None and system.fixed.move:
        warn("fixed: ASE's FixAtoms keeps atoms at rest, so those at a given velocity are free", stacklevel=3)
    massless = np.flatnonzero(state.masses == 0)
    if massless.size:
        raise InputError(
            f"masses: {system.body(int(massless[0]))} has no mass, and ASE stores momenta: its velocity would be lost"
        )
    kinds = [system.species[k] for k in system.species_index]
    masses = state.masses / scale.mass
    atoms = Atoms(
        [symbol[kind] for kind in kinds],
        positions=state.positions / scale.length,
        momenta=state.velocities / scale.velocity * masses[:, None],
        masses=masses,
        cell=system.box.matrix / scale.length,
        pbc=system.box.periodic_axes,
    )
    if UNKNOWN in symbol.values():
        atoms.set_tags(system.species_index)
        atoms.info["species"] = list(system.species)
    if system.names:
        atoms.set_array(NAMES, np.array(system.names))
    if system.radii is not None:
        atoms.set_array(RADII, system.radii / scale.length)
    if system.charges is not None:
        atoms.set_initial_charges(system.charges / elementary_charge(system.units))
    if system.dimensions == 2:
        atoms.info[DIMENSIONS] = 2
    if system.fixed is not None and len(still := system.fixed.particles[~system.fixed.velocities.any(axis=0)]):
        atoms.set_constraint(FixAtoms(still))
    if calculator and system.forces:
        one = system.forces[0] if len(system.forces) == 1 else None
        ready = vars(one)["made"] if isinstance(one, CalculatorForce) and not one.symbols else None
        atoms.calc = ready or Calculator(system.forces, system.units, topology=system.topology)
    return atoms


class Calculator(AseCalculator):
    """An ASE calculator that runs forces of kickdrift: ``atoms.calc = Calculator([kd.LennardJones(cutoff=8.5)])``.

    Results are ``energy`` in eV, ``forces`` (n, 3) in eV/angstrom and, for a periodic cell, ``stress`` (xx, yy, zz, yz,
    xz, xy) in eV/angstrom^3: minus the sum over pairs of r F, divided by the volume. Compiled code and pair lists are
    kept between calls. They are made again only if cell, elements or masses change.

    Parameters
    ----------
    forces : iterable of forces
        Forces that depend on positions alone. Any other force raises InputError.
    units : str or UnitSystem
        Units of the forces' parameters; see `System.from_ase`.
    threads : int
    topology : Topology of molecules; default that of the atoms, see `System.from_ase`

    Raises
    ------
    InputError
        In a calculation, for atoms that `System.from_ase` refuses, and for the stress in two dimensions. Constraints
        are allowed: ASE applies them.
    RunError
        If the forces are not finite.
    """

    implemented_properties = ["energy", "free_energy", "forces", "stress"]  # noqa: RUF012
    nolabel = True

    def __init__(
        self,
        forces: Iterable[Any],
        units: str | UnitSystem = "metal",
        threads: int = 1,
        topology: Topology | None = None,
    ) -> None:
        super().__init__()
        self.forces = tuple(forces)
        self.units = unit_system(units) if isinstance(units, str) else units
        self.threads, self.topology = threads, topology
        for force in self.forces:
            for trait in ("velocity_dependent", "works"):
                if getattr(force, trait, False):
                    raise InputError(f"forces: {force.name} depends on more than positions, which ASE does not support")
        self._scale = Scale.of(self.units)
        self._system: System | None = None

    def check_state(self, atoms: Any, tol: float = 1e-15) -> list[str]:
        """Return what changed since the last calculation, including masses, which ASE does not check."""
        changes: list[str] = super().check_state(atoms, tol)
        if self.atoms is not None and not np.array_equal(self.atoms.get_masses(), atoms.get_masses()):
            changes.append("masses")
        return changes

    def calculate(
        self, atoms: Any = None, properties: Iterable[str] = ("energy",), system_changes: Iterable[str] = all_changes
    ) -> None:
        """Fill ``results``; ASE calls this method."""
        from kickdrift.forces.bound.forces import BoundForces

        super().calculate(atoms, properties, system_changes)
        if self._system is None or not set(system_changes) <= {"positions", "initial_magmoms"}:
            self._system, self._rotation = _system(self.atoms, self.forces, self.units, topology=self.topology)
            self._bound = BoundForces(self._system, self.threads)
        turn = np.eye(3) if self._rotation is None else self._rotation
        given = self.atoms.positions if self._rotation is None else self.atoms.positions @ turn.T
        x = np.ascontiguousarray(given.T * self._scale.length)
        measured = self._bound.measure(0.0, np.array([x, np.zeros_like(x)])) if np.isfinite(x).all() else None
        if measured is None:
            raise RunError(f"the forces at these positions are not finite{nearest_pair(self._system, x)}")
        energy = measured.potential / self._scale.energy
        forces: Floats = (measured.accelerations * self._system.coherent_masses).T / self._scale.force
        if self._rotation is not None:
            forces = forces @ turn
        self.results = {"energy": energy, "free_energy": energy, "forces": np.ascontiguousarray(forces)}
        if "stress" in properties:
            self.results["stress"] = self._stress(self._system, x.T, turn)

    def _stress(self, system: System, x: Floats, turn: Floats) -> Floats:
        """Return the stress (6,) of particles at rest at x, in Voigt's order and ASE's axes.

        The rotation ``turn`` (3, 3) turns ASE's axes into the System's.
        """
        from kickdrift.looks.pressure import instantaneous_pressure

        if system.dimensions == 2:
            raise InputError("stress: ASE's is a force over an area, and in two dimensions it is a force over a length")
        pressure = turn.T @ instantaneous_pressure(system, x, np.zeros_like(x)) @ turn
        return -full_3x3_to_voigt_6_stress(pressure) / (self._scale.energy / self._scale.length**3)
