"""Figures in Python: the same as those of the command line, as matplotlib Figures."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.drawing import Figures
from kickdrift.cli.main import app
from kickdrift.plots import figures
from tests.systems import liquid


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("figures") / "liquid.h5md"
    kd.Simulation(liquid(), dt=0.001).run(20, every=1, output=path)
    return path


def pixels(figure: Figure) -> np.ndarray:
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())


def test_the_command_line_has_the_kinds_of_python():
    assert {str(kind) for kind in Figures} == set(figures.KINDS)


@pytest.mark.parametrize("more", [{}, {"kind": "energies"}, {"kind": "rdf"}, {"column": "momentum"}])
def test_a_run_draws_what_the_command_draws(path, tmp_path, more):
    from matplotlib.image import imread

    target = tmp_path / "figure.png"
    flags = [text for key, value in more.items() for text in (f"--{key}", value)]
    assert CliRunner().invoke(app, ["plot", str(path), "--output", str(target), *flags]).exit_code == 0
    with kd.open(path) as run:
        found = run.plot(**more)
    assert isinstance(found, Figure)
    np.testing.assert_array_equal(pixels(found)[:, :, :3], (imread(target) * 255).round()[:, :, :3])


def test_a_run_refuses_what_it_does_not_have(path):
    with kd.open(path) as run:
        with pytest.raises(kd.InputError, match=r"kind: expected one of orbits, .*did you mean 'energies'"):
            run.plot("energy")
        with pytest.raises(kd.InputError, match="give kind or column, not both"):
            run.plot("rdf", column="momentum")
        with pytest.raises(kd.InputError, match="column 'none'"):
            run.plot(column="none")


def test_a_report_draws_its_samples(path):
    sim = kd.Simulation(liquid(), dt=0.001)
    report = sim.run(20, every=1)
    energies, error, temperature = report.plot().axes
    assert [line.get_label() for line in energies.lines] == ["kinetic", "potential", "total"]
    with kd.open(path) as run:
        np.testing.assert_array_equal(energies.lines[2].get_ydata(), run.energies.total)
        np.testing.assert_array_equal(temperature.lines[0].get_ydata(), run.observables["temperature"])
    assert f"RMS {report.energy.rms_relative_error:.2g}" in error.get_title()
    assert len(sim.plot().axes) == 3


def test_a_problem_draws_its_energy_error_if_it_has_an_energy():
    (axes,) = kd.Simulation(kd.load("ode-harmonic")).run(20, every=1).plot().axes
    assert len(axes.lines[-1].get_xdata()) == 21
    sim = kd.Simulation(kd.Problem(lambda t, y: -y, [1.0]), "rk4", dt=0.1)
    with pytest.raises(kd.InputError, match="problem: has no energy to draw"):
        sim.run(2).plot()


def test_stability_is_a_figure_with_the_numbers_of_the_command():
    found = kd.stability("rk4", kd.integrator("leapfrog"))
    assert isinstance(found, Figure)
    labels = [text.get_text() for axes in found.axes for text in axes.get_legend().get_texts()]
    assert "rk4: real 2.7853, imaginary 2.8284" in labels
    assert kd.integrator("rk4").stability == pytest.approx(
        {"real lambda dt": 2.785293563405282, "imaginary lambda dt": 2 * np.sqrt(2)}  # Hairer & Wanner 1996, IV.2
    )
    assert kd.integrator("leapfrog").stability == pytest.approx({"omega dt": 2.0})
    with pytest.raises(kd.InputError, match="name an integrator"):
        kd.stability()
    with pytest.raises(kd.InputError, match="no stability function is known"):
        kd.stability("lsoda")


def test_a_notebook_shows_a_figure():
    assert kd.stability("rk4")._repr_png_().startswith(b"\x89PNG")


def test_problems_draw_themselves(tmp_path):
    """A Problem runs with several methods side by side; a file of its run draws what the command draws."""
    problem = kd.load("ode-pendulum")
    figure = problem.plot(kd.integrator("euler", dt=0.05), kd.integrator("rk4", dt=0.1), time=2.0)
    titles = [axes.get_title() for axes in figure.axes[:2]]
    assert titles == ["euler, dt = 0.05", "rk4, dt = 0.1"]
    kd.Simulation(problem, "rk4", dt=0.05).run(20, output=tmp_path / "run.h5")
    with kd.open(tmp_path / "run.h5") as run:
        assert len(run.plot().axes) == 3
        assert len(run.plot(column="y0").axes) == 1
        with pytest.raises(kd.InputError, match="column 'speed': its columns are"):
            run.plot(column="speed")
