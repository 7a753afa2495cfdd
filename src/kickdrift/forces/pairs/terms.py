"""Force of a pair law at many distances at once, by the engine's own code."""

from typing import Any

import numpy as np

from kickdrift.forces.pairs.binding import at_common_cutoff, law_class, truncation_at
from kickdrift.forces.pairs.lanes import pair_terms
from kickdrift.forces.pairs.law import PairForce
from kickdrift.jit.compile import driver
from kickdrift.jit.lanes.functions import lanes_like
from kickdrift.jit.lanes.memory import load, store
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.state import Floats


def force_over_r(force: PairForce, first: str, second: str, r2: Floats) -> Floats:
    """-U'(r) / r between two species, truncated, at squared distances (m,) below that of their cutoff."""
    law, end = law_class(force)(*map(float, force.pair_law(first, second))), force.pair_end(first, second)
    padded = np.full(-(-len(r2) // WIDTH) * WIDTH, 1.0)
    padded[: len(r2)] = r2
    found = np.empty_like(padded)
    evaluate((law, at_common_cutoff(law, end), truncation_at(end), None), padded, found)
    return found[: len(r2)]


@driver
def evaluate(laws: Any, r2: Floats, found: Floats) -> None:
    """Write the force over r at each r2 to found, eight at a time."""
    for k in range(0, r2.size, WIDTH):
        eight = load(r2, k)
        store(found, k, lanes_like(pair_terms(laws, 0, 0, eight)[1], eight))
