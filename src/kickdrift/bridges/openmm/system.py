"""A System of OpenMM's System, Topology and positions, in units that both share: nm, ps, u, kJ/mol."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import openmm
from openmm import unit

from kickdrift.bridges.openmm.files import Asked, read
from kickdrift.bridges.openmm.nonbonded import nonbonded
from kickdrift.bridges.openmm.out import element_of
from kickdrift.bridges.openmm.out import parts_of as parts_of  # System.to_openmm
from kickdrift.bridges.openmm.terms import TAKEN, Molecules, number
from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.fixed import Fixed
from kickdrift.model.molecules.constraint import Constraint
from kickdrift.model.molecules.topology import Topology
from kickdrift.model.molecules.virtual_sites import VirtualSite
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.text import shown

UNITS = UNIT_SYSTEMS["gromacs"]
PAIRS, OWN_PAIRS, BAROSTAT = "NonbondedForce", "CustomNonbondedForce", "MonteCarloBarostat"
NEEDLESS = "CMMotionRemover"  # methods keep the total momentum; Langevin baths move it, and temperatures count that
UNKNOWN = "X"  # symbol of a site without an element
MIDDLE = {"friction": 1.0}  # per ps, for a barostat whose heat bath is not stated; OpenMM's examples have this value
WATER = "4.5e-5 bar^-1"  # compressibility; OpenMM's barostat has none, and the size of moves follows from it


def system_of(
    given: Any, topology: Any, positions: Any, velocities: Any = None, integrator: Any = None, *, name: str = "openmm"
) -> System:
    """Return the System; see `System.from_openmm`."""
    if not isinstance(given, openmm.System):
        raise InputError(f"system: expected openmm.System, got {type(given).__name__}")
    n = given.getNumParticles()
    symbols, bonds = _read(topology, n)
    masses = [number(given.getParticleMass(i)) for i in range(n)]
    still = [i for i, mass in enumerate(masses) if not mass and not given.isVirtualSite(i)]
    for i in still:  # which OpenMM leaves in place; kickdrift's particles keep a mass
        element = element_of(symbols[i])
        masses[i] = 1.0 if element is None else element.mass._value
    x = _vectors("positions", positions, unit.nanometer, n)
    v = None if velocities is None else _vectors("velocities", velocities, unit.nanometer / unit.picosecond, n)
    _refuse(given)
    kept = [given.getConstraintParameters(k) for k in range(given.getNumConstraints())]
    pairs = [(i, j) for i, j, _ in kept]
    molecules, barostat = Molecules(_bonds(given, pairs) if bonds is None else bonds), None
    pair_forces: dict[str, list[Any]] = {PAIRS: [], OWN_PAIRS: []}
    for force in given.getForces():
        kind = type(force).__name__
        if kind in TAKEN:
            TAKEN[kind](molecules, force)
        elif kind in pair_forces:
            pair_forces[kind].append(force)
        elif kind == BAROSTAT:
            barostat = force
    if len(pair_forces[PAIRS]) > 1:
        raise InputError(f"system: has {len(pair_forces[PAIRS])} forces {PAIRS}; kickdrift takes one")
    plain = next(iter(pair_forces[PAIRS]), None)
    found = nonbonded(plain, symbols, x, pair_forces[OWN_PAIRS]) if any(pair_forces.values()) else None
    species = found.species if found else list(symbols)
    lists, forces = molecules.lists(species)
    box, turn = Box(None), np.eye(3)
    if given.usesPeriodicBoundaryConditions():
        box, turn = Box.from_vectors([number(row) for row in given.getDefaultPeriodicBoxVectors()])
    made = System(
        x @ turn.T,
        None if v is None else v @ turn.T,
        masses,
        box if box.periodic else None,
        [*(found.forces if found else ()), *forces],
        UNITS,
        species,
        name,
        _run(barostat, integrator),
        topology=Topology(**lists, exclusions=found.exclusions if found else ()) if lists or found else None,
        charges=found.charges if found else None,
        constraints=[Constraint(pairs=pairs, distance=[number(length) for *_, length in kept])] if kept else None,
        virtual_sites=_sites(given),
    )
    return made.with_fixed(Fixed(still)) if still else made


def file_system(path: Path, asked: Asked) -> System:
    """Return the System of a file of parameters, or of a structure with a force field; see `kickdrift.load`."""
    return system_of(*read(path, asked), name=path.stem)


def _read(topology: Any, n: int) -> tuple[list[str], list[tuple[int, int]] | None]:
    """Symbol of each particle, and the bonds; without a topology one symbol, and no bonds known."""
    if topology is None:
        return ["A"] * n, None
    if not hasattr(topology, "atoms"):
        raise InputError(f"topology: expected openmm.app.Topology, got {type(topology).__name__}")
    atoms = list(topology.atoms())
    if len(atoms) != n:
        raise InputError(f"topology: has {len(atoms):,} atoms, and the system {n:,} particles")
    symbols = [UNKNOWN if atom.element is None else atom.element.symbol for atom in atoms]
    return symbols, [(first.index, second.index) for first, second in topology.bonds()]


def _bonds(given: Any, pairs: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Bonds of a system without a topology: those with a harmonic term, and rigid ones."""
    harmonic = [force for force in given.getForces() if type(force).__name__ == "HarmonicBondForce"]
    return [*pairs, *(tuple(force.getBondParameters(k)[:2]) for force in harmonic for k in range(force.getNumBonds()))]


