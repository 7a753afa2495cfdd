"""Conversion between galpy's potentials and orbits, and the force ``galaxy`` and Systems.

galpy has natural units: lengths in ro, speeds in vo, and G = 1. G times a mass is converted, so accelerations are equal
whatever the value of G. In N-body units the numbers are galpy's own.
"""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from galpy import potential as galpys
from galpy.orbit import Orbit

from kickdrift.bridges.galaxies import galaxy_and_centre, units_with_gravity
from kickdrift.errors import InputError
from kickdrift.forces import Galaxy
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import choices


def _needle(p: Any) -> dict[str, float]:
    return {"a": p._a, "b": p._b, "c": math.sqrt(p._c2), "angle": math.degrees(p._pa), "omega": p._omegab}


def _logarithmic(p: Any) -> dict[str, float]:
    return {"core": math.sqrt(p._core2), "q": p._q, "p": 1.0 if p._b is None else p._b, "speed": math.sqrt(p._amp)}


def _power_law(p: Any) -> dict[str, float]:
    total = p._amp * 2.0 * math.pi * p.rc ** (3.0 - p.alpha) * math.gamma(1.5 - 0.5 * p.alpha)
    return {"mass": total, "alpha": p.alpha, "cutoff": p.rc}


# galpy's class by kind: a part's numbers from a potential, and a potential from a part's numbers, in natural units.
KINDS: dict[str, tuple[str, Callable[[Any], dict[str, float]], Callable[[dict[str, float]], dict[str, Any]]]] = {
    "kepler": ("KeplerPotential", lambda p: {}, lambda n: {}),
    "plummer": ("PlummerPotential", lambda p: {"b": p._b}, lambda n: {"b": n["b"]}),
    "isochrone": ("IsochronePotential", lambda p: {"b": p.b}, lambda n: {"b": n["b"]}),
    "hernquist": (
        "HernquistPotential", lambda p: {"mass": 0.5 * p._amp, "a": p.a},
        lambda n: {"amp": 2.0 * n["mass"], "a": n["a"]},
    ),
    "nfw": ("NFWPotential", lambda p: {"a": p.a}, lambda n: {"a": n["a"]}),
    "miyamoto-nagai": (
        "MiyamotoNagaiPotential", lambda p: {"a": p._a, "b": p._b}, lambda n: {"a": n["a"], "b": n["b"]}
    ),
    "power-law": (
        "PowerSphericalPotentialwCutoff", _power_law,
        lambda n: {"alpha": n["alpha"], "rc": n["cutoff"], "amp": n["mass"]
                   / (2.0 * math.pi * n["cutoff"] ** (3.0 - n["alpha"]) * math.gamma(1.5 - 0.5 * n["alpha"]))},
    ),
    "logarithmic": (
        "LogarithmicHaloPotential", _logarithmic,
        lambda n: {"amp": n["speed"] ** 2, "core": n["core"], "q": n["q"], "b": None if n["p"] == 1.0 else n["p"]},
    ),
    "bar": (
        "SoftenedNeedleBarPotential", _needle,
        lambda n: {"a": n["a"], "b": n["b"], "c": n["c"], "pa": math.radians(n["angle"]), "omegab": n["omega"]},
    ),
}  # fmt: skip
SIZES = {"mass": "mass", "speed": "speed", "omega": "rate", "alpha": "", "q": "", "p": "", "angle": ""}


def galaxy_of(potential: Any, units: str | UnitSystem, ro: float | None, vo: float | None) -> Galaxy:
    """The force of a potential; see ``Galaxy.from_galpy``."""
    parts = []
    for p in _flat(potential):
        given = {"ro": ro, "vo": vo}
        scale = Scale(units, **{key: getattr(p, f"_{key}") if value is None else value
                                    for key, value in given.items()})  # fmt: skip
        parts.append(scale(_numbers(p)))
    return Galaxy(parts)


