"""What the validation scripts rest on: the equations of state, and the scripts that take no time."""

import importlib.util
import inspect
import json
import math
import sys
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from registry import SCRIPTS

import kickdrift as kd
from kickdrift.integrators import integrator
from kickdrift.odes import kepler

VALIDATION = Path(__file__).parents[1] / "validation"
PEERS_AT_IMPORT = ("mdanalysis-readers", "solar-system-from-jpl")  # pytest inside pytest; an optional package
STATE_POINTS = json.loads((VALIDATION / "data" / "lj-eos" / "state_points.json").read_text())
POINTS = [
    pytest.param(equation, point, id=f"{equation}-{point['T']}-{point['rho']}")
    for equation, key in (("thol2016_full_LJ", "thol2016_full"), ("thol2015_cutshift_2.5", "thol2015_cutshift2.5"))
    for point in STATE_POINTS[key]
]


@pytest.fixture
def script(monkeypatch):
    """Loads a validation script by its name, as running it would."""
    monkeypatch.syspath_prepend(VALIDATION)
    monkeypatch.syspath_prepend(VALIDATION / "performance")
    monkeypatch.syspath_prepend(VALIDATION / "claims")

    def load(name):
        spec = importlib.util.spec_from_file_location(f"validation_{Path(name).stem}", VALIDATION / name)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, spec.name, module)
        spec.loader.exec_module(module)
        return module

    before = set(sys.modules)
    yield load
    for name in set(sys.modules) - before:
        if Path(getattr(sys.modules[name], "__file__", None) or "/").is_relative_to(VALIDATION):
            del sys.modules[name]


@pytest.mark.parametrize(("equation", "point"), POINTS)
def test_equations_of_state_give_the_tabulated_points(script, equation, point):
    fluid = script("equation_of_state.py").equation(equation, point["T"], point["rho"])
    assert fluid.pressure == pytest.approx(point["P"], rel=1e-11)
    assert fluid.energy == pytest.approx(point["U_res"], rel=1e-12)
    assert fluid.energy_slope == pytest.approx(point["cv_res"], rel=1e-11)


@pytest.mark.parametrize("equation", ["thol2016_full_LJ", "thol2015_cutshift_2.5"])
def test_slopes_are_those_of_the_values(script, equation):
    of = script("equation_of_state.py").equation
    step = 1e-5
    low, high, fluid = (of(equation, t, 0.75) for t in (1.0 - step, 1.0 + step, 1.0))
    assert fluid.pressure_slope == pytest.approx((high.pressure - low.pressure) / (2 * step), rel=1e-8)
    assert fluid.energy_slope == pytest.approx((high.energy - low.energy) / (2 * step), rel=1e-8)


def test_equation_of_state_agrees_with_monte_carlo_within_its_errors(script):
    module = script("equation_of_state.py")
    for density in (0.78, 0.82, 0.86):
        fluid, published = module.equation("thol2016_full_LJ", 0.85, density), module.nist(0.85, density)
        for quantity in ("pressure", "energy"):
            assert abs(getattr(fluid, quantity) - published[quantity]) < 2 * module.NIST_ERROR[quantity]
    assert module.nist(1.0, 0.75) is None


def test_error_of_a_correlated_mean(script):
    mean_and_error = script("equation_of_state.py").mean_and_error
    rng = np.random.default_rng(1)
    means, errors = [], []
    for _ in range(200):
        noise = np.convolve(rng.normal(size=4096 + 19), np.ones(20) / 20, "valid")  # correlated over 20 samples
        mean, error = mean_and_error(noise)
        means.append(mean)
        errors.append(error)
    assert np.mean(errors) == pytest.approx(np.std(means), rel=0.25)


def test_nist_claims_hold(script):
    rows = list(script("nist_lj.py").claims())
    assert len(rows) == 17
    assert {row["verdict"] for row in rows} == {"pass"}
    assert set(rows[0]) == {"claim", "value", "bound", "reference", "verdict"}


