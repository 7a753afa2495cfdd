"""What the engines ask of a System under Lennard-Jones."""

from __future__ import annotations

from collections.abc import Collection

from kickdrift.forces.lennard_jones import LennardJones
from kickdrift.model.system import System


def only_lennard_jones(system: System, truncations: Collection[str]) -> str | None:
    """Why its forces are not one Lennard-Jones of one of these truncations; None where they are."""
    strange = [force.name for force in system.forces if type(force) is not LennardJones]
    if strange:
        return f"force {strange[0]!r}: it runs lennard-jones"
    if len(system.forces) != 1:
        return f"it runs one force lennard-jones, and {system.name!r} has {len(system.forces) or 'none'}"
    truncation = system.forces[0].truncation
    if truncation not in truncations:
        return f"truncation {truncation!r}: it has {' and '.join(repr(each) for each in truncations)}"
    return None


def small_units(system: System) -> str | None:
    """Why a program whose tolerances are lengths of about a particle's size would err; None where it would not."""
    if system.units.name == "si":
        return "units 'si': its tolerances are absolute, and too long for lengths in metres; metal has angstroms"
    return None
