"""What a distant observer measures: radial velocities, and positions on the sky.

The observer is in a ``direction`` from the system, by default along +z, at rest relative to the barycentre and far
away. So the sky is the x-y plane (Winn 2010, arXiv:1001.2010, section 2.1). Positions and velocities are relative to
the barycentre. Light can take its time (``light_time``); no other effect of relativity is included.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from kickdrift.analysis.orbits.orbits import paths
from kickdrift.errors import InputError
from kickdrift.integrators.asked import Integrator
from kickdrift.looks.columns import Column
from kickdrift.model.state import Floats
from kickdrift.model.subject import index_of
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity, time_in
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.run.at_times import begun_from, states_at
from kickdrift.run.simulation import Simulation
from kickdrift.text import shown
from kickdrift.trajectory.read import reader

Seen = System | Simulation | reader.Run | str | os.PathLike[str]
PASSES = 8  # most runs to find the times at which light left
SETTLED = 1e-13  # of all the time: a change of these times at which they are found
ARCSECONDS = 3600.0 * 180.0 / np.pi


def radial_velocities(
    given: Seen,
    times: Iterable[float | str] | None = None,
    body: str | int | None = None,
    *,
    direction: Sequence[float] = (0.0, 0.0, 1.0),
    light_time: bool = False,
    integrator: str | Integrator | None = None,
    dt: float | str | None = None,
    **options: Any,
) -> Floats:
    """Radial velocities (k,) of a body at given times: positive where it moves away from the observer.

    A planet of mass m with the elements of a system file gives its star v_r = K [cos(omega + f) + e cos(omega)], with
    K = (m / (M + m)) n a sin(inc) / sqrt(1 - e^2) (Winn 2010, arXiv:1001.2010, eq. 49 to 51), since the observer is
    along +z and the orbit's ``inc`` is measured from the sky.

    Parameters
    ----------
    given : a System or a Simulation, which runs from its present state to the times; or a run's file, whose frames are
        the times
    times : (k,) numbers or texts such as "10 yr", in any order; those before the present need a method that runs back
    body : name or number; default the most massive body
    direction : from the system towards the observer; default z
    light_time : whether the times are those at which light from the body arrives, on a clock that agrees with the
        system's for light from the barycentre. By default light takes no time
    integrator, dt, options : method; default that of the Simulation or of the system file

    Returns
    -------
    (k,) in m/s, or in the system's unit of velocity for reduced units

    Raises
    ------
    InputError
        For arguments that make no sense, and for ``light_time`` in units without a speed of light.
    RunError
        If the run blows up.
    """
    sight = unit_vector("direction", direction)
    units, _, v = _seen(given, times, View(body, None, sight, light_time), integrator, {"dt": dt, **options})
    return -(v @ sight) * metres_a_second(units)


def sky_offsets(
    given: Seen,
    times: Iterable[float | str] | None = None,
    body: str | int | None = None,
    *,
    about: str | int | None = None,
    direction: Sequence[float] = (0.0, 0.0, 1.0),
    north: Sequence[float] = (1.0, 0.0, 0.0),
    distance: float | str | None = None,
    light_time: bool = False,
    integrator: str | Integrator | None = None,
    dt: float | str | None = None,
    **options: Any,
) -> Floats:
    """Offsets (k, 2) of a body on the sky at given times, to the north and to the east.

    ``north`` is a direction, of which the part in the plane of the sky counts; default x, so that y is east for an
    observer along +z. The offset is from the body ``about``, by default from the barycentre. With a ``distance`` from
    the observer to the system, a number or a text such as "10 pc", the offsets are in arcseconds, else in the system's
    unit of length. Light takes the way from ``body``; the body ``about`` is seen at the same time of departure. The
    other parameters and the errors are those of ``radial_velocities``.
    """
    sight = unit_vector("direction", direction)
    axes = _north_and_east(sight, north)
    units, x, _ = _seen(given, times, View(body, about, sight, light_time), integrator, {"dt": dt, **options})
    offsets = x @ axes.T
    if distance is None:
        return offsets
    far = quantity(distance, "length", units, "distance")
    if not (np.isfinite(far) and far > 0.0):
        raise InputError(f"distance: expected a positive length, got {shown(distance)}")
    return offsets / far * ARCSECONDS


def radial_velocity(body: str | int, direction: Sequence[float] = (0.0, 0.0, 1.0)) -> Column:
    """Column with the radial velocity of a body at each look of a run, as in ``radial_velocities``.

    ``sim.run(columns=[kd.analysis.radial_velocity("star")])`` writes ``radial_velocity_star`` beside the energies, in
    m/s. Reduced units are refused at the first look.
    """
    sight = unit_vector("direction", direction)

    def measured(sim: Simulation) -> float:
        units = sim.integration.system.units  # type: ignore[union-attr]
        if units.reduced:
            raise InputError(f"radial_velocity: units {units.name!r} have no metre; use radial_velocities")
        return float(-(sight @ _from_barycentre(sim, body, "radial_velocity: body")[1]) * metres_a_second(units))

    return Column(f"radial_velocity_{_plain(body)}"[:60], "m/s", (), measured)


def sky_offset(
    body: str | int,
    direction: Sequence[float] = (0.0, 0.0, 1.0),
    north: Sequence[float] = (1.0, 0.0, 0.0),
) -> Column:
    """Column (2,) with the offset of a body from the barycentre on the sky at each look of a run, to the north and to
    the east, in the system's unit of length, as in ``sky_offsets``. ``sim.run(columns=[...])`` writes
    ``sky_offset_star``."""
    axes = _north_and_east(unit_vector("direction", direction), north)

    def measured(sim: Simulation) -> Floats:
        return np.asarray(axes @ _from_barycentre(sim, body, "sky_offset: body")[0])

    return Column(f"sky_offset_{_plain(body)}"[:60], "length", (2,), measured)


def _from_barycentre(sim: Simulation, body: str | int, key: str) -> Floats:
    """Position and velocity (2, 3) of a body in a run, relative to the barycentre."""
    state, system = sim.state, sim.integration.system
    assert isinstance(system, System)
    return np.asarray(state.phase[:, :, index_of(system, body, key)] - state.phase @ state.masses / state.masses.sum())


def _plain(body: str | int) -> str:
    """A body's name as a part of a column's name."""
    return "".join(each if each.isalnum() and each.isascii() else "_" for each in str(body))


def _north_and_east(sight: Floats, north: Any) -> Floats:
    """Axes (2, 3) of the sky. Raises an InputError for a ``north`` along the line of sight."""
    up = unit_vector("north", north)
    up = up - (up @ sight) * sight
    if np.linalg.norm(up) < 1e-9:
        raise InputError("north: points at the observer; expected another direction than direction")
    up = up / np.linalg.norm(up)
    return np.array([up, np.cross(sight, up)])


def unit_vector(key: str, direction: Any) -> Floats:
    """A direction as a vector of length 1. Raises an InputError that begins with the key."""
    try:
        sight = np.asarray(direction, dtype=float)
    except (TypeError, ValueError):
        sight = np.zeros(0)
    if sight.shape != (3,) or not np.isfinite(sight).all() or not sight.any():
        raise InputError(f"{key}: expected a vector (x, y, z) with a length, got {direction!r}")
    sight = sight / np.abs(sight).max()
    return np.asarray(sight / np.linalg.norm(sight))


def speed_of_light(units: UnitSystem, light_time: bool) -> float:
    """Speed of light in these units; endless if light takes no time. Raises an InputError for units without one."""
    if light_time and units.light is None:
        raise InputError(f"light_time: units {units.name!r} have no speed of light")
    return units.light if light_time and units.light else np.inf


@cache
def metres_a_second(units: UnitSystem) -> float:
    """Unit of velocity in m/s; 1 for reduced units, which have none."""
    return 1.0 if units.reduced else 1.0 / quantity("1 m/s", "velocity", units)


class View(NamedTuple):
    """What is seen, and how; see ``sky_offsets``."""

    body: str | int | None
    about: str | int | None
    sight: Floats
    light_time: bool


def _seen(
    given: Any, times: Any, view: View, method: Any, options: dict[str, Any]
) -> tuple[UnitSystem, Floats, Floats]:
    """The units, and positions and velocities (k, 3) of the body when its light leaves."""
    if isinstance(given, System | Simulation):
        return _in_run(given, times, view, method, options)
    if times is not None or view.light_time:
        key = "times" if times is not None else "light_time"
        raise InputError(f"{key}: a run's file has its own times; give a System or a Simulation")
    if not isinstance(given, reader.Run):
        with reader.open(given) as opened:
            return _seen(opened, None, view, method, options)
    found = paths(given)
    one, other = _rows(given[0].system, view)
    x, v = found.positions[:, one], found.velocities[:, one]
    return given.units, x if other is None else x - found.positions[:, other], v


def _rows(system: System, view: View) -> tuple[int, int | None]:
    """Rows of the body, by default the most massive one, and of the body that it is seen from."""
    one = int(np.argmax(system.state.masses)) if view.body is None else index_of(system, view.body, "body")
    return one, None if view.about is None else index_of(system, view.about, "about")


def _in_run(
    given: System | Simulation, times: Any, view: View, method: Any, options: dict[str, Any]
) -> tuple[UnitSystem, Floats, Floats]:
    system, method, asked_options = begun_from(given, method, options)
    if system.box.periodic:
        raise InputError("a periodic box has no outside from which to observe it")
    units, (one, other) = system.units, _rows(system, view)
    if times is None or isinstance(times, str) or not isinstance(times, Iterable):
        raise InputError(f"times: expected a row of times, such as [0.5, 1.0], got {shown(times)}")
    asked = np.array([time_in(each, units, f"times[{k}]") for k, each in enumerate(times)], dtype=float)
    m, left, light = system.state.masses, asked, speed_of_light(units, view.light_time)
    for _ in range(PASSES):
        y = states_at(system, left, method, asked_options)  # (k, 2, 3, n)
        x, v = (y[:, j, :, one] - y[:, j] @ m / m.sum() for j in (0, 1))
        late = (left - (x @ view.sight) / light - asked) / (1.0 - (v @ view.sight) / light)
        if not view.light_time or np.abs(late).max(initial=0.0) <= SETTLED * np.abs(asked).max(initial=1.0):
            break
        left = left - late
    if other is not None:
        x = y[:, 0, :, one] - y[:, 0, :, other]
    return units, x, v
