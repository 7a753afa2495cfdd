"""The part of Coulomb's law that the list of pairs sums: 1 / r less a smooth function of the squared distance.

Ewald's near part, a reaction field and the damped shifted force all have this form. The smooth function is a polynomial
of r^2, so a pair costs a square root, a division and a polynomial, and no exponential. In Ewald's near part,
erf(a r) / r is an entire function of r^2. So its Chebyshev series converges faster than any geometric series (Trefethen
2013, Approximation Theory and Approximation Practice, theorem 8.2).
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from kickdrift.model.state import Floats

EWALD, PME, AUTO, DIRECT, REACTION_FIELD, DAMPED_SHIFTED = METHODS = (
    "ewald",
    "pme",
    "auto",
    "direct",
    "reaction-field",
    "damped-shifted",
)
ALL_IMAGES = (EWALD, PME, AUTO)  # methods that sum over all images
BLOCK = 8  # coefficients that compiled code takes at once
BLOCKS = (1, 2, 3, 4)  # possible lengths of the polynomials, in blocks
POINTS = 400  # at which a series is compared with its function
STRONGEST = 6.0  # largest product of splitting parameter and cutoff that 32 coefficients serve

Blocks = tuple[tuple[float, ...], ...]


class Radial(NamedTuple):
    """U(r) / (q q) = 1 / r - P(s) + slope r below the cutoff, with s = scale r^2 - 1 from -1 to 1.

    Attributes
    ----------
    cutoff2 : squared cutoff
    scale : 2 / cutoff^2
    slope : of the part that is linear in r
    smooth : coefficients of P in blocks of eight, lowest power first
    pull : coefficients of 2 dP / d(r^2), likewise
    """

    cutoff2: float
    scale: float
    slope: float
    smooth: Blocks
    pull: Blocks


def force_over_r(radial: Radial, r2: Floats) -> Floats:
    """-U'(r) / r of two unit charges at squared distances below that of the cutoff."""
    s, inverse = radial.scale * r2 - 1.0, r2**-0.5
    return np.asarray(inverse**3 - radial.slope * inverse + polynomial.polyval(s, np.concatenate(radial.pull)))


def radial_of(cutoff: float, coefficients: Floats, slope: float = 0.0) -> Radial:
    """The Radial with these coefficients of P, lowest power first."""
    scale = 2.0 / cutoff**2
    pull = np.asarray(2.0 * scale * polynomial.polyder(coefficients), np.float64)
    count = -(-len(coefficients) // BLOCK)
    return Radial(cutoff**2, scale, slope, _blocks(coefficients, count), _blocks(pull, count))


def _blocks(coefficients: Floats, count: int) -> Blocks:
    padded = np.zeros(count * BLOCK)
    padded[: len(coefficients)] = coefficients
    return tuple(tuple(block) for block in padded.reshape(count, BLOCK).tolist())


def ewald_near(alpha: float, cutoff: float, accuracy: float) -> Radial:
    """Ewald's near part erfc(alpha r) / r. The polynomial is the shortest with an error far below the accuracy."""
    return radial_of(cutoff, _screening(alpha, cutoff, 1e-3 * accuracy))


def damped_shifted(alpha: float, cutoff: float) -> Radial:
    """erfc(alpha r) / r, shifted so that energy and force vanish at the cutoff (Fennell & Gezelter 2006,
    doi:10.1063/1.2206581, eqs. 18 and 19)."""
    from scipy.special import erfc

    at_end = float(erfc(alpha * cutoff)) / cutoff
    gaussian = 2.0 * alpha / math.sqrt(math.pi) * math.exp(-((alpha * cutoff) ** 2))
    slope = (at_end + gaussian) / cutoff
    coefficients = _screening(alpha, cutoff, 0.0)
    coefficients[0] += at_end + slope * cutoff
    return radial_of(cutoff, coefficients, slope)


def reaction_field(cutoff: float, surroundings: float | None) -> Radial:
    """Coulomb's law with the field of a medium of this relative permittivity beyond the cutoff, None for a conductor
    (Tironi et al. 1995, doi:10.1063/1.469273, eqs. 4 and 5)."""
    part = 0.5 if surroundings is None else (surroundings - 1.0) / (2.0 * surroundings + 1.0)
    at_half = 0.5 * part / cutoff  # part r^2 / cutoff^3 is part / (2 cutoff) (s + 1)
    return radial_of(cutoff, np.array([(1.0 + part) / cutoff - at_half, -at_half]))


def _screening(alpha: float, cutoff: float, wanted: float) -> Floats:
    """Coefficients of erf(alpha r) / r in powers of s. The error of the slope of erf(z) / z by z^2 is ``wanted``, or
    what the longest polynomial gives."""
    most = 0.5 * (alpha * cutoff) ** 2
    s = np.linspace(-1.0, 1.0, POINTS)
    exact = _slope(most * (1.0 + s))
    for count in BLOCKS[1:]:
        found = chebyshev.cheb2poly(chebyshev.chebinterpolate(_over(most), count * BLOCK - 1))
        error = np.abs(polynomial.polyval(s, polynomial.polyder(found)) / most - exact).max() if most else 0.0
        if error <= wanted:
            break
    return np.asarray(alpha * found)


def _over(most: float) -> Any:
    """erf(z) / z as a function of s, with z^2 = most (1 + s)."""
    from scipy.special import erf

    def value(s: Floats) -> Floats:
        z = np.sqrt(np.maximum(most * (1.0 + s), 1e-30))
        return np.asarray(erf(z) / z)

    return value


def _slope(square: Floats) -> Floats:
    """Derivative of erf(z) / z by z^2."""
    from scipy.special import erf

    z = np.sqrt(np.maximum(square, 1e-30))
    near = -2.0 / math.sqrt(math.pi) * (1.0 / 3.0 - square / 5.0 + square**2 / 14.0)
    with np.errstate(all="ignore"):
        far = (2.0 / math.sqrt(math.pi) * np.exp(-square) - erf(z) / z) / (2.0 * square)
    return np.where(square < 1e-3, near, far)
