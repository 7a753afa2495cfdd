"""Lyapunov spectra: closed forms, published values, and sums that the divergence of the flow gives."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.cli import main as cli
from kickdrift.errors import InputError

LORENZ = (0.9056, 0.0, -14.5723)  # Sprott 2003, Chaos and Time-Series Analysis, appendix A
DIVERGENCE = -(10.0 + 1.0 + 8.0 / 3.0)


def saddle() -> kd.Problem:
    """Exponents 0.3 and -0.2, the eigenvalues of a triangular matrix."""
    return kd.Problem(lambda t, y: (0.3 * y[0] + y[1], -0.2 * y[1]), [0.0, 0.0], name="saddle", compiled=False)


def planets(*forces) -> kd.System:
    x = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.02], [-1.4, 0.1, 0.0]]
    v = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -0.86, 0.05]]
    return kd.System(x, v, [1.0, 1e-3, 3e-4], forces=[kd.Gravity(G=1.0), *forces], units="nbody")


def test_a_linear_problem_has_its_eigenvalues():
    found = kd.lyapunov_spectrum(saddle(), 400.0, "rk4", 0.1)
    np.testing.assert_allclose(found.exponents, [0.3, -0.2], rtol=0, atol=1e-7)
    assert found.complete
    assert found.dimension == 2.0
    one = kd.lyapunov_spectrum(saddle(), 400.0, "rk4", 0.1, count=1)
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
def test_what_makes_no_sense_is_said(given, message):
    with pytest.raises(InputError, match=message):
        kd.lyapunov_spectrum(planets(), **{"time": 1.0, **given})
    with pytest.raises(InputError, match="takes a System or a Problem, got str"):
        kd.lyapunov_spectrum("two-body", 1.0)


def test_the_command_finds_the_published_spectrum_of_lorenz(monkeypatch, tmp_path, capsys):
    def called(*words: str) -> int:
        monkeypatch.setattr(sys, "argv", ["kickdrift", "chaos", "ode-lorenz", "--time", "300", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return int(ended.value.code or 0)

    file = tmp_path / "spectrum.json"
    assert called("--integrator", "rk4", "--dt", "0.01", "--spectrum", "all", "--json", str(file)) == 0
    assert "exponent 3" in capsys.readouterr().out
    found = json.loads(file.read_text())
    np.testing.assert_allclose(found["exponents"], LORENZ, rtol=0, atol=0.03)
    assert found["sum"] == pytest.approx(DIVERGENCE, abs=1e-3)  # the error of the method
    assert found["dimension"] == pytest.approx(2.062, abs=2e-3)
    assert found["time_unit"] == ""
    assert called("--spectrum", "many") == 2
    assert "--spectrum: expected a number of exponents, or all, got 'many'" in capsys.readouterr().err
