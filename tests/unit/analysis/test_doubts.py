"""Reports made from a trajectory say when the trajectory is no good."""

import json

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.chaos.megno import megnos
from kickdrift.analysis.orbits.secular_run import orbit_report
from kickdrift.ensemble.rows import megno_columns
from kickdrift.trajectory.read.info import warnings_of
from tests.systems import three_bodies

OFF = "the energy is off by"


def planets() -> kd.System:
    x, v = [[0, 0, 0], [1, 0, 0], [1.7, 0, 0]], [[0, 0, 0], [0, 1, 0], [0, 0.77, 0]]
    return kd.System(x, v, [1.0, 1e-5, 1e-5], forces=[kd.Gravity()], units="nbody")


def told(found) -> str:
    """The one warning, which the text and the JSON of a report have, too."""
    (warning,) = found.warnings
    assert warning.startswith(OFF)
    assert warning in str(found)
    return warning


@pytest.mark.parametrize(("system", "wrong"), [(three_bodies(), True), (planets(), False)])
def test_megno_and_the_spectrum_and_the_transition_matrix(system, wrong):
    found = kd.megno(system, 100.0, "rk4", 0.5 if wrong else 0.05)
    spectrum = kd.lyapunov_spectrum(system, 100.0, "rk4", 0.5 if wrong else 0.05, count=1)
    matrix = kd.transition_matrix(system, 100.0, "rk4", 0.5 if wrong else 0.05)
    assert (found.verdict == "unreliable") is wrong
    if wrong:
        assert told(found) == told(spectrum) == told(matrix)
        assert found.as_json()["warnings"] == spectrum.as_json()["warnings"] == found.warnings
        assert megno_columns(found)["warnings"] == found.warnings[0]
        assert found.time_to_decide is None
    else:
        assert [*found.warnings, *spectrum.warnings, *matrix.warnings] == []


def test_megnos_of_a_batch():
    wrong, right = megnos([three_bodies(), planets()], 25.0, "rk4", [0.5, 0.5])
    assert wrong.verdict == "unreliable"
    assert told(wrong)
    assert not right.warnings


def test_maps_and_problems():
    heavy = planets().remade(masses=[1.0, 0.08, 0.08])
    assert kd.megno(heavy, 60.0, "wisdom-holman", 0.9).verdict == "unreliable"
    assert told(kd.lyapunov_spectrum(heavy, 60.0, "wisdom-holman", 0.9, count=1))
    pendulum = kd.Problem(
        lambda t, y: np.array([y[1], -np.sin(y[0])]), [3.0, 0.0], name="pendulum", compiled=False,
        energy=lambda t, y: 0.5 * y[1] ** 2 - np.cos(y[0]),
    )  # fmt: skip
    assert told(kd.megno(pendulum, 200.0, "rk4", 1.2))
    assert told(kd.lyapunov_spectrum(pendulum, 200.0, "rk4", 1.2, count=1))


def test_transits():
    loose = kd.transits(three_bodies(), 1, 0, until=40.0, integrator="dop853", rtol=10.0, direction=(1, 0, 0))
    assert told(loose) in loose.as_json()["warnings"]
    assert not kd.transits(planets(), 1, 0, until=14.0, direction=(1, 0, 0)).warnings


def test_frequencies(tmp_path):
    """The file's report has the warning, and the report of frequencies has it from there."""
    path = tmp_path / "run.h5md"
    heavy = planets().remade(masses=[1.0, 1e-3, 1e-3])
    kd.Simulation(heavy, "rk4", dt=0.4).run(900, every=6, output=path)
    with kd.open(path) as run:
        (warning,) = warnings_of(run)
        assert warning.startswith(OFF)
        found = orbit_report(run)
    assert found.warnings == [warning]
    assert found.warnings[0] in str(found)
    assert json.loads(json.dumps(found.as_json()))["warnings"] == found.warnings
