"""Members of an ensemble: every combination of the grids' values, in several replicas, each with random values and a
seed. A member is the same whatever the size of the ensemble, and whoever runs it."""

import re
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from math import prod
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.asked import Integrator
from kickdrift.model.checks.limits import check_room, whole_text
from kickdrift.model.run_defaults import REPLACED
from kickdrift.systemfile.schema_run import is_run_key, run_keys
from kickdrift.text import shown, suggestion

VALUE_BYTES = 32  # memory of a grid's value
ROW_BYTES = 3000  # memory of a member's row
DRAWS = ("uniform", "normal", "log-uniform")
SPELLINGS = (
    "START:STOP:COUNT, log:START:STOP:COUNT, A,B,C, uniform:LOW:HIGH, normal:MEAN:DEVIATION or log-uniform:LOW:HIGH"
)


class Draw(NamedTuple):
    """Distribution of a value, drawn anew for each member."""

    kind: str  # one of DRAWS
    first: float  # low end, or mean
    second: float  # high end, or standard deviation

    def value(self, rng: np.random.Generator) -> float:
        """Draw one value."""
        if self.kind == "normal":
            return float(rng.normal(self.first, self.second))
        if self.kind == "uniform":
            return float(rng.uniform(self.first, self.second))
        return float(np.exp(rng.uniform(np.log(self.first), np.log(self.second))))


class Member(NamedTuple):
    """One run of an ensemble."""

    number: int
    replica: int
    seed: int  # seed of all random choices in its system
    values: dict[str, Any]  # values of the varied keys


@dataclass(frozen=True)
class Members:
    """All members, in order: replica by replica, and within a replica the last grid's values change fastest.

    Member i draws from ``SeedSequence(seed, spawn_key=(i,))``, the i-th child of ``SeedSequence(seed).spawn`` (O'Neill
    2015; numpy.random).
    """

    grids: dict[str, list[Any]]
    draws: dict[str, Draw]
    replicas: int
    seed: int

    @property
    def points(self) -> int:
        """Number of combinations of the grids' values."""
        return prod(len(values) for values in self.grids.values())

    def __len__(self) -> int:
        return self.points * self.replicas

    def __getitem__(self, index: int) -> Member:
        if not 0 <= index < len(self):
            raise IndexError(index)
        replica, point = divmod(index, self.points)
        places = np.unravel_index(point, tuple(len(values) for values in self.grids.values())) if self.grids else ()
        values = {key: grid[place] for (key, grid), place in zip(self.grids.items(), places, strict=True)}
        drawing, running = np.random.SeedSequence(self.seed, spawn_key=(index,)).spawn(2)
        rng = np.random.Generator(np.random.PCG64(drawing))
        values |= {key: draw.value(rng) for key, draw in self.draws.items()}
        return Member(index, replica, int(running.generate_state(1)[0]), values)


def members_of(vary: Mapping[str, Any], replicas: int, seed: int) -> Members:
    """Members of ``vary``: for each key the values on a grid, a text in one of SPELLINGS, or a Draw."""
    for key, value in (("replicas", replicas), ("seed", seed)):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < (key == "replicas"):
            least = "one" if key == "replicas" else "zero"
            raise InputError(f"{key}: expected a whole number, {least} or more, got {value!r}")
    grids: dict[str, list[Any]] = {}
    draws: dict[str, Draw] = {}
    for key, given in vary.items():
        found = spelled(key, given) if isinstance(given, str) else given
        if isinstance(found, Draw):
            draws[key] = _checked(key, found)
        else:
            grids[key] = _grid(key, found)
    found = Members(grids, draws, int(replicas), int(seed))
    check_room("ensemble", found.points * found.replicas, "members", ROW_BYTES, "give fewer")
    return found


