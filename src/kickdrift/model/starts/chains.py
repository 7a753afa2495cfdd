"""Random chains: each a walk of equal steps that does not fold back onto itself."""

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.limits import check_particles
from kickdrift.model.checks.values import positive, whole_number
from kickdrift.model.starts.builders import generator
from kickdrift.model.state import Floats


def random_chains(count: int, length: int, corners: Floats, bond: float, apart: float = 0.0, seed: int = 0) -> Floats:
    """Positions (count * length, 3) of chains whose bonds point at random, one chain after the other.

    Chains begin anywhere in the box and go on beyond its faces. A bond is drawn again where its end lies nearer than
    ``apart`` to the particle before the last, as Kremer and Grest do (1990, doi:10.1063/1.458541). The chain is then a
    freely rotating one: neighbouring bonds have the mean cosine c = (apart / (2 bond))², and N of them have
    <R²> = N bond² [(1 + c) / (1 - c) - 2 c (1 - c^N) / (N (1 - c)²)]. Particles overlap with others; a minimization
    moves them apart.

    Parameters
    ----------
    count, length : chains, and particles of each
    corners : (3, 3) edges of the box, one per row
    bond : length of a bond
    apart : least distance of next neighbours but one, below 2 bond; 0 gives freely jointed chains
    seed : of NumPy's PCG64

    Raises
    ------
    InputError
        For numbers outside these ranges.
    """
    count, length, bond = whole_number("count", count, 1), whole_number("length", length, 2), positive("bond", bond)
    check_particles("count", count * length)
    if not 0.0 <= apart < 2.0 * bond:
        raise InputError(f"apart: expected 0 or more, and less than two bonds, which are {2.0 * bond:g}, got {apart:g}")
    rng = generator(seed)
    x = np.empty((length, count, 3))
    x[0] = rng.random((count, 3)) @ corners
    # A direction at the angle t to the last bond is allowed if 2 bond² (1 + cos t) >= apart².
    lowest = 0.5 * (apart / bond) ** 2 - 1.0
    along = _directions(rng, count, np.zeros((count, 3)), -1.0)
    x[1] = x[0] + bond * along
    for k in range(2, length):
        along = _directions(rng, count, along, lowest)
        x[k] = x[k - 1] + bond * along
    return np.ascontiguousarray(x.transpose(1, 0, 2).reshape(-1, 3))


def _directions(rng: np.random.Generator, count: int, last: Floats, lowest: float) -> Floats:
    """Random directions (count, 3), each at a cosine of at least ``lowest`` to its ``last`` one."""
    found, todo = np.empty((count, 3)), np.arange(count)
    while len(todo):
        drawn = rng.standard_normal((len(todo), 3))
        found[todo] = drawn / np.linalg.norm(drawn, axis=1)[:, None]
        todo = todo[(found[todo] * last[todo]).sum(axis=1) < lowest]
    return found
