"""Switches of the hybrid map: which pairs are near, and which bodies pass their pericentre.

Each body has a hand-over radius, ``hill_radii`` times r (m / (3 m_0))^(1/3). A pair is near if its distance falls below
the larger radius of the two, within half a step before or after, on straight lines.

A body passes its pericentre if the step is longer than the time scale of its Kepler motion,

    tau^2 = 2 a^2 / (a'^2 + a a''),

where a, a' and a'' are the moduli of the acceleration and its time derivatives (Pham, Rein & Spiegel 2024,
doi:10.21105/astro.2401.02849). A body whose hand-over radius reaches the central body is always in passage.

Both conditions are the same with the time turned round (Lu, Hernandez & Rein 2024, doi:10.1093/mnras/stae1982;
Hernandez & Dehnen 2023, MNRAS 522, 4639).
"""

from kickdrift.integrators.trace.state import HEAVY, NEW, NONE, PAIRS, PASSAGES
from kickdrift.integrators.wisdom_holman.bodies import GM, LIVE
from kickdrift.jit.compile import inlined, jit
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_numbers, splat
from kickdrift.jit.lanes.masks import any_lane, mask_bits, select
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vector3 import dot, load3, numbers3
from kickdrift.jit.lanes.vectors import WIDTH


@inlined
def passage(x, v, gm, dt):
    """Return a mask of the bodies whose time scale is shorter than dt.

    For Kepler motion, with sigma = x . v / r and c = 2 GM / r - 3 v^2 + 15 sigma^2,

        tau^2 = 2 r^2 / (v^2 + 3 sigma^2 + sqrt(c^2 - 12 c sigma^2 + 36 sigma^2 v^2)).
    """
    r2, v2, along = dot(x, x), dot(v, v), dot(x, v)
    inverse = inverse_sqrt(r2)
    sigma = along * inverse
    sigma2 = sigma * sigma
    c = 2.0 * gm * inverse - 3.0 * v2 + 15.0 * sigma2
    square = c * (c - 12.0 * sigma2) + 36.0 * sigma2 * v2
    rest = 2.0 / (dt * dt) * r2 - v2 - 3.0 * sigma2
    return (rest < 0.0) | (rest * rest < square)


@inlined
def comes_near(d, u, half, limit):
    """Mask of the pairs whose squared distance falls below a limit within a time ``half`` before or after.

    A pair moves on a straight line with position d and velocity u."""
    r2, u2, along = dot(d, d), dot(u, u), abs(dot(d, u))
    at_closest = (along < half * u2) & ((r2 - limit) * u2 < along * along)
    return at_closest | (r2 + half * (half * u2 - 2.0 * along) < limit)


@jit
def note_passages(hybrid, b, bits):
    """Note which of these eight bodies pass their pericentre."""
    table, counts = hybrid.bodies.table, hybrid.counts
    for i in range(b, b + WIDTH):
        if (bits >> (i - b)) & 1 and table[LIVE, i] != 0.0 and not hybrid.passes[i]:
            hybrid.passes[i] = 1
            counts[NEW] += 1
            counts[PASSAGES] += 1
            if i < hybrid.bodies.massive:
                counts[HEAVY] += 1


@jit
def note_near_pairs(hybrid, j, b, bits):
    """Note which of these eight bodies are near the massive body j."""
    table, counts, near = hybrid.bodies.table, hybrid.counts, hybrid.near
    for i in range(b, b + WIDTH):
        if (bits >> (i - b)) & 1 and i != j and table[LIVE, i] != 0.0 and not near[j, i]:
            near[j, i] = 1
            hybrid.meets[i] += 1
            if i < hybrid.bodies.massive:  # also from the other side, whatever rounding says there
                near[i, j] = 1
                hybrid.meets[j] += 1
            counts[NEW] += 1
            counts[PAIRS] += 1


@jit
def note_used(hybrid):
    """Note the pairs and passages of the last step, if they are wanted."""
    used, massive = hybrid.used, hybrid.near.shape[0]
    if used.shape[0] > 0:
        for i in range(used.shape[1]):
            for j in range(massive):
                used[j, i] = hybrid.near[j, i]
            used[massive, i] = hybrid.passes[i]


@jit
def clear_flags(hybrid):
    """Forget all pairs and passages."""
    counts, near = hybrid.counts, hybrid.near
    if counts[PAIRS] > 0:
        for i in range(hybrid.meets.size):
            if hybrid.meets[i] > 0:
                hybrid.meets[i] = 0
                for j in range(near.shape[0]):
                    near[j, i] = 0
    if counts[PASSAGES] > 0:
        hybrid.passes[:] = 0
    counts[PAIRS], counts[PASSAGES], counts[HEAVY] = 0, 0, 0


@jit
def find_flags(hybrid, dt):
    """Add the pairs that are near and the passages at the present state. Return the number of new ones."""
    bodies, counts = hybrid.bodies, hybrid.counts
    orbit, live, gm = bodies.orbit, bodies.table[LIVE], bodies.table[GM]
    n, half = orbit.shape[1], 0.5 * dt
    counts[NEW] = 0
    for b in range(0, bodies.massive, WIDTH):
        x = load3(orbit, b, n)
        store(hybrid.zone, b, load(hybrid.reach, b) * dot(x, x))
    for b in range(0, n, WIDTH):
        x, v = load3(orbit, b, n), load3(orbit, 3 * n + b, n)
        if hybrid.way != NONE:
            short = passage(x, v, load(gm, b), dt) | (load(hybrid.reach, b) >= 1.0)
            if any_lane(short):
                note_passages(hybrid, b, mask_bits(short))
        own = load(hybrid.reach, b) * dot(x, x)
        for j in range(bodies.massive):
            if live[j] == 0.0:
                continue
            d, u = numbers3(orbit, j, n) - x, numbers3(orbit, 3 * n + j, n) - v
            zone = splat(hybrid.zone[j])
            place, own_place = lane_numbers(), float(j - b)
            other = (place < own_place) | (place > own_place)
            close = other & comes_near(d, u, half, select(own > zone, own, zone))
            if any_lane(close):
                note_near_pairs(hybrid, j, b, mask_bits(close))
    return counts[NEW]