def _vectors(key: str, values: Any, of: Any, n: int) -> Floats:
    """Positions or velocities (n, 3), given with OpenMM's units or as numbers in nm and ps."""
    try:
        plain = values.value_in_unit(of) if unit.is_quantity(values) else values
        if isinstance(plain, list | tuple) and len(plain) and unit.is_quantity(plain[0]):
            plain = [each.value_in_unit(of) for each in plain]
        found = np.array(plain, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"{key}: expected vectors in a unit such as {of}, got {shown(values)}") from None
    if found.shape != (n, 3):
        raise InputError(f"{key}: expected shape ({n}, 3), one row for each particle of the system, got {found.shape}")
    return found


SITES: dict[str, Callable[[Any], tuple[tuple[float, ...], float]]] = {  # weights, and the factor of the cross product
    "TwoParticleAverageSite": lambda site: ((site.getWeight(0), site.getWeight(1)), 0.0),
    "ThreeParticleAverageSite": lambda site: ((site.getWeight(0), site.getWeight(1), site.getWeight(2)), 0.0),
    "OutOfPlaneSite": lambda site: (
        (1.0 - site.getWeight12() - site.getWeight13(), site.getWeight12(), site.getWeight13()), site.getWeightCross()
    ),
}  # fmt: skip


def _sites(given: Any) -> list[VirtualSite] | None:
    """The virtual sites. Each `VirtualSite` holds all sites with the same weights and factor."""
    found: dict[Any, tuple[list[int], list[list[int]]]] = {}
    for i in filter(given.isVirtualSite, range(given.getNumParticles())):
        site = given.getVirtualSite(i)
        form = SITES[type(site).__name__](site)
        particles, of = found.setdefault(form, ([], []))
        particles.append(i)
        of.append([site.getParticle(k) for k in range(site.getNumParticles())])
    return [VirtualSite(*lists, weights, normal) for (weights, normal), lists in found.items()] or None


def _refuse(given: Any) -> None:
    """Refuse what has no counterpart: other virtual sites, and other forces."""
    for i in filter(given.isVirtualSite, range(given.getNumParticles())):
        if (kind := type(given.getVirtualSite(i)).__name__) not in SITES:
            raise InputError(f"system: particle {i} is a {kind}, which has no counterpart in kickdrift")
    for k, force in enumerate(given.getForces()):
        kind = type(force).__name__
        if kind not in (*TAKEN, PAIRS, OWN_PAIRS, BAROSTAT, NEEDLESS):
            raise InputError(f"system: force {k}, {kind}, has no counterpart in kickdrift{_first_term(force)}")


def _first_term(force: Any) -> str:
    """Particles of a force's first term as text; "" if its terms do not list particles."""
    for count, term in (("getNumBonds", "getBondParameters"), ("getNumAngles", "getAngleParameters"),
                        ("getNumTorsions", "getTorsionParameters")):  # fmt: skip
        if hasattr(force, count) and getattr(force, count)():
            found = [each for each in getattr(force, term)(0) if isinstance(each, int)]
            found = found[1:] if type(force).__name__ == "CMAPTorsionForce" else found  # the number of its map
            return f"; its first term is of the particles {', '.join(map(str, found))}"
    return ""


METHODS = {
    "VerletIntegrator": "velocity-verlet", "LangevinMiddleIntegrator": "baoa", "LangevinIntegrator": "baoa",
}  # fmt: skip


def _run(barostat: Any, integrator: Any) -> RunDefaults:
    """Defaults of a run from OpenMM's integrator and barostat."""
    chosen: dict[str, Any] = {}
    if integrator is not None:
        kind = type(integrator).__name__
        if kind not in METHODS:
            raise InputError(f"integrator: {kind} has no counterpart in kickdrift; possible are {', '.join(METHODS)}")
        chosen = {"integrator": METHODS[kind], "dt": number(integrator.getStepSize())}
        if kind.startswith("Langevin"):
            chosen |= {
                "temperature": number(integrator.getTemperature()), "friction": number(integrator.getFriction())
            }  # fmt: skip
    if barostat is not None and barostat.getFrequency():
        temperature = number(barostat.getDefaultTemperature())
        bath = {"integrator": "baoa", "temperature": temperature, **MIDDLE}
        bar = number(barostat.getDefaultPressure())
        pressure = quantity(f"{bar!r} bar", "pressure", UNITS, "pressure")
        chosen = bath | chosen | {
            "barostat": "monte-carlo", "pressure": pressure, "pressure_every": barostat.getFrequency(),
            "compressibility": quantity(WATER, "compressibility", UNITS, "compressibility"),
        }  # fmt: skip
    return RunDefaults(**chosen)
