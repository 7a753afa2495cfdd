"""Where pairs cease to interact: cutoffs and truncations, of a whole force and of single pairs of species.

This module does not import numba, so reading and checking a system file stays fast.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.text import shown

TRUNCATIONS = ("cut", "shift", "force-shift", "switch", "potential-switch")
SWITCHED = TRUNCATIONS[3:]
WITH_TAIL = ("cut", "potential-switch")
SWITCH_START = 0.8  # default start of the switch, as a part of the cutoff
SHORTEST, LONGEST = 1e-100, 1e100  # limits of a cutoff: its sphere's volume stays within the range of float64


class End(NamedTuple):
    """Where and how a pair ceases to interact."""

    cutoff: float
    truncation: str
    switch_start: float | None  # of a switch alone


def checked_end(name: str, where: str, cutoff: Any, truncation: Any, start: Any) -> End:
    """End with these values, and the default start of a switch. An InputError names the force and ``where``."""
    if truncation not in TRUNCATIONS:
        raise InputError(f"{name}: truncation{where} {shown(truncation)} is not one of {', '.join(TRUNCATIONS)}")
    if not (math.isfinite(number(cutoff)) and cutoff > 0):
        raise InputError(f"{name}: cutoff{where} must be a positive length, got {shown(cutoff)}")
    if not SHORTEST < cutoff < LONGEST:
        raise InputError(
            f"{name}: cutoff{where} must be between {SHORTEST:g} and {LONGEST:g}, so that its powers are numbers, "
            f"got {shown(cutoff)}"
        )
    if truncation not in SWITCHED:
        if start is not None:
            raise InputError(f'{name}: switch_start{where} goes with truncation {either(SWITCHED)}, not "{truncation}"')
        return End(cutoff, truncation, None)
    start = SWITCH_START * cutoff if start is None else start
    if not math.isfinite(number(start)):
        raise InputError(f"{name}: switch_start{where} must be a length, got {shown(start)}")
    if not 0 < start < cutoff:
        raise InputError(f"{name}: switch_start{where} must lie between 0 and the cutoff {cutoff:g}, got {start:g}")
    return End(cutoff, truncation, start)


def either(names: Sequence[str]) -> str:
    """Two names in quotes, with "or" between them."""
    return " or ".join(f'"{name}"' for name in names)


def own_end(name: str, where: str, given: Mapping[str, Any], base: End) -> End:
    """End of a species or a pair: what its table gives, and the rest as in ``base``. A switch of another cutoff starts
    at its default."""
    if not any(key in given for key in End._fields):
        return base
    cutoff, truncation = given.get("cutoff", base.cutoff), given.get("truncation", base.truncation)
    start = given.get("switch_start")
    if start is None and (cutoff, truncation) == base[:2]:
        start = base.switch_start
    return checked_end(name, where, cutoff, truncation, start)


def mixed_end(one: End, other: End) -> End:
    """End of a pair of two species: the mean of their cutoffs and of the starts of their switches. Its truncation is ""
    where theirs differ."""
    if one == other:
        return one
    if one.truncation != other.truncation:
        return End(0.5 * (one.cutoff + other.cutoff), "", None)
    starts = one.switch_start, other.switch_start
    start = None if None in starts else 0.5 * sum(filter(None, starts))
    return End(0.5 * (one.cutoff + other.cutoff), one.truncation, start)
