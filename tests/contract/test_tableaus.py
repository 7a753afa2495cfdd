"""Every Runge-Kutta row satisfies the order conditions of its stated order, and not more; its numbers are the published
ones."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from scipy.integrate._ivp import dop853_coefficients, rk

from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from kickdrift.integrators.runge_kutta import method as runge_kutta
from kickdrift.integrators.runge_kutta.method import Tableau, interpolant
from kickdrift_validation.butcher_tableaus import Conditions, gamma, trees

NAMES = [row.name for row in runge_kutta.ROWS]
ADAPTIVE = [row.name for row in runge_kutta.ROWS if row.adaptive]
DENSE = {"bogacki-shampine23": 3, "dormand-prince45": 4, "dop853": 7}  # published orders
EMBEDDED = {"bogacki-shampine23": (2,), "cash-karp45": (4,), "dormand-prince45": (4,), "dop853": (5, 3)}
SCIPY = {"bogacki-shampine23": rk.RK23, "dormand-prince45": rk.RK45, "dop853": rk.DOP853}
THETAS = [Fraction(1, 8), Fraction(1, 3), Fraction(1, 2), Fraction(4, 5), Fraction(1)]
ROUNDING, WRONG = 8.0, 1e7  # bounds for residuals, in units of eps times their terms


def rows(method: Tableau) -> list[tuple[float, ...]]:
    """Every stage's row of a, including the rows of f(t + dt, y_new) and of dense output."""
    return [(), *method.a, method.b, *method.extra]


def within_ulps(ours, theirs, ulps=1.0) -> bool:
    ours, theirs = np.asarray(ours, dtype=float), np.asarray(theirs, dtype=float)
    return ours.shape == theirs.shape and bool(np.all(np.abs(ours - theirs) <= ulps * np.spacing(np.abs(theirs))))


@pytest.fixture(scope="module")
def conditions() -> dict[str, Conditions]:
    """Order conditions, shared by all tests of this file: each tree's stage weights are computed once for each
    method."""
    return {name: Conditions(rows(integrator(name))) for name in NAMES}


def test_rooted_trees_are_the_known_ones():
    """Hairer, Nørsett & Wanner, tables II.2.2 and II.2.3."""
    assert [len(trees(n)) for n in range(1, 10)] == [1, 1, 2, 4, 9, 20, 48, 115, 286]
    assert sorted(gamma(tree) for tree in trees(4)) == [4, 8, 12, 24]
    assert sorted(gamma(tree) for tree in trees(5)) == [5, 10, 15, 20, 20, 30, 40, 60, 120]


def test_conditions_of_third_order_as_they_are_written_out():
    """sum b c^2 = 1/3 and sum b_i a_ij c_j = 1/6, written out for rk4."""
    rk4 = integrator("rk4")
    c = [Fraction(entry) for entry in rk4.c]
    b = [Fraction(entry) for entry in rk4.b]
    inner = [sum((Fraction(a) * c[j] for j, a in enumerate(row)), Fraction(0)) for row in ((), *rk4.a)]
    found = {gamma(tree): Conditions(rows(rk4)).residual(b, tree)[0] for tree in trees(3)}
    assert found[3] == sum(w * x * x for w, x in zip(b, c, strict=True)) - Fraction(1, 3)
    assert found[6] == sum(w * x for w, x in zip(b, inner, strict=True)) - Fraction(1, 6)


@pytest.mark.parametrize("name", NAMES)
def test_order_conditions_hold_up_to_the_order(name, conditions):
    method = integrator(name)
    for vertices in range(1, method.order + 1):
        assert conditions[name].worst(method.b, vertices) < ROUNDING
    assert conditions[name].worst(method.b, method.order + 1) > WRONG


@pytest.mark.parametrize("name", ADAPTIVE)
def test_embedded_solutions_have_the_lower_order(name, conditions):
    method = integrator(name)
    assert len(method.errors) == len(EMBEDDED[name])
    for row, order in zip(method.errors, EMBEDDED[name], strict=True):
        lower = [Fraction(b) - Fraction(e) for b, e in zip((*method.b, 0.0), row, strict=True)]
        for vertices in range(1, order + 1):
            assert conditions[name].worst(lower, vertices) < ROUNDING
        assert conditions[name].worst(lower, order + 1) > WRONG


