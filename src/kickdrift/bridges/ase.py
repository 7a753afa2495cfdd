"""ASE's Atoms and a System, each in its own units, and an ASE calculator that runs our forces.

ASE's numbers are angstrom, eV and u, so that its unit of time is angstrom sqrt(u / eV), 10.18 fs. In ``metal`` and
``si`` they are converted; in ``lj``, ``nbody`` and ``astro`` they are taken as they stand, as ASE's own Lennard-Jones
examples do and as our files do: an angstrom is one sigma, an eV one epsilon, a u one m, ASE's unit of time one tau.

Velocities are converted so that m v^2 is the same energy on both sides, with our own constants (``model.units``). ASE's
fs comes from CODATA 2014, so times differ from those of ``ase.units`` by 5e-9, relative.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from ase import Atoms
from ase.calculators.calculator import Calculator as AseCalculator
from ase.calculators.calculator import all_changes
from ase.calculators.lj import LennardJones as AseLennardJones
from ase.data import atomic_numbers
from ase.stress import full_3x3_to_voigt_6_stress

from kickdrift.errors import InputError, RunError
from kickdrift.forces import LennardJones
from kickdrift.looks.blow_up import nearest_pair
from kickdrift.model.file_units import FileUnits
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.unit_systems import UnitSystem, unit_system
from kickdrift.model.units import quantity
from kickdrift.text import shown

NAMES, RADII = "names", "radii"  # arrays of Atoms for what ASE has no place for
UNKNOWN = "X"  # ASE's symbol of what is no element; info["species"] then says what, by the atoms' tags
SQUARE = 1e-12  # of a cell vector's length: what it may lean by, which is rounding


class Scale(NamedTuple):
    """What ASE's numbers are multiplied by to become a unit system's."""

    length: float
    energy: float
    mass: float
    velocity: float

    @property
    def force(self) -> float:
        return self.energy / self.length

    @classmethod
    def of(cls, units: UnitSystem) -> Scale:
        """All 1 where ASE does not know the units."""
        if FileUnits.of(units).nominal:
            return cls(1.0, 1.0, 1.0, 1.0)
        given = {"length": "angstrom", "energy": "eV", "mass": "u"}
        length, energy, mass = (
            1.0 if getattr(units, key) == unit else quantity(f"1 {unit}", key, units) for key, unit in given.items()
        )
        return cls(length, energy, mass, math.sqrt(energy / (mass * units.coherent_mass)))


def system_of(
    atoms: Any, forces: Iterable[Any] | None, units: str | UnitSystem, species: Iterable[str] | None = None
) -> System:
    """What `System.from_ase` returns."""
    system = _system(atoms, forces, units, species)
    if atoms.constraints:
        kind = type(atoms.constraints[0]).__name__
        raise InputError(
            f"atoms: the constraint {kind} has no equivalent in kickdrift; remove it: del atoms.constraints"
        )
    return system


def _system(atoms: Any, forces: Iterable[Any] | None, units: str | UnitSystem, species: Any = None) -> System:
    if not isinstance(atoms, Atoms):
        raise InputError(f"atoms: expected ase.Atoms, got {type(atoms).__name__}")
    units = unit_system(units) if isinstance(units, str) else units
    scale, arrays = Scale.of(units), atoms.arrays
    masses, momenta = atoms.get_masses(), atoms.get_momenta()
    stray = np.flatnonzero((masses == 0) & momenta.any(axis=1))
    if stray.size:
        raise InputError(f"atoms: atom {stray[0]} has a momentum but no mass, so its velocity is unknown")
    velocities = np.divide(momenta, masses[:, None], out=np.zeros_like(momenta), where=masses[:, None] != 0)
    return System(
        atoms.positions * scale.length,
        velocities * scale.velocity,
        masses * scale.mass,
        _box(atoms, scale),
        _forces_of(atoms, units, scale) if forces is None else forces,
        units,
        _species(atoms) if species is None else list(species),
        atoms.get_chemical_formula(),
        names=_names(atoms),
        radii=arrays[RADII] * scale.length if RADII in arrays else None,
    )


def _species(atoms: Any) -> list[str]:
    """The chemical symbols; of atoms X, what an export or `atoms_of` has written beside them."""
    symbols, known = atoms.get_chemical_symbols(), list(atoms.info.get("species", ()))
    return [
        str(known[tag]) if symbol == UNKNOWN and 0 <= tag < len(known) else symbol
        for symbol, tag in zip(symbols, atoms.get_tags(), strict=True)
    ]


def _names(atoms: Any) -> list[str]:
    """Of the bodies; an exported file has them in ``info``."""
    names = list(atoms.arrays.get(NAMES, atoms.info.get(NAMES, ())))
    return names if len(names) == len(atoms) else []


def _box(atoms: Any, scale: Scale) -> list[float] | None:
    """The edges of a cell that is periodic along x, y and z, None of an open one."""
    if not atoms.pbc.any():
        return None
    if not atoms.pbc.all():
        raise InputError(f"atoms: pbc is {atoms.pbc.tolist()}; expected a box periodic along all three axes or none")
    cell = np.asarray(atoms.cell)
    for axis, vector in enumerate(cell):
        leaning = np.abs(np.delete(vector, axis)).max()
        if not leaning <= SQUARE * vector[axis]:
            raise InputError(
                f"atoms: cell vector {'abc'[axis]} is {shown(vector.tolist())}; expected a cell with a along x, "
                "b along y and c along z"
            )
    return (np.diagonal(cell) * scale.length).tolist()


def _forces_of(atoms: Any, units: UnitSystem, scale: Scale) -> tuple[Any, ...]:
    """The forces of the calculator that the atoms carry."""
    calculator = atoms.calc
    if calculator is None:
        raise InputError("forces: needed (forces=[] means no forces), or give the atoms ASE's LennardJones calculator")
    if isinstance(calculator, Calculator):
        if calculator.units != units:
            raise InputError(
                f"forces: the calculator's forces are in units {calculator.units.name!r}, not {units.name!r}"
            )
        return calculator.forces
    if type(calculator) is not AseLennardJones:
        raise InputError(
            f"forces: the calculator {type(calculator).__name__} has no equivalent in kickdrift; give forces"
        )
    given = calculator.parameters
    if given.smooth:
        raise InputError(
            "forces: LennardJones(smooth=True) has no equivalent in kickdrift; "
            "give forces, for example with truncation='switch'"
        )
    return (
        LennardJones(  # type: ignore[call-arg]
            epsilon=float(given.epsilon) * scale.energy,
            sigma=float(given.sigma) * scale.length,
            cutoff=float(given.rc) * scale.length,
            truncation="shift",
        ),
    )


def atoms_of(system: System, symbols: Mapping[str, str] | None = None, calculator: bool = True) -> Any:
    """What `System.to_ase` returns."""
    scale, state = Scale.of(system.units), system.state
    symbol = {kind: (symbols or {}).get(kind, kind if kind in atomic_numbers else UNKNOWN) for kind in system.species}
    for kind in symbols or ():
        if kind not in symbol:
            raise InputError(f"symbols: no species {kind!r}; known are {', '.join(system.species)}")
        if symbol[kind] not in atomic_numbers:
            raise InputError(f"symbols: {shown(symbol[kind])} for species {kind!r} is not a chemical element")
    massless = np.flatnonzero(state.masses == 0)
    if massless.size:
        raise InputError(
            f"masses: {system.body(int(massless[0]))} has no mass, and ASE stores momenta: its velocity would be lost"
        )
    kinds = [system.species[k] for k in system.species_index]
    masses = state.masses / scale.mass
    lengths = system.box.lengths
    atoms = Atoms(
        [symbol[kind] for kind in kinds],
        positions=state.positions / scale.length,
        momenta=state.velocities / scale.velocity * masses[:, None],
        masses=masses,
        cell=None if lengths is None else np.array(lengths) / scale.length,
        pbc=system.box.periodic,
    )
    if UNKNOWN in symbol.values():
        atoms.set_tags(system.species_index)
        atoms.info["species"] = list(system.species)
    if system.names:
        atoms.set_array(NAMES, np.array(system.names))
    if system.radii is not None:
        atoms.set_array(RADII, system.radii / scale.length)
    if calculator and system.forces:
        atoms.calc = Calculator(system.forces, system.units)
    return atoms


class Calculator(AseCalculator):
    """An ASE calculator that runs forces of kickdrift: ``atoms.calc = Calculator([kd.LennardJones(cutoff=8.5)])``.

    It gives ``energy`` in eV, ``forces`` (n, 3) in eV/angstrom and, of a periodic cell, ``stress`` (xx, yy, zz, yz, xz,
    xy) in eV/angstrom^3: minus the sum over pairs of r F, over the volume. What is compiled for the forces and their
    pair lists are kept from call to call, and made anew only where cell, elements or masses change.

    Parameters
    ----------
    forces : iterable of forces
        Of positions alone; one that depends on velocity or does work is an InputError.
    units : str or UnitSystem
        What the forces' parameters are in; see `System.from_ase`.
    threads : int

    Raises
    ------
    InputError
        In a calculation, for atoms that `System.from_ase` refuses (constraints are ASE's own matter).
    RunError
        Where the forces are not finite.
    """

    implemented_properties = ["energy", "free_energy", "forces", "stress"]  # noqa: RUF012
    nolabel = True

    def __init__(self, forces: Iterable[Any], units: str | UnitSystem = "metal", threads: int = 1) -> None:
        super().__init__()
        self.forces = tuple(forces)
        self.units = unit_system(units) if isinstance(units, str) else units
        self.threads = threads
        for force in self.forces:
            for trait in ("velocity_dependent", "works"):
                if getattr(force, trait, False):
                    raise InputError(f"forces: {force.name} depends on more than positions, which ASE does not support")
        self._scale = Scale.of(self.units)
        self._system: System | None = None

    def check_state(self, atoms: Any, tol: float = 1e-15) -> list[str]:
        """What changed since the last calculation; ASE does not look at masses."""
        changes: list[str] = super().check_state(atoms, tol)
        if self.atoms is not None and not np.array_equal(self.atoms.get_masses(), atoms.get_masses()):
            changes.append("masses")
        return changes

    def calculate(
        self, atoms: Any = None, properties: Iterable[str] = ("energy",), system_changes: Iterable[str] = all_changes
    ) -> None:
        """Fill ``results``; called by ASE."""
        from kickdrift.forces.bound import BoundForces

        super().calculate(atoms, properties, system_changes)
        if self._system is None or not set(system_changes) <= {"positions", "initial_charges", "initial_magmoms"}:
            self._system = _system(self.atoms, self.forces, self.units)
            self._bound = BoundForces(self._system, self.threads)
        x = np.ascontiguousarray(self.atoms.positions.T * self._scale.length)
        measured = self._bound.measure(0.0, np.array([x, np.zeros_like(x)])) if np.isfinite(x).all() else None
        if measured is None:
            raise RunError(f"the forces at these positions are not finite{nearest_pair(self._system, x)}")
        energy = measured.potential / self._scale.energy
        forces: Floats = (measured.accelerations * self._system.coherent_masses).T / self._scale.force
        self.results = {"energy": energy, "free_energy": energy, "forces": np.ascontiguousarray(forces)}
        if "stress" in properties:
            self.results["stress"] = self._stress(self._system, x.T)

    def _stress(self, system: System, x: Floats) -> Floats:
        """(6,) of particles that stand still at x, in Voigt's order."""
        from kickdrift.looks.pressure import instantaneous_pressure

        pressure = instantaneous_pressure(system, x, np.zeros_like(x))
        return -full_3x3_to_voigt_6_stress(pressure) / (self._scale.energy / self._scale.length**3)
