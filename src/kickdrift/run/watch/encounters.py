"""Encounters of pairs inside a step: compiled geometry of cubic curves.

Between two step points each relative position is taken to be the cubic through both ends' positions and velocities
(Hermite's; its error is h^4 / 384 times the largest fourth derivative). The curve lies in the convex hull of its four
Bézier points, which rules most pairs out at once, rigorously; the turning points of the separation of the others, zeros
of a polynomial of degree five, are isolated by the sign changes of its Bernstein coefficients (Farin 2002, Curves and
Surfaces for CAGD, ch. 6), so that no passage that the curve shows is missed, however short.
"""

from __future__ import annotations

import numpy as np

from kickdrift.jit.compile import driver, jit

SMALLEST = 1e-14  # of the step: turning points nearer than this are one
POINTS = 8  # the two ends, five zeros at most in between, and one to spare
CLOSEST, LEFT = 0, 1  # what a row of ``passages`` says


@jit
def hull_bound(y0, y1, h, i, j):
    """No point of the cubic is nearer to the origin than this."""
    start2, a2, b2, e2 = 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        r0, r1 = y0[0, k, i] - y0[0, k, j], y1[0, k, i] - y1[0, k, j]
        u0, u1 = h * (y0[1, k, i] - y0[1, k, j]), h * (y1[1, k, i] - y1[1, k, j])
        start2 += r0 * r0
        a2 += (u0 / 3.0) ** 2
        b2 += (r1 - r0 - u1 / 3.0) ** 2
        e2 += (r1 - r0) ** 2
    return np.sqrt(start2) - np.sqrt(max(a2, max(b2, e2)))


@jit
def cubic(y0, y1, h, i, j, c):
    """c (4, 3): the relative position of i from j as a polynomial in s = 0 … 1."""
    for k in range(3):
        r0, r1 = y0[0, k, i] - y0[0, k, j], y1[0, k, i] - y1[0, k, j]
        u0, u1 = h * (y0[1, k, i] - y0[1, k, j]), h * (y1[1, k, i] - y1[1, k, j])
        c[0, k], c[1, k] = r0, u0
        c[2, k] = 3.0 * (r1 - r0) - 2.0 * u0 - u1
        c[3, k] = 2.0 * (r0 - r1) + u0 + u1


@jit
def separation2(c, s):
    """The square of the separation."""
    total = 0.0
    for k in range(3):
        r = c[0, k] + s * (c[1, k] + s * (c[2, k] + s * c[3, k]))
        total += r * r
    return total


@jit
def bernstein(c, b):
    """b (6,): the Bernstein coefficients of r . dr/ds, of degree five."""
    q = np.zeros(6)
    for k in range(3):
        c0, c1, c2, c3 = c[0, k], c[1, k], c[2, k], c[3, k]
        q[0] += c0 * c1
        q[1] += c1 * c1 + 2.0 * c0 * c2
        q[2] += 3.0 * (c1 * c2 + c0 * c3)
        q[3] += 2.0 * c2 * c2 + 4.0 * c1 * c3
        q[4] += 5.0 * c2 * c3
        q[5] += 3.0 * c3 * c3
    b[0] = q[0]
    b[1] = q[0] + q[1] / 5.0
    b[2] = q[0] + 2.0 * q[1] / 5.0 + q[2] / 10.0
    b[3] = q[0] + 3.0 * q[1] / 5.0 + 3.0 * q[2] / 10.0 + q[3] / 10.0
    b[4] = q[0] + 4.0 * q[1] / 5.0 + 6.0 * q[2] / 10.0 + 4.0 * q[3] / 10.0 + q[4] / 5.0
    b[5] = q[0] + q[1] + q[2] + q[3] + q[4] + q[5]


@jit
def halve(b, left, right):
    """De Casteljau's split of six Bernstein coefficients at the middle."""
    for k in range(6):
        right[k] = b[k]
    left[0] = b[0]
    for level in range(1, 6):
        for k in range(6 - level):
            right[k] = 0.5 * (right[k] + right[k + 1])
        left[level] = right[0]


@jit
def sign_changes(b):
    """Zeros left out."""
    count, last = 0, 0.0
    for k in range(6):
        if b[k] != 0.0:
            if last * b[k] < 0.0:
                count += 1
            last = 1.0 if b[k] > 0.0 else -1.0
    return count


@jit
def turning_points(c, points):
    """Into ``points``, in order: 0, the s in between at which the separation stops growing or shrinking, 1; their
    number."""
    stack, spans = np.empty((64, 6)), np.empty((64, 2))
    left, right = np.empty(6), np.empty(6)
    bernstein(c, stack[0])
    spans[0, 0], spans[0, 1] = 0.0, 1.0
    points[0] = 0.0
    top, count = 1, 1
    while top > 0:
        top -= 1
        if sign_changes(stack[top]) == 0:
            continue
        a, b = spans[top]
        middle = 0.5 * (a + b)
        if b - a < SMALLEST:
            if count < POINTS - 1:
                points[count] = middle
                count += 1
            continue
        halve(stack[top], left, right)
        if right[0] == 0.0:  # a zero at the very middle, which neither half would show
            right[0] = -1e-30 * right[1]
        stack[top], stack[top + 1] = right, left
        spans[top, 0], spans[top, 1] = middle, b
        spans[top + 1, 0], spans[top + 1, 1] = a, middle
        top += 2
    points[count] = 1.0
    return count + 1


