"""Other forces of the hybrid map: inside encounters and passages for bodies that move together, else as kicks.

The map's velocities are from the centre of mass. So a body feels its own acceleration less the mean of all bodies. A
force with a pair list acts as kicks alone, since lists are made for whole steps.

A kick by forces that depend on velocity is an implicit midpoint step, v' = v + h a(x, (v + v') / 2). So the kick is its
own inverse with the time turned round, as all parts of the map are.
"""

from kickdrift.forces.bound.table import EVALUATIONS, accelerate_by, fill_by
from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.integrators.trace.state import HEAVY, INSIDE, NUMBER, PAIRS, PASSAGES, compiled_hermite
from kickdrift.integrators.wisdom_holman.bodies import LIVE, OTHERS
from kickdrift.integrators.wisdom_holman.flows import add_accelerations, fill_positions
from kickdrift.jit.compile import jit
from kickdrift.jit.lanes.memory import set_zero

TURNS = 50  # iterations of a kick
ROUNDED = 1e-14  # of the velocity: smaller changes in an iteration are rounding
STALLED = 1e-9  # larger changes at the last iteration mean that it does not converge


@jit
def meets_any(hybrid, i):
    """Tell whether the body in slot i moves with others in this step: it is near a massive body, passes its pericentre,
    or is massive while another one passes."""
    return hybrid.meets[i] > 0 or hybrid.passes[i] != 0 or (hybrid.counts[HEAVY] > 0 and i < hybrid.group.size)


@jit
def momentum(hybrid, k):
    """Sum of m v over m_0 of the bodies that meet, along axis k."""
    meeting, share, total = hybrid.meeting, hybrid.bodies.table[OTHERS], 0.0
    n = meeting.size[NUMBER]
    for i in range(n):
        total += share[meeting.slots[i]] * meeting.v[k * n + i]
    return total


# --- inside ---


@jit
def place_on_drift(hybrid, k, s):
    """Put the massive bodies, along axis k, where they are a time s after the step's start: on Hermite's cubic between
    the ends of their drift, which is the same on the way back."""
    bodies, middle, h = hybrid.bodies, hybrid.middle, hybrid.span[1]
    orbit, order, f = bodies.orbit, bodies.order, s / hybrid.span[1]
    for i in range(bodies.massive):
        if order[i] >= 0:
            x, v = compiled_hermite(f, middle[k, i], h * middle[3 + k, i], orbit[k, i], h * orbit[3 + k, i])
            bodies.x[0, k, order[i]], bodies.x[1, k, order[i]] = x, v / h


@jit
def place_all(hybrid, s, x):
    """bodies.x <- positions and velocities of the massive bodies, and of those that meet, a time s after the step's
    start."""
    bodies, meeting = hybrid.bodies, hybrid.meeting
    order, shares, share, both = bodies.order, bodies.shares, bodies.table[OTHERS], bodies.x
    n, mass = meeting.size[NUMBER], 1.0
    for i in range(n):
        if meeting.jumps[i]:
            mass += share[meeting.slots[i]]
    for k in range(3):
        place_on_drift(hybrid, k, s)
        move = momentum(hybrid, k) / mass
        for i in range(n):
            body = order[meeting.slots[i]]
            both[0, k, body] = x[k * n + i]
            both[1, k, body] = meeting.v[k * n + i] - (move if meeting.jumps[i] else 0.0)
        pace = bodies.centre[1, k]
        place, speed = hybrid.centre[0, k] + s * pace, pace
        for i in range(bodies.massive):
            if order[i] >= 0:
                place -= shares[order[i]] * both[0, k, order[i]]
                speed -= share[i] * both[1, k, order[i]]
        both[0, k, bodies.central], both[1, k, bodies.central] = place, speed
        for i in range(bodies.massive):
            if order[i] >= 0:
                both[0, k, order[i]] += place
                both[1, k, order[i]] += pace
        for i in range(n):
            if meeting.slots[i] >= bodies.massive:
                both[0, k, order[meeting.slots[i]]] += place
                both[1, k, order[meeting.slots[i]]] += pace


@jit
def add_inside(hybrid, others, s, x, a):
    """Add the accelerations by other forces to those of the bodies that meet, at x and ``meeting.v``, a time s after
    the step's start. Return a status."""
    bodies, meeting, felt = hybrid.bodies, hybrid.meeting, hybrid.bodies.a
    place_all(hybrid, s, x)
    set_zero(felt)
    status = accelerate_by(others, hybrid.groups, INSIDE, hybrid.span[0] + s, bodies.x[0], bodies.x[1], felt, None)
    if status != OK:
        return status
    order, shares, share, n = bodies.order, bodies.shares, bodies.table[OTHERS], meeting.size[NUMBER]
    for k in range(3):
        mean = 0.0
        for i in range(shares.size):
            if shares[i] > 0.0:
                mean += shares[i] * felt[k, i]
        pull = 0.0  # the central body's acceleration by those that act here, the other way
        for i in range(n):
            if meeting.acts[i]:
                pull += share[meeting.slots[i]] * (felt[k, order[meeting.slots[i]]] - mean)
        for i in range(n):
            if meeting.acts[i]:
                a[k * n + i] += felt[k, order[meeting.slots[i]]] - mean
            if meeting.jumps[i]:
                a[k * n + i] += pull
    return OK


