"""How long gauss-radau15's next step is.

Pham, Rein & Spiegel (2024, doi:10.21105/astro.2401.02849) take the shortest time scale of all particles,

    tau^2 = 2 a^2 / (a'^2 + a a''),

with the moduli of the acceleration and its time derivatives at the step's end, 1 / omega on a circle; a step of
(7! epsilon)^(1/7) tau makes the polynomial's last coefficient about epsilon of the acceleration. It comes to nothing
where an acceleration passes through zero, which that of a body in the midst of a symmetric figure does. How fast the
motion changes there, the same ratio of the next derivatives says, a' in the place of a, or a'', and so on. Half of
that, or a quarter, …, is the least that tau may be: elsewhere tau is longer, and their rule stands as it is.
"""

from __future__ import annotations

import numpy as np

from kickdrift.forces.compiling import jit
from kickdrift.forces.simd import WIDTH, load, splat, store

GUARD = 0.25  # of the square of the next derivatives' time scale
TERMS = 8  # of a(s); it has as many derivatives, itself included
UNSEEN = 1e-15  # of a velocity: what changes it by less in a step has no say in how long steps are


@jit
def next_step(terms, ends, v, rows, n, h, eta):
    """The length for the step after the one that ``terms`` (8, width) describe, infinite where nothing changes: the
    shortest of all particles', or, of a Problem, of all unknowns' and of all together. ``ends`` (8, width) is
    workspace."""
    width, together = v.size, rows > 1
    for i in range(0, width, WIDTH):
        for level in range(TERMS):
            total, ways = splat(0.0), 1.0
            for k in range(2, level + 1):
                ways *= k  # level!
            for j in range(level, TERMS):
                total = total + ways * load(terms, j * width + i)
                ways *= (j + 1.0) / (j + 1.0 - level)  # j! / (j - level)!, of the next j
            store(ends, level * width + i, total)
    shortest, scale = np.inf, 0.0
    for i in range(rows * n):
        scale = max(scale, abs(v[i]), h * abs(terms[0, i]))
    sizes = np.zeros(TERMS)
    for body in range(n):
        change = 0.0
        for row in range(rows):
            i = row * n + body
            change = max(change, abs(terms[0, i]), abs(ends[0, i]))
        if h * change > UNSEEN * (scale if together else abs(v[body])):
            for level in range(TERMS):
                sizes[level] = size_of(ends[level], body, n, rows)
            shortest = min(shortest, time_scale2(sizes))
    if not together:
        for level in range(TERMS):
            sizes[level] = size_of(ends[level], 0, 1, n)
        shortest = min(shortest, time_scale2(sizes))
    return eta * h * np.sqrt(shortest)


@jit
def size_of(values, first, apart, count):
    """The root of the sum of squares of so many of the values, from the first on."""
    square = 0.0
    for k in range(count):
        square += values[first + k * apart] ** 2
    return np.sqrt(square)


@jit
def time_scale2(sizes):
    """tau^2 in units of the step's square, by the moduli (8,) of a and its derivatives, the square of each next time
    scale times GUARD; infinite where all moduli are zero."""
    longest, still, share = 0.0, True, 1.0
    for level in range(TERMS - 2):
        size = sizes[level]
        if size > 0.0:
            still = False
            longest = max(longest, share * 2.0 / ((sizes[level + 1] / size) ** 2 + sizes[level + 2] / size))
        share *= GUARD
    return np.inf if still else longest
