"""Compiled loop of the Wisdom-Holman map: Kepler drifts and interaction kicks.

``y' = A + B``, with A the Kepler motion of every body and B the rest of the Hamiltonian. The rows of drift and kick
weights are as in any splitting.
"""

from __future__ import annotations

from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.loops import FRESH, STAGE, STEP
from kickdrift.integrators.wisdom_holman.drift import drift
from kickdrift.integrators.wisdom_holman.eight import steps_of_eight, takes
from kickdrift.integrators.wisdom_holman.kernels import kick
from kickdrift.integrators.wisdom_holman.kicks import jump
from kickdrift.jit.compile import driver
from kickdrift.jit.handle import handle, unowned


@driver
def wisdom_holman_loop(forces, bodies, stages, dt, start, first, steps, cursor):
    """Apply the row of drifts (``stages[0]``), each followed by its kick (``stages[1]``), ``steps`` times.
    ``stages[2]`` is the fraction of dt at the kick, and ``stages[3]`` the weight of the kernel's correction.
    ``forces`` are the forces other than gravity; the rest is as in
    ``loops``."""
    bound, others = handle(bodies), handle(forces)
    stages, cursor = unowned(stages), unowned(cursor)
    drifts, kicks, passed = stages[0], stages[1], stages[2]
    with_jump, others_act = not bodies.jacobi, others.table.shape[0] > 0
    in_registers = takes(bound.kernel, bound, others)
    while cursor[STEP] < steps:
        if in_registers and not cursor[FRESH]:
            steps_of_eight(bound, stages, dt, steps, cursor)
            if cursor[STEP] == steps:
                break
        for stage in range(cursor[STAGE], kicks.size):
            t = start + (first + cursor[STEP] + passed[stage]) * dt
            h = kicks[stage] * dt
            if not cursor[FRESH]:
                if drifts[stage] != 0.0:
                    status = drift(bound, drifts[stage] * dt, t)
                    if status != OK:
                        cursor[STAGE] = stage
                        return status
                if with_jump and h != 0.0 and others_act:
                    jump(bound, 0.5 * h)
                cursor[FRESH] = 1
            if h != 0.0:
                status = kick(bound.kernel, others, bound, stages, stage, h, t, cursor)
                if status != OK:
                    cursor[STAGE] = stage
                    return status
            cursor[FRESH] = 0
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK
