"""Checks of the arguments of a Simulation and of a run."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.text import shown


def kind_of(value: Any, simulation: type) -> str:
    """Describe a value given in place of a System, and what to give instead."""
    if isinstance(value, simulation):
        return "a Simulation: give its ``system``, or continue with the Simulation itself"
    if isinstance(value, str | os.PathLike):
        return f"{shown(value)}: give kd.load({shown(str(value))}), or for a run's file kd.resume"
    if isinstance(value, type):
        return f"the class {value.__name__}"
    return type(value).__name__


def check_asked(observe: Any, progress: Any, overwrite: Any) -> None:
    """Refuse an ``observe`` or ``progress`` that is not a function, and an ``overwrite`` that is not a bool."""
    for key, function in (("observe", observe), ("progress", progress)):
        if not (function is None or callable(function)):
            raise InputError(f"run: {key} must be a function, got {shown(function)}")
    if not isinstance(overwrite, bool | np.bool_):
        raise InputError(f"run: overwrite must be True or False, got {shown(overwrite)}")
