"""The flows that splitting methods are words over, and words as text: letters, groups of forces and repetition.

A splitting integrates a sum of vector fields by the exact flow of each in turn (McLachlan & Quispel 2002,
doi:10.1017/S0962492902000053). Step loops have the drift and the kick built in. A further flow is machine code at an
address, so a loop is compiled once for all of them. A row of ``FLOWS`` makes its letter known.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.options import (
    ALLOW_GRAVITY,
    CHAIN,
    FRICTION,
    NOISE,
    OF_PRESSURE,
    RAMP_STEPS,
    RATE,
    SEED,
    TAU,
    TEMPERATURE,
    TEMPERATURE_TO,
    Option,
)
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options import Options
    from kickdrift.integrators.stepping.subflow_code import BoundSubflow


DRIFT, KICK, MIRROR, BESIDE, UNDER_STAR, MUTUAL = "A", "B", "W", "Y", "S", "I"


@dataclass(frozen=True)
class Subflow:
    """One letter of the words.

    Attributes
    ----------
    name : what the flow is called
    moves : whether it changes positions, so that forces must be evaluated anew
    symplectic, reversible : whether the flow keeps the symplectic form; whether -dt undoes dt
    bath : whether the flow exchanges heat with a bath
    drags : whether the bath changes the total momentum
    options : what the flow takes; every method whose word has the letter takes it
    whole : whether the flow drifts and kicks by itself, so that a word needs no other drift
    bind : makes the BoundSubflow of a run from its Flow, its Options, and the flow's part of the step at each stage;
        None for kick and drift, which loops have built in
    """

    name: str
    moves: bool
    symplectic: bool = True
    reversible: bool = True
    bath: bool = False
    drags: bool = False
    whole: bool = False
    options: tuple[Option, ...] = ()
    bind: Callable[[Flow, Options, Floats], BoundSubflow] | None = None


def _bath(letter: str, name: str, *options: Option, drags: bool) -> Subflow:
    """Return the row of a heat bath. Its module, which needs the compiler, is loaded when a run begins."""

    def bind(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
        from kickdrift.integrators.splitting.baths import csvr, nose_hoover, velocity_noise

        binders = {"C": csvr.bind, "D": velocity_noise.bind_collisions, "N": nose_hoover.bind}
        if letter in binders:
            return binders[letter](flow, options, weights)
        return velocity_noise.bind_friction(letter, flow, options, weights)

    declared = (TEMPERATURE, TEMPERATURE_TO, *options, *OF_PRESSURE, RAMP_STEPS, ALLOW_GRAVITY)
    return Subflow(name, False, False, False, True, drags, options=declared, bind=bind)


def _mirrors(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    from kickdrift.integrators.splitting.mirrors import bind

    return bind(flow, options, weights)


def _unknowns(flow: Flow, options: Options, weights: Floats) -> BoundSubflow:
    from kickdrift.integrators.splitting.unknowns import bind

    return bind(flow, options, weights)


FLOWS = {
    DRIFT: Subflow("drift", moves=True),
    KICK: Subflow("kick", moves=False),
    "O": _bath("O", "Ornstein-Uhlenbeck", FRICTION, SEED, NOISE, drags=True),
    "G": _bath("G", "Ornstein-Uhlenbeck by the midpoint", FRICTION, SEED, NOISE, drags=True),
    "M": _bath("M", "velocities drawn anew", FRICTION, SEED, NOISE, drags=True),
    "C": _bath("C", "stochastic rescaling", TAU, SEED, drags=False),
    "D": _bath("D", "Andersen's collisions", RATE, SEED, drags=True),
    "N": _bath("N", "Nosé-Hoover chain", TAU, CHAIN, drags=False),
    MIRROR: Subflow("bounces off hard walls", moves=True, bind=_mirrors),
    BESIDE: Subflow("unknowns beside the bodies", moves=True, symplectic=False, reversible=False, bind=_unknowns),
}


_TOKEN = re.compile(r"\s*(?:([A-Za-z])(\d*)|(\()|\)\s*(\d+))\s*")
MOST_GROUPS = 8


@lru_cache(maxsize=256)
def letters_of(name: str, word: str) -> tuple[str, ...]:
    """Letters of a word, in the order in which its flows act.

    "BAB" is three letters. "B0" and "B1" are kicks by the forces of group 0 and group 1. "(B0 A B0)4" is the part in
    brackets four times. Spaces have no meaning.

    Raises InputError, which begins with the ``name`` of the method, for text that is no word: an unknown letter, a
    group on a flow other than kicks, kicks with and without groups, a group that is left out, and open brackets."""
    stack: list[list[str]] = [[]]
    at = 0
    while at < len(word):
        token = _TOKEN.match(word, at)
        if token is None:
            raise InputError(f"{name}: a word is letters such as BAB, and (BAB)4 repeats them; got {word[at:]!r}")
        letter, group, opens, times = token.groups()
        at = token.end()
        if opens:
            stack.append([])
        elif letter:
            stack[-1].append(_checked(name, letter, group))
        else:
            if len(stack) == 1:
                raise InputError(f"{name}: the word {word!r} closes a bracket that is not open")
            part = stack.pop()
            stack[-1] += part * int(times)
    if len(stack) > 1:
        raise InputError(f"{name}: the word {word!r} does not close a bracket")
    letters = tuple(stack[0])
    _check_groups(name, letters)
    return letters


def group_of(letter: str) -> int | None:
    """Group of the forces of a kick; None for a kick by all forces, and for other flows."""
    return int(letter[1:]) if letter[1:] else None


def nested(inner: str, substeps: int, groups: int = 2) -> str:
    """Word of multiple time steps: each group's kicks embrace ``substeps`` steps of the groups before it.

    ``inner`` is the palindrome of group 0, with plain kicks. Tuckerman, Berne & Martyna 1992, doi:10.1063/1.463137,
    eq. 2.21."""
    word = inner.replace(KICK, f"{KICK}0 ")
    for group in range(1, groups):
        word = f"{KICK}{group} ({word}){substeps} {KICK}{group}"
    return word


def _checked(name: str, letter: str, group: str) -> str:
    if letter not in FLOWS:
        known = ", ".join(f"{each} ({flow.name})" for each, flow in FLOWS.items())
        raise InputError(f"{name}: no flow has the letter {letter!r}; letters are {known}")
    if group and letter != KICK:
        raise InputError(f"{name}: only kicks have groups of forces, and {letter}{group} is a {FLOWS[letter].name}")
    if group and int(group) >= MOST_GROUPS:
        raise InputError(f"{name}: groups of forces are 0 to {MOST_GROUPS - 1}, got {letter}{group}")
    return f"{letter}{int(group)}" if group else letter


def _check_groups(name: str, letters: tuple[str, ...]) -> None:
    """Refuse kicks with and without groups in one word, and a group that is left out."""
    groups = sorted({group for letter in letters if (group := group_of(letter)) is not None})
    if groups and KICK in letters:
        raise InputError(f"{name}: a word kicks either by all forces, B, or by groups, B0 and B1; not both")
    if groups != list(range(len(groups))):
        absent = next(k for k in range(len(groups) + 1) if k not in groups)
        raise InputError(f"{name}: the word kicks by group {groups[-1]}, and not by group {absent}")


def rows_of(letters: Sequence[str], weights: Sequence[float], further: Sequence[str]) -> Floats:
    """Rows (7, stages) of a word for compiled loops: those of `Splitting.stages`, those of `Splitting.further_stages`
    with the letters ``further``, and the group of each stage's kick."""
    slots = {KICK: 0, DRIFT: 1}
    stages: list[list[float]] = []
    last, passed, before = len(slots), 0.0, ""  # ``last``: the slot that was filled last
    for letter, weight in zip(letters, weights, strict=True):
        if not weight:
            continue
        slot = slots.get(letter[0], len(slots))
        if letter == before and group_of(letter) is not None:  # the same kick again: one kick for the sum of times
            stages[-1][slot] += weight
        else:
            if slot <= last:
                stages.append([0.0, 0.0, passed, 0.0, 0.0, 0.0, 0.0])
            if letter[0] in slots:
                stages[-1][slot] = weight
            else:
                stages[-1][3:6] = weight, passed, further.index(letter)
            if letter[0] == KICK:
                stages[-1][6] = group_of(letter) or 0
        last, passed, before = slot, passed + weight * (letter in (DRIFT, UNDER_STAR)), letter
    return np.array(stages, dtype=np.float64).T
