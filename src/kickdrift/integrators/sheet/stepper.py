"""Steps of ``sei``: its elements, and the forces that kick."""

from __future__ import annotations

from copy import copy
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.fields.shipped import Hill
from kickdrift.forces.slopes.variations import unvaried
from kickdrift.integrators.sheet.loop import ROOM, Epicycles, fill_elements, sei_loop
from kickdrift.integrators.stepping.stepping import FixedStepper
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.integrators.options.options import Options

BITS = 256
TURN = 2 * Fraction("3.14159265358979323846264338327950288419716939937510582097494")


class SeiStepper(FixedStepper):
    """Integration whose workspace holds the elements of the epicycles, so a checkpoint does too."""

    def __init__(self, flow: Flow, options: Options) -> None:
        system: Any = flow.subject
        (hill,) = (force for force in system.forces if isinstance(unvaried(force), Hill))
        kicks = copy(flow)
        others = system.under(force for force in system.forces if force is not hill)
        kicks.forces = BoundForces(others, flow.forces.threads, jumps=False)
        self._hill = unvaried(hill)
        assert options.dt is not None
        super().__init__(
            kicks,
            sei_loop,
            _epicycles(self._hill, options.dt),
            lambda shape: np.zeros((ROOM, *shape[1:])),
            options,
            kept=True,
        )

    def retimed(self, dt: float) -> Self:
        """This stepper with steps of another length. Call ``reset`` before the next step."""
        self.dt, self._stages = dt, _epicycles(self._hill, dt)
        return self

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """See Stepper."""
        super().reset(y, time, steps)
        fill_elements(self._stages, y, steps, self._work[1:].reshape(-1, y.shape[2]))


def _epicycles(hill: Any, dt: float) -> Epicycles:
    """Rates and phases of a run; half a step adds ``dt`` Omega / 2 to the phase, here exact to far beyond rounding."""
    omega, vertical = float(hill.omega), Fraction(abs(hill.omega)) * Fraction(hill.vertical)
    above, below = dt.as_integer_ratio()
    units = [_units(Fraction(rate)) * above // below for rate in (omega, vertical)]  # 2^-BITS turns
    phase = np.array([each >> (BITS - 64) & (2**64 - 1) for each in units], np.uint64)
    rest = np.array([(each & (2 ** (BITS - 64) - 1)) / 2 ** (BITS - 64) for each in units])
    return Epicycles(omega, float(vertical), phase, rest)


@lru_cache
def _units(rate: Fraction) -> int:
    """Turns in half a unit of time at a rate, in 2^-BITS turns."""
    return int(rate / 2 / TURN * 2**BITS)