# --- kicks ---


@jit
def fill_speeds(bodies):
    """bodies.x[1] <- the velocities of all bodies."""
    for k in range(3):
        pace = bodies.centre[1, k]
        central = pace
        for i in range(bodies.orbit.shape[1]):
            if bodies.order[i] >= 0:
                central -= bodies.table[OTHERS, i] * bodies.orbit[3 + k, i]
                bodies.x[1, k, bodies.order[i]] = pace + bodies.orbit[3 + k, i]
        bodies.x[1, k, bodies.central] = central


@jit
def put_speeds(hybrid):
    """Return to the velocities before the kick, as ``speeds`` keeps them."""
    bodies = hybrid.bodies
    n = bodies.orbit.shape[1]
    for k in range(3):
        for i in range(n):
            bodies.orbit[3 + k, i] = hybrid.speeds[k, i]
        bodies.centre[1, k], bodies.centre[3, k] = hybrid.speeds[k, n], hybrid.speeds[k, n + 1]


@jit
def keep_speeds(hybrid):
    """Keep the velocities before the kick."""
    bodies = hybrid.bodies
    n = bodies.orbit.shape[1]
    for k in range(3):
        for i in range(n):
            hybrid.speeds[k, i] = bodies.orbit[3 + k, i]
        hybrid.speeds[k, n], hybrid.speeds[k, n + 1] = bodies.centre[1, k], bodies.centre[3, k]


@jit
def kick_by_group(others, hybrid, group, t, h, cursor):
    """Kick by one group of forces at the positions and velocities ``bodies.x``. Bodies that move with others feel the
    group INSIDE elsewhere. Return a status."""
    bodies, kept = hybrid.bodies, hybrid.kept
    status = fill_by(others, hybrid.groups, group, t, bodies.x[0], bodies.x[1], bodies.a, None, cursor)
    cursor[EVALUATIONS] -= 1  # the kick counts
    if status != OK:
        return status
    aside = group == INSIDE and hybrid.counts[PAIRS] + hybrid.counts[PASSAGES] > 0
    n = bodies.orbit.shape[1]
    if aside:
        for i in range(n):
            for k in range(3):
                kept[k, i] = bodies.orbit[3 + k, i]
    add_accelerations(bodies, h)
    if aside:
        for i in range(n):
            if bodies.table[LIVE, i] != 0.0 and meets_any(hybrid, i):
                for k in range(3):
                    bodies.orbit[3 + k, i] = kept[k, i]
    return OK


@jit
def kick_by_groups(others, hybrid, t, h, cursor):
    """Kick by both groups. Return a status."""
    for group in range(2):
        if hybrid.present[group]:
            status = kick_by_group(others, hybrid, group, t, h, cursor)
            if status != OK:
                return status
    return OK


@jit
def halve_change(hybrid):
    """Put the velocities half way between those before the kick and those after. Return how far the velocities after
    the kick have changed since the last iteration, relative to the largest."""
    bodies, speeds, latest = hybrid.bodies, hybrid.speeds, hybrid.latest
    n, change, largest = bodies.orbit.shape[1], 0.0, 0.0
    for k in range(3):
        for i in range(n):
            found = bodies.orbit[3 + k, i]
            change, largest = max(change, abs(found - latest[k, i])), max(largest, abs(found))
            latest[k, i] = found
            bodies.orbit[3 + k, i] = 0.5 * (speeds[k, i] + found)
        found = bodies.centre[1, k]
        change, largest = max(change, abs(found - latest[k, n])), max(largest, abs(found))
        latest[k, n] = found
        bodies.centre[1, k] = 0.5 * (speeds[k, n] + found)
    return change / largest if largest > 0.0 else 0.0


@jit
def kick_by_others(others, hybrid, t, h, cursor):
    """Kick by the forces other than gravity. Return a status."""
    bodies = hybrid.bodies
    fill_positions(bodies)
    if not hybrid.moving:
        return kick_by_groups(others, hybrid, t, h, cursor)
    keep_speeds(hybrid)
    fill_speeds(bodies)
    before = 1e300
    for turn in range(TURNS):
        put_speeds(hybrid)
        status = kick_by_groups(others, hybrid, t, h, cursor)
        if status != OK:
            return status
        change = halve_change(hybrid)
        fill_speeds(bodies)
        if turn > 0 and (change <= ROUNDED or (change >= before and change <= STALLED)):
            put_speeds(hybrid)
            return kick_by_groups(others, hybrid, t, h, cursor)
        if turn > 0 and not change < 1e300:
            return BLOWN_UP
        before = change if turn > 0 else 1e300
    return BLOWN_UP
