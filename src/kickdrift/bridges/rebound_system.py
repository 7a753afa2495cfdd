"""A System of the plain data of rebound's Simulation, and rebound's names for options of shared methods.

This module does not import rebound.
"""

import math
import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np

from kickdrift.bridges.rebound_snapshot import Snapshot
from kickdrift.errors import InputError
from kickdrift.forces import FORCES, Gravity
from kickdrift.integrators.options import COMPOSITION, HELIOCENTRIC, JACOBI, LAZY, MODIFIED_KICK, STANDARD
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS, UnitSystem
from kickdrift.text import shown

COORDINATES = {"JACOBI": JACOBI, "DEMOCRATICHELIOCENTRIC": HELIOCENTRIC}
KERNELS = {"DEFAULT": STANDARD, "LAZY": LAZY, "COMPOSITION": COMPOSITION, "MODIFIEDKICK": MODIFIED_KICK}
SABA = {"2": "4,2", "3": "6,2", "4": "8,2", "10_4": "10,4", "8_6_4": "8,6,4", "10_6_4": "10,6,4"}
PASSAGES = {  # pericentre and inner of trace, by rebound's peri_mode; rebound's encounters are always bulirsch-stoer
    "FULL_IAS15": ("full", "gauss-radau15"), "FULL_BS": ("full", "bulirsch-stoer"),
    "PARTIAL_BS": ("partial", "bulirsch-stoer"),
}  # fmt: skip
LEAPFROGS = {2: "leapfrog-dkd", 4: "forest-ruth"}  # by order
UNITS = {"astro": ("au", "yr", "msun"), "si": ("m", "s", "kg")}  # length, time, mass
NEWTON = ("basic", "compensated", "jacobi", "mercurius")  # gravity modules that sum the same forces in different ways


def passage_of(pericentre: str, inner: str) -> str:
    """Return rebound's peri_mode. Partial passages have one method there; without passages the mode keeps ``inner``."""
    asked = ("full" if pericentre == "none" else pericentre, inner)
    return next((mode for mode, pair in PASSAGES.items() if pair == asked), "PARTIAL_BS")


def key_of(table: dict[str, str], ours: str) -> str:
    """Return rebound's name; "" if there is none."""
    return next((theirs for theirs, name in table.items() if name == ours), "")


def system_from(sim: Snapshot, table: Floats, forces: Iterable[Any] | None = None) -> System:
    """Return the System of a snapshot, and of the table (bodies, columns) of its bodies; see `System.from_rebound`."""
    _refuse(sim)
    units = _units(sim)
    if not len(table):
        raise InputError("sim: expected one particle or more, got none")
    masses, radii = table[:, 6], table[:, 7]
    _check_test_particles(sim, masses)
    names = [name or unnamed(i) for i, name in enumerate(sim.names)]
    run, untaken = _run(sim, masses)
    system = System(
        table[:, :3], table[:, 3:6], masses, None, _forces(sim, units) if forces is None else forces, units,
        name="rebound", names=names, radii=radii if radii.any() else None, run=run,
    )  # fmt: skip
    untaken += [key for key in ("exit_max_distance", "exit_min_distance") if getattr(sim, key)]
    tell("from_rebound", untaken, 5)
    return system.at(system.state.phase, sim.t)


def unnamed(i: int) -> str:
    """Return the name of an unnamed body among named ones."""
    return f"particle {i}"


def tell(what: str, untaken: list[str], level: int) -> None:
    """Warn of what a conversion left out; ``level`` is `warnings.warn`'s stacklevel."""
    if untaken:
        warnings.warn(f"{what}: left out, without an equivalent in kickdrift: {'; '.join(untaken)}", stacklevel=level)