def _flat(potential: Any) -> Iterator[Any]:
    parts = potential if isinstance(potential, list | tuple) else getattr(potential, "_potlist", None)
    if parts is None:
        yield potential
    else:
        for each in parts:
            yield from _flat(each)


def _numbers(p: Any) -> dict[str, Any]:
    for kind, (name, numbers, _) in KINDS.items():
        if type(p) is getattr(galpys, name):
            return {"kind": kind, **({} if kind == "logarithmic" else {"mass": float(p._amp)}),
                    **{key: float(value) for key, value in numbers(p).items()}}  # fmt: skip
    known = choices([name for name, *_ in KINDS.values()])
    raise InputError(f"from_galpy: {type(p).__name__} has no counterpart; possible are {known}, and sums of them")


class Scale:
    """Factors from galpy's natural units to a unit system's."""

    def __init__(self, units: str | UnitSystem, ro: float, vo: float) -> None:
        chosen, gravity = units_with_gravity(units)
        self.length = self.speed = 1.0
        if not chosen.reduced:
            self.length = quantity(f"{float(ro)!r} kpc", "length", chosen)
            self.speed = quantity(f"{float(vo)!r} km/s", "velocity", chosen)
        self.rate, self.mass = self.speed / self.length, self.length * self.speed**2 / gravity

    def __call__(self, part: dict[str, Any], power: float = 1.0) -> dict[str, Any]:
        """A part's numbers from natural units, or to them with the power -1."""
        sizes = {key: getattr(self, dimension) if dimension else 1.0 for key, dimension in SIZES.items()}
        return {
            key: value if key == "kind" else value * sizes.get(key, self.length) ** power for key, value in part.items()
        }


def orbit_of(system: System, ro: float, vo: float) -> tuple[Any, list[Any]]:
    """The bodies as one Orbit of galpy, and the potentials of the System's galaxy; see ``System.to_galpy``."""
    galaxy, centre = galaxy_and_centre(system, "to_galpy")
    scale = Scale(system.units, ro, vo)
    x, v = (system.state.positions - centre) / scale.length, system.state.velocities / scale.speed
    radius, angle = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
    cosine, sine = np.cos(angle), np.sin(angle)
    out, along = cosine * v[:, 0] + sine * v[:, 1], cosine * v[:, 1] - sine * v[:, 0]
    given = {} if system.units.reduced else {"ro": ro, "vo": vo}
    orbit = Orbit(np.stack([radius, out, along, x[:, 2], v[:, 2], angle], axis=1), **given)
    potentials = []
    for part in [] if galaxy is None else galaxy.parts(system):
        if part["kind"] == "logarithmic" and part["angle"]:
            raise InputError("to_galpy: galpy's logarithmic halo has its axes along x and y; expected angle = 0")
        natural = scale(part, -1.0)
        name, _, arguments = KINDS[part["kind"]]
        potentials.append(getattr(galpys, name)(**{"amp": natural.get("mass"), **arguments(natural)}, **given))
    return orbit, potentials


def system_of(
    orbit: Any, potential: Any, units: str | UnitSystem, masses: Any, ro: float | None, vo: float | None
) -> System:
    """System of an Orbit's bodies at its first time; see ``System.from_galpy``."""
    asked = {"ro": orbit._ro if ro is None else ro, "vo": orbit._vo if vo is None else vo}
    scale, plain = Scale(units, **asked), {"use_physical": False}
    rows = [[np.atleast_1d(getattr(orbit, key)(0.0 * orbit.t[0] if hasattr(orbit, "t") else 0.0, **plain))
             for key in keys] for keys in (("x", "y", "z"), ("vx", "vy", "vz"))]  # fmt: skip
    x, v = (np.stack(each, axis=1) for each in rows)
    forces = [] if potential is None else [galaxy_of(potential, units, asked["ro"], asked["vo"])]
    return System(x * scale.length, v * scale.speed, masses, forces=forces, units=units)
