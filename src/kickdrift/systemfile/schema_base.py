"""Base of all tables in a system file: numbers with units, and an error for every unknown key."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, model_validator
from pydantic_core import PydanticCustomError

from kickdrift.errors import InputError
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


Length = Annotated[float, BeforeValidator(In("length"))]
Edge = Annotated[float, BeforeValidator(In("length", "positive"))]
Time = Annotated[float, BeforeValidator(In("time", "positive"))]
Radius = Annotated[float, BeforeValidator(In("length", "non-negative"))]
Mass = Annotated[float, BeforeValidator(In("mass", "non-negative"))]
Temperature = Annotated[float, BeforeValidator(In("temperature", "non-negative"))]
Velocity = Annotated[float, BeforeValidator(In("velocity"))]
GravitationalParameter = Annotated[float, BeforeValidator(In("gravitational parameter", "non-negative"))]
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