def _refuse(sim: Snapshot) -> None:
    """Raise InputError for features that would make the System move differently."""
    if sim.N_var:
        raise InputError(f"sim: has {sim.N_var} variational particles; use kd.megno for variations")
    for key in sim.functions:
        raise InputError(f"sim: has {key}, which only rebound can call; use forces of kickdrift instead")
    if sim.N_odes:
        raise InputError("sim: its own ODEs have no equivalent in kickdrift")
    if sim.boundary != "none":
        raise InputError(f"sim: boundary {shown(sim.boundary)} has no equivalent in kickdrift; expected 'none'")
    if sim.collision != "none":
        raise InputError(
            f"sim: the action on collisions ({shown(sim.collision)}) cannot be read; set sim.collision = 'none' "
            "and give the run events=[kd.Collision(…)]"
        )
    if not math.isfinite(sim.t):
        raise InputError(f"sim: t is {sim.t}; expected a finite time")
    if not sim.is_synchronized:
        raise InputError("sim: is inside a step; call sim.synchronize() first")


def _units(sim: Snapshot) -> UnitSystem:
    length, time, mass = sim.units
    if length is None or time is None or mass is None:
        return UNIT_SYSTEMS["nbody"]
    for name, known in UNITS.items():
        if (length, time, mass) == known:
            return UNIT_SYSTEMS[name]
    energy = f"{mass} {length}^2/{time}^2"
    return UnitSystem("nbody", length, time, mass, energy, f"({energy})/k_B", 1.0, gravity=sim.G)


def _check_test_particles(sim: Snapshot, masses: Floats) -> None:
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


def _forces(sim: Snapshot, units: UnitSystem) -> tuple[Any, ...]:
    turns = sim.integrator == "sei" and sim.OMEGA
    frame = (FORCES["hill"](omega=sim.OMEGA, vertical=_vertical(sim)),) if turns else ()
    return (*_gravities(sim, units), *frame)


def _vertical(sim: Snapshot) -> float:
    """Frequency along z over that of the frame; rebound's is the same unless OMEGAZ is set."""
    return abs(sim.OMEGAZ / sim.OMEGA) if sim.OMEGAZ > 0 else 1.0


def _gravities(sim: Snapshot, units: UnitSystem) -> tuple[Any, ...]:
    if sim.gravity == "none":
        return ()
    if sim.gravity not in NEWTON:
        raise InputError(
            f"sim: gravity {shown(sim.gravity)} has no equivalent in kickdrift; give forces, for example "
            "[kd.GravityTree()]"
        )
    return (Gravity(G=None if units.gravity == sim.G else sim.G, softening=sim.softening),)


def _run(sim: Snapshot, masses: Floats) -> tuple[RunDefaults, list[str]]:
    """Return the method and its step, and warnings about options without an equivalent here."""
    method, own = sim.integrator, dict[str, Any](sim.options)
    run = RunDefaults(dt=sim.dt)
    central = int(np.argmax(masses)) == 0
    if method == "leapfrog" and own["order"] in LEAPFROGS:
        return run.changed(integrator=LEAPFROGS[own["order"]]), []
    if method == "ias15" and own["epsilon"] > 0 and own["adaptive_mode"] == "PRS23":
        untaken = ["ias15's min_dt"] if own["min_dt"] else []
        return run.changed(integrator="gauss-radau15", rtol=own["epsilon"]), untaken
    if method == "whfast" and not own["corrector2"] and central and own["coordinates"] in COORDINATES:
        coordinates, kernel = COORDINATES[own["coordinates"]], KERNELS.get(own["kernel"])
        if kernel == STANDARD:
            return run.changed(integrator="wisdom-holman", coordinates=coordinates, corrector=own["corrector"]), []
        if coordinates == JACOBI and kernel:
            return run.changed(integrator="wisdom-holman", corrector=own["corrector"], kernel=kernel), []
    passages = method == "trace" and central and own["peri_crit_eta"] in (1.0, math.inf) and not sim.own_switch
    if passages and own["peri_mode"] in PASSAGES:
        way, inner = PASSAGES[own["peri_mode"]]
        way = way if own["peri_crit_eta"] == 1.0 else "none"
        return run.changed(integrator="trace", hill_radii=own["r_crit_hill"], pericentre=way, inner=inner), []
    if method == "sei" and sim.OMEGA:
        return run.changed(integrator="sei"), []
    if method == "saba" and central and own["type"] in SABA:
        return run.changed(integrator="saba", order=SABA[own["type"]], coordinates=JACOBI), []
    return RunDefaults(), [f"integrator {shown(method)} with its settings and its step"]
