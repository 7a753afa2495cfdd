"""Checks of what users give to a System: names, radii, charges, species and forces, and arrays against dimensions.

A force says with ``stands_for`` what it stands for, such as "gravity", and with ``acting_on`` where. Two forces that
stand for the same at the same place count it twice. A user's class of forces may say so, too.
"""

import math
from collections.abc import Iterable, Sequence, Sized
from itertools import combinations
from types import FunctionType
from typing import Any
from unicodedata import category

import numpy as np
from numpy.typing import ArrayLike

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import listed, numbers, per_particle
from kickdrift.model.state import Floats
from kickdrift.model.subject import Subject
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


def body_charges(charges: ArrayLike, n: int) -> Floats:
    """Checked charges (n,) of particles."""
    return per_particle("charges", charges, n, "charge", "a finite number", signed=True)


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


def begun(forces: tuple[Any, ...], system: Any) -> tuple[Any, ...]:
    """The forces with what they take from the start of a System, such as the places of a position restraint."""
    return tuple(force.begun(system) if hasattr(force, "begun") else force for force in forces)


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


CONSTANTS = {"G": "gravity", "c": "light"}  # keys of forces, and where the unit system has the value
SAME = 1e-6  # relative; values of G in the literature differ by a hundred thousandth


def check_doubles(system: Subject) -> None:
    """Refuse two forces that can never be meant together: equal ones, or different models of the same thing."""
    for first, second, where in _doubles(system):
        if type(first) is type(second) and not _equal(first, second):
            continue
        both = "twice the same" if type(first) is type(second) else f"both {first.stands_for}"
        raise InputError(
            f"forces: {first.name} and {second.name} are {both}{where}, which would count twice; take one of them"
        )


def doubtful_forces(system: Subject) -> list[str]:
    """Warnings of forces that may count something twice, and of forces with another G or c than others."""
    lines = [
        f"{first.name} is given twice{where}, and both forces count; give one force, unless a sum is meant"
        for first, second, where in _doubles(system)
    ]
    for key in CONSTANTS:
        values: dict[float, str] = {}
        for force in system.forces:
            value = constant_of(force, key, system)
            if value and not any(math.isclose(value, known, rel_tol=SAME) for known in values):
                values[value] = force.name
        if len(values) > 1:
            said = " and ".join(f"{key} = {value:.12g} in {name}" for value, name in values.items())
            lines.append(f"forces differ in {key}: {said}; it is one constant of the system, so give the same to all")
    return lines


def constant_of(force: Any, key: str, system: Subject) -> float | None:
    """G, or the speed of light c, in a force; None for a force without such a constant."""
    dimension = getattr(force, "dimensions", {}).get(key)
    if dimension != "gravitational constant" and not (key == "c" and getattr(force, "below_light", False)):
        return None
    given = getattr(force, key, None)
    return getattr(system.units, CONSTANTS[key]) if given is None else float(given)


def _doubles(system: Subject) -> list[tuple[Any, Any, str]]:
    """Pairs of forces that stand for the same at the same place, and that place as text."""
    found = []
    standing = [force for force in system.forces if getattr(force, "stands_for", "")]
    for first, second in combinations(standing, 2):
        if first.stands_for != second.stands_for:
            continue
        given = [force.acting_on(system) if hasattr(force, "acting_on") else None for force in (first, second)]
        named = [places for places in given if places is not None]
        if not named:
            found.append((first, second, ""))
        elif shared := named[0].keys() & named[-1].keys():
            found.append((first, second, f" on {named[0][min(shared)]}"))
    return found


def _equal(first: Any, second: Any) -> bool:
    """Whether two forces of one class have equal parameters, in whichever groups they are."""
    try:
        return bool({**vars(first), "group": 0} == {**vars(second), "group": 0})
    except ValueError:  # arrays do not compare to one truth
        return False


def box_for(given: Any, dimensions: int) -> Box:
    """Return the Box of a System with this number of dimensions. Raises InputError if the box has another number."""
    if dimensions == 3 and isinstance(given, Sized) and not isinstance(given, str) and len(given) == 2:
        raise InputError("box: expected three edge lengths or None, got 2; two go with dimensions = 2")
    box = Box.of(given)
    if dimensions == 2 and box.periodic_axes[2]:
        raise InputError(
            f"box: expected two edge lengths, since a two-dimensional system is not periodic along z, got {box.shape}"
        )
    return box


def check_plane(phase: Floats) -> None:
    """Refuse positions and velocities (2, 3, n) of a two-dimensional system unless they are in one plane."""
    z, v = phase[:, 2]
    for key, values, first, what in (("positions", z, z[0], "z"), ("velocities", v, 0.0, "vz")):
        off = np.flatnonzero(values != first)
        if off.size:
            expected = f"{what} = {first:.6g}, as of particle 0," if key == "positions" else f"{what} = 0"
            raise InputError(
                f"{key}: particle {off[0]} has {what} = {values[off[0]]:.6g}; expected {expected} in two dimensions"
            )


def vectors_of(key: str, values: ArrayLike, dimensions: int) -> Floats:
    """Check positions or velocities and return them as (n, 3). In two dimensions (n, 2) is accepted."""
    array = numbers(key, values, "numbers of shape (n, 3)")
    if dimensions == 2 and array.ndim == 2 and array.shape[1] == 2:
        array = np.column_stack([array, np.zeros(len(array))])
    if array.ndim != 2 or array.shape[1] != 3 or len(array) == 0:
        raise InputError(f"{key}: expected shape (n, 3) with n >= 1, got {array.shape}")
    bad = np.argwhere(~np.isfinite(array))
    if bad.size:
        particle, axis = bad[0]
        raise InputError(
            f"{key}: particle {particle} has {array[particle, axis]} in {'xyz'[axis]}; expected finite numbers"
        )
    return array
