"""Kepler's problem in extended precision, slow and obvious: reference for the tests of the solver and of the map."""

from __future__ import annotations

import numpy as np

L = np.longdouble


def stumpff(z, n):
    """The sum over k of (-z)^k / (n + 2 k)!, term by term."""
    term = total = L(1) / L([1, 1, 2, 6][n])
    for k in range(1, 2000):
        term = -term * z / L((n + 2 * k - 1) * (n + 2 * k))
        total += term
        if abs(term) < 1e-22 * abs(total):
            break
    return total


def moved(gm, dt, x, v):
    """Relative position and velocity (3,) after a time dt, in extended precision from exactly the given numbers."""
    gm, dt, x, v = L(gm), L(dt), np.array(x, L), np.array(v, L)
    r0 = np.sqrt(x @ x)
    beta, eta = 2 * gm / r0 - v @ v, x @ v
    if beta > 0:
        period = 2 * L("3.14159265358979323846264338327950288") * gm / (beta * np.sqrt(beta))
        dt -= period * np.rint(dt / period)

    def g(s):
        return [s**n * stumpff(beta * s * s, n) for n in range(4)]

    def late(s):
        _, g1, g2, g3 = g(s)
        return r0 * g1 + eta * g2 + gm * g3 - dt

    # Bisection between bounds that grow until they enclose the root, then Newton's method, which doubles the digits.
    low, high = L(-1e-3) * np.sqrt(r0**3 / gm) / r0, L(1e-3) * np.sqrt(r0**3 / gm) / r0
    while late(high) < 0:
        high *= 2
    while late(low) > 0:
        low *= 2
    for _ in range(30):
        middle = (low + high) / 2
        if late(middle) > 0:
            high = middle
        else:
            low = middle
    root = (low + high) / 2
    for _ in range(3):
        g0, g1, g2, g3 = g(root)
        root -= late(root) / (r0 * g0 + eta * g1 + gm * g2)
    g0, g1, g2, g3 = g(root)
    r = r0 * g0 + eta * g1 + gm * g2
    new_x = x + (dt - gm * g3) * v - gm / r0 * g2 * x
    return new_x, v - gm / (r * r0) * g1 * x - gm / r * g2 * v
