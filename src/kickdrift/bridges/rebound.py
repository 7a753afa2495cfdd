"""Conversion between rebound's Simulation and a System: bodies, G, units, and the method if both programs have it.

A Simulation without units becomes ``nbody``. AU, yr and Msun become ``astro``; m, s and kg become ``si``. Other units
keep their names in a reduced unit system. G is always the Simulation's own, to the bit: rebound's
39.4769264214 au^3/(msun yr^2) exceeds the G of ``astro`` by 7.5e-12, relative.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import rebound
from rebound.units import lengths_SI, masses_SI, times_SI

from kickdrift.bridges.rebound_names import COORDINATES, KERNELS, LEAPFROGS, PASSAGES, SABA, key_of, passage_of
from kickdrift.errors import InputError
from kickdrift.forces import FORCES, Gravity, Hill
from kickdrift.forces.central import gravitational_constant
from kickdrift.integrators.option import HILL_RADII, INNER, JACOBI, PERICENTRE, STANDARD
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.unit_systems import UNIT_SYSTEMS, UnitSystem

TRACE = (HILL_RADII, PERICENTRE, INNER)
ALL_ACTIVE = 2**64 - 1  # N_active if it was never set
UNITS = {"astro": ("au", "yr", "msun"), "si": ("m", "s", "kg")}  # length, time, mass
NEWTON = ("basic", "compensated", "jacobi", "mercurius")  # gravity modules that sum the same forces in different ways
POINTERS = "reset function pointers"  # in rebound's warning about functions that no archive holds
FUNCTIONS = ("additional_forces", "pre_timestep_modifications", "post_timestep_modifications")


# --- from rebound ---


def system_of(sim: Any, forces: Iterable[Any] | None = None) -> System:
    """Return a System; see `System.from_rebound`."""
    if not isinstance(sim, rebound.Simulation):
        raise InputError(f"sim: expected a rebound.Simulation, got {type(sim).__name__}")
    _refuse(sim)
    units, particles = _units(sim), list(sim.particles)
    if not particles:
        raise InputError("sim: expected one particle or more, got none")
    table = np.array([(p.x, p.y, p.z, p.vx, p.vy, p.vz, p.m, p.r) for p in particles])
    masses, radii = table[:, 6], table[:, 7]
    _check_test_particles(sim, masses)
    named = [p.name for p in particles]
    names = [name or _number(i) for i, name in enumerate(named)] if any(named) else ()
    run, untaken = _run(sim, masses)
    system = System(
        table[:, :3], table[:, 3:6], masses, None, _forces(sim, units) if forces is None else forces, units,
        name="rebound", names=names, radii=radii if radii.any() else None, run=run,
    )  # fmt: skip
    untaken += [key for key in ("exit_max_distance", "exit_min_distance") if getattr(sim, key)]
    _tell("from_rebound", untaken)
    return system.at(system.state.phase, sim.t)


def _number(i: int) -> str:
    """Return the name of an unnamed body among named ones."""
    return f"particle {i}"


def _refuse(sim: Any) -> None:
    """Raise InputError for features that would make the System move differently."""
    if sim.N_var:
        raise InputError(f"sim: has {sim.N_var} variational particles; use kd.megno for variations")
    for key in FUNCTIONS:
        if getattr(sim, f"_{key}", None):
            raise InputError(f"sim: has {key}, which only rebound can call; use forces of kickdrift instead")
    if sim._N_odes:
        raise InputError("sim: its own ODEs have no equivalent in kickdrift")
    if sim.boundary != "none":
        raise InputError(f"sim: boundary {sim.boundary!r} has no equivalent in kickdrift; expected 'none'")
    if sim.collision != "none":
        raise InputError(
            f"sim: the action on collisions ({sim.collision!r}) cannot be read; set sim.collision = 'none' "
            "and give the run events=[kd.Collision(…)]"
        )
    if not math.isfinite(sim.t):
        raise InputError(f"sim: t is {sim.t}; expected a finite time")
    if not sim.is_synchronized:
        raise InputError("sim: is inside a step; call sim.synchronize() first")


def _units(sim: Any) -> UnitSystem:
    length, time, mass = (sim.units[key] for key in ("length", "time", "mass"))
    if None in (length, time, mass):
        return UNIT_SYSTEMS["nbody"]
    for name, known in UNITS.items():
        if (length, time, mass) == known:
            return UNIT_SYSTEMS[name]
    energy = f"{mass} {length}^2/{time}^2"
    return UnitSystem("nbody", length, time, mass, energy, f"({energy})/k_B", 1.0, gravity=sim.G)


def _check_test_particles(sim: Any, masses: Floats) -> None:
    """Refuse test particles with mass: in kickdrift, every body with mass attracts the others."""
    if sim.N_active >= len(masses):
        return
    massive = np.flatnonzero(masses[sim.N_active :])
    if massive.size:
        which = sim.N_active + int(massive[0])
        raise InputError(
            f"sim: particle {which} is a test particle (N_active = {sim.N_active}) with mass {masses[which]:g}; test "
            "particles in kickdrift have no mass"
        )


def _forces(sim: Any, units: UnitSystem) -> tuple[Any, ...]:
    turns = str(sim.integrator) == "sei" and sim.OMEGA
    frame = (FORCES["hill"](omega=sim.OMEGA, vertical=_vertical(sim)),) if turns else ()
    return (*_gravities(sim, units), *frame)


def _vertical(sim: Any) -> float:
    """Frequency along z over that of the frame; rebound's is the same unless OMEGAZ is set."""
    return abs(sim.OMEGAZ / sim.OMEGA) if sim.OMEGAZ > 0 else 1.0