@driver
def passages(y0, y1, time, h, step, pairs, limits, heaviest, closest, rows):
    """Pairs nearer than their limits: how many ``rows`` (pair, s, CLOSEST or LEFT) were filled.

    ``closest`` (P, 3) is the smallest separation of the passage that a pair is in, infinite where it is in none, its
    time and its step; a row CLOSEST says that it was found inside this step, at s. Limits are lengths or, where there
    is a ``heaviest`` body, parts of the pair's mean distance from it.
    """
    c, points = np.empty((4, 3)), np.empty(POINTS)
    count = 0
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        limit = limits[p]
        if heaviest >= 0:
            limit *= 0.5 * (_distance(y1, i, heaviest) + _distance(y1, j, heaviest))
        outside = np.isinf(closest[p, 0])
        if outside and hull_bound(y0, y1, h, i, j) >= limit:
            continue
        cubic(y0, y1, h, i, j, c)
        number = turning_points(c, points)
        best, where = np.inf, 0
        for k in range(number):
            d2 = separation2(c, points[k])
            if d2 < best:
                best, where = d2, k
        best = np.sqrt(best)
        if outside and best >= limit:
            continue
        if best < closest[p, 0]:
            closest[p, 0], closest[p, 1], closest[p, 2] = best, time + points[where] * h, step
            if 0 < where < number - 1:
                rows[count, 0], rows[count, 1], rows[count, 2] = p, points[where], CLOSEST
                count += 1
        if separation2(c, 1.0) >= limit * limit:
            rows[count, 0], rows[count, 1], rows[count, 2] = p, 1.0, LEFT
            count += 1
    return count


@jit
def _distance(y, i, j):
    return np.sqrt((y[0, 0, i] - y[0, 0, j]) ** 2 + (y[0, 1, i] - y[0, 1, j]) ** 2 + (y[0, 2, i] - y[0, 2, j]) ** 2)


@driver
def contacts(y0, y1, h, pairs, radii, approaching, touching, rows):
    """Pairs whose separation is the sum of their radii inside a step: how many ``rows`` (pair, s of contact, a and b, s
    before and after it) were filled.

    Those that overlap at the start are in contact there; with ``approaching`` only from where they come nearer. A pair
    that is ``touching`` (P,) already is none, and stops to be one when it is apart at the step's end.
    """
    c, points = np.empty((4, 3)), np.empty(POINTS)
    count = 0
    for p in range(pairs.shape[1]):
        i, j = pairs[0, p], pairs[1, p]
        reach = radii[i] + radii[j]
        if reach == 0.0 or hull_bound(y0, y1, h, i, j) > reach:
            touching[p] = False
            continue
        cubic(y0, y1, h, i, j, c)
        if touching[p]:
            touching[p] = separation2(c, 1.0) <= reach * reach
            continue
        number = turning_points(c, points)
        if not approaching and separation2(c, 0.0) <= reach * reach:
            rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = p, 0.0, 0.0, 0.0
            count += 1
            continue
        for k in range(number - 1):
            a, b = points[k], points[k + 1]
            first, last = separation2(c, a), separation2(c, b)
            if not (last < first and last <= reach * reach):  # nan is no contact
                continue
            s = a
            if first > reach * reach:
                low, high = a, b
                while high - low > SMALLEST:
                    s = 0.5 * (low + high)
                    if separation2(c, s) > reach * reach:
                        low = s
                    else:
                        high = s
                s = high
            rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = p, s, a, b
            count += 1
            break
    return count


@driver
def crossings(y, approach, bodies, signs, values):
    """Into ``values`` (K,) r . v of pairs of bodies (2, K) where ``approach``, else z; how many have another sign than
    ``signs`` say."""
    count = 0
    for m in range(bodies.shape[1]):
        i, j = bodies[0, m], bodies[1, m]
        if approach[m]:
            values[m] = 0.0
            for k in range(3):
                values[m] += (y[0, k, i] - y[0, k, j]) * (y[1, k, i] - y[1, k, j])
        else:
            values[m] = y[0, 2, i] - y[0, 2, j]
        if signs[m] * values[m] < 0.0:
            count += 1
    return count


@driver
def unbound(y, gm, softening2, about, distance, known, rows):
    """Bodies beyond ``distance`` from body ``about``, or where that is -1 from the centre of mass of the others, and
    unbound: how many ``rows`` (body, distance) were filled.

    Unbound: with v relative to the others' centre of mass and mu = m M / (m + M), M their mass, the energy
    mu v^2 / 2 + m phi is positive. A body heavier than all others together stays; the others leave it. ``gm`` (n,) is
    G m; bodies that are ``known`` are left out."""
    n, count = gm.size, 0
    total, moments = 0.0, np.zeros((2, 3))
    for i in range(n):
        total += gm[i]
        for k in range(3):
            moments[0, k] += gm[i] * y[0, k, i]
            moments[1, k] += gm[i] * y[1, k, i]
    for i in range(n):
        others = total - gm[i]
        if known[i] or i == about or gm[i] > others or others == 0.0:
            continue
        d2, v2 = 0.0, 0.0
        for k in range(3):
            centre = y[0, k, about] if about >= 0 else (moments[0, k] - gm[i] * y[0, k, i]) / others
            d2 += (y[0, k, i] - centre) ** 2
            v2 += (y[1, k, i] - (moments[1, k] - gm[i] * y[1, k, i]) / others) ** 2
        if d2 <= distance * distance:
            continue
        energy = 0.5 * v2
        for j in range(n):
            if j != i:
                energy -= gm[j] / np.sqrt(_distance(y, i, j) ** 2 + softening2) * (total / others)
        if energy > 0.0:
            rows[count, 0], rows[count, 1] = i, np.sqrt(d2)
            count += 1
    return count
