"""Compiled terms of charged pairs: a pair law, if there is one, and the near part of Coulomb's law, in one pass.

Each slot of the list has its particle's charge. Charges are scaled so that the product of two is in the unit of energy
times length.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from kickdrift.forces.charges.radial import Radial
from kickdrift.forces.lists.pair_rows import slot_of
from kickdrift.forces.pairs import upkeep
from kickdrift.forces.pairs.intra_cluster import terms_within
from kickdrift.forces.pairs.kernel import PairKernel, add_forces, compute_for
from kickdrift.forces.pairs.lanes import pair_terms
from kickdrift.forces.pairs.upkeep import brings_terms, fill_tables
from kickdrift.jit.compile import as_written
from kickdrift.jit.handle import Handle
from kickdrift.jit.inner import by_type, overload
from kickdrift.jit.lanes.functions import inverse_sqrt, lanes_like, multiply_add
from kickdrift.jit.lanes.masks import select
from kickdrift.jit.lanes.memory import broadcast, load, load_like
from kickdrift.jit.lanes.single import load_four_times, load_single
from kickdrift.jit.lanes.vectors import WIDTH, half_single_type, lanes_type, single_type


class ChargedPairs(NamedTuple):
    """Law of charged pairs, in the place of a pair law."""

    own: Any  # the law of a pair force, or None
    own_cutoff2: float
    radial: Radial


class ChargedTables(NamedTuple):
    """Numbers of the slots, in the place of the tables of a pair law."""

    own: Any  # the tables of the pair law, or None
    charges: NDArray[np.float64]  # (n,)
    slots: NDArray[np.float64]  # (slots,) charge in each slot; padding has none
    single: Any = None  # in mixed precision, the same as float32
    fours: Any = None  # and with each number four times, (4 slots,), for rows of tiles


ChargedPairs.brings_terms = True  # type: ignore[attr-defined]  # see `pairs.lanes.brings_terms`
ChargedTables.brings_terms = True  # type: ignore[attr-defined]


class ChargedPairKernel(PairKernel):
    """A bound sum of charged pairs. Steps in sorted order, which `PairKernel` takes, are for pair laws alone."""

    def _compute_for(self, kind: types.Type) -> Callable[..., int]:
        return compute_for(kind, add_forces, fill_tables)


@overload(pair_terms)
def _pair_terms(laws, i, place, r2):
    if not brings_terms(laws[0]):
        return None

    def terms(laws, i, place, r2):
        return with_charges(laws, own_terms(laws, i, place, r2), product_of(laws[3], i, slot_of(place), r2), r2)

    return terms


@by_type
def product_of(tables, i, j, r2):
    """Return the products of the charge in slot i, or with 16 lanes in the four slots from i on, with those from slot j
    on."""
    if r2 == single_type:
        return lambda tables, i, j, r2: load_single(tables.fours, 4 * i) * load_four_times(tables.single, j)
    if r2 == half_single_type:
        return lambda tables, i, j, r2: broadcast(tables.single, i, r2) * load_like(tables.single, j, r2)
    return lambda tables, i, j, r2: broadcast(tables.slots, i, r2) * load_like(tables.slots, j, r2)


@overload(terms_within, prefer_literal=True)
def _terms_within(laws, at, places, r2):
    if not brings_terms(laws[0]):
        return None

    def terms(laws, at, places, r2):
        slots = laws[3].slots
        others = np.empty(WIDTH)
        for lane in range(WIDTH):
            others[lane] = slots[at + (lane + places) % WIDTH]
        return with_charges(laws, own_terms_within(laws, at, places, r2), load(slots, at) * load(others, 0), r2)

    return terms


@by_type
def own_terms(laws, i, place, r2):
    """Return the terms of the pair law alone, zero beyond its own cutoff; None without one."""
    if isinstance(laws[0].types[0], types.NoneType):
        return lambda laws, i, place, r2: None

    def terms(laws, i, place, r2):
        found = pair_terms((laws[0].own, laws[1], laws[2], laws[3].own), i, place, r2)
        return below(r2 < laws[0].own_cutoff2, found)

    return terms


@by_type(prefer_literal=True)
def own_terms_within(laws, at, places, r2):
    """Return the terms of the pair law alone among a cluster's particles, likewise."""
    if isinstance(laws[0].types[0], types.NoneType):
        return lambda laws, at, places, r2: None

    def terms(laws, at, places, r2):
        found = terms_within((laws[0].own, laws[1], laws[2], laws[3].own), at, places, r2)
        return below(r2 < laws[0].own_cutoff2, found)

    return terms