def spelled(key: str, text: str) -> list[Any] | Draw:
    """Parse a key's text: the values of a grid, or a draw."""
    if not text.strip():
        raise InputError(f"vary: {key}: expected {SPELLINGS}, got nothing")
    kind, *rest = text.split(":")
    if kind in DRAWS:
        if len(rest) != 2:
            raise InputError(f"vary: {key}: expected {kind}:A:B, got {shown(text)}")
        return Draw(kind, *(_number(key, part) for part in rest))
    if "," in text or not rest:
        if not all(part.strip() for part in text.split(",")):
            raise InputError(f"vary: {key}: expected values between the commas, got {shown(text)}")
        return [_plain(part.strip()) for part in text.split(",")]
    parts = rest if kind == "log" else [kind, *rest]
    if len(parts) != 3:
        raise InputError(f"vary: {key}: expected {SPELLINGS}, got {shown(text)}")
    start, stop = _number(key, parts[0]), _number(key, parts[1])
    count = whole_text(parts[2])
    if not count:
        raise InputError(f"vary: {key}: COUNT must be a whole number, one or more, got {shown(parts[2])}")
    if kind == "log" and not min(start, stop) > 0:
        raise InputError(f"vary: {key}: log takes positive numbers, got {shown(text)}")
    check_room(f"vary: {key}", count, "values", VALUE_BYTES, "give a smaller COUNT")
    with np.errstate(all="ignore"):  # ends too far apart give non-finite values, which are refused later
        values = (np.geomspace if kind == "log" else np.linspace)(start, stop, count).tolist()
    whole = all(whole_text(part.removeprefix("-")) is not None for part in parts)
    whole = whole and all(value.is_integer() for value in values)
    return [int(value) for value in values] if whole else values


def _number(key: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"vary: {key}: expected a number, got {shown(text)}") from None
    if not np.isfinite(value):
        raise InputError(f"vary: {key}: expected a finite number, got {shown(text)}")
    return value


def _plain(text: str) -> Any:
    """Parse a value as TOML does: a number, true or false, else the text itself."""
    if text in ("true", "false"):
        return text == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            pass
    return text


def _checked(key: str, draw: Draw) -> Draw:
    low, high = draw.first, draw.second
    if draw.kind == "normal" and not high >= 0:
        raise InputError(f"vary: {key}: a standard deviation is zero or more, got {high:g}")
    if draw.kind != "normal" and not low < high:
        raise InputError(f"vary: {key}: expected the low end before the high end, got {low:g} and {high:g}")
    if not np.isfinite(high - low):
        raise InputError(f"vary: {key}: the low end {low:g} and the high end {high:g} are too far apart")
    if draw.kind == "log-uniform" and not low > 0:
        raise InputError(f"vary: {key}: log-uniform takes positive numbers, got {low:g}")
    return draw


def _grid(key: str, given: Any) -> list[Any]:
    values: Any = given.tolist() if isinstance(given, np.ndarray | np.generic) else given
    if not isinstance(values, Sequence | range) or isinstance(values, str) or not len(values):
        raise InputError(f"vary: {key}: expected values or {SPELLINGS}, got {shown(given)}")
    values = [value.item() if isinstance(value, np.generic) else value for value in values]
    values = [str(value) if isinstance(value, Integrator) else value for value in values]  # as tables have it
    for value in values:
        if not isinstance(value, int | float | str | bool | list):
            raise InputError(f"vary: {key}: expected numbers, texts or lists of these, got {shown(value)}")
        if isinstance(value, float) and not np.isfinite(value):
            raise InputError(f"vary: {key}: expected finite numbers, got {value}")
    return values


_PART = re.compile(r"([^.\[\]]+)|\[([^\[\]]+)\]")
_WHOLE = re.compile(r"(?:[^.\[\]]+|\[[^\[\]]+\])(?:\.[^.\[\]]+|\[[^\[\]]+\])*")
_NAMES = ("body", "type", "name")  # keys that may name an entry of a list of tables

KeyPath = tuple[str, ...]


def path_of(key: str) -> KeyPath:
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
        if not way and last not in changed and (hint := suggestion(last, run_keys())):
            raise InputError(f"vary: {key}: there is no such key{hint}")
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
