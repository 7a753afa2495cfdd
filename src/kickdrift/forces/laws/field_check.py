"""Trials of a user's law at states near the System's own: its values, its force against the slope of its energy, and
whether it depends on velocity or time without saying so. Every error is one line that names the law.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.check import raised_at
from kickdrift.model.checks.values import is_number
from kickdrift.model.state import Floats
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

MOST = 6  # particles that are tried
STEPS = tuple(10.0**-k for k in range(1, 8))  # of the system's extent, for the differences
SLOPE_TOLERANCE = 1e-4
TIMES = (0.1234, 1.732, 29.7)  # after the system's own
At = Callable[[Floats, Floats, float], tuple[Any, Floats]]  # energy and force at a place, velocity and time


def try_field(force: Any, values: dict[str, Any], system: Subject) -> None:
    """Refuse a field law that does not return what it should at the states of this system's particles, or near them."""
    state, extent = system.state, extent_of(system)
    wrong = []
    for i in sorted({round(k) for k in np.linspace(0, len(system) - 1, MOST)}):
        at = _law(force, values, system, i)
        x, v, t = state.positions[i].copy(), state.velocities[i].copy(), float(state.time)
        faster = v + np.array([0.7, -1.3, 0.4]) * (float(np.abs(v).max()) or 1.0)
        check_declared(force, "force depends", partial(_force, at, x), v, faster, t)
        if system.dimensions == 2 and at(x, v, t)[1][2] != 0:
            raise InputError(f"{force.name}: the law pushes particle {i} out of the plane of two dimensions")
        rng = np.random.Generator(np.random.PCG64(i))
        shaken = x + 0.1 * extent * rng.standard_normal(3) * (np.arange(3) < system.dimensions)
        for place in (x, shaken):
            found = wrong_slope(partial(_at_rest, at, t), place, extent, system.dimensions)
            if found and not _moves_energy(at, place, v, t):
                wrong.append((i, place, *found))
    if len(wrong) > 1:  # a law may jump, or have a kink, at one place
        i, place, pushed, slope = wrong[-1]
        raise InputError(
            f"{force.name}: law must return energy and force, minus the energy's slope; for particle {i} at "
            f"{_text(place)} it returns {_text(pushed)}, and its energy's slope gives {_text(slope)}"
        )


def _force(at: At, x: Floats, v: Floats, t: float) -> Floats:
    return at(x, v, t)[1]


def _at_rest(at: At, t: float, x: Floats) -> tuple[Any, Floats]:
    return at(x, 0.0 * x, t)


def extent_of(system: Subject) -> float:
    """A length of this system: how far its particles are spread, else how far they are from the origin, else 1."""
    x = system.state.positions
    return float(np.ptp(x, axis=0).max()) or float(np.abs(x).max()) or 1.0


def wrong_slope(at: Callable[[Floats], tuple[Any, Floats]], x: Floats, extent: float, dimensions: int) -> Any:
    """Return the force and minus the slope of the energy at x, if the two differ; else None.

    The slope comes from central differences of order 4 over ever shorter steps. Two steps in turn must agree, so a
    law with a fine structure is not refused for steps that are too long."""
    before: Floats | None = None
    try:
        with np.errstate(all="ignore"):
            energy, force = at(x)
            if energy is None:
                return None
            for h in (step * extent for step in STEPS):
                slope = np.array([_slope(at, x, axis, h) if axis < dimensions else 0.0 for axis in range(3)])
                size = float(max(np.abs(force).max(), np.abs(slope).max(), 1e-8 * abs(energy) / h))
                if not np.isfinite([*slope, *force, size]).all():
                    continue
                if np.abs(force + slope).max() <= SLOPE_TOLERANCE * size:
                    return None
                if before is not None and np.abs(before - slope).max() <= 0.1 * SLOPE_TOLERANCE * size:
                    return force, -slope
                before = slope
    except Exception:  # a law need not hold near the particles; their own states are checked
        return None
    return None


def _slope(at: Callable[[Floats], tuple[Any, Floats]], x: Floats, axis: int, h: float) -> float:
    way = np.zeros(3)
    way[axis] = h
    near, far = ([float(at(x + sign * k * way)[0]) for sign in (-1, 1)] for k in (1, 2))
    return (8 * (near[1] - near[0]) - (far[1] - far[0])) / (12 * h)


def _law(force: Any, values: dict[str, Any], system: Subject, i: int) -> At:
    """The law of particle i in plain Python, with its values checked."""
    p = force.Parameters(**{key: _one(value, i) for key, value in values.items()})
    mass, place = float(system.coherent_masses[i]), f"law(p, x, v, m, t) for particle {i}"

    def at(x: Floats, v: Floats, t: float) -> tuple[Any, Floats]:
        try:
            with np.errstate(all="ignore"):
                found = p.law(x.copy(), v.copy(), mass, p.clock(t) if hasattr(p, "clock") else t)
        except Exception as error:  # whatever a user's function raises
            text = " ".join(f"{type(error).__name__}: {error}".split())
            raise InputError(f"{force.name}: {place} raised {text}{raised_at(error.__traceback__)}") from None
        energy, push = _values(force, found, place)
        if (energy is not None and not np.isfinite(energy)) or not np.isfinite(push).all():
            raise InputError(f"{force.name}: {place} must return finite numbers; it returned {shown(found)}")
        return energy, push

    return at


def _one(value: Any, i: int) -> Any:
    if isinstance(value, np.ndarray):
        return value[i].copy() if value.ndim > 1 else float(value[i])
    return np.array(value) if isinstance(value, tuple) else float(value)


def _values(force: Any, found: Any, place: str) -> tuple[Any, Floats]:
    wanted = f"{force.name}: {place} must return two values, energy and force"
    if not isinstance(found, tuple | list) or len(found) != 2:
        raise InputError(f"{wanted}; it returned {shown(found)}")
    energy, push = found
    if energy is None and not force.works:
        raise InputError(f"{wanted}; a law without an energy says works = True in its class")
    if energy is not None and not is_number(energy):
        raise InputError(f"{wanted}; the energy it returned is {shown(energy)}")
    numbers = list(push) if isinstance(push, tuple | list | np.ndarray) else []
    if len(numbers) != 3 or not all(map(is_number, numbers)):
        raise InputError(f"{wanted} of three components; the force it returned is {shown(push)}")
    return energy if energy is None else float(energy), np.array(numbers, dtype=float)


def check_declared(
    force: Any, what: str, push: Callable[[Floats, float], Floats], v: Floats, faster: Floats, t: float
) -> None:
    """Refuse a law whose ``push(v, t)`` depends on velocity or time, and which does not say so."""
    before = push(v, t)
    states = [("velocity", "velocity_dependent", faster, t)]
    states += [("time", "time_dependent", v, t + later) for later in TIMES]
    for name, trait, other_v, other_t in states:
        if getattr(force, trait):
            continue
        try:
            after = push(other_v, other_t)
        except InputError:
            continue
        if not np.array_equal(after, before):
            raise InputError(
                f"{force.name}: the law's {what} on {name}; say {trait} = True in its class, so that methods that need "
                "another kind of force refuse it"
            )


def _moves_energy(at: At, x: Floats, v: Floats, t: float) -> bool:
    """Tell whether the energy depends on velocity; its slope along x alone is then not the force."""
    faster = v + 1.0
    try:
        return bool(at(x, faster, t)[0] != at(x, 0.0 * v, t)[0])
    except InputError:
        return False


def _text(values: Floats) -> str:
    return f"({', '.join(f'{value:.6g}' for value in values)})"
