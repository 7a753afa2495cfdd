"""Steps of ``sei``: its elements, and the forces that kick."""

from __future__ import annotations

from copy import copy
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.forces.bound import BoundForces
from kickdrift.forces.fields import Hill
from kickdrift.integrators.sei_loop import ROOM, Epicycles, fill_elements, sei_loop
from kickdrift.integrators.stepping import FixedStepper
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.integrators.flow import Flow
    from kickdrift.integrators.options import Options

TURN = 2 * Fraction("3.14159265358979323846264338327950288419716939937510582097494")


class SeiStepper(FixedStepper):
    """Integration whose workspace holds the elements of the epicycles, so a checkpoint does too."""

    def __init__(self, flow: Flow, options: Options) -> None:
        system: Any = flow.subject
        (hill,) = (force for force in system.forces if isinstance(force, Hill))
        kicks = copy(flow)
        others = system.under(force for force in system.forces if force is not hill)
        kicks.forces = BoundForces(others, flow.forces.threads, jumps=False)
        assert options.dt is not None
        super().__init__(
            kicks,
            sei_loop,
            _epicycles(hill, options.dt),
            lambda shape: np.zeros((ROOM, *shape[1:])),
            options,
            kept=True,
        )

    def reset(self, y: Floats, time: float, steps: int) -> None:
        """See Stepper."""
        super().reset(y, time, steps)
        fill_elements(self._stages, y, steps, self._work[1:].reshape(-1, y.shape[2]))


def _epicycles(hill: Any, dt: float) -> Epicycles:
    """Rates and phases of a run; half a step adds ``dt`` Omega / 2 to the phase, here exact to far beyond rounding."""
    omega = Fraction(hill.omega)
    vertical = abs(omega) * Fraction(hill.vertical)
    parts = [rate * Fraction(dt) / 2 / TURN % 1 * 2**64 for rate in (omega, vertical)]
    phase, rest = np.array([int(part) for part in parts], np.uint64), np.array([float(part % 1) for part in parts])
    return Epicycles(float(omega), float(vertical), phase, rest)
