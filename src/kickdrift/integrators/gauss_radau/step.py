"""Length of gauss-radau15's next step.

Pham, Rein & Spiegel (2024, doi:10.21105/astro.2401.02849) take the shortest time scale of all particles,

    tau^2 = 2 a^2 / (a'^2 + a a''),

with the moduli of the acceleration and its time derivatives at the step's end; it is 1 / omega on a circle. A step of
(7! epsilon)^(1/7) tau makes the polynomial's last coefficient about epsilon of the acceleration. tau vanishes where an
acceleration passes through zero, as for a body in the middle of a symmetric figure. There the same ratio of the next
derivatives (a' in place of a, or a'', and so on) gives the time scale of the motion. Half of that scale, or a quarter,
…, is the lower bound of tau. Elsewhere tau is longer, and their rule holds unchanged.
"""

import numpy as np

from kickdrift.forces.seam.kernel import BLOWN_UP, OK
from kickdrift.jit.compile import inlined, is_finite
from kickdrift.jit.lanes.functions import inverse_sqrt, lane_max, lane_numbers, lane_sum, splat
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH

MOST = 25  # iterations of a step
CONVERGED = 2.2e-16  # expected residual of another iteration, over the size of the accelerations
ROUNDED = 1e-9  # a stalled residual below this is rounding; above, the iteration diverges
PATIENCE = 3  # iterations in which residuals may grow, after a first guess
AGAIN = -1  # verdict: iterate once more
GUARD = 0.25  # fraction of the square of the next derivatives' time scale
TERMS = 8  # terms of a(s), and number of its derivatives including itself
UNSEEN = 1e-15  # fraction of a velocity: smaller changes in a step do not affect the step length


@inlined
def verdict(count, missed, residual, converged=CONVERGED):
    """Return OK if a step's iteration has converged, BLOWN_UP if it diverges, and AGAIN if it goes on.

    ``missed`` is the residual of iteration number ``count``, and ``residual`` that of the iteration before. The
    iteration has converged if another one would leave at most ``converged``.
    """
    if missed == 0.0:
        return OK
    if count > 0:
        if missed * missed / residual <= converged:
            return OK
        if missed >= residual:
            if missed <= ROUNDED:
                return OK
            if count >= PATIENCE:
                return BLOWN_UP
    if not is_finite(missed):
        return BLOWN_UP
    if count < MOST - 1:
        return AGAIN
    return OK if missed <= ROUNDED else BLOWN_UP


@inlined
def next_step(work, width, now, ends, velocities, rows, n, h, eta):
    """Return the length of the step after the one whose polynomial begins at row ``now`` of the workspace.

    This is the shortest length over all particles, or over all unknowns of a Problem and all of them together; infinite
    if nothing changes. Eight are computed at a time. The derivatives at the step's end go to the rows from ``ends`` on.
    """
    together, most = rows > 1, splat(0.0)
    for i in range(0, width, WIDTH):
        for level in range(TERMS):
            total, ways = splat(0.0), 1.0
            for k in range(2, level + 1):
                ways *= k  # level!
            for j in range(level, TERMS):
                total = total + ways * load(work, (now + j) * width + i)
                ways *= (j + 1.0) / (j + 1.0 - level)  # j! / (j - level)!, of the next j
            store(work, (ends + level) * width + i, total)
        speed, change = abs(load(work, velocities * width + i)), h * abs(load(work, now * width + i))
        most = larger(most, larger(speed, change))
    scale, shortest = splat(lane_max(most)), splat(np.inf)
    for b in range(0, n, WIDTH):
        change = splat(0.0)
        for i in range(b, rows * n, n):
            change = larger(change, larger(abs(load(work, now * width + i)), abs(load(work, ends * width + i))))
        if not together:
            scale = abs(load(work, velocities * width + b))
        seen = (lane_numbers() < float(n - b)) & (h * change > UNSEEN * scale)
        tau2 = time_scale2(work, width, ends, b, rows * n, n)
        shortest = smaller(shortest, select(seen, tau2, splat(np.inf)))
    if not together:
        shortest = smaller(shortest, time_scale2(work, width, ends, 0, n, 0))
    return eta * h * np.sqrt(-lane_max(-shortest))


@inlined
def larger(a, b):
    return select(a > b, a, b)


@inlined
def smaller(a, b):
    return select(a < b, a, b)


@inlined
def modulus(work, row, first, stop, apart):
    """Root of the sum of squares of every ``apart``-th number from the first on; with ``apart`` 0, of all."""
    square = splat(0.0)
    if apart > 0:
        for i in range(first, stop, apart):
            value = load(work, row + i)
            square = square + value * value
    else:
        for i in range(first, stop, WIDTH):
            value = load(work, row + i)
            square = square + value * value
        square = splat(lane_sum(square))
    return select(square > 0.0, square * inverse_sqrt(square), splat(0.0))


@inlined
def time_scale2(work, width, ends, first, stop, apart):
    """Return tau^2 in units of the squared step, from the moduli of a and its derivatives and the square of each next
    time scale times GUARD; infinite if all moduli are zero."""
    longest, largest, zero, share = splat(0.0), splat(0.0), splat(0.0), 2.0
    size = modulus(work, ends * width, first, stop, apart)
    slope = modulus(work, (ends + 1) * width, first, stop, apart)
    for level in range(TERMS - 2):
        bend = modulus(work, (ends + level + 2) * width, first, stop, apart)
        slower = slope / size
        rate2 = slower * slower + bend / size
        tau2 = select(rate2 > 0.0, share / rate2, splat(np.inf))
        longest = larger(select(size > 0.0, tau2, zero), longest)
        largest = larger(largest, size)
        size, slope, share = slope, bend, share * GUARD
    return select(largest > 0.0, longest, splat(np.inf))
