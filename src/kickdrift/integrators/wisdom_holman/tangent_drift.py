"""Kepler drift on duals.

The drift is differentiated through its equation (Mikkola & Innanen 1999, doi:10.1023/A:1008312912468): the root X of
F(X, p) = 0 has the slope dX/dp = -(dF/dp) / (dF/dX). One step of Newton's method on duals gives this slope, and a
second step, on duals of duals, gives the second derivative. The rest of the drift is a formula. To first order a body's
drift has seven slopes, which serve all columns.
"""

from kickdrift.integrators.wisdom_holman.kepler import kepler_increments, one_g, one_solution, solution
from kickdrift.jit.compile import jit, never_inline
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import DUAL, Dual, as_dual, dual
from kickdrift.jit.duals.operators import put_vector, vector_at
from kickdrift.jit.inner import by_type, overload
from kickdrift.jit.lanes.functions import lane_numbers, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import store
from kickdrift.jit.lanes.vector3 import vector3
from kickdrift.jit.lanes.vectors import WIDTH


@jit
def unit_slope(k):
    """Return lanes with a one in lane k."""
    return select(lane_numbers() == float(k), splat(1.0), 0.0)


@jit
def unit_slopes(k):
    """Return the slopes of a vector whose components are the numbers k to k + 2 to differentiate by."""
    return vector3(unit_slope(k), unit_slope(k + 1), unit_slope(k + 2))


@by_type
def fill_kepler(x, v, masses, dt, changes, slopes):
    """changes (n, 6) <- the changes of position and velocity by each body's Kepler drift; slopes <- their derivatives
    by position, velocity and GM, eight numbers for each change. Nothing for second derivatives, which do not share
    them."""

    def fill(x, v, masses, dt, changes, slopes):
        for i in range(1, x.shape[1]):
            place = dual(vector_at(x, i).value, unit_slopes(0))
            speed = dual(vector_at(v, i).value, unit_slopes(3))
            gm = dual(masses[1, i].value, unit_slope(6))
            found = kepler_increments(gm, dt, place, speed)
            for half in range(2):
                for k in range(3):
                    changes[i, 3 * half + k] = found[half][k].value
                    store(slopes, (6 * i + 3 * half + k) * WIDTH, found[half][k].slope)

    return fill if x.dtype == DUAL else lambda x, v, masses, dt, changes, slopes: None


@jit
def drift_duals(x, v, masses, dt, changes, slopes):
    """Move the bodies along their Kepler orbits, and the centre of mass along a line."""
    put_vector(x, 0, vector_at(x, 0) + dt * vector_at(v, 0))
    for i in range(1, x.shape[1]):
        drift_dual(x, v, masses, dt, changes, slopes, i)


@by_type(forceinline=True)
def drift_dual(x, v, masses, dt, changes, slopes, i):
    """Move body i along its Kepler orbit."""

    def once(x, v, masses, dt, changes, slopes, i):
        dx, dv, gm = vector_at(x, i).slope, vector_at(v, i).slope, masses[1, i].slope
        for row in range(6):
            at = (6 * i + row) * WIDTH
            change = slopes[at] * dx.x + slopes[at + 1] * dx.y + slopes[at + 2] * dx.z
            change = change + (slopes[at + 3] * dv.x + slopes[at + 4] * dv.y + slopes[at + 5] * dv.z)
            change = dual(changes[i, row], change + slopes[at + 6] * gm)
            if row < 3:
                x[row, i] += change
            else:
                v[row - 3, i] += change

    def twice(x, v, masses, dt, changes, slopes, i):
        never_inline()
        place, speed = vector_at(x, i), vector_at(v, i)
        moved, kicked = kepler_increments(masses[1, i], dt, place, speed)
        put_vector(x, i, place + moved)
        put_vector(v, i, speed + kicked)

    return once if x.dtype == DUAL else twice


@overload(solution)
def _solution(gm, beta, r0, eta, zeta, dt):
    def of_duals(gm, beta, r0, eta, zeta, dt):
        return one_g(beta, kepler_root(gm, beta, r0, eta, zeta, dt))

    return of_duals if isinstance(gm, Dual) else None


@by_type
def kepler_root(gm, beta, r0, eta, zeta, ahead):
    """Root X of the equation in `kepler`, of numbers or of duals."""

    def of_numbers(gm, beta, r0, eta, zeta, ahead):
        found = one_solution(gm, beta, r0, eta, zeta, ahead)
        return (ahead - eta * found.g2 - zeta * found.g3) / r0

    def of_duals(gm, beta, r0, eta, zeta, ahead):
        root = kepler_root(gm.value, beta.value, r0.value, eta.value, zeta.value, ahead.value)
        g = one_g(beta, as_dual(root))
        excess = r0 * root + eta * g.g2 + zeta * g.g3 - ahead
        return root - excess / (r0.value + eta.value * g.g1.value + zeta.value * g.g2.value)

    return of_duals if isinstance(gm, Dual) else of_numbers
