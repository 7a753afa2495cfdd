"""The article's claims: the cheap ones hold as measured, and a wrong measurement fails."""

import re
from dataclasses import replace
from fractions import Fraction
from pkgutil import iter_modules

import pytest

from docs.studies import textbooks
from docs.studies.textbooks import article, evaluations, orbits, reversal, stiff, unit_oscillator
from docs.studies.textbooks.__main__ import STUDIES
from kickdrift.integrators import INTEGRATORS

NAMES = [module.name for module in iter_modules(textbooks.__path__) if not module.name.startswith("_")]


def words(rows, said):
    return next(row["words"] for row in rows if said in row["said"])


def failed(rows):
    return [row["claim"] for row in rows if row["verdict"] == "fail"]


def test_every_script_has_claims():
    """The script that runs all others includes every one."""
    assert {study.__name__.rpartition(".")[2] for study in STUDIES} == {*NAMES} - {"article"}
    assert all(callable(study.claims) for study in STUDIES)


def test_oscillator():
    rows = unit_oscillator.claims()
    assert failed(rows) == []
    assert words(rows, "halves").startswith("holds if the method is of first order")
    assert words(rows, "0.5 %") == "holds if a unit of time stands for a period"
    assert words(rows, "doubles in 1000") == "does not hold"
    assert words(rows, "better than Euler at 0.001") == "holds"


def test_a_method_that_is_wrong_fails(monkeypatch):
    """A weight of leapfrog is wrong by one in a million."""
    method = INTEGRATORS["velocity-verlet"]
    wrong = replace(method, weights=(0.5 - 1e-6, 1.0, 0.5 + 1e-6))
    monkeypatch.setitem(INTEGRATORS, "velocity-verlet", wrong)
    assert [row["reading"] for row in unit_oscillator.halving() if row["verdict"] == "fail"] == [
        "leapfrog, t = 10", "leapfrog, one step", "dt is divided by sqrt 2 only",
    ]  # fmt: skip


def test_counts():
    rows = [*evaluations.counts(), *evaluations.pairs()]
    assert failed(rows) == []
    assert words(rows, "Dormand") == "holds if a step under way"
    assert words(rows, "Bogacki") == "holds if a step by itself"
    assert not evaluations.count("x", 7, True, 6, "y").met


def test_forest_ruth_is_the_plain_loop():
    ours, by_hand = evaluations.run("forest-ruth", 1, 0.02), evaluations.plain(evaluations.plain_triple_jump, 1, 0.02)
    assert ours == pytest.approx(by_hand, rel=1e-6)


def test_orbits_in_small():
    short = {method: orbits.energy_errors(method, 0.01, 10_000) for method in ("euler", "symplectic-euler")}
    assert 100 * short["euler"][-1] == pytest.approx(100 * orbits.plain_euler(0.0, 0.01, 10_000), rel=1e-9)
    assert short["symplectic-euler"].max() == pytest.approx(orbits.half_a_kick_off(0.01, 0.0), rel=0.02)
    assert orbits.half_a_kick_off(0.01, 0.0) == pytest.approx(1e-4, rel=1e-3)


def test_leapfrog_in_rational_numbers_comes_back():
    assert reversal.rational("velocity-verlet", Fraction(1, 10), 3) == 0
    assert reversal.rational("symplectic-euler", Fraction(1, 10), 3) == 4


def test_stiffness_begins_where_it_is_measured():
    reading = stiff.crossing(1.0, 1e-3)
    assert reading.met
    assert 10 < reading.measured < 1000


def test_a_rate_that_is_wrong_fails(monkeypatch):
    monkeypatch.setattr(stiff, "INTERVAL", 3.4)
    assert not stiff.crossing(1.0, 1e-3).met


def test_what_becomes_of_the_words():
    yes, no = (article.near(text, 2.0, text == "a", 2.0, 1e-9, "theory", "times") for text in "ab")
    off = article.near("c", 2.0, True, 2.1, 1e-3, "theory")
    assert [article.article("x", "y", *given)[0]["words"] for given in ((yes,), (no,), (yes, no, off))] == [
        "holds", "does not hold", "holds if a; or c",
    ]  # fmt: skip
    rows = article.article("x", "because", yes, off)
    assert [row["verdict"] for row in rows] == ["pass", "fail"]
    assert {"claim", "value", "bound", "reference", "verdict", "said", "why", "words"} <= set(rows[0])
    assert rows[0]["value"] == "2 times"


@pytest.mark.parametrize(
    ("measured", "said", "same"),
    [(0.5012, "0.5", True), (0.449, "0.5", False), (47.75, "47", True), (48.0, "47", False), (0.00307, "0.003", True)],
)
def test_digits(measured, said, same):
    assert article.digits(measured, said) is same


def test_magnitude():
    magnitude = article.magnitude
    assert magnitude(-1.7e-7, 1e-7)
    assert not magnitude(5.8e4, 1e4)


def test_what_is_printed():
    rows = article.article("so", "because", article.near("a|b", 2.0, True, 3.0, 1e-3, "theory"))
    assert re.search(
        r"said +“so”\nverdict +holds\nwhy +because\n +yes +a\|b +2 +fail: 3 to 1e-03 of it \(theory\)",
        article.table(rows),
    )
    lines = article.markdown(rows)
    assert "### “so”" in lines
    assert "**Holds.** because" in lines
    assert lines[-1] == "| a\\|b | holds | 2 | 3 to 1e-03 of it | theory | **fail** |"