def _gravities(sim: Any, units: UnitSystem) -> tuple[Any, ...]:
    if sim.gravity == "none":
        return ()
    if sim.gravity not in NEWTON:
        raise InputError(
            f"sim: gravity {sim.gravity!r} has no equivalent in kickdrift; give forces, for example [kd.GravityTree()]"
        )
    return (Gravity(G=None if units.gravity == sim.G else sim.G, softening=sim.softening),)


def _run(sim: Any, masses: Floats) -> tuple[RunDefaults, list[str]]:
    """Return the method and its step, and warnings about options without an equivalent here."""
    method, own = str(sim.integrator), sim.integrator
    run = RunDefaults(dt=sim.dt)
    central = int(np.argmax(masses)) == 0
    if method == "leapfrog" and own.order in LEAPFROGS:
        return run.changed(integrator=LEAPFROGS[own.order]), []
    if method == "ias15" and own.epsilon > 0 and str(own.adaptive_mode) == "PRS23":
        untaken = ["ias15's min_dt"] if own.min_dt else []
        return run.changed(integrator="gauss-radau15", rtol=own.epsilon), untaken
    if method == "whfast" and not own.corrector2 and central and str(own.coordinates) in COORDINATES:
        coordinates, kernel = COORDINATES[str(own.coordinates)], KERNELS[str(own.kernel)]
        if kernel == STANDARD:
            return run.changed(integrator="wisdom-holman", coordinates=coordinates, corrector=own.corrector), []
        if coordinates == JACOBI:
            return run.changed(integrator="wisdom-holman", corrector=own.corrector, kernel=kernel), []
    if method == "trace" and central and own.peri_crit_eta in (1.0, math.inf) and not _own_switch(own):
        way, inner = PASSAGES[str(own.peri_mode)]
        way = way if own.peri_crit_eta == 1.0 else "none"
        return run.changed(integrator="trace", hill_radii=own.r_crit_hill, pericentre=way, inner=inner), []
    if method == "sei" and sim.OMEGA:
        return run.changed(integrator="sei"), []
    if method == "saba" and central and str(own.type) in SABA:
        return run.changed(integrator="saba", order=SABA[str(own.type)], coordinates=JACOBI), []
    return RunDefaults(), [f"integrator {method!r} with its settings and its step"]


def _own_switch(own: Any) -> bool:
    """Tell whether a user's function decides where trace's encounters or passages begin."""
    for key in ("S", "S_peri"):
        try:
            if getattr(own, key):
                return True
        except TypeError:  # rebound cannot read a pointer that was never set
            pass
    return False


def _tell(what: str, untaken: list[str]) -> None:
    if untaken:
        warnings.warn(f"{what}: left out, without an equivalent in kickdrift: {'; '.join(untaken)}", stacklevel=4)


# --- from an archive ---


def archived_system(path: Path, snapshot: int | None = None) -> System:
    """Return the System of a snapshot, by default the last, named after the file; see ``kickdrift.load``."""
    snapshot = -1 if snapshot is None else snapshot
    if isinstance(snapshot, bool) or not isinstance(snapshot, int | np.integer):
        raise InputError(f"snapshot: expected a whole number, got {snapshot!r}")
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        archive = archive_at(path)
        count = len(archive)
        if not -count <= snapshot < count:
            raise InputError(f"{path}: has no snapshot {snapshot}; the archive holds {count}, from 0 to {count - 1}")
        sim = archive[snapshot]
        if not sim.is_synchronized:
            sim.synchronize()
    lost = [str(each.message) for each in said]
    told = ["additional forces and other functions, which no archive holds"] if any(POINTERS in s for s in lost) else []
    if any("corrupt" in each for each in lost):
        warnings.warn(f"{path}: the end of the archive is damaged; its {count} whole snapshots are read", stacklevel=4)
    if sim.collision != "none":
        told.append(f"the action on collisions ({sim.collision!r}); give the run events=[kd.Collision(…)]")
        sim.collision = "none"
    try:
        system = system_of(sim)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    if told:
        warnings.warn(f"{path}: left out: {'; '.join(told)}", stacklevel=4)
    return system.remade(name=path.stem)


