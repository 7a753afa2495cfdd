"""Keys of the table [equilibrate] on the command line."""

from __future__ import annotations

from copy import copy
from typing import Any

from kickdrift.errors import InputError
from kickdrift.integrators.asked import known_options
from kickdrift.model.checks.limits import whole_text
from kickdrift.model.problem import Problem
from kickdrift.model.system import System
from kickdrift.text import shown

WHOLE = ("steps", "interval")


def with_keys(chosen: System | Problem, pairs: list[str]) -> System | Problem:
    """The system with keys of [equilibrate] from texts KEY=VALUE, over those of its file."""
    from kickdrift.systemfile.schema_run import EquilibrateTable, equilibration_of

    if not pairs:
        return chosen
    if not isinstance(chosen, System):
        raise InputError("--equilibrate: a Problem has no temperature")
    given: dict[str, Any] = {}
    for text in pairs:
        key, equals, value = (part.strip() for part in text.partition("="))
        if not (equals and key and value):
            raise InputError(f"--equilibrate: expected KEY=VALUE, such as temperature=1, got {shown(text)}")
        if key in given:
            raise InputError(f"--equilibrate {key}: is given twice")
        option = None if key in EquilibrateTable.model_fields else known_options().get(key)
        given[key] = option.parsed(value) if option else _value(key, value)
    said = chosen.equilibration.said() if chosen.equilibration else {}
    for one, other in (("steps", "time"), ("time", "steps")):
        if one in given and other not in given:
            said.pop(other, None)
    made = copy(chosen)
    object.__setattr__(made, "equilibration", equilibration_of(said | given, chosen.units))
    return made


def _value(key: str, text: str) -> int | float | str:
    """The number that a text is, whole where it must be, or the text itself."""
    whole = whole_text(text)
    if whole is not None:
        return whole
    try:
        found = float(text)
    except ValueError:
        return text
    return int(found) if key in WHOLE and found.is_integer() else found
