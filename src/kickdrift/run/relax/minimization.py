"""Minimization: the positions of least potential energy near those of a System, from any start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from kickdrift.display.showing import Lines, Shown
from kickdrift.errors import InputError
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.checks.values import positive, unwarned, whole_number
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.run.relax.descent import METHODS, EnergySurface, untangled
from kickdrift.run.stepping import purpose_of
from kickdrift.text import counted, measured, shown, suggestion

if TYPE_CHECKING:
    pass

Progress = Callable[[int, int], Any]

FORCE, STEPS, METHOD = 1e-6, 10_000, "fire"  # defaults
RISE = 1e-9  # relative rise of the energy that may be rounding


@dataclass(frozen=True, repr=False)
class Minimum(Shown):
    """Result of a minimization, in the system's units.

    Attributes
    ----------
    method : "fire" or "l-bfgs"
    converged : whether the largest force is at most the tolerance, and the energy no higher than at the start
    energy, energy_at_start : potential energy now and before
    largest_force, force : largest force on a particle, and its tolerance
    max_displacement : longest step of a particle; infinite without a cap
    steps, evaluations : number of steps, and of evaluations of the forces
    energy_unit, force_unit : symbols of the units, "" for plain numbers
    system : the System at the minimum, at time 0. Its velocities are those from before the minimization, so that
        ``kd.Simulation(found.system)`` can equilibrate and run.
    """

    method: str
    converged: bool
    energy: float
    energy_at_start: float
    largest_force: float
    force: float
    max_displacement: float
    steps: int
    evaluations: int
    energy_unit: str
    force_unit: str
    system: System = field(repr=False)

    def __repr__(self) -> str:
        return str(self)

    def _lines(self) -> Lines:
        sign = "at most" if self.largest_force <= self.force else "more than"
        largest = measured(f"{self.largest_force:.2g}", self.force_unit)
        steps = f"{counted(self.steps, 'step')}, {counted(self.evaluations, 'force evaluation')}"
        found = f"yes, in {steps}" if self.converged else f"no, {self.trouble}, after {steps}"
        return [
            ("system", self.system.name),
            ("energy", f"{measured(f'{self.energy:.10g}', self.energy_unit)} (start: {self.energy_at_start:.10g})"),
            ("largest force", f"{largest}, {sign} {self.force:g}"),
            ("method", self.method),
            ("converged", found),
        ]

    @property
    def trouble(self) -> str:
        """Reason why the minimization did not converge, as text; "" if it did."""
        if self.converged:
            return ""
        if self.largest_force > self.force:
            return f"the largest force is more than {self.force:g}"
        return "the energy rose, so the particles flew apart"

    def as_json(self) -> dict[str, Any]:
        """The result as one JSON object, without the System."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name != "system"}


def minimize(sim: Any, *given: Any) -> Minimum:
    """See ``Simulation.minimize``. ``given`` are the arguments of ``minimum`` from ``force`` on."""
    if sim.running:
        raise InputError("minimize: the Simulation is already running")
    if not isinstance(sim.system, System):
        raise InputError("minimize: a Problem has no forces")
    now = sim.state
    found = minimum(sim.system.at(now.phase, now.time, now.steps_done, now.ids, now.box), sim.threads, *given)
    phase = found.system.state.phase.copy()
    phase[1] = 0.0
    sim.state = State(phase, now.masses, now.ids, now.box, now.time, now.steps_done)
    return found


@unwarned
def minimum(
    system: System,
    threads: int = 1,
    force: float | str = FORCE,
    steps: int = STEPS,
    method: str = METHOD,
    max_displacement: float | str | None = None,
    progress: Progress | None = None,
) -> Minimum:
    """Minimum of the potential energy near the positions of a System; see ``Simulation.minimize``."""
    if not system.forces:
        raise InputError(f"minimize: {system.name!r} has no forces")
    least = _amount("force", force, system)
    steps = whole_number("minimize: steps", steps, 0)
    if not isinstance(method, str) or method not in METHODS:
        known = ", ".join(METHODS)
        raise InputError(f"minimize: method: expected one of {known}, got {shown(method)}{suggestion(method, METHODS)}")
    cap = None if max_displacement is None else _amount("length", max_displacement, system, "max_displacement")
    with compiling_for(purpose_of(method, system)):
        surface = EnergySurface(system, threads, cap)
        here = surface.near(system.state.phase[0].copy())
    first, done = here, 0
    for walk in (untangled, METHODS[method]):
        if here.largest <= least:
            break
        for point in walk(surface, here, steps - done, least):
            here, done = point, done + 1
            if progress:
                progress(done, steps)
    if progress:
        progress(steps, steps)
    phase = system.state.phase.copy()
    phase[0] = here.x
    units = system.units
    return Minimum(
        method=method,
        converged=here.largest <= least and not here.energy > first.energy + RISE * abs(first.energy),
        energy=here.energy,
        energy_at_start=first.energy,
        largest_force=here.largest,
        force=least,
        max_displacement=surface.cap,
        steps=done,
        evaluations=surface.evaluations,
        energy_unit=units.symbol("energy"),
        force_unit=units.symbol("force"),
        system=system.remade(positions=here.x.T).at(phase, 0.0),
    )


def _amount(dimension: str, value: float | str, system: System, key: str = "") -> float:
    """A positive number in the system's units, from a number or a text with a unit."""
    key = f"minimize: {key or dimension}"
    found = quantity(value, dimension, system.units, key) if isinstance(value, str) else value
    return positive(key, found, "positive")