def archive_at(path: Path) -> Any:
    """A rebound.Simulationarchive. rebound takes names in ASCII alone; other files are read whole."""
    try:
        return rebound.Simulationarchive(str(path) if str(path).isascii() else path.read_bytes())
    except RuntimeError as error:
        raise InputError(f"{path}: rebound cannot read this archive: {' '.join(str(error).split())}") from None


# --- to rebound ---


def simulation_of(system: System) -> Any:
    """Return a rebound Simulation; see `System.to_rebound`."""
    hill = [force for force in system.forces if isinstance(force, Hill)] if system.run.integrator == "sei" else []
    gravity = _gravity(system, hill)
    if system.box.periodic:
        raise InputError("to_rebound: the box is periodic; rebound's boundaries differ from kickdrift's")
    if system.units.coherent_mass != 1.0:
        raise InputError(f"to_rebound: rebound cannot express units {system.units.name!r}, in which force is not m a")
    sim, state = rebound.Simulation(), system.state
    if (units := _rebound_units(system.units)) is not None:
        sim.units = units
    if gravity is None:
        sim.gravity = "none"
    else:
        sim.G = gravitational_constant(gravity.name, gravity.G, system)
        sim.softening = gravity.softening
    radii = np.zeros(len(system)) if system.radii is None else system.radii
    rows = np.column_stack([state.masses, state.positions, state.velocities, radii]).tolist()
    for i, (m, x, y, z, vx, vy, vz, r) in enumerate(rows):
        name = system.names[i] if system.names and system.names[i] != _number(i) else None
        sim.add(m=m, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, r=r, name=name)
    massive = int(np.count_nonzero(state.masses))
    if massive < len(system) and state.masses[:massive].all():
        sim.N_active = massive
    sim.t = state.time
    untaken = _set_method(sim, system) + [f"event {event.kind}" for event in system.events]
    _tell("to_rebound", untaken)
    return sim


def _gravity(system: System, frame: list[Any]) -> Gravity | None:
    forces = [force for force in system.forces if force not in frame]
    strange = [force.name for force in forces if not isinstance(force, Gravity)]
    if strange:
        raise InputError(f"to_rebound: rebound has no force {strange[0]!r}; expected only gravity")
    if len(forces) > 1:
        raise InputError("to_rebound: expected one gravity force, got two")
    return forces[0] if forces else None


def _rebound_units(units: UnitSystem) -> tuple[str, str, str] | None:
    """Return rebound's names of the units of length, time and mass; None for plain numbers."""
    if units.name in UNITS:
        return UNITS[units.name]
    known = units.length in lengths_SI and units.time in times_SI and units.mass in masses_SI
    return (units.length, units.time, units.mass) if known else None


def _set_method(sim: Any, system: System) -> list[str]:
    """Set the integrator if rebound has it; return warnings about options without an equivalent."""
    run, masses = system.run, system.state.masses
    if run.dt is not None:
        sim.dt = run.dt
    central = int(np.argmax(masses)) == 0
    if run.integrator is None:
        return []
    if run.integrator == "gauss-radau15":
        sim.integrator = "ias15"
        if run.options.get("rtol") is not None:
            sim.integrator.epsilon = run.options["rtol"]
        return []
    if run.integrator == "sei":
        (hill,) = (force for force in system.forces if isinstance(force, Hill))
        sim.integrator, sim.OMEGA, sim.OMEGAZ = "sei", hill.omega, hill.vertical * abs(hill.omega)
        return []
    for order, name in LEAPFROGS.items():
        if run.integrator == name:
            sim.integrator = "leapfrog"
            sim.integrator.order = order
            return []
    if run.integrator == "wisdom-holman" and central:
        sim.integrator = "whfast"
        sim.integrator.coordinates = key_of(COORDINATES, run.options.get("coordinates", JACOBI))
        sim.integrator.corrector = run.options.get("corrector", 0)
        sim.integrator.kernel = key_of(KERNELS, run.options.get("kernel", STANDARD))
        return []
    if run.integrator == "trace" and central:
        own: dict[str, Any] = {each.name: run.options.get(each.name, each.default) for each in TRACE}
        sim.integrator = "trace"
        sim.integrator.r_crit_hill = own["hill_radii"]
        sim.integrator.peri_mode = passage_of(own["pericentre"], own["inner"])
        if own["pericentre"] == "none":
            sim.integrator.peri_crit_eta = math.inf  # no step is longer than this times the time scale
        return []
    order_there = key_of(SABA, run.options.get("order", "10,6,4"))
    if run.integrator == "saba" and central and order_there and run.options.get("coordinates", JACOBI) == JACOBI:
        sim.integrator = "saba"
        sim.integrator.type = order_there
        return []
    return [f"integrator {run.integrator!r} as it is set here"]
