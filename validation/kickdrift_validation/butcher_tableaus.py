"""Runge-Kutta rows of the registry: order conditions in exact arithmetic, and SciPy's own numbers.

A method has order p where sum_i b_i Phi_i(t) = 1 / gamma(t) for every rooted tree t of p vertices or fewer (Butcher
1963, doi:10.1017/S1446788700027932); what is left is given in units of eps times the absolute values of the terms, so
that 1 is a rounding. One tree of p + 1 vertices must fail by far, else the order stated is too low.
"""

from collections.abc import Iterator, Sequence
from fractions import Fraction
from functools import cache
from itertools import combinations_with_replacement
from math import prod

import numpy as np
from scipy.integrate._ivp import rk

from kickdrift.integrators import INTEGRATORS, integrator
from kickdrift.integrators.own.registration import REGISTERED
from kickdrift_validation.claim import Claim, at_most, claim, largest, main

Tree = tuple  # the sorted trees that hang on its root (Hairer, Nørsett & Wanner 1993, II.2); () is a single vertex
EPS = Fraction(1, 2**52)


@cache
def order(tree: Tree) -> int:
    return 1 + sum(order(branch) for branch in tree)


@cache
def gamma(tree: Tree) -> int:
    """The density: the order times the densities of what hangs on the root; Definition II.2.10."""
    return order(tree) * prod(gamma(branch) for branch in tree)


@cache
def trees(vertices: int) -> tuple[Tree, ...]:
    """All trees of so many vertices: 1, 1, 2, 4, 9, 20, 48, 115, 286, …"""
    return tuple(dict.fromkeys(tuple(sorted(forest)) for forest in _forests(vertices - 1, vertices - 1)))


@cache
def _forests(vertices: int, largest: int) -> tuple[Tree, ...]:
    """All collections of trees, none of more than ``largest`` vertices, with so many vertices in all."""
    if vertices == 0:
        return ((),)
    if largest == 0:
        return ()
    found = []
    for count in range(vertices // largest + 1):
        rest = _forests(vertices - count * largest, largest - 1)
        for branches in combinations_with_replacement(trees(largest), count) if count else [()]:
            found += [(*branches, *others) for others in rest]
    return tuple(found)


class Weights:
    """Phi_i(t) of a method, i over its stages: 1 for a single vertex, else the product over the branches u of
    sum_j a_ij Phi_j(u); Definition II.2.9."""

    def __init__(self, a: Sequence[Sequence[Fraction]]) -> None:
        self.a = a
        self.known: dict[Tree, list[Fraction]] = {}

    def at_stages(self, tree: Tree) -> list[Fraction]:
        if tree not in self.known:
            phi = [Fraction(1)] * len(self.a)
            for branch in tree:
                inner = self.at_stages(branch)
                sums = [sum((a * p for a, p in zip(row, inner, strict=False) if a), Fraction(0)) for row in self.a]
                phi = [p * s for p, s in zip(phi, sums, strict=True)]
            self.known[tree] = phi
        return self.known[tree]


class Conditions:
    """The order conditions of stages with the rows ``a``, each as long as there are stages before it, or longer."""

    def __init__(self, a: Sequence[Sequence[float]]) -> None:
        self.weights = Weights([[Fraction(entry) for entry in row] for row in a])
        self.sizes = Weights([[abs(Fraction(entry)) for entry in row] for row in a])

    def residual(self, b: Sequence[Fraction], tree: Tree, theta: Fraction = Fraction(1)) -> tuple[Fraction, Fraction]:
        """sum_i b_i Phi_i(t) - theta^order / gamma, and the sum of the absolute values of all its terms."""
        value = sum((w * p for w, p in zip(b, self.weights.at_stages(tree), strict=False)), Fraction(0))
        size = sum((abs(w) * p for w, p in zip(b, self.sizes.at_stages(tree), strict=False)), Fraction(0))
        exact = theta ** order(tree) / gamma(tree)
        return value - exact, size + exact

    def worst(self, b: Sequence[float], vertices: int, theta: Fraction = Fraction(1)) -> float:
        """The largest residual over trees of so many vertices, in units of eps times the terms' absolute values."""
        exact = [Fraction(weight) for weight in b]
        return max(
            float(abs(value) / (EPS * size))
            for value, size in (self.residual(exact, tree, theta) for tree in trees(vertices))
        )


ROUNDING, WRONG = 8.0, 1e7
TREES = "rooted trees, exact arithmetic: Butcher 1963"
SCIPY = {"bogacki-shampine23": rk.RK23, "dormand-prince45": rk.RK45, "dop853": rk.DOP853}


def with_tableau() -> list[str]:
    """The methods that are a tableau; Rosenbrock methods have other conditions."""
    return [
        name
        for name, method in INTEGRATORS.items()
        if method.butcher is not None and method.family != "Rosenbrock" and name not in REGISTERED
    ]


def conditions(name: str) -> Iterator[Claim]:
    """Claims on the order conditions of the stated order and of the next one."""
    method = integrator(name)
    assert method.butcher is not None
    a, b = method.butcher
    rows = Conditions(a.tolist())
    left = max(rows.worst(b.tolist(), vertices) for vertices in range(1, method.order + 1))
    text = f"{name}: what is left of the conditions up to order {method.order}, in roundings"
    yield at_most(text, left, ROUNDING, TREES)
    beyond = rows.worst(b.tolist(), method.order + 1)
    text = f"{name}: what is left of those of order {method.order + 1}"
    yield claim(text, beyond, f"over {WRONG:g}", beyond > WRONG, TREES)


def beside_scipy(name: str) -> Claim:
    """The largest difference of an entry of a or b."""
    solver, (a, b) = SCIPY[name], integrator(name).butcher or (np.zeros(0), np.zeros(0))
    rows, columns = solver.A.shape
    off = largest(np.abs(a[:rows, :columns] - solver.A).max(), np.abs(b - solver.B).max())
    return claim(f"{name}: farthest entry from SciPy's", float(off), "at most 1e-14", off <= 1e-14, "scipy.integrate")


def claims(long: bool = False) -> Iterator[Claim]:
    """Claims on every method with a tableau."""
    for name in with_tableau():
        yield from conditions(name)
    for name in SCIPY:
        yield beside_scipy(name)


if __name__ == "__main__":
    main(claims, __doc__)
