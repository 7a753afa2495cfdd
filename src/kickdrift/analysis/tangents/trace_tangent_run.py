"""A run of a System by the hybrid map `trace`, with derivatives of its end by the map's tangent map."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.analysis.tangents.columns import Columns
from kickdrift.analysis.tangents.map_pushes import bound_others
from kickdrift.analysis.tangents.map_run import MapRun
from kickdrift.analysis.tangents.varied_run import DEFAULT
from kickdrift.errors import InputError, RunError
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.slopes.pushes import parameter_of
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.model.state import Floats
from kickdrift.model.system import System

if TYPE_CHECKING:
    from kickdrift.integrators.wisdom_holman.tangent_columns import Derived

POINTS = 2**16  # rows of the path: points of all bodies that meet inside one step


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
            from kickdrift.integrators.trace.tangent_others import NO_SLOPES

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
