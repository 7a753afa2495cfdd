"""The order conditions of methods for y'' = f(t, y), from the special Nyström trees, in exact rational arithmetic.

Hairer, Nørsett & Wanner 1993, Solving Ordinary Differential Equations I, II.14, doi:10.1007/978-3-540-78862-1.

A splitting is the explicit Nyström method Y_i = y + c_i h y' + h^2 sum_j abar_ij f(Y_j), with
y1 = y + h y' + h^2 sum_i bbar_i f(Y_i), y1' = y' + h sum_i b_i f(Y_i). It has order p if its drifts add up to one and

    sum_i b_i Phi_i(tree) = 1 / gamma(tree)                    for every tree of order up to p,
    sum_i bbar_i Phi_i(tree) = 1 / ((rho + 1) gamma(tree))     for every tree of order rho up to p - 1.

Time is one more y, with y' = 1 and f = 0: only drifts move it, as they move the clock of a splitting. So f(t, y) needs
no further condition.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cache
from itertools import accumulate, combinations_with_replacement
from math import prod
from operator import mul
from typing import NamedTuple


class Tree(NamedTuple):
    """A derivative of f by y, applied to y' once for each leaf, and to f in each of the branches."""

    leaves: int
    branches: tuple[Tree, ...] = ()


class Condition(NamedTuple):
    """Condition sum of terms = value, for every method of this order or more."""

    order: int
    terms: list[Fraction]
    value: Fraction

    @property
    def residual(self) -> Fraction:
        return abs(sum(self.terms) - self.value)

    @property
    def size(self) -> Fraction:
        return sum(map(abs, self.terms), Fraction())


def rho(tree: Tree) -> int:
    """Order of a tree: the power of h at the tree in y'."""
    return 1 + tree.leaves + sum(rho(branch) + 1 for branch in tree.branches)


def gamma(tree: Tree) -> int:
    """Density of a tree: its factor is h^rho / gamma in y'(h) and h^(rho + 1) / ((rho + 1) gamma) in y(h)."""
    return rho(tree) * prod((rho(branch) + 1) * gamma(branch) for branch in tree.branches)


@cache
def trees(order: int) -> tuple[Tree, ...]:
    """All trees of an order, each once: some branches, and leaves for the rest of the order."""
    return tuple(
        Tree(order - 1 - height, branches) for height in range(order) for branches in forests(height, height - 1)
    )


@cache
def forests(height: int, largest: int) -> tuple[tuple[Tree, ...], ...]:
    """All multisets of trees of orders up to ``largest`` that, as branches, add ``height`` to the order of a tree."""
    if height == 0:
        return ((),)
    return tuple(
        (*alike, *others)
        for order in range(largest, 0, -1)
        for count in range(1, height // (order + 1) + 1)
        for alike in combinations_with_replacement(trees(order), count)
        for others in forests(height - count * (order + 1), order - 1)
    )


def conditions(kick: Sequence[float], drift: Sequence[float], first: str, order: int) -> Iterator[Condition]:
    """Order conditions of a row of kicks and drifts, whose numbers are taken as exact."""
    b = [Fraction(weight) for weight in kick]
    passed = list(accumulate(map(Fraction, drift), initial=Fraction()))  # times before the first drift, the second, ...
    end = passed[-1]
    c = passed[: len(b)] if first == "kick" else passed[1 : len(b) + 1]
    b_bar = [b[i] * (end - c[i]) for i in range(len(b))]
    a_bar = [[b[j] * (c[i] - c[j]) for j in range(i)] for i in range(len(b))]

    @cache
    def phi(tree: Tree) -> list[Fraction]:
        weights = [c_i**tree.leaves for c_i in c]
        for branch in tree.branches:
            weights = [
                weight * sum(map(mul, row, phi(branch)), Fraction()) for weight, row in zip(weights, a_bar, strict=True)
            ]
        return weights

    yield Condition(1, [Fraction(weight) for weight in drift], Fraction(1))
    for rank in range(1, order + 1):
        for tree in trees(rank):
            yield Condition(rank, list(map(mul, b, phi(tree))), Fraction(1, gamma(tree)))
            if rank < order:
                value = Fraction(1, (rank + 1) * gamma(tree))
                yield Condition(rank + 1, list(map(mul, b_bar, phi(tree))), value)
