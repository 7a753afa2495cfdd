"""Fixes of LAMMPS as defaults of a run and as constraints. A fix without a counterpart is an error that names it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from kickdrift.bridges.lammps.reading import Read
from kickdrift.errors import InputError
from kickdrift.text import choices, shown

WATCHING = frozenset((  # fixes that only measure or write
    "print", "ave/atom", "ave/chunk", "ave/correlate", "ave/correlate/long", "ave/grid", "ave/histo",
    "ave/histo/weight", "ave/moments", "ave/time", "balance", "controller", "halt", "store/force", "store/state",
    "vector",
))  # fmt: skip
STEPPING = ("nve", "nvt", "npt", "nph", "langevin", "temp/csvr", "shake", "rattle", "momentum", "recenter", "enforce2d")
LIMIT = 1e-12


class Asked(NamedTuple):
    """What the fixes ask for.

    Attributes
    ----------
    run : arguments of RunDefaults
    rigid : types of bonds and of angles that are rigid
    left : what stays behind
    masses : of particles whose bonds are rigid
    """

    run: dict[str, Any]
    rigid: dict[str, set[int]]
    left: list[str]
    masses: list[float]


def asked_of(read: Read) -> Asked:
    """Return what the fixes in force ask for."""
    found = Asked({"dt": float(read.told["dt"])}, {"bonds": set(), "angles": set()}, [], [])
    for name, (group, style, *rest) in _in_force(read).items():
        style = style.removesuffix("/omp").removesuffix("/kk").removesuffix("/gpu").removesuffix("/intel")
        where = f"fix {name} {group} {style}"
        if style in WATCHING:
            continue
        if style not in STEPPING:
            raise InputError(f"{where}: has no counterpart in kickdrift; it has {choices(STEPPING)}")
        if group != "all":
            raise InputError(f"{where}: acts on the group {group} alone; kickdrift's methods move all particles")
        if style in ("shake", "rattle"):
            _rigid(where, rest, found)
        elif style in ("momentum", "recenter"):
            found.left.append(where)
        elif style == "langevin":
            start, end, damping = _three(where, rest)
            more = [word for word, before in zip(rest[4:], rest[3:], strict=False) if "tally" not in (word, before)]
            if more:
                found.left.append(f"{' '.join(more)} of {where}")
            _bath(where, found, "baoab", start, end, friction=1.0 / damping)
        elif style == "temp/csvr":
            start, end, tau = _three(where, rest)
            _bath(where, found, "csvr", start, end, tau=tau)
        elif style in ("nvt", "npt", "nph"):
            if "temp" in rest:
                start, end, tau = _three(where, rest[rest.index("temp") + 1 :])
                _bath(where, found, "nose-hoover", start, end, tau=tau)
            if style != "nvt":
                found.left.append(f"the barostat of {where}")
        found.run.setdefault("integrator", "velocity-verlet")
    return found


def _in_force(read: Read) -> dict[str, list[str]]:
    """Group, style and arguments of each fix that no ``unfix`` took away."""
    found: dict[str, list[str]] = {}
    for word, *rest in read.commands:
        if word == "fix" and len(rest) > 2:
            found[rest[0]] = rest[1:]
        elif word == "unfix" and rest:
            found.pop(rest[0], None)
    return found


def _three(where: str, words: Sequence[str]) -> list[float]:
    """Temperatures at start and end, and a time."""
    try:
        start, end, time = map(float, words[:3])
    except ValueError:
        given = " ".join(words[:3])
        raise InputError(f"{where}: expected two temperatures and a time as numbers, got {shown(given)}") from None
    return [start, end, time]


def _number(where: str, word: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise InputError(f"{where}: expected masses as numbers after m, got {shown(word)}") from None


def _bath(where: str, found: Asked, name: str, start: float, end: float, **more: float) -> None:
    if abs(end - start) > LIMIT * abs(start):
        found.left.append(f"the change of temperature of {where}, from {start:g} to {end:g}")
    found.run.update(integrator=name, temperature=start, **more)


def _rigid(where: str, words: Sequence[str], found: Asked) -> None:
    """Take the types of rigid bonds and angles."""
    kind = ""
    for word in words[3:]:
        if word in ("b", "a", "m"):
            kind = {"b": "bonds", "a": "angles", "m": "masses"}[word]
        elif word in ("t", "mol", "kbond", "store"):
            if word == "t":
                raise InputError(
                    f"{where}: t names rigid bonds by types of atoms; kickdrift takes b and a, by types, and m, a mass"
                )
            kind = ""
        elif kind == "masses":
            found.masses.append(_number(where, word))
        elif kind:
            if not word.isdecimal():
                raise InputError(f"{where}: expected numbers of types after {kind[0]}, got {shown(word)}")
            found.rigid[kind].add(int(word))
