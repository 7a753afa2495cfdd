"""Kernels of the Wisdom-Holman map: what a step does between its half drifts.

The standard kernel is a kick by the accelerations B(x) of the interaction. A corrector leaves an error dt^2
[B, [A, B]], quadratic in the planets' masses. This commutator depends on positions alone, so it can join the kick: the
modified kick is by B(x) + dt^2 / 12 B'(x) B(x). The lazy implementer's kernel kicks by B(x + dt^2 / 12 B(x)), which
differs from the modified kick by terms of order dt^4. The third way is a composition of kicks and drifts, which needs
no further code.

Sources: Wisdom, Holman & Touma 1996, Fields Inst. Commun. 10, 217; Rein, Tamayo & Brown 2019,
doi:10.1093/mnras/stz2503.
"""

from typing import NamedTuple

from numba import types

from kickdrift.forces.bound.table import EVALUATIONS
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.options import LAZY, MODIFIED_KICK
from kickdrift.integrators.stepping.subflow_code import call_subflow
from kickdrift.integrators.wisdom_holman import bodies as rows
from kickdrift.integrators.wisdom_holman import flows
from kickdrift.integrators.wisdom_holman.bodies import (
    Bodies,
    add_centre,
    add_vectors,
)
from kickdrift.jit.compile import inlined, jit, never_inline
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_numbers, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import aligned, load
from kickdrift.jit.lanes.vector3 import dot, lane_sums, load3, numbers3, select3, store3, thrice
from kickdrift.jit.lanes.vectors import WIDTH

KICKS = LAZY, MODIFIED_KICK  # kernels that change the kick; a composition is a word of drifts and kicks
CORRECTION = 1.0 / 12.0  # weight of dt^2 B'(x) B(x)


class Kernel(NamedTuple):
    """Bodies whose positions are places where the interaction is evaluated, and whose velocities are results."""

    aside: Bodies  # the velocities are accelerations
    slope: Bodies | None  # positions are accelerations, and velocities their slope along themselves; None if lazy


def kernel_of(name: str, bodies: Bodies) -> Kernel:
    """Return the parts of the kernel with this name."""

    def beside() -> Bodies:
        return bodies._replace(
            orbit=aligned(bodies.orbit.shape), carry=aligned((6, 0)), centre=aligned(bodies.centre.shape),
            work=aligned(bodies.work.shape), kernel=None,
        )  # fmt: skip

    return Kernel(beside(), None if name == LAZY else beside())


@by_type(forceinline=True)
def kick(kernel, others, bodies, stages, stage, dt, t, cursor):
    """Let the interaction and the other forces act for a time dt. Return a status."""
    if isinstance(kernel, types.NoneType):

        def plain(kernel, others, bodies, stages, stage, dt, t, cursor):
            with_jump, others_act = not bodies.jacobi, others.table.shape[0] > 0
            if others_act:
                advance_beside(bodies.beside, bodies, t, 0.5 * dt)
                status = flows.fill_others(others, bodies, t, cursor)
                if status != OK:
                    return status
            if with_jump:
                flows.heliocentric_kick(bodies, dt, t)
            else:
                flows.jacobi_kick(bodies, dt, t)
            if others_act:
                flows.add_accelerations(bodies, dt)
            advance_beside(bodies.beside, bodies, t, 0.5 * dt)
            if with_jump:
                flows.jump(bodies, 0.5 * dt if others_act else dt)
            cursor[EVALUATIONS] += 1
            return OK

        return plain

    def corrected(kernel, others, bodies, stages, stage, dt, t, cursor):
        aside = kernel.aside
        n, weight = bodies.orbit.shape[1], stages[3, stage] * dt * dt
        status = look_aside(aside, others, bodies, 0.0, t, cursor)
        if status == OK and weight != 0.0:
            status = correct(kernel.slope, aside, others, bodies, weight, t, cursor)
        if status == OK:
            for b in range(0, n, WIDTH):
                add_vectors(bodies, 3, b, splat(dt) * load3(aside.orbit, 3 * n + b, n))
            if others.table.shape[0] > 0:
                add_centre(bodies.centre, 1, dt * load(aside.centre[1], 0))
        return status

    return corrected


