"""Compiled loop around a user's own step."""

from __future__ import annotations

from typing import Any

from kickdrift.forces.bound.table import fill_accelerations
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import STAGE, STEP
from kickdrift.jit.compile import driver, jit
from kickdrift.jit.handle import handle
from kickdrift.jit.inner import by_type, overload

STATUS = STAGE  # slot of the cursor: error status inside the step


def accelerations(forces: Any, t: float, x: Any, v: Any, a: Any) -> None:
    """a <- the accelerations at positions x and velocities v, all (rows, n). For steps compiled by
    ``register_step``."""
    raise NotImplementedError("for compiled code: a step registered with kd.register_step")


@overload(accelerations)
def _accelerations(forces, t, x, v, a):
    def fill(forces, t, x, v, a):
        bound, cursor = forces
        if cursor[STATUS] == OK:
            cursor[STATUS] = fill_accelerations(bound, t, x, v, a, None, cursor)

    return fill


@by_type
def take_step(kind, forces, t, x, v, a, dt):
    """Call the user's function behind the class of ``kind``."""
    function = jit(kind.instance_class.kernel_sources[0])

    if "options" not in kind.fields:

        def step(kind, forces, t, x, v, a, dt):
            function(forces, t, x, v, a, dt)

        return step

    def step_with_options(kind, forces, t, x, v, a, dt):
        function(forces, t, x, v, a, dt, *kind.options)

    return step_with_options


@driver
def custom_loop(forces, y, carry, work, kind, dt, start, first, steps, cursor):
    bound = handle(forces)
    a, before = work[0], work[1:]
    while cursor[STEP] < steps:
        before[:] = y
        t = start + (first + cursor[STEP]) * dt
        take_step(kind, (bound, cursor), t, y[0], y[1], a, dt)
        status = cursor[STATUS]
        if status != OK:  # a step is done as a whole or not at all
            y[:] = before
            cursor[STATUS] = OK
            return status
        cursor[STEP] += 1
    return OK
