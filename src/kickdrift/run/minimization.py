"""Minimization: the positions of least potential energy near those of a System, from any start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from itertools import chain
from typing import TYPE_CHECKING, Any, Protocol

from kickdrift.display.showing import Lines, Shown
from kickdrift.errors import InputError
from kickdrift.model.checks import positive, whole_number
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.run.descent import METHODS, EnergySurface, untangled
from kickdrift.text import counted, measured, shown, suggestion

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration

Progress = Callable[[int, int], Any]

FORCE, STEPS, METHOD = 1e-6, 10_000, "fire"  # defaults


@dataclass(frozen=True, repr=False)
class Minimum(Shown):
    """Result of a minimization, in the system's units.

    Attributes
    ----------
    method : "fire" or "l-bfgs"
    converged : whether the largest force is at most the tolerance
    energy, energy_at_start : potential energy now and before; the latter is infinite for particles at one place
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
        sign = "at most" if self.converged else "more than"
        largest = measured(f"{self.largest_force:.2g}", self.force_unit)
        steps = f"{counted(self.steps, 'step')}, {counted(self.evaluations, 'force evaluation')}"
        found = f"yes, in {steps}" if self.converged else f"no, after {steps}"
        return [
            ("system", self.system.name),
            ("energy", f"{measured(f'{self.energy:.10g}', self.energy_unit)} (start: {self.energy_at_start:.10g})"),
            ("largest force", f"{largest}, {sign} {self.force:g}"),
            ("method", self.method),
            ("converged", found),
        ]

    def as_json(self) -> dict[str, Any]:
        """The result as one JSON object, without the System."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.name != "system"}


class Moved(Protocol):
    """Attributes of a Simulation that a minimization needs."""

    state: Any
    threads: int
    integration: Integration

    @property
    def system(self) -> Any: ...

    @property
    def running(self) -> bool: ...


def minimize(sim: Moved, *given: Any) -> Minimum:
    """See ``Simulation.minimize``; ``given`` are the arguments of ``minimum`` from ``force`` on."""
    if sim.running:
        raise InputError("minimize: the Simulation is already running")
    if not isinstance(sim.system, System):
        raise InputError("minimize: a Problem has no forces")
    now = sim.state
    found = minimum(sim.system.at(now.phase, now.time, now.steps_done, now.ids), sim.threads, *given)
    phase = found.system.state.phase.copy()
    phase[1] = 0.0
    sim.state = State(phase, now.masses, now.ids, now.box, now.time, now.steps_done)
    return found


def minimum(
    system: System,
    threads: int = 1,
    force: float = FORCE,
    steps: int = STEPS,
    method: str = METHOD,
    max_displacement: float | None = None,
    progress: Progress | None = None,
) -> Minimum:
    """Minimum of the potential energy near the positions of a System; see ``Simulation.minimize``."""
    if not system.forces:
        raise InputError(f"minimize: {system.name!r} has no forces")
    force = positive("minimize: force", force, "positive")
    steps = whole_number("minimize: steps", steps, 0)
    if not isinstance(method, str) or method not in METHODS:
        known = ", ".join(METHODS)
        raise InputError(f"minimize: method: expected one of {known}, got {shown(method)}{suggestion(method, METHODS)}")
    if max_displacement is not None:
        max_displacement = positive("minimize: max_displacement", max_displacement, "positive")
    surface = EnergySurface(system, threads, system.state.time, max_displacement)
    here = surface.near(system.state.phase[0].copy())
    first, done = here.energy, 0
    if here.largest > force:
        for here in untangled(surface, here, steps):
            done += 1
            if progress:
                progress(done, steps)
        for here in METHODS[method](surface, here, steps - done, force):
            done += 1
            if progress:
                progress(done, steps)
    if progress:
        progress(steps, steps)
    phase = system.state.phase.copy()
    phase[0] = here.x
    units = system.units
    return Minimum(
        method=method,
        converged=here.largest <= force,
        energy=here.energy,
        energy_at_start=first,
        largest_force=here.largest,
        force=force,
        max_displacement=surface.cap,
        steps=done,
        evaluations=surface.evaluations,
        energy_unit=units.symbol("energy"),
        force_unit=units.symbol("force"),
        system=system.remade(positions=here.x.T).at(phase, 0.0),
    )
