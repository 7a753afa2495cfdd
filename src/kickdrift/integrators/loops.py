"""The compiled step loops, one a family. Each is compiled once per combination of forces, and cached on disk.

All take (forces, phase, work, stages, dt, start, first, steps, cursor): ``forces`` a tuple of bound forces, ``phase``
(2, 3, n) positions and velocities, ``work`` the method's workspace, ``start`` the time of step 0, ``first`` the steps
done before this call (the clock must not depend on how a run is cut into calls), ``steps`` the number of steps to take.
``cursor`` (int64) says where the loop is, so that it can stop inside a step (a pair list without room) and go on there.
"""

from __future__ import annotations

from kickdrift.forces.compiling import driver, jit
from kickdrift.forces.evaluate import fill_accelerations
from kickdrift.forces.handle import handle
from kickdrift.forces.kernel import OK

STEP, STAGE, FRESH = (
    1,
    2,
    3,
)  # of the cursor, after EVALUATIONS: steps done in this call, stage to do, `work` holds a(x)


@jit
def add_scaled(y, factor, dy):
    """y <- y + factor dy, for (3, n) arrays."""
    for k in range(3):
        row, change = y[k], dy[k]
        for i in range(row.size):
            row[i] += factor * change[i]


@driver
def splitting_loop(forces, phase, work, stages, dt, start, first, steps, cursor):
    bound = handle(forces)
    x, v = phase[0], phase[1]
    kick, drift, passed = stages[0], stages[1], stages[2]
    while cursor[STEP] < steps:
        for stage in range(cursor[STAGE], kick.size):
            if kick[stage] != 0.0:
                if not cursor[FRESH]:
                    t = start + (first + cursor[STEP] + passed[stage]) * dt
                    status = fill_accelerations(bound, t, x, v, work, None, cursor)
                    if status != OK:
                        cursor[STAGE] = stage
                        return status
                    cursor[FRESH] = 1
                add_scaled(v, kick[stage] * dt, work)
            if drift[stage] != 0.0:
                add_scaled(x, drift[stage] * dt, v)
                cursor[FRESH] = 0
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK


@driver
def runge_kutta_loop(forces, phase, work, stages, dt, start, first, steps, cursor):
    bound = handle(forces)
    count = stages.shape[1]
    y, k = work[0], work[1:]
    while cursor[STEP] < steps:
        for stage in range(cursor[STAGE], count + 1):
            c = 0.0
            for half in range(2):
                target = y[half] if stage < count else phase[half]  # the last row is the step itself
                for axis in range(3):
                    for i in range(target.shape[1]):
                        target[axis, i] = phase[half, axis, i]
                for j in range(count):
                    if stages[stage, j] != 0.0:
                        add_scaled(target, stages[stage, j] * dt, k[j, half])
            if stage == count:
                break
            for j in range(count):
                c += stages[stage, j]
            t = start + (first + cursor[STEP] + c) * dt
            status = fill_accelerations(bound, t, y[0], y[1], k[stage, 1], None, cursor)
            if status != OK:
                cursor[STAGE] = stage
                return status
            for axis in range(3):
                for i in range(y.shape[2]):
                    k[stage, 0, axis, i] = y[1, axis, i]
        cursor[STAGE] = 0
        cursor[STEP] += 1
    return OK
