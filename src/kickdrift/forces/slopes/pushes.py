"""The push on a deviation by a number that the forces contain: the slope of a force by a parameter or by a mass.

The variational equation of such a number p is d' = (dF/dy) d + dF/dp. A `Push` adds the last term, by central
differences of order 4 between copies of the force with other numbers.
"""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.group import ListedForce
from kickdrift.model.checks.values import is_number
from kickdrift.model.state import State
from kickdrift.text import choices

if TYPE_CHECKING:
    from kickdrift.model.system import System

STEP = 2.0**-10  # of the number's size; the error of order 4 and rounding are then alike
PLACES = (1, -1, 2, -2)  # steps from the number


class Push:
    """Slope of a force by a number, added to the accelerations of one column of deviations.

    ``copies`` are the force and its System with the number moved by 1, -1, 2 and -2 steps. ``size`` is the number's
    change that the column stands for, over the step.
    """

    may_overlap: ClassVar[bool] = True
    differs: ClassVar[bool] = False

    def __init__(self, force: Any, copies: list[tuple[Any, System]], column: int, size: float) -> None:
        self.name = force.name
        self._copies, self._column, self._size = copies, column, size
        for trait in ("external", "works", "velocity_dependent"):
            setattr(self, trait, getattr(force, trait, False))

    def check(self, system: System) -> None:
        """Accept every System, since it has already been checked."""

    def bind(self, system: System, threads: int = 1) -> Any:
        """Return the parts: a NamedTuple with a compiled body."""
        from kickdrift.forces.slopes.variations_kernel import bind

        bound = [force.bind(moved, threads) for force, moved in self._copies]
        return bind(bound, len(self._copies[0][1]), self._column, self._size)


class PairPush(ListedForce):
    """Slope of a pair law by its parameter ``key``, added to the accelerations of one column of deviations. ``size`` is
    the change of the parameter that the column stands for."""

    may_overlap: ClassVar[bool] = True
    differs: ClassVar[bool] = False

    def __init__(self, force: PairForce, key: str, system: System, column: int, size: float) -> None:
        known = ", ".join(force.Parameters._fields if force.law_keys == force.Parameters._fields else ())
        if key not in known.split(", "):
            if not known:
                raise InputError(f"parameters: {force.name}.{key}: a table has no parameters to differentiate by")
            raise InputError(f"parameters: {force.name}.{key}: has no derivative; expected {known}")
        self.name, self._given = force.name, (force, key, system)  # type: ignore[misc]
        self._column, self._size = column, size

    def check(self, system: System) -> None:
        """Accept every System, since it has already been checked."""

    def bind(self, system: System, threads: int = 1, mixed: bool = False) -> Any:
        """Return the bound force, a `pairs.pushes.PairPushKernel`."""
        from kickdrift.forces.pairs.pushes import bind

        return bind(*self._given, threads, self._column, self._size)


def parameter_of(system: System, text: str) -> tuple[int, str, float]:
    """Number of the force, key and value of a parameter such as "j2.radius"."""
    name, _, key = text.partition(".") if isinstance(text, str) else ("", "", "")
    found = [k for k, force in enumerate(system.forces) if force.name == name]
    if len(found) != 1 or not key:
        known = choices(force.name for force in system.forces)
        raise InputError(f"parameters: expected FORCE.KEY with a force of {known}, got {text!r}")
    force = system.forces[found[0]]
    value: Any = getattr(force, key, None)
    if isinstance(force, Gravity) and key == "G":
        value = gravitational_constant(force.name, force.G, system)
    if not is_number(value):
        raise InputError(f"parameters: {text}: expected a parameter that is one number")
    return found[0], key, float(value)


def push_of_parameter(system: System, text: str, column: int, unit: float) -> Push | PairPush:
    """The push of a parameter; the column stands for a change by ``unit``."""
    number, key, value = parameter_of(system, text)
    if isinstance(system.forces[number], PairForce):
        return PairPush(system.forces[number], key, system, column, unit)
    if isinstance(system.forces[number], ListedForce):
        raise InputError(f"parameters: {text}: many-body forces have no derivatives by parameters")
    force, step = system.forces[number], STEP * (abs(value) or 1.0)
    copies = [(replace(force, **{key: value + k * step}), system) for k in PLACES]
    return Push(force, copies, column, unit / step)


def pushes_of_mass(system: System, body: int, column: int, unit: float) -> list[Push]:
    """The pushes of a body's mass in all forces but gravity and forces on a list, which have it by themselves."""
    masses = system.state.masses
    step = STEP * float(masses[body] or masses.max())

    def moved(k: int) -> System:
        other, old = copy(system), system.state
        changed = masses + k * step * (np.arange(len(masses)) == body)
        object.__setattr__(other, "state", State(old.phase.copy(), changed, old.ids, old.box, old.time))
        return other

    systems = [moved(k) for k in PLACES]
    others = [force for force in system.forces if not isinstance(force, Gravity | ListedForce)]
    return [Push(force, [(force, each) for each in systems], column, unit / step) for force in others]
