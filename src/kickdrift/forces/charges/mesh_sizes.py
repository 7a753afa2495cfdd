"""Sizes of a mesh: numbers of points that the transform takes, and orders of the splines."""

from __future__ import annotations

ORDERS = (4, 5, 6, 7, 8)
SMALLEST = 8  # shortest line: a line takes two passes or more, since no pass of the transform works in place
IMAGES = 8  # images of a wave on the mesh whose splines count


def is_smooth(n: int) -> bool:
    """Tell whether the transform takes lines of n points: n has no prime factor over 5."""
    for radix in (2, 3, 5):
        while n % radix == 0:
            n //= radix
    return n == 1
