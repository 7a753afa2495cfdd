"""System files with one mistake each, made from the shipped ones: an unknown or a missing key, or a wrong type."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Iterator
from typing import Any

from kickdrift.systemfile.files import shipped

FREE = ("invariants", "species", "arguments", "types", "mass", "charge")  # tables with keys of the user's own
REQUIRED = ("units", "particles", "force", "type", "count", "central", "elements", "problem")
UNKNOWN, WRONG, MISSING = "unknown key", "wrong type", "missing key"


def shipped_tables() -> dict[str, dict[str, Any]]:
    """Parsed shipped files, by name."""
    return {name: tomllib.loads(path.read_text(encoding="utf-8")) for name, path in shipped().items()}


def broken(name: str, whole: dict[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Where the mistake is, its kind, and the tables with this mistake."""
    for path in _paths(whole):
        copied = copy.deepcopy(whole)
        inside: Any = copied
        for key in path[:-1]:
            inside = inside[key]
        where = f"{name}: {'.'.join(map(str, path))}"
        value = inside[path[-1]]
        if isinstance(value, dict) and path[-1] not in FREE:
            value["no_such_key"] = 1
            yield where, UNKNOWN, copy.deepcopy(copied)
            del value["no_such_key"]
        inside[path[-1]] = _other(value)
        yield where, WRONG, copy.deepcopy(copied)
        if path[-1] in REQUIRED:
            del inside[path[-1]]
            yield where, MISSING, copied


def _paths(value: Any) -> Iterator[tuple[Any, ...]]:
    """Path of each key and of the first item of each list, outside of free tables."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield (key,)
            if key not in FREE:
                yield from ((key, *more) for more in _paths(inner))
    elif isinstance(value, list) and value:
        yield (0,)
        yield from ((0, *more) for more in _paths(value[0]))


def _other(value: Any) -> Any:
    """A value of another type, which no unit makes a number."""
    return {bool: 3, str: [["x"]], int: "many", float: "much", list: "much", dict: [["x"]]}[type(value)]
