"""`compare` for heat baths: sampling errors from coupled paths, against exact ones, and what the user sees."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.analysis.compare.coupled_paths import CoupledPaths, difference, stretch_of, stretches
from kickdrift.analysis.compare.sampling import SamplingComparison, SamplingRow, advice
from kickdrift.cli.main import app
from kickdrift.errors import InputError
from kickdrift_validation.heat_baths import covariance
from tests.systems import liquid, wells

RUNNER = CliRunner()


@pytest.mark.parametrize("word", ["obabo", "baoab", "aboba"])
def test_the_difference_in_a_well_is_exact(word):
    """<U> and <K> of oscillators at dt = 1 and 1/2, from discrete Lyapunov equations; within four standard errors."""
    method = kd.integrator(word, temperature=1.0, friction=1.0, seed=2)
    paths = CoupledPaths(wells(300), method, 1.0, wells(300).state)
    stretches(paths, 10, 2)  # to equilibrium
    looks = stretches(paths, 8, 40)
    found = difference(looks, paths, 8)
    whole, half = (covariance(word.upper(), dt, 1.0) for dt in (1.0, 0.5))
    exact = 0.5 * 900 * np.array([whole[0, 0] - half[0, 0], whole[1, 1] - half[1, 1]])
    assert np.all(np.abs(found.values[:2] - exact) < 4 * found.errors[:2])
    assert np.all(found.errors[:2] < 0.02 * 450)


def test_paths_part_in_a_liquid_and_not_in_a_well():
    method = kd.integrator("baoab", temperature=1.0, friction=1.0)
    assert stretch_of(CoupledPaths(wells(20), method, 0.1, wells(20).state), 100, pilots=1) == 100
    system = liquid(64, 2.0)
    paths = CoupledPaths(system, method, 0.008, system.state)
    steps = stretch_of(paths, 1000, pilots=1)
    assert 10 < steps < 500
    assert paths.parted() < 0.1
    paths.advance(1000)
    assert paths.parted() > 0.3


@pytest.fixture(scope="module")
def found():
    baths = [kd.integrator(name, temperature=1.0, friction=5.0) for name in ("baoab", "obabo")]
    return kd.compare(liquid(64, 2.0), baths, dt=0.016, time=40.0, accuracy=0.05)


@pytest.mark.long
def test_a_liquid_is_compared(found):
    assert isinstance(found, SamplingComparison)
    assert [row.dt for row in found.of(found.methods[0])] == pytest.approx([0.016 * 2 ** (-k / 2) for k in range(4)])
    obabo = found.of(found.methods[1])[0]
    assert obabo.potential > 4 * obabo.potential_error > 0  # the known sign: obabo's configurations are too hot
    assert obabo.gain > 10
    baoab = found.of(found.methods[0])[0]
    assert baoab.kinetic < -10 * baoab.kinetic_error  # and baoab's velocities too slow
    assert abs(baoab.potential) < abs(obabo.potential)
    choice = found.recommendation.choice
    assert choice.method.startswith("baoab")
    assert 0.004 < choice.dt <= 0.016


def test_it_shows_itself(found):
    text = str(found)
    assert text.startswith("system: errors of means against the step\nmethod  dt")
    assert "\nrecommended       baoab -o temperature=1.0 -o friction=5.0, dt = " in text
    assert "kd.Simulation(system, 'baoab', dt=" in text
    written = json.loads(json.dumps(found.as_json()))
    assert written["measure"] == "sampling"
    assert written["rows"][0]["method"] == "baoab -o temperature=1.0 -o friction=5.0"
    assert len(found.plot().axes) == 3


def test_the_command(tmp_path):
    table, figure = tmp_path / "found.json", tmp_path / "found.png"
    small = tmp_path / "small.toml"
    small.write_text(liquid(64, 2.0).to_toml(), encoding="utf-8")
    words = ["compare", str(small), "--integrator", "obabo", "-o", "temperature=1", "-o", "friction=5", "-o", "dt=0.01"]
    done = RUNNER.invoke(app, [*words, "--time", "1", "--json", str(table), "--plot", str(figure)])
    assert done.exit_code == 0, done.output
    assert len(json.loads(table.read_text(encoding="utf-8"))["rows"]) == 4
    assert figure.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("methods", "options", "line"),
    [
        (["baoab", "velocity-verlet"], {}, "compare: baoab has a heat bath and velocity-verlet has none"),
        ("nose-hoover", {"temperature": 1.0, "tau": 1.0}, "nose-hoover: compare couples paths by noise = refine, and"),
        ("baoab", {"friction": 1.0}, "temperature is needed: a heat bath has no default temperature"),
        ("baoab", {"temperature": 1.0, "friction": 1.0}, "compare: system has no dt in \\[run\\]; give the longest"),
        ("baoab", {"temperature": 1.0, "friction": 1.0, "dt": -1.0}, "dt must be a positive finite time, got -1.0"),
        ("baoab", {"temperature": 1.0, "friction": 1.0, "dt": 0.1, "noise": "refine"}, "noise: compare sets it"),
    ],
)
def test_what_cannot_be_compared_is_refused(methods, options, line):
    with pytest.raises(InputError, match=f"^{line}"):
        kd.compare(wells(20), methods, time=1.0, **options)


def test_a_step_that_blows_up_is_a_row():
    found = kd.compare(liquid(64, 2.0), "baoab", temperature=1.0, friction=1.0, dt=0.05, time=0.2)
    assert found.rows[0].failure
    assert math.isnan(found.rows[0].potential)
    assert found.as_json()["rows"][0]["potential"] is None


def test_the_advice_takes_the_longest_step_that_is_surely_good():
    rows = tuple(
        SamplingRow("obabo", 0.02 / 2**k, potential=0.04 / 4**k, potential_error=0.001, steps=1000, seconds=1.0)
        for k in range(3)
    )
    comparison = SamplingComparison("mine", 10, 1.0, "", "", "", 1, rows)
    choice = advice(comparison, 0.016, 10.0).choice  # a bound of 0.012 at dt = 0.01, and of 0.042 at 0.02
    assert choice.dt == pytest.approx(0.01 * math.sqrt(0.016 / 0.012), rel=1e-2)
    assert choice.steps == math.ceil(10.0 / (0.01 * math.sqrt(0.016 / 0.012)))
    assert comparison.slopes["obabo"] == pytest.approx(2.0)
    assert advice(comparison, 0.002, 10.0).refusal.startswith("no method reaches")
    doubtful = replace(comparison, rows=(rows[0], replace(rows[1], settled=False), rows[2]))
    assert advice(doubtful, 0.016, 10.0).choice.dt < 0.01  # rows whose paths part too early recommend nothing
