"""Columns: the values that each look at a run records, kickdrift's own and users'. This module needs no numba.

Compiled code writes each look at particles as a row of numbers (``looking``). A column of kickdrift's own begins at its
``place`` in the row, and is an attribute of the ``Sample`` made from the row.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.text import shown

# Potential energy, virial and pairs are adjacent, since the forces add to all three.
TIME, POTENTIAL, VIRIAL, PAIRS, KINETIC, TOTAL, TEMPERATURE, PRESSURE = range(8)
MOMENTUM, ANGULAR, CENTRE, VELOCITY = 8, 11, 14, 17  # three numbers each
VOLUME = 20  # of a box that a barostat changes, else nan
ENERGY_TAKEN, MOMENTUM_TAKEN, ANGULAR_TAKEN = 21, 22, 25  # taken by events so far; one, three and three numbers
COLUMNS = 28

BODY_MASSES, BODY_RADII = "body_masses", "body_radii"  # columns of runs whose collisions may add bodies
MOST_NUMBERS = 10_000  # in a user's column at one look
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,59}")


@checked_arguments
@dataclass(frozen=True)
class Column:
    """A number, or an array of numbers, that each look at a run records.

    ``sim.run(columns=[kd.Column("radius_of_gyration", "length", (), f)])`` calls ``f(sim)`` at each look. The file, its
    readers, ``info``, figures and tables show the values beside kickdrift's own.

    Parameters
    ----------
    name : letters, digits and underscores; not one of kickdrift's own names
    unit : a dimension ("length", "energy", "velocity", …), which means the system's own unit; a unit's name
        ("angstrom"); or "" for a plain number. The unit is a label: values are never converted
    shape : shape of the function's value: () for a number, (3,) for a vector, (3, 3) for a tensor
    function : called as ``function(sim)`` with the Simulation; returns a number or an array of ``shape``, with nan for
        a value that does not exist. The function may read the state, but not replace it

    Raises
    ------
    InputError
        If one of these makes no sense. At the first look, ``run`` refuses an unknown unit, a function that raises, and
        a function whose value is not numbers of ``shape``.
    """

    name: str
    unit: str
    shape: tuple[int, ...]
    function: Callable[[Any], Any]

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name) or keyword.iskeyword(self.name):
            raise InputError(
                f"column: its name must be a letter and up to 59 letters, digits or underscores, got {shown(self.name)}"
            )
        key = f"column {self.name!r}"
        if self.name in _taken():
            raise InputError(f"{key}: kickdrift uses this name itself; choose another")
        if not isinstance(self.unit, str):
            raise InputError(f"{key}: unit must be text, got {shown(self.unit)}")
        shape = (self.shape,) if isinstance(self.shape, int) and not isinstance(self.shape, bool) else self.shape
        whole = isinstance(shape, tuple | list) and all(isinstance(n, int) and not isinstance(n, bool) for n in shape)
        if not whole or any(n < 1 for n in shape):
            raise InputError(
                f"{key}: shape must be a tuple of whole numbers, one or more each, got {shown(self.shape)}"
            )
        if prod(shape) > MOST_NUMBERS:
            raise InputError(f"{key}: shape {tuple(shape)} has {prod(shape):,} numbers; the limit is {MOST_NUMBERS:,}")
        object.__setattr__(self, "shape", tuple(shape))
        if not callable(self.function):
            raise InputError(f"{key}: function must be a function, got {shown(self.function)}")


@dataclass(frozen=True)
class Own:
    """A column of kickdrift's own. ``value`` takes a Sample and returns the column's value, or None if it has none.

    ``unit`` is a dimension. ``place`` is the index of the first number in a row."""

    name: str
    unit: str
    shape: tuple[int, ...]
    place: int
    value: Callable[[Any], Any]


def _number(name: str) -> Callable[[Any], Any]:
    """Return a function that reads an attribute of a Sample; the function returns None for nan."""

    def value(sample: Any) -> Any:
        found = getattr(sample, name)
        return found if found == found else None

    return value


def _pairs(sample: Any) -> float | None:
    """Return the number of pairs within range; None for a Problem, or if another engine does not report pairs."""
    return None if sample.momentum is None or sample.pairs is None else float(sample.pairs)


OWN = (
    Own("kinetic_energy", "energy", (), KINETIC, lambda sample: sample.energies.kinetic),
    Own("potential_energy", "energy", (), POTENTIAL, lambda sample: sample.energies.potential),
    Own("total_energy", "energy", (), TOTAL, lambda sample: sample.energies.total),
    Own("momentum", "momentum", (3,), MOMENTUM, lambda sample: sample.momentum),
    Own("angular_momentum", "angular momentum", (3,), ANGULAR, lambda sample: sample.angular_momentum),
    Own("centre_of_mass", "length", (3,), CENTRE, lambda sample: sample.centre_of_mass),
    Own("centre_of_mass_velocity", "velocity", (3,), VELOCITY, lambda sample: sample.centre_of_mass_velocity),
    Own("temperature", "temperature", (), TEMPERATURE, _number("temperature")),
    Own("pressure", "pressure", (), PRESSURE, _number("pressure")),
    Own("volume", "volume", (), VOLUME, _number("volume")),
    Own("pairs", "dimensionless", (), PAIRS, _pairs),
)
TAKEN = (  # columns of runs whose events may change conserved quantities
    Own("energy_taken", "energy", (), ENERGY_TAKEN, lambda sample: sample.taken.energy),
    Own("momentum_taken", "momentum", (3,), MOMENTUM_TAKEN, lambda sample: sample.taken.momentum * np.ones(3)),
    Own(
        "angular_momentum_taken",
        "angular momentum",
        (3,),
        ANGULAR_TAKEN,
        lambda sample: sample.taken.angular_momentum * np.ones(3),
    ),
)
NUMBERS = tuple(column for column in OWN if column.shape == () and column.place > TOTAL and column.place != PAIRS)
VECTORS = tuple(column for column in OWN if column.shape == (3,))
KNOWN = {column.name: column for column in OWN + TAKEN}


def parts(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of a column's numbers in a table: ``momentum_x``, ``stress_x_y``, ``share_0``."""
    labels = [""]
    for size in shape:
        labels = [f"{label}_{'xyz'[k] if size == 3 else k}" for label in labels for k in range(size)]
    return [name + label for label in labels]


def _taken() -> set[str]:
    """Return names that a user's column may not have: kickdrift's own, and names that tables and files use."""
    own = {part for column in KNOWN.values() for part in (column.name, *parts(column.name, column.shape))}
    others = "step time value positions velocities forces masses species names frame sample particle axis"
    return own | set(others.split()) | {"sample_step", "sample_time"}
