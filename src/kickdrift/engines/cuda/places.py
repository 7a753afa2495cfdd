"""Positions in the form that pair sums read: float64, or whole numbers of 32 bits that count parts of the box.

Differences of the whole numbers wrap at 2^32 as the box does, so they are those of nearest images. Their float32 forms
have the relative error of float32. Neither form depends on the order of the particles.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from kickdrift.engines.cuda.law_code import Code, on_device
from kickdrift.engines.cuda.words import loaded, store
from kickdrift.model.state import Floats

PARTS = 2.0**32
ROUNDED = {"contract", "arcp", "nsz"}  # what float32 arithmetic may do; nan stays nan


class Places(NamedTuple):
    """Form of positions.

    Attributes
    ----------
    single : whether displacements are float32
    write : device function (places, i, x, y, z) that writes a position
    read : device function (places, i) that returns three numbers, and that of the species
    apart : device function of two such positions that returns the displacement of the nearest images
    """

    single: bool
    write: Code
    read: Code
    apart: Code

    @property
    def rounding(self) -> Any:
        """What arithmetic with displacements may do."""
        return ROUNDED if self.single else False


def places_of(edges: Floats, single: bool, mixture: bool) -> Places:
    """Form of positions in a box with perpendicular edges (3,), zero along open axes; ``single`` needs all three. In a
    mixture, a write keeps the number of the species."""
    a, b, c = (float(edge) for edge in edges)
    return _wrapped(a, b, c, mixture) if single else _plain(a, b, c)


@lru_cache(maxsize=8)
def _plain(a: float, b: float, c: float) -> Places:
    inverse_a, inverse_b, inverse_c = (1.0 / edge if edge else 0.0 for edge in (a, b, c))

    def write(places, i, x, y, z):
        places[4 * i], places[4 * i + 1], places[4 * i + 2] = x, y, z

    def read(places, i):
        x, y = loaded(places, np.uint32(2 * i))
        z, kind = loaded(places, np.uint32(2 * i + 1))
        return x, y, z, kind

    def apart(p, q):
        dx, dy, dz = p[0] - q[0], p[1] - q[1], p[2] - q[2]
        dx -= a * round_(dx * inverse_a)
        dy -= b * round_(dy * inverse_b)
        dz -= c * round_(dz * inverse_c)
        return dx, dy, dz

    round_ = on_device(nearest)
    return Places(False, on_device(write), on_device(read), on_device(apart))


def unplaced(places, i, x, y, z):
    """Write nothing, for forces that read the positions themselves."""


WRITE_NOTHING = on_device(unplaced)


def nearest(value: float) -> float:
    """The nearest whole number of a float64 below 2^51, as the sum with 1.5 x 2^52 rounds."""
    return (value + 6755399441055744.0) - 6755399441055744.0


@lru_cache(maxsize=8)
def _wrapped(a: float, b: float, c: float, mixture: bool) -> Places:
    inverse_a, inverse_b, inverse_c = 1.0 / a, 1.0 / b, 1.0 / c
    part_a, part_b, part_c = (np.float32(edge / PARTS) for edge in (a, b, c))

    def part(share):
        return np.int32(np.uint32(np.int64((share - math.floor(share)) * 4294967296.0) & 0xFFFFFFFF))

    def write_three(places, i, x, y, z):
        places[4 * i], places[4 * i + 1] = part_of(x * inverse_a), part_of(y * inverse_b)
        places[4 * i + 2] = part_of(z * inverse_c)

    def write_four(places, i, x, y, z):
        store(places, np.uint32(i), part_of(x * inverse_a), part_of(y * inverse_b), part_of(z * inverse_c), np.int32(0))

    def read(places, i):
        return loaded(places, i)

    def apart(p, q):
        return (
            np.float32(np.int32(np.int64(p[0]) - np.int64(q[0]))) * part_a,
            np.float32(np.int32(np.int64(p[1]) - np.int64(q[1]))) * part_b,
            np.float32(np.int32(np.int64(p[2]) - np.int64(q[2]))) * part_c,
        )

    part_of = on_device(part)
    return Places(True, on_device(write_three if mixture else write_four), on_device(read), on_device(apart))


def room_for(places: Places, n: int) -> Any:
    """Shape and type of the array of n positions."""
    return 4 * n, np.int32 if places.single else np.float64