def test_a_failed_claim_is_exit_status_one(script, capsys):
    claims = script("claim.py")
    good, bad = (claims.claim("x", 1.0, "at most 1", holds, "y") for holds in (True, False))
    skipped = claims.not_run("z", "at least 3", "peer", "pip install peer")
    assert claims.show([good, skipped]) == 0
    assert claims.show([good, bad]) == 1
    printed = capsys.readouterr().out
    assert "pip install peer" in printed
    assert "fail" in printed


@pytest.mark.parametrize(
    "name",
    [
        *(row.file for row in SCRIPTS if row.name not in PEERS_AT_IMPORT),
        "performance/lj_scaling.py",
        "performance/looks.py",
        "performance/ode_scipy.py",
        "performance/speed.py",
    ],
)
def test_scripts_import_and_have_claims(script, name):
    claims = script(name).claims
    if not name.startswith("performance/"):
        parameters = inspect.signature(claims).parameters
        assert set(parameters) in ({"long"}, {"long", "figures"})
        assert not any(parameter.default for parameter in parameters.values())
        assert "sys.exit(main(claims, __doc__))" in (VALIDATION / name).read_text(encoding="utf-8")


def test_every_script_is_in_the_registry():
    shared = {"claim", "lennard_jones", "measures", "planted", "problems", "rooted_trees", "article", "docs_tables"}
    programs = {"__main__", "arm", "arm_kinds", "child", "faults", "registry", "report_file", "runner", "solver_guide"}
    found = [*VALIDATION.glob("*.py"), *(VALIDATION / "claims").glob("*.py")]
    files = {path.relative_to(VALIDATION).as_posix() for path in found if path.stem not in shared | programs}
    assert files == {row.file for row in SCRIPTS}
    assert all((VALIDATION / row.file).is_file() for row in SCRIPTS)
    assert len({row.name for row in SCRIPTS}) == len(SCRIPTS)


def test_lammps_missing_is_not_a_failure(script, monkeypatch):
    module = script("lj_lammps_melt.py")

    def missing():
        raise ImportError

    monkeypatch.setattr(module, "lammps_class", missing)
    (row,) = module.claims()
    assert row["verdict"] == "not run"
    assert "pip install" in row["value"]


# --- integrators ---


def test_integrators_in_small(script, capsys):
    """One of each kind; the claims are about those."""
    module = script("integrators.py")
    rows = list(module.study(["symplectic-euler", "rk4", "dormand-prince45"]))
    assert {row["verdict"] for row in rows} == {"pass"}
    assert len(rows) == 9
    lines = capsys.readouterr().out.splitlines()
    rk4 = next(line.split() for line in lines if line.startswith("| rk4"))
    assert rk4[3] == "4"
    assert "2.8284" in rk4


def test_a_method_that_is_not_what_it_states_fails(script, capsys):
    module = script("integrators.py")
    row = module.Fixed([1.0] * 4, 1e-3, [1e-3, 1e-3], (2.0, None), (1.5, None), 2.0)
    rows = list(module.fixed_claims("velocity-verlet", row))
    assert len(rows) == 5
    assert {claim["verdict"] for claim in rows} == {"fail"}
    assert [claim["verdict"] for claim in module.adaptive_claims("dop853", [1.0, 0.7, 0.7])] == ["fail"]
    assert list(module.adaptive_claims("bdf", [1.0, 0.7, 0.7])) == []


def test_no_method_is_left_out(script, monkeypatch):
    module = script("integrators.py")
    assert module.coverage()["verdict"] == "pass"
    monkeypatch.setattr(module, "ELSEWHERE", {})
    assert module.coverage()["verdict"] == "fail"


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
def test_what_agrees_with_a_bound(script, bound, found, holds):
    assert script("integrators.py").agrees(bound, found) is holds


