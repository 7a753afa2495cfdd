"""The order of particles in a file's frames, where events have absorbed or removed bodies."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from kickdrift.model.state import Floats


def in_order(
    vectors: Mapping[str, Floats], ids: NDArray[np.int64], wanted: NDArray[np.int64], absorbed: Mapping[int, int]
) -> Mapping[str, Floats] | None:
    """Vectors (n, 3) of the particles ``ids`` in the order ``wanted``; None if particles are too many or lacking.

    An absorbed body has the values of the body that absorbed it, a removed body nan. ``absorbed`` has the id of the
    former, and a negative number for the latter."""
    if ids is wanted or np.array_equal(ids, wanted):
        return vectors
    row_of = {int(each): row for row, each in enumerate(ids)}
    order = np.array([row_of.get(_survivor(int(each), absorbed), -1) for each in wanted])
    missing = order < 0
    if len(ids) > len(wanted) or any(int(each) not in absorbed for each in wanted[missing]):
        return None
    found = {name: vector[order] for name, vector in vectors.items()}
    for vector in found.values():
        vector[missing] = np.nan
    return found


def _survivor(body: int, absorbed: Mapping[int, int]) -> int:
    """The id of the body that now contains this body."""
    while body in absorbed:
        body = absorbed[body]
    return body
