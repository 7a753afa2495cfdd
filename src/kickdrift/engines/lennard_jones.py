"""Requirements of the engines on a System under Lennard-Jones."""

from __future__ import annotations

from collections.abc import Collection

from kickdrift.engines.bonded import split
from kickdrift.forces.lennard_jones import LennardJones
from kickdrift.model.system import System


def only_lennard_jones(system: System, truncations: Collection[str], molecules: bool = False) -> str | None:
    """Reason why the System's forces are not one Lennard-Jones force with one of these truncations, or None.

    With ``molecules``, bonded forces and exclusions may come beside it."""
    if not molecules and system.topology is not None and len(system.topology.scaled.pairs):
        return "topology: pairs that are left out or scaled are not possible"
    forces = split(system)[0] if molecules else system.forces
    strange = [force.name for force in forces if type(force) is not LennardJones]
    if strange:
        return f"force {strange[0]!r}: only lennard-jones is possible"
    if len(forces) != 1:
        return f"exactly one force lennard-jones is possible, and {system.name!r} has {len(forces) or 'none'}"
    truncation = forces[0].truncation
    if truncation not in truncations:
        return f"truncation {truncation!r}: possible are {' and '.join(repr(each) for each in truncations)}"
    return None


def small_units(system: System) -> str | None:
    """Reason why lengths would be too small for a program with absolute tolerances, or None."""
    if system.units.name == "si":
        return "units 'si': the program's tolerances are absolute, and too long for metres; use metal, with angstroms"
    return None