def test_the_step_follows_the_estimate():
    """dop853 combines its estimates of order 5 and 3 into one that scales as dt^8: (II.10.17)."""
    orders = {name: integrator(name).error_order for name in ADAPTIVE}
    assert orders == {"bogacki-shampine23": 2, "cash-karp45": 4, "dormand-prince45": 4, "dop853": 7}
    for name, solver in SCIPY.items():
        assert orders[name] == solver.error_estimator_order
    assert {name: integrator(name).evaluations for name in ADAPTIVE} == {
        "bogacki-shampine23": 3, "cash-karp45": 6, "dormand-prince45": 6, "dop853": 12,
    }  # fmt: skip


@pytest.mark.parametrize("name", DENSE)
def test_dense_output_has_its_order_throughout_the_step(name, conditions):
    dense = integrator(name).dense
    for theta in THETAS:
        b = [sum(Fraction(p) * theta ** (j + 1) for j, p in enumerate(row)) for row in dense]
        # Rounding acts on the coefficients of the powers, which partly cancel. So these coefficients are the terms.
        sizes = [sum(abs(Fraction(p)) * theta ** (j + 1) for j, p in enumerate(row)) for row in dense]
        for vertices in range(1, DENSE[name] + 1):
            for tree in trees(vertices):
                value, _ = conditions[name].residual(b, tree, theta)
                _, size = conditions[name].residual(sizes, tree, theta)
                assert abs(value) < ROUNDING * Fraction(1, 2**52) * size
        if theta < 1:
            assert conditions[name].worst(b, DENSE[name] + 1, theta) > WRONG


@pytest.mark.parametrize("name", DENSE)
def test_dense_output_meets_both_ends_and_the_derivatives_there(name):
    method = integrator(name)
    s, dense = len(method.b), np.array(method.dense)
    scale = np.abs(dense).sum(axis=1)
    new = np.eye(len(dense))
    powers = np.arange(1, dense.shape[1] + 1)
    at_end = np.concatenate([method.b, np.zeros(len(dense) - s)])
    assert np.all(np.abs(dense.sum(axis=1) - at_end) <= 2.0**-52 * scale)
    assert np.all(dense[:, 0] == new[0])  # f(t, y)
    assert np.all(np.abs(dense @ powers - new[s]) <= 2.0**-52 * scale * powers[-1])  # f(t + dt, y_new)


def test_interpolant_without_further_terms_is_hermites_cubic():
    """theta (1 - theta)^2 k_1, theta^2 (theta - 1) k_2 and b times 3 theta^2 - 2 theta^3, for Euler's method."""
    assert interpolant((1.0,)) == ((1.0, 3.0 - 2.0, -2.0 + 1.0), (0.0, -1.0, 1.0))


@pytest.mark.parametrize("name", SCIPY)
def test_numbers_are_scipys(name):
    method, solver = integrator(name), SCIPY[name]
    s = len(method.b)
    assert within_ulps(method.stages[:-1, : solver.A.shape[1]], solver.A, 0)
    assert within_ulps(method.b, solver.B, 0)
    sizes = np.abs(method.stages[:-1]).sum(axis=1)
    assert np.all(np.abs(np.array(method.c) - solver.C) <= 2.0**-52 * np.maximum(sizes, 2.0**-52))
    if name != "dop853":
        assert within_ulps(method.errors[0], -solver.E, 0)
        assert within_ulps(method.dense, solver.P)
        return
    assert within_ulps(method.errors, [solver.E5, solver.E3], 0)
    for i, row in enumerate(method.extra):
        assert within_ulps(row, solver.A_EXTRA[i, : s + 1 + i], 0)
        assert math.fsum(row) == pytest.approx(solver.C_EXTRA[i], abs=4e-15)


