"""Formulas that are text: slopes beside differences of energies, names, and what is refused."""

import math

import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.bonded.law import value_of
from kickdrift.forces.formulas.expression import law_of

GIVEN = {"k": 1.7, "n": 3.0, "exp": 0.4, "min": 0.7}
FORMULAS = (
    "sqrt(r)+exp(-r)*log(k*r)", "sin(r)*cos(k*r)+tan(r/2)", "sec(r/3)+csc(r)+cot(r)", "sinh(r)-cosh(r/k)+tanh(r)",
    "square(r)+cube(r)/recip(r)", "abs(r-2)*min(r, 2)+max(r, k)", "step(r-0.5)*r", "select(step(r-1), r^2, k*r)",
    "select(k-1.7, 1, r^3)", "-r^2+2^-1/r^k^0.5+k^r+r^n", "k*d^2; d=r-r0; r0=0.5*k", "exp*min(min, r)*exp(-exp*r)",
    "r^0.5+r^-0.5+r^-3+r^1.5", "k*(r-2)^n", "k*r^(n/2)+r^2.5", "select(step(r-2), sqrt(r-2), 0)",
)  # fmt: skip


@pytest.mark.parametrize("variable", ["r", "r2"])
@pytest.mark.parametrize("formula", FORMULAS)
def test_slopes_are_those_of_the_energy(formula, variable):
    law = law_of(formula, variable)
    numbers = law.of("", {name: GIVEN[name] for name in law.formula.parameters}, 1.0, 1.0)
    for r in (0.6, 1.3, 2.9):
        near = [value_of(numbers, x * x if variable == "r2" else x) for x in (r - 1e-5, r, r + 1e-5)]
        slope = -near[1][1] * r if variable == "r2" else near[1][1]
        assert slope == pytest.approx((near[2][0] - near[0][0]) / 2e-5, rel=1e-8, abs=1e-8), (formula, r)


def test_tanh_ends_at_one_far_away():
    numbers = law_of("tanh(50*r)", "r").of("", {}, 1.0, 1.0)
    assert value_of(numbers, 100.0) == (1.0, 0.0)
    assert value_of(numbers, -100.0)[0] == -1.0


def test_a_power_of_pairs_need_not_be_whole():
    force = kd.FormulaPair("k*(r-r0)^n+r^-2.5", {"k": 3.0, "r0": 0.6, "n": 2.5}, cutoff=2.0, truncation="cut")
    assert value_of(force.law, 1.0)[0] == pytest.approx(3.0 * 0.4**2.5 + 1.0)
    assert math.isnan(value_of(force.law, 0.25)[0])


@pytest.mark.long
def test_a_choice_by_a_parameter_compiles_for_lanes():
    x = [[0.0, 0.0, 0.0], [1.3, 0.0, 0.0]]
    for k, energy in ((0.0, 2.6), (1.0, 1.3)):
        force = kd.FormulaPair("select(k, r, 2*r)", {"k": k}, cutoff=3.0, truncation="cut")
        assert kd.System(x, masses=1.0, forces=[force]).energy().potential == pytest.approx(energy, rel=1e-15)


@pytest.mark.parametrize(
    ("formula", "why"),
    [
        ("k*r; r=2", "'r' is the variable, which has no definition"),
        ("k*a; a=1; a=r", "'a' is defined twice"),
        ("a; a=b*r; b=a", "the definition of 'a' needs itself"),
        ("k*r^2 # + c*r^4", "is no expression such as"),
        ("k*r**2", "is no expression such as"),
        ("1e400*r", "has a number that is too large"),
        ("r.real", "is not part of a formula"),
        ("__import__('os')", "function '__import__' is not there"),
        ("k*r", "parameters: 'k' of the formula has no value"),
        ("r/0*1^0*(1/0)", "the formula has no value$"),
    ],
)
def test_what_a_formula_cannot_be_is_named(formula, why):
    with pytest.raises(InputError, match=f"^formula-bond: .*{why}"):
        kd.System(
            [[0.0, 0, 0], [1.0, 0, 0]], masses=1.0, topology=kd.Topology(bonds=[[0, 1]]),
            forces=[kd.FormulaBond(formula)],
        )  # fmt: skip


def test_a_dihedral_that_jumps_is_refused():
    with pytest.raises(InputError, match="must be the same at -180 and 180 degrees"):
        kd.FormulaDihedral("k*theta", {"k": 1.0})
    assert kd.FormulaImproper("k*theta^2", {"k": 1.0}).law.law(math.pi)[0] == pytest.approx(math.pi**2)
