"""MEGNO, Lyapunov exponents and spectra: published values, closed forms, sums, differences of nearby solutions."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.chaos.megno import megno
from kickdrift.analysis.tangents.deviations import direction
from kickdrift.errors import InputError
from kickdrift.forces.slopes.problem_variations import varied_problem
from kickdrift.odes import ODES
from tests.long import rest

LORENZ = 0.9056  # Viswanath 1998, thesis, Cornell; Sprott 2003, Chaos and Time-Series Analysis, appendix A
REGULAR, CHAOTIC = 0.1, -0.25  # y at x = 0, y' = 0 and energy 1/8: Skokos, Bountis & Antonopoulos 2007


def star(y: float) -> kd.Problem:
    """Hénon and Heiles' star at x = 0, y' = 0 and energy 1/8."""
    return ODES["henon-heiles"](y0=[0.0, y, math.sqrt(0.25 - y * y + 2 * y**3 / 3), 0.0])


def saddle(**given) -> kd.Problem:
    """Deviations grow with the larger eigenvalue of a triangular matrix, 0.3, and fall with -0.2."""
    return kd.Problem(lambda t, y: (0.3 * y[0] + y[1], -0.2 * y[1]), [0.0, 0.0], **given)


def growth_of_nearby(problem: kd.Problem, seed: int, time: float) -> float:
    """ln of the distance of two solutions that begin 1e-7 apart, over their distance at the start. At a distance of
    1e-8, an error of 1e-13 in y changes the logarithm by 1e-5."""
    ends = []
    for sign in (-1, 1):
        start = problem.y0 + sign * 5e-8 * direction(len(problem), seed)
        other = kd.Problem(problem.f, start, separable=problem.separable)
        sim = kd.Simulation(other, "dop853", rtol=1e-13, atol=1e-13)
        sim.run(until=time)
        ends.append(sim.state.y)
    return math.log(np.linalg.norm(ends[1] - ends[0]) / 1e-7)


@pytest.mark.long
def test_the_exponent_of_lorenz_is_the_published_one():
    found = megno(kd.load("ode-lorenz"), 2000.0, "rk4", 0.01)
    assert found.verdict == "chaotic"
    assert found.lyapunov == pytest.approx(LORENZ, rel=0.02)
    assert abs(found.lyapunov - LORENZ) < 3 * found.lyapunov_error + 0.005
    assert found.growth[-1] / found.times[-1] == pytest.approx(LORENZ, rel=0.02)
    assert found.time_unit == ""
    assert math.isnan(found.energy_error)
    assert found.as_json()["verdict"] == "chaotic"


@pytest.mark.long
def test_orbits_of_one_energy_are_regular_and_chaotic():
    regular, chaotic = (megno(star(y), 2000.0, "yoshida6", 0.1) for y in (REGULAR, CHAOTIC))
    assert regular.verdict == "regular"
    assert regular.lyapunov < 1e-3
    assert chaotic.verdict == "chaotic"
    assert 0.02 < chaotic.lyapunov < 0.1
    assert max(regular.energy_error, chaotic.energy_error) < 1e-8


@pytest.mark.parametrize("given", [rest({}), {"jacobian": lambda t, y: [[0.3, 1.0], [0.0, -0.2]]}, {"compiled": False}])
def test_a_linear_equation_has_its_largest_eigenvalue(given):
    found = megno(saddle(**given), 100.0, "rk4", 0.1)
    assert found.lyapunov == pytest.approx(0.3, rel=0.02)  # the first directions still count a little
    assert found.growth[-1] - found.growth[-2] == pytest.approx(0.3 * 0.1, rel=1e-6)


def test_a_falling_deviation_keeps_its_digits():
    decay = kd.Problem(lambda t, y: (-1.5 * y[0],), [1.0], compiled=False)
    found = megno(decay, 60.0, "dormand-prince45", rtol=1e-9, atol=1e-9)
    assert found.growth[-1] / found.times[-1] == pytest.approx(-1.5, rel=1e-5)


@pytest.mark.parametrize("name", ["lorenz", rest("arenstorf")])
def test_the_deviation_is_the_difference_of_nearby_solutions(name):
    problem = ODES[name]()
    found = megno(problem, 2.0, "dop853", seed=3, rtol=1e-12, atol=1e-12)
    assert found.growth[-1] == pytest.approx(growth_of_nearby(problem, 3, float(found.times[-1])), abs=1e-4)


@pytest.mark.parametrize("method", ["leapfrog", "rk4"])
def test_the_solution_keeps_its_bits(method):
    problem = replace(star(REGULAR), compiled=False)
    varied, place = varied_problem(problem, direction(4, 0))
    assert varied.separable
    sims = [kd.Simulation(each, method, dt=0.05) for each in (problem, varied)]
    for sim in sims:
        sim.run(200)
    own = np.setdiff1d(np.arange(8), place)
    np.testing.assert_array_equal(sims[1].state.y[own], sims[0].state.y)


def test_a_jacobian_that_does_not_compile_is_replaced_by_differences():
    table = {"a": [[0.3, 1.0], [0.0, -0.2]]}

    def jacobian(t, y):
        return table["a"]

    assert megno(saddle(jacobian=jacobian), 50.0, "rk4", 0.1).lyapunov == pytest.approx(0.3, rel=1e-2)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"integrator": "no-such", "time": 1.0}, "no-such"),
        ({"time": -1.0}, "time must be a positive finite time"),
        ({"time": 1.0, "seed": -1}, "seed: expected a whole number"),
        ({}, "has no time in [run]"),
    ],
)
def test_what_makes_no_sense_is_said(given, message):
    with pytest.raises(InputError) as caught:
        megno(saddle(compiled=False), **given)
    assert message in str(caught.value)


def test_the_command_prints_and_writes(kickdrift, tmp_path):
    status, out, err = kickdrift("chaos", "ode-henon-heiles", "--json", tmp_path / "chaos.json")
    assert (status, err) == (0, "")
    assert "chaotic over this length" in out
    assert "per unit of time" in out
    assert '"verdict": "chaotic"' in (tmp_path / "chaos.json").read_text(encoding="utf-8")


def test_further_arguments_belong_to_the_equation():
    def f(t, y, rate):
        return rate * y[0], -y[1]

    problem = kd.Problem(f, [0.0, 1.0], lambda t, y, rate: [[rate, 0.0], [0.0, -1.0]], args=(0.2,))
    assert megno(problem, 100.0, "rk4", 0.1).lyapunov == pytest.approx(0.2, rel=0.02)


SPECTRUM = (0.9056, 0.0, -14.5723)  # Sprott 2003, Chaos and Time-Series Analysis, appendix A
DIVERGENCE = -(10.0 + 1.0 + 8.0 / 3.0)


def planets(*forces) -> kd.System:
    x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.02], [-1.4, 0.1, 0.0]]
    v = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.86, 0.05]]
    return kd.System(x, v, [1.0, 1e-3, 3e-4], forces=[kd.Gravity(G=1.0), *forces], units="nbody")


def test_a_linear_problem_has_its_eigenvalues():
    found = kd.lyapunov_spectrum(saddle(compiled=False), 400.0, "rk4", 0.1)
    np.testing.assert_allclose(found.exponents, [0.3, -0.2], rtol=0, atol=1e-7)
    assert found.complete
    assert found.dimension == 2.0
    one = kd.lyapunov_spectrum(saddle(compiled=False), 400.0, "rk4", 0.1, count=1)
    assert one.exponents[0] == pytest.approx(0.3, abs=1e-7)
    assert one.dimension is None


@pytest.mark.parametrize("name", ["wisdom-holman", "yoshida4"])
def test_exponents_of_conservative_forces_add_to_zero(name):
    """A map and a splitting have the same spectrum, whose sum is zero to round-off."""
    found = kd.lyapunov_spectrum(planets(), 60.0, name, 0.02)
    assert abs(found.sum) < 1e-12
    assert found.exponents.shape == (18,)
    short = kd.lyapunov_spectrum(planets(), 60.0, "gauss-radau15", count=2)
    np.testing.assert_allclose(found.exponents[:2], short.exponents, rtol=0, atol=2e-3)


def test_drag_takes_its_rate_from_each_velocity():
    system = planets(kd.LinearDrag(0.3))
    assert kd.lyapunov_spectrum(system, 5.0, "gauss-radau15").sum == pytest.approx(-0.3 * 9, rel=1e-9)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"count": 0}, "count: expected a number of exponents from 1 to 18, got 0"),
        ({"count": 19}, "count: expected a number of exponents from 1 to 18, got 19"),
        ({"time": -1.0}, "time must be a positive finite time"),
        ({"seed": -1}, "seed: expected a whole number, zero or more"),
        ({"integrator": "hermite4"}, "integrator: hermite4 carries no variations"),
        ({"integrator": "yoshida4", "dt": 0.5, "time": 2.0}, "looks are too few to measure growth"),
    ],
)
def test_a_spectrum_that_makes_no_sense_is_said(given, message):
    with pytest.raises(InputError, match=message):
        kd.lyapunov_spectrum(planets(), **{"time": 1.0, **given})
    with pytest.raises(InputError, match="takes a System or a Problem, got str"):
        kd.lyapunov_spectrum("two-body", 1.0)


@pytest.mark.long
def test_the_command_finds_the_published_spectrum_of_lorenz(tmp_path, kickdrift):
    file, words = tmp_path / "spectrum.json", ("chaos", "ode-lorenz", "--time", 300, "--spectrum")
    code, out, _ = kickdrift(*words, "all", "--integrator", "rk4", "--dt", 0.01, "--json", file)
    assert not code
    assert "exponent 3" in out
    found = json.loads(file.read_text())
    np.testing.assert_allclose(found["exponents"], SPECTRUM, rtol=0, atol=0.03)
    assert found["sum"] == pytest.approx(DIVERGENCE, abs=1e-3)  # the error of the method
    assert found["dimension"] == pytest.approx(2.062, abs=2e-3)
    assert found["time_unit"] == ""
    code, _, err = kickdrift(*words, "many")
    assert code == 2
    assert "--spectrum: expected a number of exponents, or all, got 'many'" in err
