"""Systems made body by body in Python, with the keys, the checks and the code of system files."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces import Gravity
from kickdrift.model.bodies import primary_row
from kickdrift.model.checks.values import listed, no_overflow
from kickdrift.model.orbits import G_given, gravity_of
from kickdrift.model.starts.builders import check_overlaps, generator
from kickdrift.model.starts.coordinates import to_barycentric
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem, unit_system
from kickdrift.systemfile.files import plain, prefixed
from kickdrift.systemfile.particles import on_orbits, orbit_of
from kickdrift.systemfile.schema import checked
from kickdrift.systemfile.schema_base import AddedTable, BodiesTable, BodyTable, CentralTable
from kickdrift.text import choices


def from_elements(
    cls: type[System],
    bodies: Sequence[Mapping[str, Any]],
    forces: Iterable[Any] | None,
    units: str | UnitSystem,
    frame: str,
    seed: int | None,
    name: str,
) -> System:
    """See ``System.from_elements``."""
    known = units if isinstance(units, UnitSystem) else unit_system(units)
    given = [plain(each) for each in listed("bodies", bodies, "a list of tables, one for each body")]
    if not given:
        raise InputError("bodies: expected one body or more, got none")
    first, *others = (
        checked(BodyTable if k else CentralTable, each, known, f"bodies[{k}]") for k, each in enumerate(given)
    )
    table = {"central": first, "elements": others, "frame": plain(frame), "seed": plain(seed)}
    checked_table = checked(BodiesTable, table, known, "from_elements")
    acting = [Gravity()] if forces is None else list(forces)
    with no_overflow():
        start = on_orbits(checked_table, G_given(acting, known), key="bodies", first_at=1, units=known)
    made = cls(
        start.positions, start.velocities, start.masses, None, acting, known, start.species, name,
        names=start.names, radii=start.radii, seed=start.seed,
    )  # fmt: skip
    check_overlaps(made)
    object.__setattr__(made, "ephemerides", start.ephemerides)
    return made


def with_body(system: System, name: str | None, barycentric: bool, given: Mapping[str, Any]) -> System:
    """See ``System.with_body``."""
    body: AddedTable = checked(AddedTable, _in_space(system, {"name": name, **plain(given)}), system.units, "with_body")
    state = system.state
    with prefixed("with_body: "), no_overflow():
        mass = body.mass if body.GM is None else body.GM / gravity_of(system, "GM")
        x, v = _placed(system, body, float(mass or 0.0))
        positions, velocities = np.vstack([state.positions, x]), np.vstack([state.velocities, v])
        masses = np.append(state.masses, float(mass or 0.0))
        if barycentric:
            if system.fixed is not None:
                raise InputError("barycentric: would move fixed particles; fix them in the new system")
            positions, velocities = (to_barycentric(rows, masses)[0] for rows in (positions, velocities))
        made = system.remade(
            positions=positions,
            velocities=velocities,
            masses=masses,
            species=[*(system.species[k] for k in system.species_index), _species(system, body)],
            names=_names(system, body),
            radii=_radii(system, body),
            charges=None if system.charges is None else np.append(system.charges, 0.0),
            ids=np.append(state.ids, state.ids.max() + 1),
        )
        check_overlaps(made)
    return made


def _in_space(system: System, given: dict[str, Any]) -> dict[str, Any]:
    """Values of the new body; in a plane, vectors get a third number."""
    if system.dimensions == 2:
        for key, height in (("position", float(system.state.phase[0, 2, 0])), ("velocity", 0.0)):
            if isinstance(given.get(key), list) and len(given[key]) == 2:
                given[key] = [*given[key], height]
    return given


def _placed(system: System, body: AddedTable, mass: float) -> tuple[Floats, Floats]:
    """Position and velocity of the new body."""
    if body.from_jpl:
        raise InputError("horizons and spk go with from_elements and system files, whose origin is the central body")
    if body.position is not None:
        return np.array(body.position), np.array(body.velocity or [0.0, 0.0, 0.0])
    about, state = primary_row(system, body.primary, "primary"), system.state
    mu = gravity_of(system, "elements") * (float(state.masses[about]) + mass)
    x, v = orbit_of(body, 1, mu, generator(0), state.time)
    return x + state.phase[0, :, about], v + state.phase[1, :, about]


def _species(system: System, body: AddedTable) -> str:
    if body.species is None and len(system.species) > 1:
        raise InputError(f"species: required, one of {choices(system.species)} or a new one")
    return system.species[0] if body.species is None else body.species


def _names(system: System, body: AddedTable) -> list[str]:
    if not system.names and body.called is None:
        return []
    others = [system.body(i) for i in range(len(system))]
    own = f"particle {int(system.state.ids.max()) + 1}" if body.called is None else body.called
    return [*others, own]


def _radii(system: System, body: AddedTable) -> Floats | None:
    if system.radii is None and body.radius is None:
        return None
    others = np.zeros(len(system)) if system.radii is None else system.radii
    return np.append(others, body.radius or 0.0)  # a body without a radius is a point
