"""Truncations of a pair law at the cutoff: cut, shift, force-shift and switch.

Each works on numbers and on SIMD lanes."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from kickdrift.jit.compile import as_written
from kickdrift.jit.duals import functions as functions  # what duals take part in
from kickdrift.jit.duals.dual import of_lanes
from kickdrift.jit.inner import overload
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


def positive(u: Any) -> Any:
    """Return u, or zero where u is negative."""


@overload(positive)
def _positive(u):
    if isinstance(u, Lanes):
        return lambda u: select(u > 0.0, u, 0.0)
    if of_lanes(u):
        return lambda u: np.where(u > 0.0, u, 0.0)
    return lambda u: max(u, 0.0)


def truncated(truncation: Any, at_cutoff: Any, r2: Any, energy: Any, force_over_r: Any) -> Any:
    """Return energy and force over r of a truncated law, below its cutoff."""


@overload(truncated)
def _truncated(truncation, at_cutoff, r2, energy, force_over_r):
    apply = as_written(truncation.instance_class.apply)
    return lambda truncation, at_cutoff, r2, energy, force_over_r: apply(
        truncation, at_cutoff, r2, energy, force_over_r
    )
