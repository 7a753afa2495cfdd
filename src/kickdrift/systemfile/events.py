"""The tables ``[[event]]`` of a system file."""

from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from kickdrift.errors import InputError
from kickdrift.forces.seam.named import found_function
from kickdrift.model.events.collision import C_STAR, MU_BAR, NEW_BODIES
from kickdrift.model.events.events import CloseApproach, Collision, Crossing, Escape, Event, checked_events
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.systemfile.schema import checked
from kickdrift.systemfile.schema_base import Edge, In, Table
from kickdrift.text import shown, suggestion


def radii_given(value: Any, info: Any) -> Any:
    convert = In("length", "non-negative")
    if isinstance(value, dict):
        return {name: convert(radius, info) for name, radius in value.items()}
    return [convert(radius, info) for radius in value] if isinstance(value, list) else convert(value, info)


class CloseApproachTable(Table):
    """Table of close approaches. The distance has a unit, unless it counts Hill radii."""

    type: str
    distance: Any
    hill: bool = False
    bodies: Annotated[list[str | int], Field(min_length=1)] | None = None
    action: Literal["log", "stop"] = "log"

    def event(self, units: UnitSystem) -> Event:
        distance = quantity(self.distance, "dimensionless" if self.hill else "length", units, "distance")
        return CloseApproach(distance, self.bodies, self.hill, self.action)


class CollisionTable(Table):
    """Table of collisions. A rule is the import path of a function in a module that ``--load`` names."""

    type: str
    radii: Annotated[Any, BeforeValidator(radii_given)] = None
    action: Literal["merge", "bounce", "fragment", "rule", "stop"] = "merge"
    restitution: Any = 1.0
    elastic_below: Annotated[float, BeforeValidator(In("velocity", "non-negative"))] = 0.0
    fragment_mass: Annotated[float, BeforeValidator(In("mass", "positive"))] | None = None
    c_star: float = C_STAR
    mu_bar: float = MU_BAR
    reference_density: Annotated[float, BeforeValidator(In("density", "positive"))] | None = None
    new_bodies: int = NEW_BODIES
    rule: str | None = None
    loss: bool = False

    def event(self, units: UnitSystem) -> Event:
        given: dict[str, Any] = {key: getattr(self, key) for key in self.model_fields_set - {"type", "rule"}}
        if self.rule is not None:
            given["rule"] = found_function(f"{Collision.kind}: rule", self.rule)
        return Collision(**given)


class EscapeTable(Table):
    type: str
    distance: Edge
    about: str | int | None = None
    action: Literal["log", "remove", "stop"] = "log"

    def event(self, units: UnitSystem) -> Event:
        return Escape(self.distance, self.about, self.action)


class PassageTable(Table):
    """Table of a passage of one body by another."""

    type: str
    body: str | int
    about: str | int

    def event(self, units: UnitSystem) -> Event:
        return PASSAGES[self.type](self.body, self.about)


PASSAGES = {
    "pericentre": Crossing.pericentre,
    "apocentre": Crossing.apocentre,
    "ascending-node": Crossing.ascending_node,
    "descending-node": Crossing.descending_node,
}
TABLES: dict[str, Any] = {
    CloseApproach.kind: CloseApproachTable,
    Collision.kind: CollisionTable,
    Escape.kind: EscapeTable,
    **dict.fromkeys(PASSAGES, PassageTable),
}


def events_of(system: System, given: Sequence[dict[str, Any]]) -> list[Event]:
    """Events of a file's tables, checked for the system. Raises an InputError that names table and key."""
    made: list[Event] = []
    for k, table in enumerate(given):
        path = f"event[{k}]"
        if "type" not in table:
            raise InputError(f"{path}.type: required key is missing; expected one of {', '.join(TABLES)}")
        name = table["type"]
        if not isinstance(name, str) or name not in TABLES:
            hint = suggestion(name, TABLES) if isinstance(name, str) else ""
            raise InputError(f"{path}.type: expected one of {', '.join(TABLES)}, got {shown(name)}{hint}")
        model = checked(TABLES[name], table, system.units, path)
        try:
            made += checked_events(system, [model.event(system.units)])
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
    return made
