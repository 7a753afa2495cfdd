"""Options of a Simulation's integration."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from kickdrift.integrators.options.option import ATOL, OPTIONS, RTOL

Tolerance = float | tuple[float, ...]  # one number, or one for each component of y


class Options(Mapping[str, Any]):
    """Values of dt and of options by name, each an attribute too; None for a value that was not given.

    Use ``options.dt`` or ``options["rtol"]``. All options of the table are included, and those of a user's method that
    have values. Tolerances in a list or an array become tuples. Options can be compared and can be dictionary keys.
    """

    _values: dict[str, Any]

    def __init__(self, dt: float | None = None, **values: Any) -> None:
        found = {"dt": dt, **{name: False if each.type is bool else None for name, each in OPTIONS.items()}}
        found |= {key: _row(key, value) for key, value in values.items() if value is not None}
        object.__setattr__(self, "_values", found)

    def __getitem__(self, key: str) -> Any:
        return self._values[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name not in self._values:
            raise AttributeError(f"Options have no {name!r}")
        return self._values[name]

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError("Options are read-only; ``changed`` makes others")

    def __hash__(self) -> int:
        return hash(frozenset(self._values.items()))

    def __repr__(self) -> str:
        said = [f"{key}={value!r}" for key, value in self.items() if value is not None and value is not False]
        return f"Options({', '.join(said)})"

    def __reduce__(self) -> Any:
        return _made, (dict(self),)

    def changed(self, **values: Any) -> Options:
        """Return a copy with these values."""
        return Options(**{**self, **values})

    def extras(self, tunable: Collection[str]) -> dict[str, Any]:
        """Values for a run's file besides dt, for a method with these options."""
        said = {key: value for key, value in self.items() if key != "dt" and value}
        tolerances = zip(("rtol", "atol"), self.tolerances, strict=True)
        return said | {key: value for key, value in tolerances if key in tunable}

    @property
    def tolerances(self) -> tuple[Tolerance, Tolerance]:
        """rtol and atol, with defaults for values that were not given."""
        rtol, atol = self._values[RTOL.name], self._values[ATOL.name]
        return (RTOL.default if rtol is None else rtol), (ATOL.default if atol is None else atol)

    @property
    def longest(self) -> float:
        """Longest allowed step."""
        longest = self._values["max_step"]
        return np.inf if longest is None else longest


def _made(values: dict[str, Any]) -> Options:
    return Options(**values)


def _row(key: str, value: Any) -> Any:
    """Convert a list or an array to a tuple of Python's numbers, for an option with several numbers, and an array of no
    dimension to its number."""
    if key in OPTIONS and not OPTIONS[key].several:
        return value
    found = value.tolist() if isinstance(value, np.ndarray) else value
    return tuple(found) if isinstance(found, list) else found
