"""Checks of values that users give for each body: names and radii."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.checks import listed, per_particle
from kickdrift.model.state import Floats
from kickdrift.text import shown


def names_of(key: str, values: list[Any]) -> list[str]:
    """Return the values as names. Raises InputError if one is neither text nor a whole number."""
    wrong = {kind for kind in set(map(type, values)) if not issubclass(kind, str | int | np.integer) or kind is bool}
    if wrong:
        k, value = next((k, value) for k, value in enumerate(values) if type(value) in wrong)
        raise InputError(f"{key}[{k}]: expected a name, got {shown(value)}")
    return list(map(str, values))


def body_radii(radii: ArrayLike, n: int) -> Floats:
    """Checked radii (n,) of bodies."""
    return per_particle("radii", radii, n, "radius", "a length")


def body_names(names: Sequence[str], n: int) -> tuple[str, ...]:
    """Checked names of n bodies: none, or a different one for each."""
    given = tuple(names_of("names", listed("names", names, "a list of names")))
    if given and len(given) != n:
        raise InputError(f"names: expected {n}, one for each particle, got {len(given)}")
    seen: set[str] = set()
    if len(set(given)) == len(given) and all(map(str.strip, given)):
        return given
    for k, name in enumerate(given):
        if not name.strip() or name in seen:
            raise InputError(f"names: particle {k} is called {name!r}; expected unique names")
        seen.add(name)
    return given
