"""Forces of a System that count something twice, and forces whose constants differ.

A force says with ``stands_for`` what it stands for, such as "gravity", and with ``acting_on`` where. Two forces that
stand for the same at the same place count it twice. A user's class of forces may say so, too.
"""

from __future__ import annotations

import math
from itertools import combinations
from typing import Any

from kickdrift.errors import InputError
from kickdrift.model.subject import Subject

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
