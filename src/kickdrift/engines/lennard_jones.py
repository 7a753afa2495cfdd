"""Requirements of the engines on a System under Lennard-Jones."""

from __future__ import annotations

from collections.abc import Collection

from kickdrift.engines.bonded import split
from kickdrift.forces.pairs.lennard_jones import LennardJones
from kickdrift.model.system import System


def only_lennard_jones(system: System, truncations: Collection[str], takes: str, molecules: bool = False) -> str | None:
    """Reason why the System's forces are not one Lennard-Jones force with one of these truncations, or None.

    ``takes`` says which forces the program takes. With ``molecules``, bonded forces and exclusions may come beside the
    pair force."""
    if not molecules and system.topology is not None and len(system.topology.scaled.pairs):
        return "topology: pairs that are left out or scaled are not possible"
    forces = split(system)[0] if molecules else system.forces
    if [type(force) for force in forces] != [LennardJones]:
        names = " and ".join(repr(force.name) for force in system.forces)
        given = f"force{'s' * (len(system.forces) > 1)} {names}" if names else f"{system.name!r} has no force"
        return f"{given}: {takes}"
    truncation = forces[0].truncation
    if truncation not in truncations:
        return f"truncation {truncation!r}: possible are {' and '.join(repr(each) for each in truncations)}"
    return None


def small_units(system: System) -> str | None:
    """Reason why lengths would be too small for a program with absolute tolerances, or None."""
    if system.units.name == "si":
        return "units 'si': the program's tolerances are absolute, and too long for metres; use metal, with angstroms"
    return None
