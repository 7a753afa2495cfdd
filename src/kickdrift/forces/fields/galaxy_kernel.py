"""Compiled potentials of galaxies: a sum over parts and bodies, on one thread, so that sums have a fixed order.

Accelerations are formulas of numbers or of duals, which have their slopes. Energies are of numbers alone.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.forces.fields.galaxy_parts import CODES, OPERATIONS
from kickdrift.forces.seam.kernel import OK, kernel
from kickdrift.jit.compile import as_written, jit, never_inline

if TYPE_CHECKING:
    from kickdrift.model.state import Floats
    from kickdrift.model.subject import Subject


class GalaxyKernel(NamedTuple):
    """The potential of a galaxy bound to a System."""

    rows: Floats  # (parts, 10) kind, G M, four lengths or numbers, angle, its rate, two constants
    centre: Floats  # (3,)
    masses: Floats  # (n,) coherent
    operations: NDArray[np.int64]  # of all strengths, one after the other
    numbers: Floats  # one for each operation
    firsts: NDArray[np.int64]  # (parts + 1,) first operation of each part


def bind(rows: Any, programs: Any, centre: Any, system: Subject) -> GalaxyKernel:
    """Bind the rows of parts, and the programs of their strengths."""
    steps = [step for program in programs for step in program]
    return GalaxyKernel(
        np.array(rows, float),
        np.array(centre, float),
        system.coherent_masses.copy(),
        np.array([code for code, _ in steps], np.int64),
        np.array([value for _, value in steps], float),
        np.cumsum([0, *map(len, programs)]).astype(np.int64),
    )


KEPLER, PLUMMER, ISOCHRONE, HERNQUIST, NFW, MIYAMOTO_NAGAI, POWER_LAW, LOGARITHMIC, BAR = CODES.values()
(
    NUMBER, TIME, NEG, ADD, SUB, MULT, DIV, POW, SQRT, EXP, LOG, SIN, COS, TAN, SEC, CSC, COT, SINH, COSH, TANH, SQUARE,
    CUBE, RECIP, ABS, STEP, MIN, MAX, SELECT,
) = range(len(OPERATIONS))  # fmt: skip
TINY = 1e-280  # a square of a length that keeps quotients at the centre finite
SMALL, LARGE = 2.5, 40.0  # squares of r / cutoff between which a continued fraction gives the mass of a power law


@jit
def strength_of(force, k, t):
    """Strength of part k at time t."""
    first, last = force.firsts[k], force.firsts[k + 1]
    if first == last:
        return 1.0
    stack, top = np.empty(last - first), -1
    for step in range(first, last):
        code = force.operations[step]
        if code in (NUMBER, TIME):
            top += 1
            stack[top] = force.numbers[step] if code == NUMBER else t
        elif code == SELECT:
            top -= 2
            stack[top] = stack[top + 1] if stack[top] != 0.0 else stack[top + 2]
        elif ADD <= code <= POW or code in (MIN, MAX):
            top -= 1
            stack[top] = of_two(code, stack[top], stack[top + 1])
        else:
            stack[top] = of_one(code, stack[top])
    return stack[0]


@jit
def of_two(code, x, y):
    """An operation on two numbers."""
    if code == ADD:
        return x + y
    if code == SUB:
        return x - y
    if code == MULT:
        return x * y
    if code == DIV:
        return x / y
    if code == POW:
        return x**y
    return min(x, y) if code == MIN else max(x, y)


@jit
def of_one(code, x):
    """An operation on one number."""
    if code == NEG:
        return -x
    if code == SQRT:
        return math.sqrt(x)
    if code == EXP:
        return math.exp(x)
    if code == LOG:
        return math.log(x)
    if code == SIN:
        return math.sin(x)
    if code == COS:
        return math.cos(x)
    if code == TAN:
        return math.tan(x)
    if code == SEC:
        return 1.0 / math.cos(x)
    if code == CSC:
        return 1.0 / math.sin(x)
    if code == COT:
        return 1.0 / math.tan(x)
    if code == SINH:
        return math.sinh(x)
    if code == COSH:
        return math.cosh(x)
    if code == TANH:
        return math.tanh(x)
    if code == SQUARE:
        return x * x
    if code == CUBE:
        return x * x * x
    if code == RECIP:
        return 1.0 / x
    if code == ABS:
        return abs(x)
    return 0.0 if x < 0.0 else 1.0


@as_written
def lower_sum(s, z):
    """The lower incomplete gamma function of s and z, over z^s, for small z: exp(-z) sum of z^k / (s ... (s + k)).

    Source: DLMF, section 8.7.1.
    """
    term = 1.0 / s + 0.0 * z
    total = term
    k = 1
    while term > 1e-17 * total:
        term = term * (z / (s + k))
        total = total + term
        k += 1
    return math.exp(-z) * total


@as_written
def upper_fraction(s, z):
    """The upper incomplete gamma function of s and z, over z^s exp(-z), for z from SMALL: a continued fraction.

    Source: DLMF, section 8.9.2.
    """
    k = 44 if z < 5.0 else (24 if z < 12.0 else 14)
    below = z + (2.0 * k + 1.0 - s)
    while k > 0:
        below = z + (2.0 * k - 1.0 - s) + (k * (s - k)) / below
        k -= 1
    return 1.0 / below


@as_written
def power_law_mass(row, r2):
    """Mass of a power law within r, over the total mass and r^3."""
    alpha, cutoff, over_gamma = row[2], row[3], row[8]
    s, z = 1.5 - 0.5 * alpha, r2 / (cutoff * cutoff)
    if z < SMALL:
        return over_gamma * cutoff ** (alpha - 3.0) * r2 ** (-0.5 * alpha) * lower_sum(s, z)
    if z < LARGE:
        return (1.0 - over_gamma * z**s * math.exp(-z) * upper_fraction(s, z)) * r2**-1.5
    return r2**-1.5


@as_written
def nfw_mass(s):
    """(ln(1 + s) - s / (1 + s)) / s^2, from its series near s = 0."""
    if s < 0.1:
        total = 17.0 / 18.0 + 0.0 * s
        k = 17
        while k > 1:
            total = (k - 1.0) / k - s * total
            k -= 1
        return total
    return (math.log1p(s) - s / (1.0 + s)) / (s * s)


@as_written
def spherical_pull(row, r2):
    """Acceleration of a spherical part towards the centre, over G M r."""
    kind = row[0]
    if kind == KEPLER:
        return r2**-1.5
    if kind == PLUMMER:
        return (r2 + row[2] * row[2]) ** -1.5
    if kind == ISOCHRONE:
        root = math.sqrt(r2 + row[2] * row[2])
        return 1.0 / (root * (row[2] + root) * (row[2] + root))
    if kind == POWER_LAW:
        return power_law_mass(row, r2 + TINY)
    r = math.sqrt(r2 + TINY)
    if kind == HERNQUIST:
        return 1.0 / (r * (r + row[2]) * (r + row[2]))
    return nfw_mass(r / row[2]) / (row[2] * row[2] * r)


@as_written
def disc_pull(row, across2, z):
    """Accelerations of a Miyamoto-Nagai disc over G M, and over minus the distance from the axis and minus z."""
    height = math.sqrt(z * z + row[3] * row[3])
    reach = row[2] + height
    along = (across2 + reach * reach) ** -1.5
    return along, along * reach / height


@as_written
def bar_pull(row, x, y, z):
    """Accelerations of a bar over G M, and over minus x, minus y and minus z, in the frame of the bar."""
    height = math.sqrt(z * z + row[4] * row[4])
    reach = row[3] + height
    off2 = y * y + reach * reach
    plus, minus = math.sqrt((row[2] + x) * (row[2] + x) + off2), math.sqrt((row[2] - x) * (row[2] - x) + off2)
    both = plus + minus
    over = 1.0 / (plus * minus)
    side = 0.5 * over * (both - 4.0 * (x * x) / both) / off2
    return 2.0 * over / both, side, side * reach / height


@as_written
def pulls(row, x, y, z):
    """Accelerations of a part over G M, and over minus x, minus y and minus z, in the frame of the part."""
    kind = row[0]
    if kind == MIYAMOTO_NAGAI:
        along, up = disc_pull(row, x * x + y * y, z)
        return along, along, up
    if kind == BAR:
        return bar_pull(row, x, y, z)
    if kind == LOGARITHMIC:
        flat, long = 1.0 / (row[3] * row[3]), 1.0 / (row[4] * row[4])
        over = 1.0 / (x * x + y * y * long + z * z * flat + (row[2] * row[2] + TINY))
        return over, over * long, over * flat
    pull = spherical_pull(row, x * x + y * y + z * z)
    return pull, pull, pull


@as_written
def upper_gamma(a, z, constant):
    """The upper incomplete gamma function for a from -1/2 to 1, also at a = 0; ``constant`` is (Gamma(1 + a) - 1) / a.

    Source for small z: DLMF, section 8.7.3, with z^a / a taken from both terms.
    """
    if z >= LARGE * 18.0:
        return 0.0
    if z >= SMALL:
        return z**a * math.exp(-z) * upper_fraction(a, z)
    power = a * math.log(z)
    total = constant - (math.expm1(power) / a if a != 0.0 else math.log(z))
    term = z**a
    for k in range(1, 40):
        term *= -z / k
        total -= term / (a + k)
    return total


@as_written
def potential_of(row, x, y, z):
    """Energy per mass of a part over G M, in the frame of the part."""
    kind, r2 = row[0], x * x + y * y + z * z
    r = math.sqrt(r2 + TINY)
    if kind == KEPLER:
        return -1.0 / r
    if kind == PLUMMER:
        return -1.0 / math.sqrt(r2 + row[2] * row[2])
    if kind == ISOCHRONE:
        return -1.0 / (row[2] + math.sqrt(r2 + row[2] * row[2]))
    if kind == HERNQUIST:
        return -1.0 / (r + row[2])
    if kind == NFW:
        return -math.log1p(r / row[2]) / r
    if kind == POWER_LAW:
        rest = upper_gamma(1.0 - 0.5 * row[2], (r2 + TINY) / (row[3] * row[3]), row[9])
        return -(power_law_mass(row, r2 + TINY) * r2 + row[8] * rest / row[3])
    if kind == LOGARITHMIC:
        return 0.5 * math.log(x * x + y * y / (row[4] * row[4]) + z * z / (row[3] * row[3]) + (row[2] * row[2] + TINY))
    reach = row[3] + math.sqrt(z * z + row[4] * row[4])
    if kind == MIYAMOTO_NAGAI:
        reach = row[2] + math.sqrt(z * z + row[3] * row[3])
        return -1.0 / math.sqrt(x * x + y * y + reach * reach)
    off2 = y * y + reach * reach
    both = math.sqrt((row[2] + x) * (row[2] + x) + off2) + math.sqrt((row[2] - x) * (row[2] - x) + off2)
    return -math.atanh(2.0 * row[2] / both) / row[2]


@kernel(GalaxyKernel)
def galaxy_forces(force, t, x, v, a, sums):
    never_inline()
    energy = 0.0
    for k in range(force.rows.shape[0]):
        row = force.rows[k]
        scale = row[1] * strength_of(force, k, t)
        turn = row[6] + row[7] * t
        cosine, sine = math.cos(turn), math.sin(turn)
        for i in range(x.shape[1]):
            dx, dy, dz = x[0, i] - force.centre[0], x[1, i] - force.centre[1], x[2, i] - force.centre[2]
            along, across = cosine * dx + sine * dy, cosine * dy - sine * dx
            first, second, third = pulls(row, along, across, dz)
            first, second = scale * first * along, scale * second * across
            a[0, i] -= cosine * first - sine * second
            a[1, i] -= sine * first + cosine * second
            a[2, i] -= scale * third * dz
            if sums is not None:
                energy += force.masses[i] * scale * potential_of(row, along, across, dz)
    if sums is not None:
        sums[0] += energy
    return OK
