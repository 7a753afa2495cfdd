"""Runs of a System with derivatives of its end by a tangent map: Wisdom-Holman methods and the hybrid map `trace`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.analysis.tangents.columns import Columns
from kickdrift.analysis.tangents.map_run import MapRun, bound_others
from kickdrift.analysis.tangents.varied_run import DEFAULT
from kickdrift.errors import InputError, RunError
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.slopes.pushes import parameter_of
from kickdrift.integrators.options import JACOBI, KERNEL, LAZY, MODIFIED_KICK, STANDARD, Options
from kickdrift.integrators.trace.method import Trace
from kickdrift.integrators.wisdom_holman.method import WisdomHolman
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.state import Floats
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.wisdom_holman.tangent_columns import Derived


KNOWN = ("coordinates", "corrector", "kernel", "compensated", "order")  # options that the map follows, or that round
POINTS = 2**16  # rows of the path: points of all bodies that meet inside one step


class TangentRun(MapRun):
    """A System with derivatives under a Wisdom-Holman method.

    The run waits before the last drift of a step, which is joined to the next step's first drift.
    """

    def _slopes_of_masses(self, system: System, columns: Columns, name: str) -> Floats | None:
        for text in columns.parameters:
            if isinstance(system.forces[parameter_of(system, text)[0]], Gravity):
                raise InputError(f"parameters: the tangent map of {name} takes none of gravity; {DEFAULT} takes {text}")
        return columns.of_masses(len(system))

    def start(self, slopes: Floats, of_masses: Floats | None = None, second: Floats | None = None) -> None:
        from kickdrift.integrators.wisdom_holman.tangent import tangents

        self._correct, self._begin, self._step, self._end = _rows(self.sim.method, self.sim.options)
        self._modified = self.sim.options.get(KERNEL.name) == MODIFIED_KICK
        system, masses = self.system, self.system.state.masses
        n, central = len(system), int(np.argmax(masses))
        self._order = np.concatenate([[central], np.delete(np.arange(n), central)])
        with compiling_for(self.sim.integration.purpose):
            made = tangents(*self._given(slopes, of_masses, second))
            self._bound = bound_others(self._others, self._pushes, system, self.sim.threads)
        self._rows, self._columns = made.rows, made.columns
        self.steps = 0

    def _take(self, rows: Floats, row: Floats, steps: int) -> None:
        from kickdrift.integrators.wisdom_holman.tangent import tangent_steps

        if not (row.size and steps):
            return
        further = self._bound.forces, self._bound.table, self._order
        given = self.dt, self.system.state.time, self.steps, steps, *further
        if tangent_steps(rows, len(self.system), row, self._modified, *given):
            raise self._without_slopes()

    def advance(self, steps: int) -> None:
        with compiling_for(self.sim.integration.purpose):
            if steps and not self.steps:
                self._take(self._rows, self._correct, 1)
                self._take(self._rows, self._begin, 1)
                self.steps, steps = 1, steps - 1
            self._take(self._rows, self._step, steps)
        self.steps += steps

    def _leave(self, found: Derived) -> None:
        from kickdrift.integrators.wisdom_holman.tangent import leave

        rows, n = self._rows.copy(), len(self.system)
        if self.steps:
            self._take(rows, self._end, 1)
            self._take(rows, _undone(self._correct), 1)
        leave(rows, self._columns, n, found)


def _rows(method: Any, options: Options) -> tuple[Floats, Floats, Floats, Floats]:
    """Stages of the corrector, of the first step, of a later step, and of the drift at the end: rows of drifts, kicks,
    fractions of dt at the kicks, and weights of the kernel's correction."""
    assert isinstance(method, WisdomHolman)
    if options.coordinates != JACOBI:
        raise InputError(
            f"coordinates: the tangent map of {method.name} takes {JACOBI} alone, got {options.coordinates}"
        )
    for option in method.declared:
        if option.name not in KNOWN and options.get(option.name) not in (None, False, option.default):
            raise InputError(f"{option.name}: the tangent map of {method.name} takes {option.default!r} alone")
    table, kernel = method.table(options), options.get(KERNEL.name) or STANDARD
    drift, kick = np.array(table.drift), np.array([*table.kick, 0.0])
    weight = 1.0 / 12.0 if kernel in (LAZY, MODIFIED_KICK) else 0.0
    begin = np.array([drift, kick, np.cumsum(drift), np.full(len(kick), weight)])
    step = begin[:, :-1].copy()
    step[0, 0] += drift[-1]
    return _corrector(options.get("corrector"), kernel != STANDARD), begin[:, :-1].copy(), step, begin[:, -1:].copy()


