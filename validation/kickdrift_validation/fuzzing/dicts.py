"""Dicts given to `kickdrift.load`: the tables of files that ship, with values and keys that no file can hold."""

import tomllib
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from kickdrift_validation.fuzzing import actions
from kickdrift_validation.fuzzing.case import NUMBERS, TEXTS, UNITS, Case, dice
from kickdrift_validation.fuzzing.system_files import bases

KIND = "dicts"


def itself() -> dict[str, Any]:
    found: dict[str, Any] = {}
    found["particles"] = found
    return found


def deep() -> list[Any]:
    found: list[Any] = []
    for _ in range(100_000):
        found = [found]
    return found


ODD: tuple[Callable[[], Any], ...] = (
    lambda: None, lambda: True, object, lambda: b"bytes", lambda: {1, 2}, lambda: 1j, lambda: 10**5000, itself, deep,
    lambda: np.array([]), lambda: np.array("text"), lambda: np.full((2, 2), np.nan), lambda: np.float32(0.1),
    lambda: np.array([object()]), lambda: np.datetime64("2020-01-01"), lambda: np.zeros((3, 3, 3, 3)), lambda: print,
    lambda: int, lambda: iter([1]), lambda: range(3), lambda: (1, "x", None), dict, list, lambda: {"": {}},
    lambda: {None: 1}, lambda: {2: 3}, lambda: {("a", 1): "b"}, lambda: {"a\0": 1}, lambda: np.ma.masked,
    lambda: float("nan"), lambda: -float("inf"), lambda: np.zeros(10**6), lambda: "x" * 10**6, lambda: "\ud800",
)  # fmt: skip


def places(table: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Ways to every value of a table."""
    items = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    return [way for key, value in items for way in ((*path, key), *places(value, (*path, key)))]


def put(table: Any, way: tuple[Any, ...], value: Any) -> None:
    for key in way[:-1]:
        table = table[key]
    table[way[-1]] = value


def made(number: int, seed: int) -> Any:
    rng = dice(KIND, seed, number)
    table = tomllib.loads(rng.choice(list(bases().values())))
    ways = places(table)
    for way in rng.sample(ways, rng.choice((1, 1, 2, 3))):
        what = rng.random()
        value = rng.choice((*NUMBERS, *TEXTS, *(f"1 {unit}" for unit in UNITS), 0, -1, 1e300, 2**70))
        with suppress(LookupError, TypeError):  # another value may have taken the place of the way
            if what < 0.1:
                table[rng.choice((None, 1, "", "x", ("a",), "units.x"))] = value
            else:
                put(table, way, rng.choice(ODD)() if what < 0.6 else value)
    return table


def load(number: str, seed: str) -> int:
    """Give the dict to `kickdrift.load`."""
    return actions.load(made(int(number), int(seed)))


def case(number: int, seed: int = 0) -> Case:
    return Case(KIND, number, (("!dicts.load", str(number), str(seed)),), f"dict {number}", may_compute=True)
