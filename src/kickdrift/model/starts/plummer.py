"""A Plummer sphere of stars."""

import math

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.checks.limits import check_particles
from kickdrift.model.checks.values import whole_number
from kickdrift.model.starts.builders import generator
from kickdrift.model.state import Floats

MOST_SCALED = 50_000  # most stars whose potential energy is summed over all pairs, in some ten seconds
BLOCK = 4_000_000  # pairs that are summed at a time


def plummer(count: int, seed: int, scaled: bool = True) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities (n, 3) and masses (n,) of equal stars in a Plummer sphere.

    Units are N-body units (Henon's): G = 1, total mass 1, energy -1/4. The centre of mass is at rest at the origin.

    The draws follow Aarseth, Henon & Wielen 1974 (A&A 37, 183, appendix): radii from the mass profile
    M(r) = r^3 / (r^2 + b^2)^(3/2), speeds as fractions of the escape speed from q^2 (1 - q^2)^(7/2), directions at
    random; b = 3 pi / 16. The random numbers come from NumPy's PCG64 with ``seed``.

    Parameters
    ----------
    count : stars, two or more
    scaled : stretch lengths and velocities, so that the energy of these very stars is -1/4 and twice their kinetic
        energy is minus their potential energy, to rounding. Unscaled, both hold for the smooth sphere, and drawn stars
        deviate by some 1 / sqrt(count). Scaling sums over pairs and is refused above 50,000 stars
    """
    count = whole_number("count", count, 2)
    check_particles("count", count)
    if scaled and count > MOST_SCALED:
        raise InputError(
            f"scaled: expected false above {MOST_SCALED} stars, because the energy is summed over all pairs; "
            f"got count = {count}"
        )
    rng = generator(seed)
    x, v, _ = draw(count, rng)
    masses = np.full(count, 1.0 / count)
    x -= x.mean(axis=0)
    v -= v.mean(axis=0)
    if scaled:
        potential, kinetic = -pair_sum(x) / count**2, 0.5 * float(np.sum(v**2)) / count
        x *= -2.0 * potential  # scales to U = -1/2 and K = 1/4
        v *= math.sqrt(0.25 / kinetic)
    return x, v, masses


def draw(count: int, rng: np.random.Generator) -> tuple[Floats, Floats, Floats]:
    """Positions and velocities (n, 3) of stars of Plummer's sphere in N-body units, and the energy of each alone."""
    b = 3 * math.pi / 16
    within = np.minimum(np.cbrt(rng.random(count)), 1.0 - 1e-15)  # the cube root of the mass inside r
    r = b * within / np.sqrt(1.0 - within**2)
    x = r[:, None] * directions(rng, count)
    escape = np.sqrt(2.0) * (r**2 + b**2) ** -0.25
    fractions = _speeds(rng, count)
    v = (escape * fractions)[:, None] * directions(rng, count)
    return x, v, (fractions**2 - 1.0) * 0.5 * escape**2


def directions(rng: np.random.Generator, count: int) -> Floats:
    """Vectors (count, 3) of length 1, in random directions."""
    up, turn = 2.0 * rng.random(count) - 1.0, 2 * math.pi * rng.random(count)
    flat = np.sqrt(1.0 - up**2)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=1)


def _speeds(rng: np.random.Generator, count: int) -> Floats:
    """Fractions of the escape speed by von Neumann's rejection. The density is at most 0.0922, below the bound 0.1."""
    taken = np.empty(0)
    while len(taken) < count:
        q, level = rng.random(2 * count), 0.1 * rng.random(2 * count)
        taken = np.concatenate([taken, q[level < q**2 * (1.0 - q**2) ** 3.5]])
    return taken[:count]


def pair_sum(x: Floats, masses: Floats | None = None) -> float:
    """Sum of 1 / r over pairs, or of m m' / r with masses."""
    rows = max(1, BLOCK // len(x))
    total = 0.0
    for start in range(0, len(x), rows):
        block = x[start : start + rows]
        r2 = sum((block[:, k, None] - x[None, start:, k]) ** 2 for k in range(3))
        later = np.arange(start, len(x))[None, :] > np.arange(start, start + len(block))[:, None]
        over = 1.0 / np.sqrt(r2[later])  # type: ignore[index]
        if masses is not None:
            over = over * np.outer(masses[start : start + rows], masses[start:])[later]
        total += float(np.sum(over))
    return total
