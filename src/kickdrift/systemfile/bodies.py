"""Bodies on orbits and in clusters, from the tables of a system file."""

from __future__ import annotations

from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.limits import check_particles
from kickdrift.model.starts import elements
from kickdrift.model.starts.builders import Structure, generator
from kickdrift.model.starts.coordinates import at_barycentre, attracting_masses
from kickdrift.model.starts.plummer import plummer
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.systemfile.schema_bodies import ORBIT, BodiesTable, BodyTable, PlummerTable
from kickdrift.text import choices, shown, suggestion


def on_orbits(
    table: BodiesTable, gravity: float | None, seed: int | None = None, key: str = "elements", first_at: int = 0
) -> Structure:
    """Central body and other bodies from a system file's ``elements``, relative to their barycentre.

    The frame sets the origin and the G M of each orbit. "heliocentric": the central body, G times the two masses.
    "jacobi": the centre of mass of the bodies before it, G times their masses and its own. "barycentric": the centre of
    mass of all, G times all masses. With a ``primary``: that body, G times the two masses.

    Parameters
    ----------
    gravity : G in the file's units
    seed : replaces the table's seed
    key, first_at : name of the list in errors, and index of the first body on an orbit in that list
    """
    if gravity is None:
        raise InputError("elements: these units do not set G; give G in [[force]] gravity")
    counts = [1, *(body.count or 1 for body in table.elements)]
    check_particles("elements: count", sum(counts))
    given = [table.central, *table.elements]
    masses = np.repeat([body.mass if body.GM is None else body.GM / gravity for body in given], counts).astype(float)
    if not masses[0] > 0:
        raise InputError("central.mass: expected a positive mass, since the other bodies orbit the central one")
    seed = table.seed if seed is None else seed
    rng = generator(seed or 0)
    attracting = gravity * attracting_masses(masses, table.frame)
    x, v = np.zeros((len(masses), 3)), np.zeros((len(masses), 3))
    names, first = [table.central.called], 1
    for k, (body, count) in enumerate(zip(table.elements, counts[1:], strict=True), first_at):
        rows, mu = slice(first, first + count), attracting[first - 1 : first - 1 + count]
        called = body.called
        names += [called] if body.count is None else [called and f"{called} {i + 1}" for i in range(count)]
        try:
            about = None if body.primary is None else _primary(body.primary, names[:first])
            if about is not None:
                mu = gravity * (masses[about] + masses[rows])
            x[rows], v[rows] = orbit_of(body, count, mu, rng)
            if about:  # row 0 is the central body, the origin of the other rows
                x[rows] += x[about]
                v[rows] += v[about]
        except InputError as error:
            raise InputError(f"{key}[{k}]{f' ({called})' if called else ''}.{error}") from None
        first += count
    named = [name or f"particle {i}" for i, name in enumerate(names)] if any(names) else []
    x, v = (at_barycentre(y, masses, table.frame) for y in (x, v))
    drawn = seed if table.seed is not None else None
    radii = None
    if any(body.radius is not None for body in given):  # bodies without a radius are points
        radii = np.repeat([body.radius or 0.0 for body in given], counts).tolist()
    return Structure(
        x, masses, ["A"] * len(masses), None, periodic=False, velocities=v, names=named, seed=drawn, radii=radii
    )


def _primary(name: str, names: list[str | None]) -> int:
    if name not in names:
        known = [each for each in names if each]
        raise InputError(
            f"primary: no earlier body is called {shown(name)}{suggestion(name, known)} "
            f"(earlier: {choices(known, name)})"
        )
    return names.index(name)


def orbit_of(
    body: BodyTable, count: int, mu: Floats | float, rng: np.random.Generator, time: float = 0.0
) -> tuple[Floats, Floats]:
    """Positions and velocities (count, 3) on a body's orbit about its primary at a time. mu is G times the masses."""

    def value(key: str) -> Any:
        given = getattr(body, key)
        if isinstance(given, list):
            given = given[0] + (given[1] - given[0]) * rng.random(count)
        return np.radians(given) if key in elements.ANGLES and given is not None else given

    values = {key: value(key) for key in ORBIT}
    period = values.pop("P")
    if period is not None:
        if np.any(np.asarray(values["e"]) >= 1):
            raise InputError("P: only an ellipse (e < 1) has a period; give q")
        if not np.all(np.asarray(period) > 0):
            raise InputError("P: expected a positive period")
        values["a"] = np.cbrt(mu * (np.asarray(period) / elements.TAU) ** 2)
    return elements.states(mu, t=time, **values)


def cluster(table: PlummerTable, units: UnitSystem, seed: int | None = None) -> Structure:
    """Stars from a system file's ``plummer``. ``seed`` replaces the table's seed."""
    if units.name != "nbody":
        raise InputError(
            f'plummer: is in N-body units, G = M = 1 and E = -1/4; expected units = "nbody", got "{units.name}"'
        )
    sphere = table.plummer
    seed = sphere.seed if seed is None else seed
    x, v, masses = plummer(sphere.count, seed, sphere.scaled)
    return Structure(x, masses, ["A"] * len(masses), None, periodic=False, velocities=v, seed=seed)
