"""Checks of values that users give to a System: names, radii, species and forces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from types import FunctionType
from typing import Any
from unicodedata import category

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.checks.values import listed, per_particle
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import shown

MOST_LETTERS = 255  # of a name
UNWRITABLE = ("Cc", "Cs", "Zl", "Zp")  # Unicode's control, surrogate and separator characters


def names_of(key: str, values: list[Any]) -> list[str]:
    """Return the values as names. Raises InputError if one is neither text nor a whole number, or if a run's file
    could not hold it: see `check_name`."""
    wrong = {kind for kind in set(map(type, values)) if not issubclass(kind, str | int | np.integer) or kind is bool}
    if wrong:
        k, value = next((k, value) for k, value in enumerate(values) if type(value) in wrong)
        raise InputError(f"{key}[{k}]: expected a name, got {shown(value)}")
    names = list(map(str, values))
    for name in set(names):
        if not (name.isprintable() and 0 < len(name) <= MOST_LETTERS and name.strip()):
            check_name(f"{key}[{names.index(name)}]", name)
    return names


def check_name(key: str, name: str) -> None:
    """Refuse a name that is empty, longer than MOST_LETTERS, or has a control character or half a character."""
    if not name.strip():
        raise InputError(f"{key}: expected a name, got {shown(name)}")
    if len(name) > MOST_LETTERS:
        raise InputError(f"{key}: expected a name of at most {MOST_LETTERS} letters, got {len(name):,}: {shown(name)}")
    for each in name:
        if category(each) in UNWRITABLE:
            raise InputError(f"{key}: expected a name without control characters, got {shown(name)}")


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


def forces_of(forces: Iterable[Any], units: UnitSystem | None = None) -> tuple[Any, ...]:
    """Return the forces as a tuple, checked: each has ``check``, as ``kd.Gravity()`` does. A force whose parameters are
    text with units is made in ``units``."""
    found = listed("forces", forces, "a list of forces, such as [kd.LennardJones(cutoff=2.5)]")
    for k, force in enumerate(found):
        if isinstance(force, type) or not callable(getattr(force, "check", None)):
            raise InputError(f"forces[{k}]: expected a force, such as kd.LennardJones(cutoff=2.5), {_instead(force)}")
    return tuple(force.in_units(units) if units and hasattr(force, "in_units") else force for force in found)


def _instead(force: Any) -> str:
    """Description of a value given in place of a force, and what to write instead."""
    if isinstance(force, str):
        return f"got the name {shown(force)}"
    if isinstance(force, type):
        return f"got the class {force.__name__}; write {force.__name__}(…)"
    if isinstance(force, FunctionType):
        return "got a function; kd.PythonForce(function) makes it a force, see docs/your-own-force.md"
    return f"got {shown(force)}"


def listed_species(species: Any) -> list[Any]:
    """Return the species as a list; a text is a list of letters."""
    return list(species) if isinstance(species, str) else listed("species", species, "a list of names")


def check_kinds(**given: tuple[Any, type]) -> None:
    """Refuse a value of a wrong type; None is allowed for all types but text."""
    for key, (value, kind) in given.items():
        if not (isinstance(value, kind) or (value is None and kind is not str)):
            expected = "text" if kind is str else f"a {kind.__name__}"
            raise InputError(f"{key}: expected {expected}, got {shown(value)}")
