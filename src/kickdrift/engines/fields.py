"""Traps, uniform fields, position restraints and walls in the terms of other programs, beside their other forces."""

from __future__ import annotations

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

    if isinstance(force, HarmonicTrap | Restraint):
        edges = zip("xyz", np.diag(system.box.matrix).tolist(), system.box.periodic_axes, strict=True)
        made = openmm.CustomExternalForce(HARMONIC + "".join(_apart(*each) for each in edges))
        _globals(made, dict(zip(("kx", "ky", "kz"), np.broadcast_to(force.stiffness, 3).tolist(), strict=True)))
        for key in ("x0", "y0", "z0"):
            made.addPerParticleParameter(key)
        if isinstance(force, Restraint):
            held, places = list(force.particles or ()), force.places(system)[0].tolist()
        else:
            held, places = list(range(len(system))), [list(force.centre)] * len(system)
        for i, place in zip(held, places, strict=True):
            made.addParticle(i, place)
        return made
    made = openmm.CustomExternalForce(TERMS[type(force)])
    if isinstance(force, UniformField):
        _globals(made, dict(zip(("gx", "gy", "gz"), force.acceleration, strict=True)))
        made.addPerParticleParameter("m")
    else:
        normal = unit(force)
        _globals(made, dict(zip(("nx", "ny", "nz"), normal.tolist(), strict=True)))
        made.addGlobalParameter("offset", float(normal @ np.array(force.point)))
        lennard_jones = isinstance(force, LennardJonesWall)
        keys = (
            {"e": "epsilon", "l": "sigma", "cutoff": "cutoff"}
            if lennard_jones
            else {"k": "stiffness", "reach": "reach"}
        )
        _globals(made, {key: getattr(force, name) for key, name in keys.items()})
    for i, mass in enumerate(system.coherent_masses.tolist()):
        made.addParticle(i, [mass] if isinstance(force, UniformField) else [])
    return made


def _apart(axis: str, edge: float, periodic: bool) -> str:
    """Component of a displacement from the nearest image of a place."""
    apart = f"{axis}-{axis}0"
    return f"; d{axis}={apart}" + (f"-{edge!r}*floor(({apart})/{edge!r}+0.5)" if periodic else "")


def _globals(made: Any, values: dict[str, float]) -> None:
    for key, value in values.items():
        made.addGlobalParameter(key, value)


# --- LAMMPS: commands of fixes ---


class Held(NamedTuple):
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


def lammps_fixes(system: System) -> tuple[tuple[tuple[str, ...], ...], tuple[Held, ...]]:
    """The commands of each wall, and the restraints."""
    walls: list[tuple[str, ...]] = []
    held: list[Held] = []
    for k, force in enumerate(system.forces):
        if isinstance(force, Restraint):
            values = np.broadcast_to(force.stiffness, 3)
            axes = "".join(axis for axis, value in zip("xyz", values, strict=True) if value)
            ids = np.array(force.particles, np.int64) + 1
            held.append(Held(ids, float(values.max()), axes, force.places(system)[0]))
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
