"""Keys of a system file as users type them: ``particles.elements[1].a``, ``particles.elements[Saturn].a``, ``dt``."""

from __future__ import annotations

import re
from copy import deepcopy
from typing import Any

from kickdrift.errors import InputError
from kickdrift.model.checks.limits import whole_text
from kickdrift.model.run_defaults import REPLACED
from kickdrift.systemfile.schema_run import is_run_key
from kickdrift.text import shown, suggestion

_PART = re.compile(r"([^.\[\]]+)|\[([^\[\]]+)\]")
_WHOLE = re.compile(r"(?:[^.\[\]]+|\[[^\[\]]+\])(?:\.[^.\[\]]+|\[[^\[\]]+\])*")
_NAMES = ("body", "type", "name")  # keys that may name an entry of a list of tables

Path = tuple[str, ...]


def path_of(key: str) -> Path:
    """Parts of a key; a bare name of a key in ``[run]`` means ``run.NAME``."""
    if not isinstance(key, str) or not _WHOLE.fullmatch(key):
        raise InputError(f"vary: expected a key such as dt or particles.elements[1].a, got {shown(key)}")
    parts = tuple(plain or bracketed for plain, bracketed in _PART.findall(key))
    return ("run", *parts) if len(parts) == 1 and is_run_key(parts[0]) else parts


def with_values(data: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Copy of a system file's content with each key's value in its place."""
    changed = deepcopy(data)
    run = changed.setdefault("run", {})
    for key, value in values.items():
        *way, last = path_of(key)
        place: Any = changed
        for part in way:
            place = place[_index(place, part, key)]
        if not isinstance(place, dict | list):
            raise InputError(f"vary: {key}: no table or list holds {last!r}, but {shown(place)}")
        index: Any = last if isinstance(place, dict) else _index(place, last, key)
        there = place.get(index) if isinstance(place, dict) else place[index]
        if isinstance(there, dict | list) and not isinstance(value, dict | list):
            raise InputError(f"vary: {key}: is a {'table' if isinstance(there, dict) else 'list'}, not one value")
        place[index] = value
    said = [path_of(key) for key in values]
    for one, *others in REPLACED:
        for other in others:
            if ("run", one) in said and ("run", other) not in said:
                run.pop(other, None)
    return changed


def _index(place: Any, part: str, key: str) -> Any:
    """Index of a key's part in a table or list."""
    if isinstance(place, dict):
        if part not in place:
            raise InputError(
                f"vary: {key}: there is no {part!r}{suggestion(part, place)}; there are {', '.join(place)}"
            )
        return part
    if not isinstance(place, list):
        raise InputError(f"vary: {key}: {part!r} is inside {shown(place)}, which is not a table or list")
    if (number := whole_text(part)) is not None:
        if number >= len(place):
            raise InputError(f"vary: {key}: no entry [{part}] in a list of {len(place)}; entries count from 0")
        return number
    called = [next((each[name] for name in _NAMES if name in each), "") for each in place if isinstance(each, dict)]
    if part not in called:
        raise InputError(f"vary: {key}: no entry is named {part!r}{suggestion(part, called)}")
    if called.count(part) > 1:
        raise InputError(f"vary: {key}: {called.count(part)} entries are named {part!r}; give its number, from 0")
    return called.index(part)
