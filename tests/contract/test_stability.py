"""Stable step lengths computed from coefficients: against the literature, and against runs that blow up or stay
bounded."""

from __future__ import annotations

import math

import numpy as np
import pytest

from kickdrift.errors import InputError
from kickdrift.integrators import integrator
from kickdrift.integrators.runge_kutta import method as runge_kutta
from kickdrift.integrators.runge_kutta.method import Tableau
from kickdrift.integrators.splitting import method as splitting
from kickdrift.integrators.splitting.method import Splitting, composed, in_turn
from kickdrift.integrators.step_choice.stability import (
    half_trace,
    imaginary_interval,
    real_interval,
    stability_function,
    stability_function_of,
    stability_interval,
)
from kickdrift.plots import stability as plots_stability
from kickdrift.plots.drawing import save_figure
from tests.long import shortened
from tests.oracle import integrators as oracle_integrators

RUNGE_KUTTA = [row.name for row in runge_kutta.ROWS]
SPLITTINGS = [row.name for row in splitting.ROWS]
HEUN = Tableau("heun", ((1.0,),), (0.5, 0.5), 2, "Heun 1900")
KUTTA3 = Tableau("kutta3", ((0.5,), (-1.0, 2.0)), (1 / 6, 2 / 3, 1 / 6), 3, "Kutta 1901")


def implicit(name: str):
    """R(z) of an implicit method, from Hairer & Wanner 1996, table IV.3.1 and IV.5."""
    r3, r6 = math.sqrt(3.0), math.sqrt(6.0)
    radau = [
        [(88 - 7 * r6) / 360, (296 - 169 * r6) / 1800, (-2 + 3 * r6) / 225],
        [(296 + 169 * r6) / 1800, (88 + 7 * r6) / 360, (-2 - 3 * r6) / 225],
        [(16 - r6) / 36, (16 + r6) / 36, 1 / 9],
    ]
    tables = {
        "backward-euler": ([[1.0]], [1.0]),
        "implicit-midpoint": ([[0.5]], [1.0]),
        "gauss-legendre4": ([[0.25, 0.25 - r3 / 6], [0.25 + r3 / 6, 0.25]], [0.5, 0.5]),
        "radau-iia5": (radau, radau[-1]),
    }
    return stability_function_of(*tables[name])


@pytest.mark.parametrize("name", RUNGE_KUTTA)
def test_stability_function_is_the_exponential_to_the_order(name):
    method = integrator(name)
    r = stability_function(method)
    exact = [1 / math.factorial(k) for k in range(method.order + 2)]
    coefficients = np.pad(r.numerator.coef, (0, 2))
    np.testing.assert_allclose(coefficients[: method.order + 1], exact[:-1], rtol=1e-12)
    assert coefficients[method.order + 1] != pytest.approx(exact[-1], rel=1e-3)
    assert r.denominator.coef.tolist() == [1.0]


@pytest.mark.parametrize("name", RUNGE_KUTTA)
def test_steps_of_the_oracle_grow_as_the_stability_function_says(name):
    """On the oscillator lambda = ±i omega: the matrix of a step has the eigenvalues R(±i omega dt)."""
    dt = 0.7
    columns = [step_of_oracle(integrator(name), x, v, dt) for x, v in ((1.0, 0.0), (0.0, 1.0))]
    eigenvalues = np.linalg.eigvals(np.array(columns).T)
    expected = stability_function(integrator(name))(np.array([-1j, 1j]) * dt)
    np.testing.assert_allclose(np.sort_complex(eigenvalues), np.sort_complex(expected), rtol=1e-12)


@pytest.mark.parametrize("name", SPLITTINGS)
@pytest.mark.parametrize("dt", [0.3, 1.4, 2.2])
def test_half_trace_is_that_of_the_oracles_step(name, dt):
    columns = [step_of_oracle(integrator(name), x, v, dt) for x, v in ((1.0, 0.0), (0.0, 1.0))]
    matrix = np.array(columns).T
    half = half_trace(integrator(name))(dt**2)
    assert half == pytest.approx(np.trace(matrix) / 2, rel=1e-11, abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0, rel=1e-10)


def step_of_oracle(method, x: float, v: float, dt: float) -> list[float]:
    x, v = oracle_integrators.run(method, lambda t, x: -x, np.array([[x]]), np.array([[v]]), dt, 1)
    return [float(x[0, 0]), float(v[0, 0])]


