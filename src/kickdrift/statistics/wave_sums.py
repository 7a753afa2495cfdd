"""Sums of products of waves, in compiled code, and the workspace of fits.

The places of n evenly spaced numbers are k = -(n - 1) / 2 … (n - 1) / 2. Over these, 1, cos(w k) and k sin(w k) are
even, and k, sin(w k) and k cos(w k) are odd. So the normal equations fall into two systems of half the size. Sums of
products of waves follow from D0(w), the sum of cos(w k), D1, that of k sin(w k), and D2, that of k^2 cos(w k). These
are known: D0 = sin(n w / 2) / sin(w / 2), D1 = -D0' and D2 = -D0''.
"""

import math
from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.jit.compile import inlined, jit
from kickdrift.jit.lanes.functions import lane_numbers, splat
from kickdrift.jit.lanes.masks import mask_bits, select
from kickdrift.jit.lanes.memory import aligned, load, store
from kickdrift.jit.lanes.vectors import WIDTH

NEAR = 0.3  # n |sin(w / 2)| below which the closed forms cancel
MOMENTS = 8  # powers of the series for these
BELOW = 2.4492935982947064e-16  # 2 pi less its nearest number of float64


class Room(NamedTuple):
    """Workspace for a series of n numbers and up to L waves.

    C is L filled up to a multiple of eight, and eight more. Index 0 is the even system, 1 the odd one, and 2 that of
    the changes of the frequencies.
    """

    places: NDArray[np.float64]  # (p,) the places k >= 0, filled up with zeros to a multiple of eight
    halves: NDArray[np.float64]  # (2, p) y(k) + y(-k) and y(k) - y(-k) for k >= 0, but y(0) alone
    turns: NDArray[np.float64]  # (4, C) sines and cosines of w / 2 and n w / 2
    first: NDArray[np.float64]  # (2, 8) cosines and sines of the first eight places
    systems: NDArray[np.float64]  # (3, C, C) sums of products, then their factors
    across: NDArray[np.float64]  # (2, C, C) sums with k sin and k cos, and the right side in the column behind
    slopes: NDArray[np.float64]  # (2, C, C) sums of k cos with each other, and of k sin
    found: NDArray[np.float64]  # (4, C) sums of the series with 1 and cos, k and sin, k sin, k cos
    scales: NDArray[np.float64]  # (3, C) one over the roots of the diagonals
    inverses: NDArray[np.float64]  # (3, C) one over the diagonals of the factors, 0 for hidden columns
    solution: NDArray[np.float64]  # (3, C) coefficients of the columns
    moments: NDArray[np.float64]  # (8,) sums of the even powers of 2 k / (n - 1); zeros until they are needed


