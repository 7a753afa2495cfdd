"""The registry of integrators. Reading it compiles nothing."""

from __future__ import annotations

import sys
from difflib import get_close_matches
from types import ModuleType

from kickdrift.errors import InputError
from kickdrift.integrators import runge_kutta, splitting
from kickdrift.integrators.runge_kutta import Tableau
from kickdrift.integrators.splitting import Splitting

Method = Splitting | Tableau

INTEGRATORS: dict[str, Method] = {row.name: row for row in (*splitting.ROWS, *runge_kutta.ROWS)}
INTEGRATORS |= {alias: INTEGRATORS[name] for alias, name in splitting.ALIASES.items()}


def integrator(name: str) -> Method:
    """The method of that name; for an unknown one an InputError that offers the nearest names."""
    if name in INTEGRATORS:
        return INTEGRATORS[name]
    near = get_close_matches(name, INTEGRATORS, 3, 0.4) or list(INTEGRATORS)
    raise InputError(f"integrator {name!r} is unknown; did you mean {', '.join(near)}?")


def integrators() -> list[str]:
    """The names of all integrators, aliases included."""
    return list(INTEGRATORS)


class _Callable(ModuleType):
    """``kickdrift.integrators()`` names them all, although importing this module makes that attribute the module."""

    def __call__(self) -> list[str]:
        return integrators()


sys.modules[__name__].__class__ = _Callable