def test_implicit_methods_have_pade_approximants():
    """Hairer & Wanner 1996, table IV.3.1: (0, 1), (1, 1), (2, 2) and (2, 3)."""
    pade = {
        "backward-euler": ([1], [1, -1]),
        "implicit-midpoint": ([1, 1 / 2], [1, -1 / 2]),
        "gauss-legendre4": ([1, 1 / 2, 1 / 12], [1, -1 / 2, 1 / 12]),
        "radau-iia5": ([1, 2 / 5, 1 / 20], [1, -3 / 5, 3 / 20, -1 / 60]),
    }
    for name, (numerator, denominator) in pade.items():
        r = implicit(name)
        np.testing.assert_allclose(np.pad(r.numerator.coef, (0, 4))[:4], np.pad(numerator, (0, 4))[:4], atol=1e-15)
        np.testing.assert_allclose(r.denominator.coef, denominator, rtol=1e-14)
        assert real_interval(r) == math.inf
        assert imaginary_interval(r) == math.inf


def test_intervals_in_closed_form():
    """rk4: |R(iy)|^2 - 1 = -y^6/72 + y^8/576; third order: -y^4/12 + y^6/36; second: y^4/4; Euler: y^2.

    On the negative axis R(-x) = -1 ends the interval for odd orders, R(-x) = 1 for even ones.
    """
    third = 2.512745326618329
    fourth = 2.785293563405282
    for method, real, imaginary in (
        (integrator("euler"), 2.0, 0.0),
        (integrator("midpoint"), 2.0, 0.0),
        (HEUN, 2.0, 0.0),
        (KUTTA3, third, math.sqrt(3.0)),
        (integrator("bogacki-shampine23"), third, math.sqrt(3.0)),
        (integrator("rk4"), fourth, math.sqrt(8.0)),
    ):
        assert real_interval(method) == pytest.approx(real, rel=1e-14)
        assert imaginary_interval(method) == pytest.approx(imaginary, rel=1e-14)
    for x, bound, order in ((third, -1.0, 3), (fourth, 1.0, 4)):
        assert sum((-x) ** k / math.factorial(k) for k in range(order + 1)) == pytest.approx(bound, abs=1e-14)


def test_intervals_of_the_literature():
    """dormand-prince45: 3.31, Hairer & Wanner 1996, figure IV.2.1 (DOPRI5); dop853 beyond 6 in the same figure."""
    assert real_interval(integrator("dormand-prince45")) == pytest.approx(3.3066, abs=5e-5)
    assert 6.0 < real_interval(integrator("dop853")) < 6.5
    # For order 5, |R(iy)|^2 - 1 = 2 (1/720 - c) y^6 + …, c the coefficient of z^6.
    for name, c in (("cash-karp45", 1 / 800), ("dormand-prince45", 1 / 600)):
        assert stability_function(integrator(name)).numerator.coef[6] == pytest.approx(c, rel=1e-13)
        assert (imaginary_interval(integrator(name)) > 0.0) is (c > 1 / 720)


def test_intervals_of_splittings():
    """Leapfrog 2; the triple jump 1.5734: the first zero of trace = 2, a cubic in (omega dt)^2 without the root at
    zero."""
    for name in ("symplectic-euler", "velocity-verlet", "leapfrog-dkd"):
        assert stability_interval(integrator(name)) == pytest.approx(2.0, rel=1e-15)
    w = 1.0 / (2.0 - 2.0 ** (1.0 / 3.0))
    forest_ruth = stability_interval(integrator("forest-ruth"))
    assert forest_ruth == pytest.approx(1.5734, abs=5e-5)
    assert forest_ruth == pytest.approx(stability_interval(integrator("yoshida4")), rel=1e-13)
    outer, inner = (
        np.array([[1 - h * h / 2, h - h**3 / 4], [-h, 1 - h * h / 2]]) for h in forest_ruth * np.array([w, 1 - 2 * w])
    )
    assert np.trace(outer @ inner @ outer) == pytest.approx(2.0, abs=1e-12)


@pytest.mark.parametrize("parts", [2, 3, 5, 7])
def test_touching_the_bound_does_not_end_the_interval(parts):
    """Several leapfrog steps in one are stable as long as each is, although the trace touches ±2 on the way."""
    kick, drift = (1 / parts,) * parts, (0.5 / parts, *[1 / parts] * (parts - 1), 0.5 / parts)
    method = Splitting("mine", *in_turn("AB", drift, kick), 2, "me")
    w = np.linspace(0.0, 2.0 * parts, 2001)
    assert np.abs(half_trace(method)(w**2)).max() == pytest.approx(1.0, abs=1e-6)
    assert stability_interval(method) == pytest.approx(2.0 * parts, rel=1e-10)


@pytest.mark.parametrize("outer", [0.34, 0.3334])
def test_a_narrow_gap_ends_the_interval(outer):
    """Three leapfrog steps of slightly unequal lengths: the trace slightly exceeds its bound and returns."""
    halves, wholes = composed((outer,))
    method = Splitting("mine", *in_turn("AB", halves, wholes), 2, "me")
    reach = stability_interval(method)
    assert reach == pytest.approx(3.0, abs=0.02)
    just_before, just_after, later = np.abs(half_trace(method)((reach * np.array([0.9999999, 1.0000001, 1.1])) ** 2))
    assert just_before < 1.0 < just_after
    assert later < 1.0


