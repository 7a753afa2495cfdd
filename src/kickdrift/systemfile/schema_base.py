"""Base of all tables in a system file: numbers with units, an error for every unknown key; and the tables of bodies."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeInt,
    PositiveInt,
    ValidationInfo,
    model_validator,
)
from pydantic_core import PydanticCustomError

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import other_name
from kickdrift.model.units.quantities import quantity
from kickdrift.text import choices, shown, suggestion


class In:
    """Validator that turns a number, or text with a unit, into a number in the file's units."""

    def __init__(self, dimension: str, sign: Literal["any", "positive", "non-negative"] = "any") -> None:
        self.dimension, self.sign = dimension, sign

    def __call__(self, value: Any, info: ValidationInfo) -> float:
        number = quantity(value, self.dimension, info.context["units"])  # type: ignore[index]
        if (self.sign == "positive" and number <= 0) or (self.sign == "non-negative" and number < 0):
            raise InputError(f"expected a {self.sign} {self.dimension}, got {shown(value)}")
        return number


class OneOrMore:
    """Validator of one number with a unit, or of a list of them."""

    def __init__(self, one: In) -> None:
        self.one = one

    def __call__(self, value: Any, info: ValidationInfo) -> float | list[float]:
        return [self.one(each, info) for each in value] if isinstance(value, list) else self.one(value, info)


class NamedOrMore(OneOrMore):
    """Validator of a name, or of a list of numbers with units."""

    def __call__(self, value: Any, info: ValidationInfo) -> Any:
        return super().__call__(value, info) if isinstance(value, list) else value


Length = Annotated[float, BeforeValidator(In("length"))]
Edge = Annotated[float, BeforeValidator(In("length", "positive"))]
Start = Annotated[float, BeforeValidator(In("time"))]
Time = Annotated[float, BeforeValidator(In("time", "positive"))]
Radius = Annotated[float, BeforeValidator(In("length", "non-negative"))]
Mass = Annotated[float, BeforeValidator(In("mass", "non-negative"))]
Temperature = Annotated[float, BeforeValidator(In("temperature", "non-negative"))]
Velocity = Annotated[float, BeforeValidator(In("velocity"))]
GravitationalParameter = Annotated[float, BeforeValidator(In("gravitational parameter", "non-negative"))]
Charge = Annotated[float, BeforeValidator(In("charge"))]
Vector = Annotated[list[Length], Field(min_length=3, max_length=3)]


class Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        if isinstance(data, cls):
            return data  # an instance was checked before
        if not isinstance(data, dict):
            raise PydanticCustomError("table", "{text}", {"text": f"expected a table, got {shown(data)}"})
        if key := cls.unknown(data):
            raise PydanticCustomError("unknown_key", "{text}", {"text": cls.unknown_text(key), "key": key})
        return data

    @classmethod
    def unknown(cls, data: Any) -> str | None:
        """First key that the table does not have, or None."""
        return next((key for key in data if key not in cls.model_fields), None)

    @classmethod
    def unknown_text(cls, key: str) -> str:
        """Message about an unknown key."""
        return f"unknown key{cls.hint(key)} (known: {choices(cls.model_fields, key)})"

    @classmethod
    def hint(cls, key: str) -> str:
        """Text ``; did you mean 'x'?`` if a known key is near, else ""."""
        return suggestion(key, cls.model_fields)

    def one_of(self, *keys: str) -> None:
        given = [key for key in keys if getattr(self, key) is not None]
        if len(given) != 1:
            raise InputError(f"expected exactly one of {', '.join(keys)}, got {' and '.join(given) or 'none'}")


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
    horizons: str | None = None
    spk: str | None = None
    target: int | None = None
    date: Any = None
    plane: Literal["ecliptic", "equator"] = "ecliptic"
    origin: int = 10

    @model_validator(mode="after")
    def _an_orbit(self) -> BodyTable:
        if self.from_jpl:
            return self._at_a_date()
        if lost := [key for key in ("target", "date", "plane", "origin") if key in self.model_fields_set]:
            raise InputError(f"{lost[0]}: goes with horizons or spk")
        self.one_of("a", "q", "P")
        where = [key for key in ("f", "M", "E", "T") if getattr(self, key) is not None]
        if len(where) > 1:
            raise InputError(f"expected one of f, M, E, T, got {' and '.join(where)}")
        if self.count is None and self.spread:
            raise InputError(f"{self.spread[0]} is a range, which needs count, the number of bodies to draw")
        return self

    @property
    def from_jpl(self) -> bool:
        """Whether the state comes from JPL Horizons, or from a kernel."""
        return self.horizons is not None or self.spk is not None

    def _at_a_date(self) -> BodyTable:
        """Check a body whose state comes from JPL."""
        self.one_of("horizons", "spk")
        if (self.target is None) == (self.spk is not None):
            raise InputError(
                "target: the number of the body in the kernel is missing, such as 2000001"
                if self.spk is not None
                else "target: goes with spk; horizons names its body"
            )
        if self.date is None:
            raise InputError("date: required with horizons and spk, such as 2025-01-01T00:00")
        if other := sorted(self.model_fields_set & {*ORBIT, "count", "primary"}):
            raise InputError(f"{other[0]}: excluded by {'horizons' if self.spk is None else 'spk'}")
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
        for body in self.elements if self.frame != "heliocentric" else ():
            if body.primary is not None or body.from_jpl:
                key = "primary" if body.primary is not None else "horizons" if body.spk is None else "spk"
                raise InputError(f'{key}: goes with frame = "heliocentric", not "{self.frame}"')
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


class BinariesTable(Table):
    fraction: float
    a: Annotated[Any, BeforeValidator(OneOrMore(In("length", "positive")))]
    e: Any = "thermal"


class HeavyTable(Table):
    fraction: float
    ratio: float


class SphereTable(Table):
    count: Annotated[int, Field(ge=2)]
    seed: NonNegativeInt
    scaled: bool = True
    masses: Annotated[Any, BeforeValidator(NamedOrMore(In("mass")))] = None
    mass_range: Annotated[list[Mass], Field(min_length=2, max_length=2)] | None = None
    mass: Annotated[float, BeforeValidator(In("mass", "positive"))] | None = None
    heavy: HeavyTable | None = None
    segregation: float = 0.0
    binaries: BinariesTable | None = None
    half_mass_radius: Edge | None = None
    virial_radius: Edge | None = None
    position: Vector | None = None
    velocity: Annotated[list[Velocity], Field(min_length=3, max_length=3)] | None = None


class KingSphereTable(SphereTable):
    W0: float


class PlummerTable(Table):
    plummer: SphereTable


class KingTable(Table):
    king: KingSphereTable


class ChainsTable(Table):
    count: PositiveInt
    length: Annotated[int, Field(ge=2)]


class TopologyTable(Table):
    chains: ChainsTable | None = None
    file: str | None = None
    bonds: Any = None
    angles: Any = None
    dihedrals: Any = None
    impropers: Any = None
    bond_types: Any = None
    angle_types: Any = None
    dihedral_types: Any = None
    improper_types: Any = None
    factors: list[float] | None = None
    exclusions: Any = None
    copies: PositiveInt | None = None


class ConstraintTable(Table):
    pairs: Any = None
    bonds: Any = None
    hydrogen: bool = False
    angles: Any = None
    rigid: Any = None
    distance: Annotated[Any, BeforeValidator(OneOrMore(In("length", "positive")))] = None
    angle: Annotated[float, BeforeValidator(In("angle"))] | None = None
    tolerance: float | None = None


class FixedTable(Table):
    particles: Any = None
    species: Any = None
    velocity: Annotated[list[Velocity], Field(min_length=3, max_length=3)] | None = None


class VirtualSiteTable(Table):
    particles: Any
    of: Any
    weights: Any
    normal: Annotated[Any, BeforeValidator(OneOrMore(In("inverse length")))] = 0.0
