"""How a Simulation was asked to integrate."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

import numpy as np

Tolerance = float | tuple[float, ...]  # one number, or one for each component of y


@dataclass(frozen=True)
class Options:
    """How a Simulation was asked to integrate; None where it was not said."""

    dt: float | None = None
    rtol: Tolerance | None = None
    atol: Tolerance | None = None
    controller: str | None = None
    compensated: bool = False
    iteration: str | None = None
    coordinates: str | None = None
    corrector: int | None = None
    order: str | None = None
    eta: float | None = None
    scheme: str | None = None
    precision: str | None = None
    max_step: float | None = None

    def __post_init__(self) -> None:
        for key in ("rtol", "atol"):
            value: Any = getattr(self, key)
            if isinstance(value, list | np.ndarray):
                object.__setattr__(self, key, _row(value))

    def or_else(self, defaults: Any) -> Options:
        """The same, with what was not said taken from ``defaults`` where those have it."""
        unsaid = [field.name for field in fields(self) if getattr(self, field.name) is None]
        found: dict[str, Any] = {key: getattr(defaults, key, None) for key in unsaid}
        return replace(self, **found)

    def extras(self, tunable: Collection[str]) -> dict[str, Any]:
        """What a run's file should say besides dt, of a method that takes these options."""
        said = {key: value for key, value in asdict(self).items() if key != "dt" and value}
        tolerances = zip(("rtol", "atol"), self.tolerances, strict=True)
        return said | {key: value for key, value in tolerances if key in tunable}

    @property
    def tolerances(self) -> tuple[Tolerance, Tolerance]:
        """rtol and atol, with what stands in where they were not said."""
        return (1e-8 if self.rtol is None else self.rtol), (1e-10 if self.atol is None else self.atol)

    @property
    def longest(self) -> float:
        """The longest step allowed."""
        return np.inf if self.max_step is None else self.max_step


def _row(value: Any) -> Any:
    """A list or an array as a tuple of Python's numbers; an array of no dimension as its number."""
    found = value.tolist() if isinstance(value, np.ndarray) else value
    return tuple(found) if isinstance(found, list) else found
