"""Trials of a user's body law in plain Python, at the System's own state and near it. Every error is one line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.check import raised_at
from kickdrift.forces.laws.field_check import check_declared, extent_of, wrong_slope
from kickdrift.model.checks.values import is_number
from kickdrift.model.state import Floats
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

MOST_TRIED, MOST_SLOPES = 100, 24  # bodies of a system whose law, or its slope, is tried: plain Python is slow
MOST_MOVED = 3  # bodies that are moved to and fro
PLACE = "law(p, x, v, m, t, a)"


def try_bodies(force: Any, p: Any, system: Subject) -> None:
    """Refuse a body law that does not return what it should at this system's state, or near it."""
    n = len(system)
    if n > MOST_TRIED:
        return
    phase, t = system.state.phase, float(system.state.time)
    x, v, masses = phase[0], phase[1], system.coherent_masses
    energy, a = _called(force, p, x, v, masses, t)
    if system.dimensions == 2 and a[2].any():
        raise InputError(f"{force.name}: the law pushes particle {_first(a[2])} out of the plane of two dimensions")
    rng = np.random.Generator(np.random.PCG64(1))
    faster = v + rng.standard_normal(v.shape) * (float(np.abs(v).max()) or 1.0)
    check_declared(force, "accelerations depend", lambda v, t: _called(force, p, x, v, masses, t)[1], v, faster, t)
    if n > MOST_SLOPES or energy is None or (force.velocity_dependent and _moves_energy(force, p, x, v, masses, t)):
        return
    _check_slope(force, p, system, t)


def _check_slope(force: Any, p: Any, system: Subject, t: float) -> None:
    x, masses = system.state.phase[0], system.coherent_masses
    still, extent, wrong = np.zeros_like(x), extent_of(system), []
    heavy = np.flatnonzero(masses > 0)
    for i in heavy[np.unique(np.linspace(0, len(heavy) - 1, MOST_MOVED).round().astype(int))] if len(heavy) else ():

        def at(y: Floats, i: int = int(i)) -> tuple[Any, Floats]:
            moved = x.copy()
            moved[:, i] = y
            energy, a = _called(force, p, moved, still, masses, t)
            return energy, masses[i] * a[:, i]

        found = wrong_slope(at, x[:, i].copy(), extent, system.dimensions)
        if found:
            wrong.append((int(i), *found))
    if wrong:
        i, push, slope = wrong[-1]
        text = [f"({', '.join(f'{value:.6g}' for value in each)})" for each in (push, slope)]
        raise InputError(
            f"{force.name}: mass times the law's acceleration must be minus the slope of its energy; for particle {i} "
            f"it is {text[0]}, and the energy's slope gives {text[1]}"
        )


def _called(force: Any, p: Any, x: Floats, v: Floats, masses: Floats, t: float) -> tuple[Any, Floats]:
    """Energy and accelerations (3, n) of the law in plain Python."""
    a = np.zeros_like(x)
    try:
        with np.errstate(all="ignore"):
            found = force.Parameters.law(p, x.copy(), v.copy(), masses.copy(), t, a)
    except Exception as error:  # whatever a user's function raises
        text = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{force.name}: {PLACE} raised {text}{raised_at(error.__traceback__)}") from None
    values = list(found) if isinstance(found, tuple) else [found]
    if found is None:
        if not force.works:
            raise InputError(
                f"{force.name}: {PLACE} must return the energy; a law without an energy says works = True in its class"
            )
        values = []
    elif len(values) > 3 or not values or not all(map(is_number, values)):
        raise InputError(
            f"{force.name}: {PLACE} must return the energy, or energy and virial, or energy, virial and pairs; "
            f"it returned {shown(found)}"
        )
    if not np.isfinite(a).all():
        raise InputError(f"{force.name}: {PLACE} gives particle {_first(~np.isfinite(a).all(axis=0))} no finite force")
    if not all(map(np.isfinite, values)):
        raise InputError(f"{force.name}: {PLACE} must return finite numbers; it returned {shown(found)}")
    return (float(values[0]) if values else None), a


def _first(wrong: Any) -> int:
    return int(np.flatnonzero(wrong)[0])


def _moves_energy(force: Any, p: Any, x: Floats, v: Floats, masses: Floats, t: float) -> bool:
    """Tell whether the energy depends on velocity; its slope along x alone is then not the force."""
    found = [_called(force, p, x, velocities, masses, t)[0] for velocities in (v + 1.0, np.zeros_like(v))]
    return bool(found[0] != found[1])