def _corrector(order: Any, mirrored: bool) -> Floats:
    from kickdrift.integrators.wisdom_holman.corrector import corrector

    return _staged(corrector(order, mirrored)) if order else np.zeros((4, 0))


def _undone(stages: Floats) -> Floats:
    from kickdrift.integrators.wisdom_holman.corrector import undone

    return _staged(undone(stages[:2])) if stages.size else stages


def _staged(row: Floats) -> Floats:
    """Drifts and kicks at no time and without correction, as stages."""
    return np.concatenate([row, np.zeros_like(row)])


class TraceTangentRun(MapRun):
    """A System with derivatives under `trace`. The bodies move as in a run without derivatives, to the last bit."""

    def _slopes_of_masses(self, system: System, columns: Columns, name: str) -> Floats:
        """See MapRun. A change of G acts as one of all masses."""
        masses, found = system.state.masses, columns.of_masses(len(system))
        made = np.zeros((len(system), columns.total)) if found is None else found
        for body in np.flatnonzero(made.any(axis=1) & (masses == 0.0)):
            raise InputError(
                f"masses: {system.body(int(body))} has no mass, and the tangent map of {name} has no slope by it; "
                f"{DEFAULT} does"
            )
        for column, text in enumerate(columns.parameters, sum(columns.widths[:2])):
            number, key, value = parameter_of(system, text)
            if isinstance(system.forces[number], Gravity):
                if key != "G":
                    raise InputError(f"parameters: the tangent map of {name} takes no {text}; {DEFAULT} does")
                made[:, column] = masses / value
        return made

    def start(self, slopes: Floats, of_masses: Floats | None = None, second: Floats | None = None) -> None:
        from kickdrift.integrators.trace.tangent import trace_tangents

        system = self.system
        with compiling_for(self.sim.integration.purpose):
            flow: Any = self.sim.integration.flow
            stepper: Any = self.sim.method.stepper(flow, self.sim.options)
            stepper.reset(system.state.phase, system.state.time, 0)
            slot, slots, self._order = stepper.noting(POINTS)
            self._bound = bound_others(self._others, self._pushes, system, self.sim.threads)
            self._made = trace_tangents(
                *self._given(slopes, of_masses, second), self._order, slot, slots,
                self._bound.forces, self._bound.table, flow.not_separable is not None,
            )  # fmt: skip
        self._stepper = stepper
        self._rows = self._made.rows
        self.steps = 0

    def advance(self, steps: int) -> None:
        with compiling_for(self.sim.integration.purpose):
            status = self._stepper.advance_with(self._made, steps)
        self.steps = self._stepper.steps_done
        if status:
            from kickdrift.integrators.trace.tangent import CROWDED
            from kickdrift.integrators.wisdom_holman.tangent_columns import NO_SLOPES

            which = f"{self.sim.integrator}, dt = {self.dt:g}"
            if status == NO_SLOPES:
                raise self._without_slopes()
            if status == CROWDED:
                raise RunError(f"{which}: step {self.steps + 1} has more than {POINTS} points of bodies that meet")
            raise RunError(f"{which}: blew up before step {self.steps + 1}")

    def _deviations(self) -> list[Floats]:
        from kickdrift.integrators.trace.tangent_state import LOST_X
        from kickdrift.integrators.wisdom_holman.tangent import slopes_in

        return [*super()._deviations(), slopes_in(self._rows, LOST_X)]  # what rounding took is as large as they are

    def _leave(self, found: Derived) -> None:
        from kickdrift.integrators.trace.tangent import leave_democratic

        leave_democratic(self._rows, self._made.columns, len(self.system), found)
        found.values[:] = self._stepper.y[:, :, self._order].ravel()  # as without derivatives, to the last bit


def has_map(method: Any) -> bool:
    """Whether derivatives move by this method's tangent map."""
    return isinstance(method, WisdomHolman | Trace)


def serves(method: Any, system: System, columns: Columns, given: dict[str, Any]) -> bool:
    """Whether the tangent map of a system file's own method gives these columns."""
    alone = all(isinstance(force, Gravity) for force in system.forces)
    has_step = given.get("dt") is not None or system.run.dt is not None
    if isinstance(method, Trace):
        of_masses = columns.of_masses(len(system))
        light = of_masses is not None and of_masses[system.state.masses == 0.0].any()
        alone = alone and not light
    return alone and has_step


def map_run(
    system: System,
    columns: Columns | None,
    method: Any,
    threads: int,
    options: dict[str, Any],
    twice: bool = False,
) -> MapRun:
    """A System with derivatives under a method that has a tangent map, with second ones if ``twice``. Without columns
    the caller gives the deviations to ``start``."""
    kind = TraceTangentRun if isinstance(method, Trace) else TangentRun
    return kind(system, columns, method.name, threads, options, twice)