@as_written
def below(inside, terms):
    """Return energy and force over r where ``inside``, else zero."""
    energy, force_over_r = terms
    return select(inside, energy, 0.0), select(inside, force_over_r, 0.0)


@by_type
def with_charges(laws, own, product, r2):
    """Return the terms ``own`` plus the terms of two charges with this ``product``."""
    alone = isinstance(own, types.NoneType)

    def charged(laws, own, product, r2):
        radial = laws[0].radial
        energy, force_over_r = radial_terms(radial, r2)
        energy, force_over_r = below(r2 < radial.cutoff2, (product * energy, product * force_over_r))
        return (energy, force_over_r) if alone else (own[0] + energy, own[1] + force_over_r)

    return charged


@as_written
def radial_terms(radial, r2):
    """Return energy and force over r of two unit charges at squared distances in lanes; see `Radial`."""
    inverse = inverse_root(r2)
    s = multiply_add(lanes_like(radial.scale, r2), r2, lanes_like(-1.0, r2))
    slope = lanes_like(radial.slope, r2)
    energy = inverse - polynomial(radial.smooth, s) + slope * (r2 * inverse)
    return energy, multiply_add(inverse * inverse - slope, inverse, polynomial(radial.pull, s))


@by_type
def inverse_root(r2):
    """Return 1 / r."""
    return (lambda r2: inverse_sqrt(r2)) if r2 == lanes_type else (lambda r2: 1.0 / math.sqrt(r2))


@by_type
def polynomial(blocks, s):
    """Return the polynomial with these blocks of eight coefficients, lowest power first."""

    def powers(blocks, s):
        s2 = s * s
        return higher(blocks, s, s2, s2 * s2)

    return powers


@by_type
def higher(blocks, s, s2, s4):
    """Return the polynomial, given also the second and fourth power of s."""
    if len(blocks) == 1:
        return lambda blocks, s, s2, s4: eight_terms(blocks[0], s, s2, s4)
    return lambda blocks, s, s2, s4: multiply_add(
        s4 * s4, higher(blocks[1:], s, s2, s4), eight_terms(blocks[0], s, s2, s4)
    )


@as_written
def eight_terms(c, s, s2, s4):
    """Return the sum of c[k] s^k for k below 8, by pairs (Estrin 1960)."""
    first = multiply_add(pair(c[3], c[2], s), s2, pair(c[1], c[0], s))
    return multiply_add(multiply_add(pair(c[7], c[6], s), s2, pair(c[5], c[4], s)), s4, first)


@as_written
def pair(a, b, s):
    """Return a s + b of lanes s."""
    return multiply_add(lanes_like(a, s), s, lanes_like(b, s))


@overload(upkeep.spread)
def _spread(tables, pairs):
    if not brings_terms(tables):
        return None

    def spread_charges(tables, pairs):
        tables.slots[:] = 0.0
        for i in range(pairs.place.size):
            p = pairs.place[i]
            tables.slots[slot_of(p)] = tables.charges[i]
        spread_single(tables)
        upkeep.spread(tables.own, pairs)

    return spread_charges


@by_type
def spread_single(tables):
    """In mixed precision, copy the charges of all slots to float32."""
    kind = tables.kind if isinstance(tables, Handle) else tables
    if isinstance(kind.types[3], types.NoneType):
        return lambda tables: None

    def spread_charges(tables):
        for k in range(tables.slots.size):
            tables.single[k] = tables.slots[k]
            tables.fours[4 * k : 4 * k + 4] = tables.slots[k]

    return spread_charges
