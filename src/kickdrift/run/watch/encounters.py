"""Encounters of pairs inside a step: compiled geometry of cubic curves.

Between two step points, each relative position follows Hermite's cubic through the positions and velocities of both
ends. The error is h^4 / 384 times the largest fourth derivative. The curve lies in the convex hull of its four Bézier
points, which rigorously rules out most pairs at once. For the other pairs, the turning points of the separation are
zeros of a polynomial of degree five. The sign changes of its Bernstein coefficients isolate these zeros (Farin 2002,
Curves and Surfaces for CAGD, ch. 6). So no passage of the curve is missed, however short.
"""

import numpy as np

from kickdrift.jit.compile import driver, jit

SMALLEST = 1e-14  # fraction of the step: closer turning points count as one
POINTS = 8  # the two ends, at most five zeros in between, and one spare
CLOSEST, LEFT = 0, 1  # kinds of row of ``passages``


@jit
def hull_bound(y0, y1, h, i, j):
    """Return a lower bound of the distance between the cubic and the origin."""
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
    """c (4, 3) <- coefficients of the position of i relative to j, a polynomial in s = 0 … 1."""
    for k in range(3):
        r0, r1 = y0[0, k, i] - y0[0, k, j], y1[0, k, i] - y1[0, k, j]
        u0, u1 = h * (y0[1, k, i] - y0[1, k, j]), h * (y1[1, k, i] - y1[1, k, j])
        c[0, k], c[1, k] = r0, u0
        c[2, k] = 3.0 * (r1 - r0) - 2.0 * u0 - u1
        c[3, k] = 2.0 * (r0 - r1) + u0 + u1


@jit
def separation2(c, s):
    total = 0.0
    for k in range(3):
        r = c[0, k] + s * (c[1, k] + s * (c[2, k] + s * c[3, k]))
        total += r * r
    return total


@jit
def bernstein(c, b):
    """b (6,) <- the Bernstein coefficients of r . dr/ds, of degree five."""
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
    """Split six Bernstein coefficients at the middle, by de Casteljau's algorithm."""
    for k in range(6):
        right[k] = b[k]
    left[0] = b[0]
    for level in range(1, 6):
        for k in range(6 - level):
            right[k] = 0.5 * (right[k] + right[k + 1])
        left[level] = right[0]


@jit
def sign_changes(b):
    """Return the number of sign changes in b, ignoring zeros."""
    count, last = 0, 0.0
    for k in range(6):
        if b[k] != 0.0:
            if last * b[k] < 0.0:
                count += 1
            last = 1.0 if b[k] > 0.0 else -1.0
    return count


@jit
def turning_points(c, points):
    """points <- 0, the turning points s of the separation, 1, in order; return their number."""
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
        if right[0] == 0.0:  # a zero exactly at the middle, which neither half counts
            right[0] = -1e-30 * right[1]
        stack[top], stack[top + 1] = right, left
        spans[top, 0], spans[top, 1] = middle, b
        spans[top + 1, 0], spans[top + 1, 1] = a, middle
        top += 2
    points[count] = 1.0
    return count + 1


@driver
def passages(y0, y1, time, h, step, pairs, limits, heaviest, closest, rows):
    """Find pairs closer than their limits; return how many ``rows`` (pair, s, CLOSEST or LEFT) were filled.

    ``closest`` (P, 3) holds the smallest separation of each pair's current passage, with its time and step. The
    separation is infinite for a pair outside any passage. A row CLOSEST marks a smallest separation inside this step,
    at s. Limits are lengths; with a ``heaviest`` body, they are fractions of the pair's mean distance from that body.
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
    """Find pairs that touch inside a step; return how many ``rows`` were filled.

    A row holds the pair, s of contact, and a and b, the turning points before and after the contact. A pair touches
    when its separation is the sum of its radii. A pair that overlaps at the start touches there; with ``approaching``,
    only from where the pair comes closer. A pair marked in ``touching`` (P,) is not reported again, and the mark ends
    when the pair is apart at the step's end.
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
def crossings(y0, y1, h, approach, bodies, signs, values, most):
    """values (K,) <- r . v of each pair of ``bodies`` (2, K) with ``approach``, else the relative z, at y1.

    Return how many values have another sign than in ``signs``, and how many of ``most`` exceed 1. ``most`` (K,) += the
    largest number of zeros that the scalar can have on the cubics between both states: the sign changes of its
    Bernstein coefficients."""
    c, b, count, several = np.empty((4, 3)), np.zeros(6), 0, 0
    for m in range(bodies.shape[1]):
        i, j = bodies[0, m], bodies[1, m]
        cubic(y0, y1, h, i, j, c)
        if approach[m]:
            values[m] = 0.0
            for k in range(3):
                values[m] += (y1[0, k, i] - y1[0, k, j]) * (y1[1, k, i] - y1[1, k, j])
            bernstein(c, b)
        else:
            values[m] = y1[0, 2, i] - y1[0, 2, j]
            b[:] = 0.0
            b[0], b[1] = c[0, 2], c[0, 2] + c[1, 2] / 3.0
            b[2] = c[0, 2] + (2.0 * c[1, 2] + c[2, 2]) / 3.0
            b[3] = c[0, 2] + c[1, 2] + c[2, 2] + c[3, 2]
        most[m] += sign_changes(b)
        several += most[m] > 1.0
        count += signs[m] * values[m] < 0.0
    return count, several


@jit
def unbound_bodies(y, gm, softening2, about, distance, known, rows):
    """Find unbound bodies beyond ``distance``; return how many ``rows`` (body, distance) were filled.

    The distance is from body ``about``, or from the centre of mass of the other bodies if ``about`` is -1. A body is
    unbound if the energy mu v^2 / 2 + m phi is positive. Here v is relative to the others' centre of mass, M is the
    others' mass, and mu = m M / (m + M). A body heavier than all others together never escapes. ``gm`` (n,) is G m;
    ``known`` bodies are skipped."""
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


@driver
def unbound(y, gm, softening2, about, distance, known, rows):
    """Call ``unbound_bodies`` from Python."""
    return unbound_bodies(y, gm, softening2, about, distance, known, rows)
