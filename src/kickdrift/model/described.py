"""Lines that describe a System or a Problem to people."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kickdrift.display.showing import Lines, Shown, above
from kickdrift.text import choices, counted, measured

FEW = 6  # different charges that are listed


class ShownSystem(Shown):
    """A System that prints what it holds."""

    def __repr__(self: Any) -> str:
        return f"<System {self.name}: {counted(len(self), 'particle')} at time {self.state.time:g}>"

    def view(self, *, colour: str | None = None, size: float = 1.0, height: int | None = None) -> Any:
        """Show the particles in a picture that turns: a widget in a notebook, else an object with ``save(path)``.

        ``height`` is in pixels; ``colour`` and ``size`` are those of `kickdrift view`. See docs/live.md."""
        return above("view")(self, colour=colour, size=size, height=height)

    def _lines(self: Any) -> Lines:
        units = self.units
        lines = [
            ("system", self.name),
            ("particles", f"{len(self):,} ({_counts(self)})"),
            ("box", self.box.described(units.symbol("length"))),
            *([("dimensions", "2")] if self.dimensions == 2 else []),
            ("time", measured(f"{self.state.time:g}", units.symbol("time"))),
            ("units", f"{units.name}: {units.described(('length', 'time', 'mass', 'energy'))}"),
            *([("net charge", _net_charge(self))] if self.charges is not None else []),
            *([("topology", str(self.topology))] if self.topology is not None else []),
            *([("constraints", str(self.constraints))] if self.constraints is not None else []),
            *([("virtual sites", str(self.virtual_sites))] if self.virtual_sites is not None else []),
            *(("force", _force(force)) for force in self.forces),
            *_run_line(self),
        ]
        if self.equilibration:
            wanted = self.equilibration.said().items()
            lines.append(("equilibrate", ", ".join(f"{key} = {value}" for key, value in wanted)))
        if self.stages:
            lines.append(("stages", ", ".join(each.name for each in self.stages)))
        return lines


def _counts(system: Any) -> str:
    """The species, each with its number of particles if there are several."""
    if len(system.species) == 1:
        return choices(system.species)
    return choices(map("{} {:,}".format, system.species, np.bincount(system.species_index).tolist()))


def _net_charge(system: Any) -> str:
    values, counts = np.unique(system.charges, return_counts=True)
    unit = system.units.symbol("charge")
    found = measured(f"{math.fsum(system.charges):.6g}", unit)
    if len(values) > FEW:
        return f"{found}, of {len(values)} different charges"
    each = (f"{n:,} of {measured(format(q, '+g'), unit)}" for q, n in zip(values, counts, strict=True))
    return f"{found}: {', '.join(each)}"


def _force(force: Any) -> str:
    group = getattr(force, "group", 0)
    return f"{force}, group {group}" if group else str(force)


class ShownProblem(Shown):
    """A Problem that prints what it holds."""

    def __repr__(self: Any) -> str:
        return f"<Problem {self.name}: {counted(len(self), 'unknown')}>"

    def plot(self, *integrators: Any, time: float | None = None, **options: Any) -> Any:
        """Run the Problem with each method, and draw the runs side by side; a matplotlib Figure.

        Parameters
        ----------
        integrators : names or values of ``kickdrift.integrator``; none means the Problem's own
        time : length of the runs; default the Problem's own
        options : dt and others; each method takes those that it has

        Raises
        ------
        InputError
            For arguments that make no sense. A run that blows up is drawn as far as it came.
        """
        return above("methods figure")(self, integrators, time=time, options=options)

    def _lines(self: Any) -> Lines:
        about = [key for key in ("jacobian", "energy", "exact") if getattr(self, key)]
        return [
            ("system", self.name),
            ("problem", f"{counted(len(self), 'unknown')}, separable: {'yes' if self.separable else 'no'}"),
            ("y0", f"{', '.join(f'{value:.10g}' for value in self.y0)} at t = {self.t0:g}"),
            ("known", ", ".join(about) or "only f"),
            *_run_line(self),
        ]


def _run_line(subject: Any) -> Lines:
    """The defaults of a run, if there are any."""
    given = subject.run.said()
    if times := given.get("times"):
        given["times"] = f"{times[0]:g} to {times[-1]:g} ({len(times):,})"
    said = ", ".join(f"{key} = {value}" for key, value in given.items())
    return [("run", said)] if said else []
