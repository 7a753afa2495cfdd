"""Every row of the splitting table satisfies the order conditions of its order to the last digits, and not those of the
next."""

from dataclasses import replace
from fractions import Fraction
from itertools import chain

import numpy as np
import pytest

from kickdrift.integrators import integrator
from kickdrift.integrators.splitting import method as splitting
from kickdrift.integrators.splitting.method import palindrome
from tests.oracle import integrators as oracle_integrators
from tests.oracle.order_conditions import Tree, conditions, gamma, rho, trees

NAMES = [row.name for row in splitting.ROWS]
EPS = Fraction(1, 2**52)
# The fifteen printed digits: Yoshida 1990, tables 1 (solution A) and 2 (solution D).


def excess(kick, drift, first, order) -> float:
    """Largest residual of the order conditions, in eps times the size of its terms."""
    return max(float(one.residual / (EPS * one.size)) for one in conditions(kick, drift, first, order))


def test_trees_are_as_many_as_they_should_be():
    """Hairer, Nørsett & Wanner, II.14: the conditions for y'' = f(y), order by order."""
    assert [len(trees(order)) for order in range(1, 10)] == [1, 1, 2, 3, 6, 10, 20, 36, 72]
    assert len(set(chain.from_iterable(map(trees, range(1, 10))))) == 151
    assert all(rho(tree) == order for order in range(1, 10) for tree in trees(order))


def test_conditions_of_order_four_written_out():
    """Hairer, Nørsett & Wanner, II.14, the conditions of a Nyström method of order 4 for y'' = f(t, y)."""
    leaf = Tree(0)
    expected = {Tree(0): 1, Tree(1): 2, Tree(2): 3, Tree(0, (leaf,)): 6, Tree(3): 4, Tree(1, (leaf,)): 8,
                Tree(0, (Tree(1),)): 24}  # fmt: skip
    assert {tree: gamma(tree) for order in range(1, 5) for tree in trees(order)} == expected
    row = integrator("yoshida4")
    assert len(list(conditions(row.kick, row.drift, row.first, 4))) == 1 + 7 + 4


@pytest.mark.parametrize("name", NAMES)
def test_conditions_are_what_a_step_does(name):
    """Run a step in fractions, from rest at time 0, on an equation with one tree for each component.

    The acceleration of a tree's component is t^leaves times the product of its branches, which is its Phi.
    """
    row, order = integrator(name), 6
    forest = list(chain.from_iterable(map(trees, range(1, order + 1))))

    def acceleration(t, x):
        value = dict(zip(forest, x, strict=True))
        return np.array([t**tree.leaves * np.prod([Fraction(1), *map(value.get, tree.branches)]) for tree in forest])

    exact = replace(row, weights=tuple(map(Fraction, row.weights)))
    start = np.array([Fraction()] * len(forest))
    x, v = oracle_integrators.splitting_step(exact, acceleration, Fraction(), start, start, Fraction(1))
    expected = []
    for tree, displacement, velocity in zip(forest, x, v, strict=True):
        expected.append(velocity)
        if rho(tree) < order:
            expected.append(displacement)
    drifts, *rest = conditions(row.kick, row.drift, row.first, order)
    assert drifts.value == 1
    assert [sum(one.terms) for one in rest] == expected


@pytest.mark.parametrize("name", NAMES)
def test_order_conditions_hold_to_the_last_digits(name):
    row = integrator(name)
    assert excess(row.kick, row.drift, row.first, row.order) <= 8


@pytest.mark.parametrize("name", NAMES)
def test_order_is_not_understated(name):
    row = integrator(name)
    left = max(float(one.residual) for one in conditions(row.kick, row.drift, row.first, row.order + 1))
    assert left > 1e-6


@pytest.mark.parametrize("name", [name for name in NAMES if len(integrator(name).kick) > 2])
@pytest.mark.parametrize("place", [0, 1])
def test_a_weight_that_is_off_is_noticed(name, place):
    row = integrator(name)
    kick = list(row.kick)
    kick[place] += 1e-13
    kick[place + 1] -= 1e-13
    assert excess(kick, row.drift, row.first, row.order) > 16


def test_palindromes_add_up_to_one():
    assert palindrome(()) == (1.0,)
    assert palindrome((), 2) == (0.5, 0.5)
    assert palindrome((0.25,), 2) == (0.25, 0.25, 0.25, 0.25)
    assert palindrome((0.5, -0.25)) == (0.5, -0.25, 0.5, -0.25, 0.5)
