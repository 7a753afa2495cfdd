"""Poincaré sections: the states at which a run crosses a surface."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from kickdrift.display.showing import Lines, Shown, above
from kickdrift.errors import InputError
from kickdrift.integrators.asked import Integrator
from kickdrift.model.checks.limits import MOST_STEPS
from kickdrift.model.events.events import Crossing
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.quantities import time_in
from kickdrift.run.at_times import begun_from
from kickdrift.run.simulation import Simulation
from kickdrift.text import shown


@dataclass(frozen=True, repr=False)
class Section(Shown):
    """Crossings of a surface.

    Attributes
    ----------
    times : (k,)
    positions, velocities : (k, n, 3)
    values : (k, m), the coordinates asked for, named by ``names``
    """

    times: Floats
    positions: Floats
    velocities: Floats
    values: Floats
    names: tuple[str, ...]

    def _lines(self) -> Lines:
        first, last = self.times[0], self.times[-1]
        crossings = f"{len(self.times):,}, from t = {first:.6g} to {last:.6g}"
        return [("crossings", crossings), ("coordinates", ", ".join(self.names))]

    def plot(self) -> Any:
        """Draw the second value over the first, a point for each crossing; a matplotlib Figure."""
        return above("section figure")(self)


def poincare_section(
    given: System | Simulation,
    surface: Callable[..., float],
    coordinates: Callable[..., Sequence[float]],
    *,
    until: float | str,
    direction: int = 1,
    names: Sequence[str] = (),
    integrator: str | Integrator | None = None,
    dt: float | str | None = None,
    **options: Any,
) -> Section:
    """Poincaré section: the times and states at which a function of the state passes through zero.

    The crossings are those of a `Crossing` event. A state inside a step is the interpolant of an adaptive method, or
    the end of a shortened copy of a fixed step.

    Parameters
    ----------
    given : a System, or a Simulation, which starts from its present state
    surface : g(t, x, v) with x and v (n, 3); its zeros are the section
    coordinates : f(t, x, v) -> numbers to keep at each crossing
    until : last time
    direction : 1: g rises through zero; -1: it falls; 0: both
    names : of the coordinates, for the figure
    integrator, dt, options : method; default that of the Simulation or of the system file

    Returns
    -------
    Section

    Raises
    ------
    InputError
        For arguments that make no sense, and if nothing crosses.
    RunError
        If the run blows up.
    """
    system, method, asked = begun_from(given, integrator, {"dt": dt, **options})
    end = time_in(until, system.units, "until")
    if not callable(coordinates):
        raise InputError(f"coordinates: expected a function f(t, x, v), got {shown(coordinates)}")
    kept: dict[float, tuple[Floats, Floats]] = {}

    def keep(t: float, x: Floats, v: Floats) -> None:
        kept[t] = x, v

    sim = Simulation(system.watched((Crossing(surface, "section", direction, seen=keep),)), method, **asked)
    sim.run(until=end, every=MOST_STEPS)
    times = np.array([each["time"] for each in sim.report().events if each["kind"] == "section"])
    if not times.size:
        raise InputError(
            f"poincare_section: no crossing until t = {end:.10g}; another surface or a longer run may have"
        )
    x, v = (np.array([kept[time][k] for time in times.tolist()]) for k in (0, 1))
    values = np.array([np.atleast_1d(coordinates(t, *each)) for t, *each in zip(times, x, v, strict=True)], dtype=float)
    named = tuple(names) or tuple(f"value {k}" for k in range(values.shape[1]))
    if len(named) != values.shape[1]:
        raise InputError(f"names: expected {values.shape[1]}, one for each coordinate, got {len(named)}")
    return Section(times, x, v, values, named)
