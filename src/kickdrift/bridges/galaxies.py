"""What the bridges to galpy and gala share: the galaxy of a System, and G of its units."""

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces import Galaxy
from kickdrift.model.orbits import G_given
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem, unit_system


def galaxy_and_centre(system: System, asked: str) -> tuple[Galaxy | None, Floats]:
    """The System's force ``galaxy``, None without one, and its centre. Refuses several, and what changes with time."""
    found = [force for force in system.forces if isinstance(force, Galaxy)]
    if len(found) > 1:
        raise InputError(f"{asked}: the system has {len(found)} galaxies; give one force with all their potentials")
    if not found:
        return None, np.zeros(3)
    for part in found[0].parts(system):
        if "strength" in part:
            raise InputError(f"{asked}: {part['kind']} has a strength that changes, which has no counterpart there")
        if part.get("omega") and (part["kind"] != "bar" or asked == "to_gala"):
            raise InputError(f"{asked}: {part['kind']} turns, which has no counterpart there")
    return found[0], np.array(found[0].centre)


def units_with_gravity(units: str | UnitSystem) -> tuple[UnitSystem, float]:
    """Unit system of this name, and its G."""
    found = unit_system(units) if isinstance(units, str) else units
    gravity = G_given((), found)
    if gravity is None:
        raise InputError(f"units: {found.name!r} have no G; expected galactic, stellar, astro, si or nbody")
    return found, gravity
