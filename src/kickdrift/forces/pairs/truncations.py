"""Truncations of pair laws: cut, shift, force-shift, switch and potential-switch, on numbers and on SIMD lanes.

One cutoff for all pairs is a number of the truncation. Where pairs of species end apart, the numbers of each pair stand
beside its parameters, in an `AtOwnCutoff`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.forces.pairs.ends import End
from kickdrift.jit.compile import as_written
from kickdrift.jit.duals.dual import of_lanes
from kickdrift.jit.duals.operators import dual_like
from kickdrift.jit.inner import by_type
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.vectors import Lanes


class AtCutoff(NamedTuple):
    """Energy and force over r of a pair at the cutoff."""

    energy: float
    force_over_r: float


class Cut(NamedTuple):
    """U(r) unchanged: the energy jumps at the cutoff, so no method conserves it."""

    def apply(self, at_cutoff, r2, energy, force_over_r):
        return energy, force_over_r


class Shift(NamedTuple):
    """U(r) - U(r_c): the energy is continuous, the force jumps at the cutoff."""

    def apply(self, at_cutoff, r2, energy, force_over_r):
        return energy - at_cutoff.energy, force_over_r


class ForceShift(NamedTuple):
    """U(r) - U(r_c) + (r - r_c) F(r_c): energy and force are continuous (Toxvaerd & Dyre 2011,
    doi:10.1063/1.3558787)."""

    cutoff: float

    def apply(self, at_cutoff, r2, energy, force_over_r):
        force_at_cutoff = at_cutoff.force_over_r * self.cutoff
        r = math.sqrt(r2)
        shifted = energy - at_cutoff.energy + (r - self.cutoff) * force_at_cutoff
        return shifted, force_over_r - force_at_cutoff / r


class Switch(NamedTuple):
    """U(r) S(r), where S falls from 1 at ``start`` to 0 at the cutoff, four times continuously differentiable.

    S = (1 - u)^5 (1 + 5 u + 15 u^2 + 35 u^3 + 70 u^4) is the smooth step of degree nine (Ebert et al., Texturing and
    Modeling, 2003, ch. 2, generalised). Its argument u = (r^2 - start^2) / (r_c^2 - start^2) needs no square root, and
    this form has no cancellation at the cutoff. The degree is high because a potential with k continuous derivatives
    limits a method to order k.
    """

    start2: float
    inverse_width: float  # 1 / (r_c^2 - start^2)

    def apply(self, at_cutoff, r2, energy, force_over_r):
        u = positive((r2 - self.start2) * self.inverse_width)  # above 1 only beyond the cutoff, where lanes are masked
        w = 1.0 - u
        w2, uw = w * w, u * w
        s = w2 * w2 * w * (1.0 + u * (5.0 + u * (15.0 + u * (35.0 + u * 70.0))))
        # F / r = -(1/r) d(U S)/dr = F_U S / r - U dS/du du/dr / r, with du/dr / r = 2 / (r_c^2 - start^2)
        uw2 = uw * uw
        slope = 1260.0 * self.inverse_width * (uw2 * uw2)
        return energy * s, force_over_r * s + energy * slope


class PotentialSwitch(NamedTuple):
    """U(r) S(r), where S falls from 1 at ``start`` to 0 at the cutoff, twice continuously differentiable.

    S = (1 - u)^3 (1 + 3 u + 6 u^2) with u = (r - start) / (r_c - start) is the switching function of OpenMM, and
    GROMACS' "Potential-switch".
    """

    start: float
    inverse_way: float  # 1 / (r_c - start)

    def apply(self, at_cutoff, r2, energy, force_over_r):
        r = math.sqrt(r2)
        u = positive((r - self.start) * self.inverse_way)
        w = 1.0 - u
        w2, u2 = w * w, u * u
        s = w2 * w * (1.0 + u * (3.0 + u * 6.0))
        return energy * s, force_over_r * s + energy * (30.0 * self.inverse_way * (u2 * w2)) / r


@by_type
def positive(u):
    """Return u, or zero where u is negative."""
    if isinstance(u, Lanes):
        return lambda u: select(u > 0.0, u, 0.0)
    if of_lanes(u):
        return lambda u: np.where(u > 0.0, u, 0.0)
    return lambda u: max(u, 0.0)


class AtOwnCutoff(NamedTuple):
    """Energy and force over r of a pair at its own cutoff, and the numbers of its truncation.

    ``apply`` of `ForceShift` and the switches finds here the numbers that it else has itself. Energy and force over r
    are zero where the pair's truncation does not shift them; ``shifted`` and ``force_shifted`` are 1 where it does,
    else 0.
    """

    energy: float
    force_over_r: float
    cutoff: float
    cutoff2: float
    start2: float
    inverse_width: float  # zero without a switch, which then is 1 everywhere
    start: float
    inverse_way: float  # likewise
    shifted: float
    force_shifted: float


class OfPairs(NamedTuple):
    """Truncations of pairs of species that end apart, with the numbers of each in its `AtOwnCutoff`."""

    first: Any  # one of the truncations above, without numbers
    then: Any  # `Switch`, or `Cut` where no pair has it
    last: Any  # `PotentialSwitch`, or `Cut` likewise


def of_pairs(ends: set[End]) -> OfPairs:
    """The truncations that the pairs with these ends need."""
    names = {end.truncation for end in ends}
    first: Any = ForceShift(0.0) if "force-shift" in names else Shift() if "shift" in names else Cut()
    then: Any = Switch(0.0, 0.0) if "switch" in names else Cut()
    return OfPairs(first, then, PotentialSwitch(0.0, 0.0) if "potential-switch" in names else Cut())


def at_own_cutoff(law: Any, end: End) -> AtOwnCutoff:
    """The numbers of a pair with this law and this end."""
    energy, force_over_r = law.law(end.cutoff**2)
    cutoff = float(end.cutoff)
    shifted, force_shifted = float("shift" in end.truncation), float(end.truncation == "force-shift")
    square, plain = float(end.truncation == "switch"), float(end.truncation == "potential-switch")
    start = float(end.switch_start or 0.0)
    return AtOwnCutoff(
        shifted * float(energy), force_shifted * float(force_over_r), cutoff, cutoff**2,
        start**2, square / (cutoff**2 - start**2), start, plain / (cutoff - start), shifted, force_shifted,
    )  # fmt: skip


@by_type
def truncated(truncation, at_cutoff, r2, energy, force_over_r):
    """Return energy and force over r of a truncated law: below the common cutoff, or of pairs that end apart at all
    distances."""
    if truncation.instance_class is OfPairs:
        first, then, last = (as_written(each.instance_class.apply) for each in truncation.types)

        def of_pair(truncation, at_cutoff, r2, energy, force_over_r):
            energy, force_over_r = first(at_cutoff, at_cutoff, r2, energy, force_over_r)
            energy, force_over_r = then(at_cutoff, at_cutoff, r2, energy, force_over_r)
            energy, force_over_r = last(at_cutoff, at_cutoff, r2, energy, force_over_r)
            return nearer(r2, at_cutoff.cutoff2, energy), nearer(r2, at_cutoff.cutoff2, force_over_r)

        return of_pair
    apply = as_written(truncation.instance_class.apply)
    return lambda truncation, at_cutoff, r2, energy, force_over_r: apply(
        truncation, at_cutoff, r2, energy, force_over_r
    )


@by_type
def nearer(r2, cutoff2, value):
    """Return the value where r2 is below the square of the cutoff, else zero."""
    if isinstance(r2, Lanes):
        return lambda r2, cutoff2, value: select(r2 < cutoff2, value, 0.0)
    if of_lanes(r2):
        return lambda r2, cutoff2, value: np.where(r2 < cutoff2, value, 0.0)
    return lambda r2, cutoff2, value: value if r2 < cutoff2 else 0.0


@by_type
def end_of(at_cutoff, cutoff2):
    """Return the square of a pair's cutoff; ``cutoff2`` is the common one."""
    if at_cutoff.instance_class is AtOwnCutoff:
        return lambda at_cutoff, cutoff2: at_cutoff.cutoff2
    return lambda at_cutoff, cutoff2: cutoff2


@by_type
def ended(at_cutoff, energy, force_over_r):
    """Return what ``at_cutoff`` is, with duals of the energy and force over r of the law at the cutoff."""
    if at_cutoff.instance_class is not AtOwnCutoff:
        return lambda at_cutoff, energy, force_over_r: AtCutoff(energy, force_over_r)

    def own(at_cutoff, energy, force_over_r):
        shifted, force_shifted = dual_like(at_cutoff.shifted, energy), dual_like(at_cutoff.force_shifted, energy)
        return AtOwnCutoff(
            shifted * energy,
            force_shifted * force_over_r,
            dual_like(at_cutoff.cutoff, energy),
            dual_like(at_cutoff.cutoff2, energy),
            dual_like(at_cutoff.start2, energy),
            dual_like(at_cutoff.inverse_width, energy),
            dual_like(at_cutoff.start, energy),
            dual_like(at_cutoff.inverse_way, energy),
            shifted,
            force_shifted,
        )

    return own
