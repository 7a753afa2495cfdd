"""Conversion between rebound's Simulation and a System: bodies, G, units, and the method if both programs have it.

A Simulation without units becomes ``nbody``. AU, yr and Msun become ``astro``; m, s and kg become ``si``. Other units
keep their names in a reduced unit system. G is always the Simulation's own, to the bit: rebound's
39.4769264214 au^3/(msun yr^2) exceeds the G of ``astro`` by 7.5e-12, relative.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import rebound
from rebound.units import lengths_SI, masses_SI, times_SI

from kickdrift.bridges.rebound_names import COORDINATES, KERNELS, LEAPFROGS, SABA, key_of, passage_of
from kickdrift.bridges.rebound_reading import archived_system as archived_system
from kickdrift.bridges.rebound_snapshot import COLUMNS, described
from kickdrift.bridges.rebound_system import UNITS, system_from, tell, unnamed
from kickdrift.errors import InputError
from kickdrift.forces import Gravity, Hill
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.integrators.options import HILL_RADII, INNER, JACOBI, PERICENTRE, STANDARD
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem

TRACE = (HILL_RADII, PERICENTRE, INNER)
ALL_ACTIVE = 2**64 - 1  # N_active if it was never set


def system_of(sim: Any, forces: Iterable[Any] | None = None) -> System:
    """Return a System; see `System.from_rebound`."""
    if not isinstance(sim, rebound.Simulation):
        raise InputError(f"sim: expected a rebound.Simulation, got {type(sim).__name__}")
    snapshot, table = described(sim)
    return system_from(snapshot, np.frombuffer(table).reshape(len(COLUMNS), -1).T, forces)


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
        name = system.names[i] if system.names and system.names[i] != unnamed(i) else None
        sim.add(m=m, x=x, y=y, z=z, vx=vx, vy=vy, vz=vz, r=r, name=name)
    massive = int(np.count_nonzero(state.masses))
    if massive < len(system) and state.masses[:massive].all():
        sim.N_active = massive
    sim.t = state.time
    untaken = _set_method(sim, system) + [f"event {event.kind}" for event in system.events]
    tell("to_rebound", untaken, 4)
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