def test_a_wrong_start_or_a_pole_ends_it():
    assert real_interval(stability_function_of([[0.0]], [-1.0])) == 0.0  # R = 1 - z grows on the negative axis
    pole = stability_function_of([[-0.5]], [1.0])  # R = (1 + 3/2 z) / (1 + z/2)
    assert real_interval(pole) == pytest.approx(1.0, rel=1e-14)
    assert imaginary_interval(pole) == 0.0


def first_blow_up(method, dt: np.ndarray, steps: int, factor: float) -> float | None:
    """Smallest of the steps ``dt`` (n,) at which an oscillator with omega = 1 grows by a factor, or None."""
    with np.errstate(over="ignore", invalid="ignore"):
        x, v = oracle_integrators.run(
            method, lambda t, x: -x, np.ones((len(dt), 1)), np.zeros((len(dt), 1)), dt[:, None], steps
        )
    grown = ~(np.hypot(x, v)[:, 0] < factor)
    return float(dt[grown][0]) if grown.any() else None


@pytest.mark.parametrize("name", shortened(SPLITTINGS, {*SPLITTINGS} - {"blanes-moan4", "blanes-moan6"}))
def test_splittings_blow_up_where_they_should(name):
    reach = stability_interval(integrator(name))
    steps, grid = 2000, np.linspace(0.02, 1.3, 641)
    if name.startswith("blanes-moan"):  # a resonance at pi: the gap is narrow, and growth inside is slow
        assert first_blow_up(integrator(name), np.linspace(0.02, 0.99, 641) * reach, steps, factor=1e4) is None
        steps, grid = 60_000, np.linspace(0.99, 1.01, 401)
    measured = first_blow_up(integrator(name), grid * reach, steps, factor=1e4)
    assert measured == pytest.approx(reach, rel=0.01)


@pytest.mark.parametrize("name", [name for name in RUNGE_KUTTA if imaginary_interval(integrator(name)) > 0.0])
def test_runge_kutta_methods_blow_up_where_they_should(name):
    """A step rotates and scales the phase plane: |R| multiplies the norm in each step, and |R| < 1 below the bound."""
    reach = imaginary_interval(integrator(name))
    measured = first_blow_up(integrator(name), np.linspace(0.5, 1.3, 401) * reach, 500, factor=1.0 + 1e-9)
    assert measured == pytest.approx(reach, rel=0.01)


@pytest.fixture
def folder(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


def drawn_legends(monkeypatch, names, target) -> list[list[str]]:
    figures = []

    def keep(figure, path, *more):
        figures.append(figure)
        return save_figure(figure, path, *more)

    monkeypatch.setattr(plots_stability, "save_figure", keep)
    assert plots_stability.plot_stability(names, target) == target
    assert target.read_bytes().startswith(b"\x89PNG")
    return [[text.get_text() for text in axes.get_legend().get_texts()] for axes in figures[0].axes]


def test_figure_has_a_panel_for_each_kind(monkeypatch, tmp_path):
    names = ["rk4", "leapfrog", "dormand-prince45", "velocity-verlet", "forest-ruth"]
    regions, curves = drawn_legends(monkeypatch, names, tmp_path / "both.png")
    assert regions == ["rk4: real 2.7853, imaginary 2.8284", "dormand-prince45: real 3.3066, imaginary 0.9972"]
    assert curves == ["velocity-verlet: ω dt ≤ 2.0000", "forest-ruth: ω dt ≤ 1.5734", "exact: cos ω dt"]


def test_command(folder, kickdrift, tmp_path):
    code, out, err = kickdrift("plot", "--stability", "rk4", "--stability", "leapfrog")
    assert (code, err) == (0, "")
    assert out.startswith("stability.png\n")
    assert "2.7853" in out
    assert "2.8284" in out
    assert "velocity-verlet" in out
    assert (tmp_path / "stability.png").exists()
    assert kickdrift("plot", "--stability", "rk4", "--output", "other.svg")[0] == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "give FILE, or --stability NAME to draw an integrator"),
        (["run.h5md", "--stability", "rk4"], "give FILE or --stability, not both"),
        (["--stability", "rk5"], "integrator 'rk5' is unknown; did you mean rk4"),
        (["--stability", "rk4", "--output", "x.gif"], "must end in .png"),
        (["--stability", "rk4", "--output", "taken.png"], "taken.png: exists already"),
    ],
)
def test_command_refuses(folder, kickdrift, tmp_path, arguments, message):
    (tmp_path / "taken.png").write_text("precious")
    code, out, err = kickdrift("plot", *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert (tmp_path / "taken.png").read_text() == "precious"


def test_nothing_to_draw(tmp_path):
    with pytest.raises(InputError, match="nothing to draw"):
        plots_stability.plot_stability([], tmp_path / "none.png")