def test_dense_output_of_dop853_is_scipys():
    """SciPy's nested form, evaluated in exact arithmetic with SciPy's numbers."""
    method, d = integrator("dop853"), dop853_coefficients.D
    s = len(method.b)
    for i, row in enumerate(method.dense):
        k = [Fraction(int(j == i)) for j in range(len(method.dense))]
        step = sum((Fraction(b) * k[j] for j, b in enumerate(method.b)), Fraction(0))
        f = [step, k[0] - step, 2 * step - k[0] - k[s], *(Fraction(float(entry)) for entry in d[:, i])]
        for theta in THETAS:
            y = Fraction(0)
            for number in range(6, -1, -1):
                y = (y + f[number]) * (theta if number % 2 == 0 else 1 - theta)
            ours = sum(Fraction(p) * theta ** (j + 1) for j, p in enumerate(row))
            assert abs(ours - y) <= Fraction(1, 2**53) * sum(abs(Fraction(p)) for p in row)


def test_embedded_solution_of_cash_and_karp():
    """Cash & Karp 1990, table 1: the weights of order 4, from which the error row was subtracted."""
    published = [Fraction(2825, 27648), 0, Fraction(18575, 48384), Fraction(13525, 55296), Fraction(277, 14336),
                 Fraction(1, 4)]  # fmt: skip
    b = [Fraction(37, 378), 0, Fraction(250, 621), Fraction(125, 594), 0, Fraction(512, 1771)]
    method = integrator("cash-karp45")
    assert method.b == tuple(float(w) for w in b)
    assert method.errors == ((*(float(w - lower) for w, lower in zip(b, published, strict=True)), 0.0),)
    assert [float(Fraction(c).limit_denominator(100)) for c in method.c] == [0, 0.2, 0.3, 0.6, 1, 0.875]


PAIR = {  # Heun's method with an embedded Euler method, and Hermite's cubic
    "name": "mine", "a": ((1.0,),), "b": (0.5, 0.5), "order": 2, "source": "me",
    "errors": ((-0.5, 0.5, 0.0),), "error_order": 1, "dense": interpolant((0.5, 0.5)),
}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"a": ((1.0,),), "b": (1.0,), "errors": (), "error_order": 0, "dense": ()},
            "the tableau is implicit (row 1 has an entry on or above the diagonal); the explicit loop cannot run it",
        ),
        ({"a": ((0.0, 0.0), (0.5, 0.5))}, "the tableau is implicit (row 2 has an entry on or above the diagonal)"),
        ({"a": ((0.0, 0.0), (1.0, 0.0))}, "rows of 1, 2, … entries below the diagonal"),
        ({"a": ()}, "rows of 1, 2, … entries below the diagonal"),
        ({"b": (0.5, 0.6)}, "b adds up to 1.1, not 1"),
        ({"errors": ((-0.5, 0.5),)}, "row 1 of errors has 2 entries, not 3"),
        ({"errors": ((-0.5, 0.5, 0.0), (0.5, 0.25, 0.0))}, "row 2 of errors adds up to 0.75, not 0"),
        ({"errors": ((math.nan, 0.5, 0.0),)}, "row 1 of errors adds up to nan, not 0"),
        ({"error_order": 0}, "errors and error_order go together; error_order is 0"),
        ({"errors": ()}, "errors and error_order go together; error_order is 1"),
        ({"extra": ((0.5, 0.5),)}, "rows of extra need an entry for each earlier stage: 3, 4, …"),
        ({"extra": ((0.5, 0.5, 0.0),)}, "dense has 4 rows of one length, one for each stage"),
        ({"dense": ((1.0,), (0.0,), (0.0, 0.0))}, "dense has 3 rows of one length, one for each stage"),
        ({"dense": interpolant((0.6, 0.4))}, "row 1 of dense adds up to 0.6"),
    ],
)
def test_broken_tables_are_refused(change, message):
    assert Tableau(**PAIR).adaptive
    with pytest.raises(InputError, match="mine: ") as caught:
        Tableau(**{**PAIR, **change})
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ADAPTIVE)
def test_a_wrong_digit_is_seen(name):
    """An error of one part in 10^10 of the largest entry of any row: the conditions find it."""
    method = integrator(name)
    table = [list(row) for row in (*method.a, method.b)]
    for i, row in enumerate(table):
        changed = [list(other) for other in table]
        changed[i][int(np.argmax(np.abs(row)))] *= 1 + 1e-10
        conditions = Conditions([(), *changed[:-1]])
        assert any(conditions.worst(changed[-1], vertices) > ROUNDING for vertices in range(1, method.order + 1)), i