def room_for(n: int, waves: int) -> Room:
    """Workspace for a series of n numbers and up to so many waves."""
    places, columns = (-(-count // WIDTH) * WIDTH for count in ((n + 1) // 2, waves + WIDTH))
    shapes = (
        (places,), (2, places), (4, columns), (2, WIDTH), (3, columns, columns), (2, columns, columns),
        (2, columns, columns), (4, columns), (3, columns), (3, columns), (3, columns), (MOMENTS,),
    )  # fmt: skip
    sizes = [math.prod(shape) for shape in shapes]
    whole, ends = aligned((sum(sizes),), None), accumulate(sizes)
    parts = [whole[end - size : end] for size, end in zip(sizes, ends, strict=True)]
    return Room(*(part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)))


@inlined
def sums_of_cosines(n, s, c, sn, cn):
    """D0, D1 and D2 of eight w, from the sines and cosines of w / 2 and n w / 2, and the mask of those that cancel."""
    inverse = 1.0 / s
    d0 = sn * inverse
    slope = (n * cn - d0 * c) * inverse
    return d0, -0.5 * slope, 0.25 * ((n * n - 1.0) * d0 + 2.0 * slope * c * inverse), abs(s) * n < NEAR


@jit
def sums_for(n, w, room):
    """The same for one w. Where the closed forms cancel, D0, D1 and D2 are series in powers of w; the first term left
    out is below 1e-18 of the sum."""
    d0, d1, d2, near = sums_of_cosines(
        n, math.sin(0.5 * w), math.cos(0.5 * w), math.sin(0.5 * n * w), math.cos(0.5 * n * w)
    )
    if not near:
        return d0, d1, d2
    moments, half = room.moments, 0.5 * (n - 1)
    if moments[0] == 0.0:
        for i in range(n):
            square, power = (i / half - 1.0) ** 2, 1.0
            for m in range(moments.size):
                moments[m] += power
                power *= square
    whole = math.floor(w / (2.0 * math.pi) + 0.5)
    x = (w - 2.0 * math.pi * whole - BELOW * whole) * half
    d0, d1, d2, term = 0.0, 0.0, 0.0, 1.0
    if n % 2 == 0 and whole % 2:  # places are halves
        term = -1.0
    for m in range(moments.size - 1):
        d0, d1, d2 = d0 + term * moments[m], d1 + term / (2 * m + 1) * moments[m + 1], d2 + term * moments[m + 1]
        term *= -x * x / ((2 * m + 1) * (2 * m + 2))
    return d0, half * x * d1, half * half * d2


@jit
def fill_turns(n, frequencies, room):
    """Fill in ``turns``, for a multiple of eight."""
    for i in range((frequencies.size + WIDTH - 1) // WIDTH * WIDTH):
        half = 0.5 * frequencies[i] if i < frequencies.size else 0.5
        room.turns[0, i], room.turns[1, i] = math.sin(half), math.cos(half)
        room.turns[2, i], room.turns[3, i] = math.sin(n * half), math.cos(n * half)


@jit
def fill_products(n, frequencies, room):
    """Fill in ``systems``, ``across`` and ``slopes``."""
    turns, systems, across, slopes = room.turns, room.systems, room.across, room.slopes
    count, columns = frequencies.size, turns.shape[1]
    size, squares = columns * columns, n * (n * n - 1.0) / 12.0
    systems[0, 0, 0], systems[1, 0, 0] = n, squares
    for i in range(-1, count):  # -1 is the frequency 0, of 1 and k
        si, ci, sni, cni = 0.0, 1.0, 0.0, 1.0
        if i >= 0:
            si, ci, sni, cni = turns[0, i], turns[1, i], turns[2, i], turns[3, i]
        for b in range(0, count, WIDTH):
            s, c = load(turns, b), load(turns, columns + b)
            sn, cn = load(turns, 2 * columns + b), load(turns, 3 * columns + b)
            p0, p1, p2, far = sums_of_cosines(
                n, s * ci + c * si, c * ci - s * si, sn * cni + cn * sni, cn * cni - sn * sni
            )
            m0, m1, m2, near = sums_of_cosines(
                n, s * ci - c * si, c * ci + s * si, sn * cni - cn * sni, cn * cni + sn * sni
            )
            itself = lane_numbers() == float(i - b)
            m0, m1 = select(itself, splat(float(n)), m0), select(itself, splat(0.0), m1)
            m2 = select(itself, splat(squares), m2)
            row = (i + 1) * columns + b
            store(systems, row + 1, 0.5 * (m0 + p0))
            store(across, row, 0.5 * (p1 + m1))
            if i >= 0:
                store(systems, size + row + 1, 0.5 * (m0 - p0))
                store(across, size + row, 0.5 * (p1 - m1))
                store(slopes, i * columns + b, 0.5 * (m2 + p2))
                store(slopes, size + i * columns + b, 0.5 * (m2 - p2))
            else:  # k in place of a sine, and k times 1 in place of k times a sine
                store(systems, size + row + 1, p1)
                store(across, size + row, p2)
            lanes = (mask_bits(near) & ~mask_bits(itself)) | mask_bits(far)
            if lanes:
                for j in range(b, min(b + WIDTH, count)):
                    if (lanes >> (j - b)) & 1:
                        fill_pair(n, frequencies, room, i, j)


@jit
def fill_pair(n, frequencies, room, i, j):
    """The same for one pair of frequencies, whose sum or difference is so near 0 that the closed forms cancel."""
    systems, across, slopes = room.systems, room.across, room.slopes
    own = frequencies[i] if i >= 0 else 0.0
    p0, p1, p2 = sums_for(n, frequencies[j] + own, room)
    m0, m1, m2 = float(n), 0.0, n * (n * n - 1.0) / 12.0
    if j != i:
        m0, m1, m2 = sums_for(n, frequencies[j] - own, room)
    systems[0, i + 1, j + 1], across[0, i + 1, j] = 0.5 * (m0 + p0), 0.5 * (p1 + m1)
    if i >= 0:
        systems[1, i + 1, j + 1], across[1, i + 1, j] = 0.5 * (m0 - p0), 0.5 * (p1 - m1)
        slopes[0, i, j], slopes[1, i, j] = 0.5 * (m2 + p2), 0.5 * (m2 - p2)
    else:
        systems[1, 0, j + 1], across[1, 0, j] = p1, p2
