"""Fourier transforms of eight lines at once, one in each lane (Stockham's form: Cochran et al. 1967).

A line has n complex numbers, and n has no prime factor above 5. Point k of the eight lines is two vectors: the real
parts at ``at + step k``, the imaginary parts ``apart`` further. The transform is sum_k x_k exp(-2 pi i k m / n). The
backward one has the other sign: the caller exchanges real and imaginary parts, with ``at + apart`` and ``-apart``.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.charges.mesh_sizes import SMALLEST
from kickdrift.jit.compile import as_written, never_inline, strict
from kickdrift.jit.lanes.functions import multiply_add, splat
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats

RADICES = (4, 2, 3, 5)
POINT = 2 * WIDTH  # numbers of a point of eight lines
HALF_ROOT = math.sqrt(0.75)
C1, C2, S1, S2 = (function(2.0 * math.pi * k / 5.0) for function in (math.cos, math.sin) for k in (1, 2))


class Plan(NamedTuple):
    """Passes of a transform of n points."""

    n: int
    radices: NDArray[np.int64]
    turns: Floats  # (2 n,) cosine and sine of -2 pi k / n


def plan_of(n: int) -> Plan:
    """The Plan of a line of n points."""
    radices, left = [], n
    for radix in RADICES:
        while left % radix == 0:
            radices.append(radix)
            left //= radix
    assert left == 1, f"a line of {n} points has no plan"
    assert n >= SMALLEST, f"a line of {n} points is too short"
    angles = -2.0 * math.pi * np.arange(n) / n
    return Plan(n, np.array(radices, np.int64), np.column_stack([np.cos(angles), np.sin(angles)]).ravel())


@strict
def transform(plan, x, at, step, apart, y, to, leap, beside, own):
    """Transform eight lines of x into y, whose points lie at ``to + leap k`` and ``beside`` further. Both may be the
    same lines. ``own`` begins with room for two lines more, POINT numbers for each point."""
    never_inline()
    length, stride = plan.n, 1
    last = plan.radices.size - 1
    source, begin, between, turn = x, at, step, apart
    free = 0
    for k in range(last + 1):
        radix = plan.radices[k]
        length //= radix
        target, end, gap, side = own, free, POINT, WIDTH
        if k == last:
            target, end, gap, side = y, to, leap, beside
        if radix == 4:
            by_four(plan.turns, length, stride, source, begin, between, turn, target, end, gap, side)
        elif radix == 2:
            by_two(plan.turns, length, stride, source, begin, between, turn, target, end, gap, side)
        elif radix == 3:
            by_three(plan.turns, length, stride, source, begin, between, turn, target, end, gap, side)
        else:
            by_five(plan.turns, length, stride, source, begin, between, turn, target, end, gap, side)
        stride *= radix
        source, begin, between, turn = target, end, gap, side
        free = POINT * plan.n - free


@as_written
def turned(turns, k, re, im):
    """Return a complex number times exp(-2 pi i k / n)."""
    c, s = splat(turns[2 * k]), splat(turns[2 * k + 1])
    return multiply_add(re, c, -(im * s)), multiply_add(re, s, im * c)


@strict
def by_two(turns, m, stride, x, at, step, apart, y, to, leap, beside):
    """Do a pass of radix 2 over ``stride`` lines of 2 m points each, which lie side by side."""
    never_inline()
    far = step * stride * m
    for p in range(m):
        for q in range(stride):
            i, o = at + step * (q + stride * p), to + leap * (q + stride * 2 * p)
            a, b = load(x, i), load(x, i + apart)
            c, d = load(x, i + far), load(x, i + far + apart)
            store(y, o, a + c)
            store(y, o + beside, b + d)
            re, im = turned(turns, stride * p, a - c, b - d)
            o += leap * stride
            store(y, o, re)
            store(y, o + beside, im)


@strict
def by_three(turns, m, stride, x, at, step, apart, y, to, leap, beside):
    """Do a pass of radix 3, likewise."""
    never_inline()
    far, next_one = step * stride * m, leap * stride
    for p in range(m):
        for q in range(stride):
            i, o = at + step * (q + stride * p), to + leap * (q + stride * 3 * p)
            a, b = load(x, i), load(x, i + apart)
            c, d = load(x, i + far), load(x, i + far + apart)
            e, f = load(x, i + 2 * far), load(x, i + 2 * far + apart)
            u, v = c + e, d + f
            w, z = HALF_ROOT * (c - e), HALF_ROOT * (d - f)
            store(y, o, a + u)
            store(y, o + beside, b + v)
            u, v = a - 0.5 * u, b - 0.5 * v
            re, im = turned(turns, stride * p, u + z, v - w)
            store(y, o + next_one, re)
            store(y, o + next_one + beside, im)
            re, im = turned(turns, 2 * stride * p, u - z, v + w)
            store(y, o + 2 * next_one, re)
            store(y, o + 2 * next_one + beside, im)


@strict
def by_four(turns, m, stride, x, at, step, apart, y, to, leap, beside):
    """Do a pass of radix 4, likewise."""
    never_inline()
    far, next_one = step * stride * m, leap * stride
    for p in range(m):
        for q in range(stride):
            i, o = at + step * (q + stride * p), to + leap * (q + stride * 4 * p)
            a, b = load(x, i), load(x, i + apart)
            c, d = load(x, i + far), load(x, i + far + apart)
            e, f = load(x, i + 2 * far), load(x, i + 2 * far + apart)
            g, h = load(x, i + 3 * far), load(x, i + 3 * far + apart)
            s, t, u, v = a + e, b + f, c + g, d + h
            store(y, o, s + u)
            store(y, o + beside, t + v)
            re, im = turned(turns, 2 * stride * p, s - u, t - v)
            store(y, o + 2 * next_one, re)
            store(y, o + 2 * next_one + beside, im)
            s, t, u, v = a - e, b - f, c - g, d - h
            re, im = turned(turns, stride * p, s + v, t - u)
            store(y, o + next_one, re)
            store(y, o + next_one + beside, im)
            re, im = turned(turns, 3 * stride * p, s - v, t + u)
            store(y, o + 3 * next_one, re)
            store(y, o + 3 * next_one + beside, im)


@strict
def by_five(turns, m, stride, x, at, step, apart, y, to, leap, beside):
    """Do a pass of radix 5, likewise."""
    never_inline()
    far, next_one = step * stride * m, leap * stride
    for p in range(m):
        for q in range(stride):
            i, o = at + step * (q + stride * p), to + leap * (q + stride * 5 * p)
            a, b = load(x, i), load(x, i + apart)
            c, d = load(x, i + far), load(x, i + far + apart)
            e, f = load(x, i + 2 * far), load(x, i + 2 * far + apart)
            g, h = load(x, i + 3 * far), load(x, i + 3 * far + apart)
            s, t = load(x, i + 4 * far), load(x, i + 4 * far + apart)
            c, d, s, t = c + s, d + t, c - s, d - t
            e, f, g, h = e + g, f + h, e - g, f - h
            store(y, o, a + (c + e))
            store(y, o + beside, b + (d + f))
            u, v = a + (C1 * c + C2 * e), b + (C1 * d + C2 * f)
            w, z = S1 * s + S2 * g, S1 * t + S2 * h
            re, im = turned(turns, stride * p, u + z, v - w)
            store(y, o + next_one, re)
            store(y, o + next_one + beside, im)
            re, im = turned(turns, 4 * stride * p, u - z, v + w)
            store(y, o + 4 * next_one, re)
            store(y, o + 4 * next_one + beside, im)
            u, v = a + (C2 * c + C1 * e), b + (C2 * d + C1 * f)
            w, z = S2 * s - S1 * g, S2 * t - S1 * h
            re, im = turned(turns, 2 * stride * p, u + z, v - w)
            store(y, o + 2 * next_one, re)
            store(y, o + 2 * next_one + beside, im)
            re, im = turned(turns, 3 * stride * p, u - z, v + w)
            store(y, o + 3 * next_one, re)
            store(y, o + 3 * next_one + beside, im)
