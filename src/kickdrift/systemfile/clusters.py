"""Star clusters from the tables of a system file, and by a function in Python."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces import Gravity
from kickdrift.model.orbits import G_given
from kickdrift.model.starts import clusters
from kickdrift.model.starts.builders import Structure
from kickdrift.model.starts.plummer import plummer
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem, unit_system
from kickdrift.systemfile import schema
from kickdrift.systemfile.files import prefixed
from kickdrift.systemfile.schema_base import KingTable, PlummerTable, SphereTable
from kickdrift.text import choices, shown

TABLES: dict[str, Any] = {"plummer": PlummerTable, "king": KingTable}
PLAIN = {"count", "seed", "scaled"}  # keys of equal stars of Plummer's sphere
SIZES = ("half_mass_radius", "virial_radius")


def stars_of(
    table: PlummerTable | KingTable, units: UnitSystem, gravity: float | None, seed: int | None = None
) -> Structure:
    """Stars from a system file's ``plummer`` or ``king``. ``seed`` replaces the table's seed."""
    name = "king" if isinstance(table, KingTable) else "plummer"
    sphere: SphereTable = getattr(table, name)
    seed = sphere.seed if seed is None else seed
    with prefixed(f"{name}."):
        x, v, masses = _stars(name, sphere, units, gravity, seed)
    for rows, centre in ((x, sphere.position), (v, sphere.velocity)):
        if centre is not None:
            rows += centre
    return Structure(x, masses, ["A"] * len(masses), None, periodic=False, velocities=v, seed=seed)


def _stars(name: str, sphere: SphereTable, units: UnitSystem, gravity: float | None, seed: int) -> Any:
    """Positions, velocities and masses in the units of the file."""
    given = sphere.model_dump(exclude_unset=True)
    if units.name == "nbody" and gravity in (None, 1.0) and name == "plummer" and not {*given} - PLAIN:
        return plummer(sphere.count, seed, sphere.scaled)
    sizes = [key for key in SIZES if getattr(sphere, key) is not None]
    if len(sizes) > 1:
        raise InputError(f"{sizes[0]}: excludes {sizes[1]}")
    if not sizes and not units.reduced:
        raise InputError(f"{SIZES[0]}: required key is missing (or {SIZES[1]}); it sets the size of the cluster")
    if gravity is None:
        raise InputError(f"units {units.name!r} do not set G; give G in [[force]] gravity")

    def scale(stars: clusters.Stars) -> float:
        """The N-body unit of length in the units of the file."""
        if not sizes:
            return 1.0
        size = float(getattr(sphere, sizes[0]))
        return size if sizes[0] == "virial_radius" else size / clusters.half_mass_radius(stars)

    joint: list[clusters.Stars] = []

    def noted(stars: clusters.Stars) -> float:
        joint.append(stars)
        return scale(stars)

    stars = clusters.cluster(
        name, sphere.count, seed, W0=getattr(sphere, "W0", None), masses=sphere.masses,
        mass_range=sphere.mass_range, heavy=given.get("heavy"), segregation=sphere.segregation,
        binaries=given.get("binaries"), scaled=sphere.scaled,
        sun=1.0 if units.reduced else quantity("1 Msun", "mass", units), length=noted,
    )  # fmt: skip
    length = scale(joint[0] if joint else stars)
    mass = sphere.mass if sphere.mass is not None else 1.0 if units.reduced else stars.total
    speed = np.sqrt(gravity * mass / length)
    return stars.positions * length, stars.velocities * speed, stars.masses * mass


def cluster(
    model: str, count: int, seed: int, units: str = "nbody", forces: Sequence[Any] | None = None, **given: Any
) -> System:
    """Return a System of a star cluster in equilibrium.

    Parameters
    ----------
    model : "plummer" or "king"
    count : stars, two or more; the two stars of a binary count as two
    seed : for the random numbers
    units : "nbody", in which the total mass and the virial radius are 1; "stellar", "galactic" or another system
    forces : default ``kd.Gravity()``
    given : the other keys of ``[particles] plummer`` and ``king`` in a system file, numbers or text with units. ``W0``
        for king. ``masses`` ("kroupa", "salpeter" or one for each star), ``mass_range``, ``heavy`` ({fraction, ratio}),
        ``mass`` (the total), ``segregation``, ``binaries`` ({fraction, a, e}), ``half_mass_radius`` or
        ``virial_radius``, ``position`` and ``velocity`` of the centre, ``scaled``. See docs/star-clusters.md.

    Raises
    ------
    InputError
        Names the key that makes no sense.
    """
    if model not in TABLES:
        raise InputError(f"model: expected {choices(TABLES, model)}, got {shown(model)}")
    system = unit_system(units)
    acting = [Gravity()] if forces is None else list(forces)
    data = {model: {"count": count, "seed": seed, **given}}
    table = schema.checked(TABLES[model], data, system)
    start = stars_of(table, system, G_given(acting, system))
    return System(start.positions, start.velocities, start.masses, forces=acting, units=system)
