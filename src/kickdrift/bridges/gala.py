"""Conversion between gala's potentials and phase-space positions, and the force ``galaxy`` and Systems.

G times a mass is converted, so accelerations are equal whatever the value of G. Potentials in gala's dimensionless
units go with N-body units.
"""

import math
from collections.abc import Iterator
from typing import Any

import astropy.units as u
import numpy as np
from gala import dynamics
from gala import potential as galas
from gala.units import DimensionlessUnitSystem, dimensionless, galactic

from kickdrift.bridges.galaxies import galaxy_and_centre, units_with_gravity
from kickdrift.errors import InputError
from kickdrift.forces import Galaxy
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import choices

# gala's class, and its parameters by those of a part.
KINDS: dict[str, tuple[str, dict[str, str]]] = {
    "kepler": ("KeplerPotential", {"mass": "m"}),
    "plummer": ("PlummerPotential", {"mass": "m", "b": "b"}),
    "isochrone": ("IsochronePotential", {"mass": "m", "b": "b"}),
    "hernquist": ("HernquistPotential", {"mass": "m", "a": "c"}),
    "nfw": ("NFWPotential", {"mass": "m", "a": "r_s"}),
    "miyamoto-nagai": ("MiyamotoNagaiPotential", {"mass": "m", "a": "a", "b": "b"}),
    "power-law": ("PowerLawCutoffPotential", {"mass": "m", "alpha": "alpha", "cutoff": "r_c"}),
    "logarithmic": ("LogarithmicPotential", {"speed": "v_c", "core": "r_h", "angle": "phi"}),
    "bar": ("LongMuraliBarPotential", {"mass": "m", "a": "a", "b": "b", "c": "c", "angle": "alpha"}),
}
ROUND = 1e-14  # of an axis ratio of gala's halo


def galaxy_of(potential: Any, units: str | UnitSystem) -> Galaxy:
    """The force of a potential; see ``Galaxy.from_gala``."""
    chosen, gravity = units_with_gravity(units)
    parts = list(_flat(potential))
    origins = np.array([each.origin.value if hasattr(each.origin, "value") else each.origin for each in parts])
    if np.ptp(origins, axis=0).any() or any(each.R is not None for each in parts):
        raise InputError("from_gala: expected potentials around one origin, without rotations")
    scales = [Scale(chosen, each.units) for each in parts]
    made = [scale(_numbers(each), float(each.G) / gravity) for scale, each in zip(scales, parts, strict=True)]
    return Galaxy(made, centre=tuple(scales[0].length * origins[0]))


def _flat(potential: Any) -> Iterator[Any]:
    if isinstance(potential, galas.CompositePotential):
        for each in potential.values():
            yield from _flat(each)
    else:
        yield potential


def _numbers(p: Any) -> dict[str, Any]:
    """Numbers of a part in the units of gala's potential."""
    given = {key: float(p.parameters[key].decompose(p.units).value) for key in p.parameters}
    for kind, (name, keys) in KINDS.items():
        if type(p) is getattr(galas, name):
            found = {key: given[gala] for key, gala in keys.items()}
            if "angle" in found:
                found["angle"] = math.degrees(found["angle"])
            if kind == "nfw" and any(abs(given[axis] - 1.0) > ROUND for axis in "abc"):
                raise InputError("from_gala: a flattened NFWPotential has no counterpart; expected a = b = c = 1")
            if kind == "logarithmic":
                first = given["q1"]
                found |= {"core": found["core"] * first, "p": given["q2"] / first, "q": given["q3"] / first}
            return {"kind": kind, **found}
    known = choices([name for name, _ in KINDS.values()])
    raise InputError(f"from_gala: {type(p).__name__} has no counterpart; possible are {known}, and sums of them")


class Scale:
    """Factors from gala's units to a unit system's; those of masses leave G as it is."""

    def __init__(self, units: UnitSystem, of: Any) -> None:
        if isinstance(of, DimensionlessUnitSystem) != units.reduced:
            raise InputError(f"units: {units.name!r} does not go with gala's {of}; nbody goes with dimensionless units")
        size = {"length": 1.0, "time": 1.0}
        if not units.reduced:
            size = {
                key: quantity(f"{float((1.0 * of[key]).si.value)!r} {unit}", key, units)
                for key, unit in (("length", "m"), ("time", "s"))
            }
        self.length, self.velocity = size["length"], size["length"] / size["time"]
        self.gravitational = size["length"] ** 3 / size["time"] ** 2  # of G times a mass in gala's units

    def __call__(self, part: dict[str, Any], gravity: float) -> dict[str, Any]:
        """A part's numbers in the unit system, where ``gravity`` is gala's G over that of the unit system."""
        sizes = self.sizes(gravity)
        return {key: value if key == "kind" else value * sizes.get(key, self.length) for key, value in part.items()}

    def sizes(self, gravity: float) -> dict[str, float]:
        """Factors by parameter; those that are not here are lengths."""
        plain = dict.fromkeys(("alpha", "angle", "p", "q"), 1.0)
        return plain | {"mass": gravity * self.gravitational, "speed": self.velocity}


def positions_of(system: System) -> tuple[Any, Any]:
    """The bodies as a PhaseSpacePosition, and the galaxy's potential; see ``System.to_gala``."""
    galaxy, centre = galaxy_and_centre(system, "to_gala")
    units, gravity = units_with_gravity(system.units)
    of = dimensionless if units.reduced else galactic
    scale, own = Scale(units, of), float(galas.KeplerPotential(m=1.0, units=of).G)
    x, v = (system.state.positions - centre).T / scale.length, system.state.velocities.T / scale.velocity
    where = [row if units.reduced else row * unit for row, unit in ((x, u.kpc), (v, u.kpc / u.Myr))]
    total = galas.CCompositePotential()
    for k, part in enumerate([] if galaxy is None else galaxy.parts(system)):
        name, keys = KINDS[part["kind"]]
        sizes = scale.sizes(own / gravity)
        made = {gala: part[key] / sizes.get(key, scale.length) for key, gala in keys.items()}
        for key in ("phi", "alpha") if "angle" in keys else ():
            if key in made:
                made[key] = math.radians(made[key])
        if part["kind"] == "logarithmic":
            made |= {"q1": 1.0, "q2": part["p"], "q3": part["q"]}
        total[f"{part['kind']} {k}"] = getattr(galas, name)(**made, units=of)
    return dynamics.PhaseSpacePosition(pos=where[0], vel=where[1]), total if len(total) else None
