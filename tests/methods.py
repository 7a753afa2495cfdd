"""Methods of the registry by name, without aliases, and one of each form that is compiled."""

from __future__ import annotations

from typing import Any

from kickdrift.integrators import INTEGRATORS, integrator

METHODS = [name for name, method in INTEGRATORS.items() if method.name == name]


def form_of(name: str) -> tuple[Any, ...]:
    """What tells the compiled loops of methods apart: their class, their choice of steps, and the flows of a word."""
    method = integrator(name)
    return type(method), method.adaptive, getattr(method, "further", ""), bool(getattr(method, "groups", 0))


OF_EACH_FORM = [*{form_of(name): name for name in METHODS[::-1]}.values()]  # the first method of each form