def test_the_pages_table_is_the_registrys(script):
    """Else: python validation/integrators.py --docs docs/integrators.md"""
    module = script("integrators.py")
    page = (VALIDATION.parent / "docs" / "integrators.md").read_text(encoding="utf-8")
    assert page.split(module.BEGIN)[1].split(module.END)[0].strip() == module.docs_table()


def test_writing_the_table_leaves_the_rest_of_the_page(script, tmp_path):
    module = script("integrators.py")
    page = tmp_path / "page.md"
    page.write_text(f"before\n\n{module.BEGIN}\nold\n{module.END}\n\nafter\n", encoding="utf-8")
    module.write_docs(page)
    module.write_docs(page)
    text = page.read_text(encoding="utf-8")
    assert text == f"before\n\n{module.BEGIN}\n\n{module.docs_table()}\n\n{module.END}\n\nafter\n"


def test_kepler_energies_in_small(script, tmp_path):
    module = script("kepler_energies.py")
    rows = module.study(40, tmp_path)
    assert {row["verdict"] for row in rows} == {"pass"}
    assert (tmp_path / "kepler_energies.png").read_bytes().startswith(b"\x89PNG")


def test_verdicts_on_chaos_are_judged(script):
    module = script("chaos.py")
    case, report = module.cases()[0], module.kd.megno(kd.load("two-body"), 20.0, "yoshida4", 0.1)

    def found(ours, *theirs):
        said = replace(report, megno=ours, verdict=module.verdict(ours))
        return module.Found(case, 1.0, said, list(theirs))

    good = [found(2.01, 2.0, 1.99, 2.05)] * 10 + [found(9.0, 8.0, 7.0, 100.0)] * 10
    not_agreed = [found(2.01, 2.0, 2.0, 5.0), found(2.0, 3.0, 3.0, 3.0)]
    assert {row["verdict"] for row in module.judged(good + not_agreed)} == {"pass"}
    verdicts = [row["verdict"] for row in module.judged([*good[1:], found(3.0, 2.0, 2.0, 2.0)])]
    assert verdicts == ["fail", "pass", "fail"]


def test_leading_terms_in_rational_numbers(script):
    """By hand for forward Euler: E = (1 + dt^2) / 2 - (1 + dt^2)^(-1/2) after one step. RK4's is that of a step."""
    module = script("kepler_energies.py")
    assert module.energy_of_a_step(integrator("euler"))[:5] == [0, 0, 1, 0, Fraction(-3, 8)]
    exponent, c = module.leading("rk4")
    sim = kd.Simulation(kepler(eccentricity=0.0), "rk4", dt=0.05)
    gained = sim.run(1).energy.final + 0.5
    assert gained == pytest.approx(float(c) * 0.05**exponent, rel=0.01)


@pytest.mark.filterwarnings("ignore::UserWarning")  # MDAnalysis guesses masses, and says so
def test_the_file_for_mdanalysis_tests_is_its_reference(script, tmp_path):
    MDAnalysis = pytest.importorskip("MDAnalysis")
    script("mdanalysis_readers.py").write(tmp_path / "run.h5md")
    universe = MDAnalysis.Universe(str(tmp_path / "run.h5md"))
    first = np.arange(15.0).reshape(5, 3)
    for frame, ts in enumerate(universe.trajectory):
        np.testing.assert_array_equal(ts.positions, 2**frame * first)
        np.testing.assert_allclose(ts.velocities, 2**frame * first / 10, rtol=1e-7)
        assert ts.time == frame
    universe.trajectory.close()


# --- planted faults ---


def test_each_fault_has_one_place(script):
    """Else what is planted is not what is said."""
    package = Path(kd.__file__).parent
    faults = script("planted.py").FAULTS
    assert len({fault.name for fault in faults}) == len(faults) == 10
    assert sum(fault.small for fault in faults) == 3
    for fault in faults:
        assert (package / fault.file).read_text(encoding="utf-8").count(fault.text) == 1, fault.name
        assert fault.wrong != fault.text
