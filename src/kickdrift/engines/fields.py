"""Traps, uniform fields, position restraints and walls in the terms of other programs, beside their other forces."""

from collections.abc import Collection
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.fields.restraint import Restraint
from kickdrift.forces.fields.shipped import HarmonicTrap, UniformField
from kickdrift.forces.fields.walls import HarmonicWall, LennardJonesWall, ReflectingWall, unit
from kickdrift.model.state import Floats
from kickdrift.model.system import System

IN_OPENMM: tuple[Any, ...] = (HarmonicTrap, UniformField, Restraint, HarmonicWall, LennardJonesWall)
IN_LAMMPS: tuple[Any, ...] = (Restraint, HarmonicWall, LennardJonesWall, ReflectingWall)


def without(system: System, kinds: Collection[Any]) -> System:
    """The System without its forces of these kinds."""
    kept = [force for force in system.forces if type(force) not in kinds]
    return system if len(kept) == len(system.forces) else system.under(kept)


def virial_of(system: System, x: Floats) -> float:
    """Virial of the restraints at positions x (n, 3), which the programs do not give."""
    total = 0.0
    for force in system.forces:
        if isinstance(force, Restraint) and force.scales:
            total -= float((np.array(force.stiffness) * force.apart(system, x) ** 2).sum())
    return total


# --- OpenMM: energies of x, y and z ---

HARMONIC = "0.5*(kx*dx^2+ky*dy^2+kz*dz^2)"
FROM_WALL = "; s=nx*x+ny*y+nz*z-offset"
OF_WALLS = {"k": "stiffness", "reach": "reach", "e": "epsilon", "l": "sigma", "cutoff": "cutoff"}
TERMS: dict[Any, str] = {
    UniformField: "-m*(gx*x+gy*y+gz*z)",
    HarmonicWall: f"0.5*k*max(0,reach-s)^2{FROM_WALL}",
    LennardJonesWall: (
        "step(cutoff-s)*e*(2/15*(q^9-last^9)-q^3+last^3)+0*sqrt(s)"  # the root is nan behind the wall
        f"; q=l/s; last=l/cutoff{FROM_WALL}"
    ),
}  # fmt: skip


def openmm_fields(system: System) -> list[Any]:
    """The System's fields, as forces of OpenMM."""
    return [_external(system, force) for force in system.forces if type(force) in IN_OPENMM]


def _external(system: System, force: Any) -> Any:
    import openmm

    count = len(system)
    held: Any
    values: Any
    if isinstance(force, HarmonicTrap | Restraint):
        edges = zip("xyz", np.diag(system.box.matrix).tolist(), system.box.periodic_axes, strict=True)
        energy, keys = HARMONIC + "".join(_apart(*each) for each in edges), ["x0", "y0", "z0"]
        values = zip(("kx", "ky", "kz"), np.broadcast_to(force.stiffness, 3).tolist(), strict=True)
        held, places = range(count), [list(force.centre)] * count if isinstance(force, HarmonicTrap) else []
        if isinstance(force, Restraint):
            held, places = force.particles, force.places(system)[0].tolist()
    elif isinstance(force, UniformField):
        energy, keys, values = TERMS[UniformField], ["m"], zip(("gx", "gy", "gz"), force.acceleration, strict=True)
        held, places = range(count), system.coherent_masses[:, None].tolist()
    else:
        normal, energy, keys = unit(force), TERMS[type(force)], []
        own = {key: getattr(force, name) for key, name in OF_WALLS.items() if hasattr(force, name)}
        offset = float(normal @ np.array(force.point))
        values = (own | {"nx": normal[0], "ny": normal[1], "nz": normal[2], "offset": offset}).items()
        held, places = range(count), [[]] * count
    made = openmm.CustomExternalForce(energy + "".join(f"; {key}={float(value)!r}" for key, value in values))
    for key in keys:
        made.addPerParticleParameter(key)
    for i, place in zip(held, places, strict=True):
        made.addParticle(i, place)
    return made


def _apart(axis: str, edge: float, periodic: bool) -> str:
    """Component of a displacement from the nearest image of a place."""
    apart = f"{axis}-{axis}0"
    return f"; d{axis}={apart}" + (f"-{edge!r}*floor(({apart})/{edge!r}+0.5)" if periodic else "")


# --- LAMMPS: commands of fixes ---


class PositionRestraint(NamedTuple):
    """A position restraint in LAMMPS' terms: ids from 1, stiffness, axes such as "xy", and reference positions."""

    ids: NDArray[np.int64]
    stiffness: float
    axes: str
    places: Floats


def lammps_refusal(system: System) -> str | None:
    """Reason why LAMMPS has no such field, or None."""
    for force in system.forces:
        if isinstance(force, Restraint):
            if len({*np.broadcast_to(force.stiffness, 3).tolist()} - {0.0}) > 1:
                return f"force {force.name!r}: LAMMPS takes one stiffness, along some axes or all"
        elif type(force) in IN_LAMMPS:
            if sum(map(bool, force.normal)) != 1:
                return f"force {force.name!r}: LAMMPS has walls across an axis alone"
            if not getattr(force, "reach", 1.0):
                return f"force {force.name!r}: LAMMPS stops at particles behind a wall, so it needs a reach above zero"
    return None


def lammps_fixes(system: System) -> tuple[tuple[tuple[str, ...], ...], tuple[PositionRestraint, ...]]:
    """The commands of each wall, and the restraints."""
    walls: list[tuple[str, ...]] = []
    held: list[PositionRestraint] = []
    for k, force in enumerate(system.forces):
        if isinstance(force, Restraint):
            values = np.broadcast_to(force.stiffness, 3)
            axes = "".join(axis for axis, value in zip("xyz", values, strict=True) if value)
            ids = np.array(force.particles, np.int64) + 1
            if axes:
                held.append(PositionRestraint(ids, float(values.max()), axes, force.places(system)[0]))
        elif type(force) in IN_LAMMPS:
            walls.append(_wall(k, force))
    return tuple(walls), tuple(held)


def _wall(k: int, force: Any) -> tuple[str, ...]:
    axis = int(np.flatnonzero(force.normal)[0])
    place = f"{'xyz'[axis]}{'lo' if force.normal[axis] > 0 else 'hi'} {force.point[axis]!r}"
    if isinstance(force, ReflectingWall):
        return (f"fix wall{k} all wall/reflect {place} units box",)
    style = f"harmonic {place} {0.5 * force.stiffness!r} 0.0 {force.reach!r}" if isinstance(force, HarmonicWall) else (
        f"lj93 {place} {force.epsilon!r} {force.sigma!r} {force.cutoff!r}"
    )  # fmt: skip
    return f"fix wall{k} all wall/{style} units box", f"fix_modify wall{k} energy yes"
