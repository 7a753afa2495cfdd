"""Checks of the arguments of a Simulation and of a run."""

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


def check_asked(observe: Any, progress: Any, overwrite: Any, who: str = "run") -> None:
    """Refuse an ``observe`` that is no function, a ``progress`` that is neither function nor bool, and an ``overwrite``
    that is no bool."""
    if not (observe is None or callable(observe)):
        raise InputError(f"{who}: observe must be a function, got {shown(observe)}")
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise InputError(f"{who}: progress must be True, False or a function, got {shown(progress)}")
    if not isinstance(overwrite, bool | np.bool_):
        raise InputError(f"{who}: overwrite must be True or False, got {shown(overwrite)}")