@by_type
def advance_beside(beside, bodies, t, span):
    """Advance unknowns beside the bodies, if there are any, while the bodies rest."""
    if isinstance(beside, types.NoneType):
        return lambda beside, bodies, t, span: None

    def advance(beside, bodies, t, span):
        flows.fill_positions(bodies)
        call_subflow(beside[0], beside[1], t, span, 0, 0, bodies.x[0], bodies.x[1])

    return advance


@jit
def look_aside(aside, others, bodies, weight, t, cursor):
    """Velocities of ``aside`` <- the accelerations at the positions of ``bodies`` plus ``weight`` times the velocities
    of ``aside``. Return a status."""
    never_inline()
    orbit, own, others_act = aside.orbit, bodies.orbit, others.table.shape[0] > 0
    n = orbit.shape[1]
    for b in range(0, n, WIDTH):
        x = load3(own, b, n)
        if weight != 0.0:
            x = x + splat(weight) * load3(orbit, 3 * n + b, n)
        store3(orbit, b, n, x)
        store3(orbit, 3 * n + b, n, thrice(splat(0.0)))
    if others_act:
        for k in range(3):
            aside.centre[0, k] = bodies.centre[0, k]
            if weight != 0.0:
                aside.centre[0, k] += weight * aside.centre[1, k]
            aside.centre[1, k] = aside.centre[3, k] = 0.0
        status = flows.fill_others(others, aside, t, cursor)
        if status != OK:
            return status
    flows.jacobi_kick(aside, 1.0, t)
    if others_act:
        flows.add_accelerations(aside, 1.0)
    cursor[EVALUATIONS] += 1
    return OK


@inlined
def correct(slope, aside, others, bodies, weight, t, cursor):
    """Add to the accelerations of ``aside`` their change along themselves, times ``weight``. Return a status."""
    if slope is None:
        return look_aside(aside, others, bodies, weight, t, cursor)
    fill_slope(slope, aside)
    n = aside.orbit.shape[1]
    for b in range(3 * n, 4 * n, WIDTH):
        store3(aside.orbit, b, n, load3(aside.orbit, b, n) + splat(weight) * load3(slope.orbit, b, n))
    return OK


@inlined
def tidal(d, u):
    """Change of d / |d|^3 when d moves along u."""
    inverse = inverse_sqrt(dot(d, d))
    inverse2 = inverse * inverse
    return inverse * inverse2 * (u - 3.0 * inverse2 * dot(d, u) * d)


@jit
def fill_slope(slope, aside):
    """Velocities of ``slope`` <- the change of the accelerations of ``aside`` when bodies move along them.

    The change of all accelerations from the centre of mass is transformed to Jacobi's coordinates; that of the Kepler
    motion is taken off.
    """
    never_inline()
    orbit, table, place, moved, order = aside.orbit, aside.table, aside.work, slope.work, aside.order
    source, a, n, massive = table[rows.SOURCE], slope.a, orbit.shape[1], aside.massive
    for b in range(0, n, WIDTH):
        store3(slope.orbit, b, n, load3(orbit, 3 * n + b, n))
        store3(slope.orbit, 3 * n + b, n, thrice(splat(0.0)))
    flows.places(slope)
    central = thrice(0.0)
    for b in range(0, n, WIDTH):
        x, u = load3(place, rows.PLACE * n + b, n), load3(moved, rows.PLACE * n + b, n)
        own = tidal(x, u)
        if b < massive:
            central = central + lane_sums(load(source, b) * own)
        change = splat(-aside.gm) * own
        for j in range(massive):
            itself = lane_numbers() == float(j - b)
            d, w = numbers3(place, rows.PLACE * n + j, n) - x, numbers3(moved, rows.PLACE * n + j, n) - u
            d = select3(itself, thrice(splat(1.0)), d)
            change = change + select(itself, splat(0.0), splat(source[j])) * tidal(d, w)
        store3(moved, rows.STAR * n + b, n, change)
    for k in range(3):
        a[k, aside.central] = (central.x, central.y, central.z)[k]
        for i in range(n):
            if order[i] >= 0:
                a[k, order[i]] = moved[rows.STAR + k, i]
    flows.add_accelerations(slope, 1.0)
    for b in range(0, n, WIDTH):
        kepler = load(table[rows.GM], b) * tidal(load3(orbit, b, n), load3(slope.orbit, b, n))
        live = load(table[rows.LIVE], b) > 0.0
        found = load3(slope.orbit, 3 * n + b, n) + kepler
        store3(slope.orbit, 3 * n + b, n, select3(live, found, thrice(splat(0.0))))
