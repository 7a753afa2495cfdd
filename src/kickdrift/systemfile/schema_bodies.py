"""Schema of bodies on orbits and of star clusters: `elements` and `plummer` under [particles]."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, NonNegativeInt, PositiveInt, ValidationInfo, model_validator

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import other_name
from kickdrift.systemfile.schema_base import GravitationalParameter, In, Length, Mass, Radius, Table, Velocity


class Spread(In):
    """Validator of one number, or of a range [low, high] for random numbers."""

    def __call__(self, value: Any, info: ValidationInfo) -> Any:
        if not (isinstance(value, list) and len(value) == 2):
            return super().__call__(value, info)
        low, high = (super(Spread, self).__call__(end, info) for end in value)
        if low > high:
            raise InputError(f"expected a range [low, high], got {value}")
        return [low, high]


Angle = Annotated[Any, BeforeValidator(Spread("angle"))]
Distance = Annotated[Any, BeforeValidator(Spread("length"))]
Moment = Annotated[Any, BeforeValidator(Spread("time"))]
Number = Annotated[Any, BeforeValidator(Spread("dimensionless"))]


class CentralTable(Table):
    name: str | None = None
    body: str | None = None  # older key of the name
    mass: Mass | None = None
    GM: GravitationalParameter | None = None
    radius: Radius | None = None

    @classmethod
    def hint(cls, key: str) -> str:
        return other_name("body", key) or super().hint(key)

    @model_validator(mode="after")
    def _one_mass(self) -> CentralTable:
        self.one_of("mass", "GM")
        if self.name is not None and self.body is not None:
            raise InputError("name: expected name or body, its older key, got both")
        return self

    @property
    def called(self) -> str | None:
        """Name of the body, if any."""
        return self.body if self.name is None else self.name


ORBIT = ("a", "q", "P", "e", "inc", "Omega", "omega", "f", "M", "E", "T")  # keys of an orbit


class BodyTable(CentralTable):
    """One body on an orbit, or ``count`` of them; angles in degrees."""

    primary: str | None = None
    count: PositiveInt | None = None
    a: Distance = None
    q: Distance = None
    P: Moment = None
    e: Number = 0.0
    inc: Angle = 0.0
    Omega: Angle = 0.0
    omega: Angle = 0.0
    f: Angle = None
    M: Angle = None
    E: Angle = None
    T: Moment = None

    @model_validator(mode="after")
    def _an_orbit(self) -> BodyTable:
        self.one_of("a", "q", "P")
        where = [key for key in ("f", "M", "E", "T") if getattr(self, key) is not None]
        if len(where) > 1:
            raise InputError(f"expected one of f, M, E, T, got {' and '.join(where)}")
        if self.count is None and self.spread:
            raise InputError(f"{self.spread[0]} is a range, which needs count, the number of bodies to draw")
        return self

    @property
    def spread(self) -> list[str]:
        """Keys with a range as their value."""
        return [key for key, value in self if isinstance(value, list)]


class BodiesTable(Table):
    """A central body and others on orbits, if any."""

    central: CentralTable
    elements: list[BodyTable]
    frame: Literal["heliocentric", "jacobi", "barycentric"] = "heliocentric"
    seed: NonNegativeInt | None = None

    @model_validator(mode="after")
    def _seeded(self) -> BodiesTable:
        if self.frame != "heliocentric" and any(body.primary is not None for body in self.elements):
            raise InputError(f'primary: goes with frame = "heliocentric", not "{self.frame}"')
        drawn = any(body.spread for body in self.elements)
        if drawn != (self.seed is not None):
            what = "is missing; bodies are drawn with a seed" if drawn else "needs ranges, but there are none"
            raise InputError(f"seed {what}, such as a = [2.1, 3.3] and seed = 1")
        return self


class ElementsTable(BodiesTable):
    elements: Annotated[list[BodyTable], Field(min_length=1)]


class AddedTable(BodyTable):
    """A body to add to a System: on an orbit, or at a position."""

    primary: str | int | None = None  # type: ignore[assignment]
    species: str | None = None
    position: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = None
    velocity: Annotated[list[Velocity], Field(min_length=3, max_length=3)] | None = None

    @model_validator(mode="after")
    def _an_orbit(self) -> AddedTable:
        if self.count is not None:
            raise InputError("count: one body is added at a time")
        if self.position is None:
            if self.velocity is not None:
                raise InputError("velocity: goes with position, and orbits have their own")
            super()._an_orbit()  # type: ignore[operator]
        elif orbit := self.model_fields_set & {*ORBIT, "primary"}:
            raise InputError(f"position: excludes the elements of an orbit, got {min(orbit)}")
        return self


class SphereTable(Table):
    count: Annotated[int, Field(ge=2)]
    seed: NonNegativeInt
    scaled: bool = True


class PlummerTable(Table):
    plummer: SphereTable
