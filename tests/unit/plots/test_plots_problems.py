"""Figures of Problems: the panels hold the run's own numbers, and methods stand side by side."""

from __future__ import annotations

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.plots import drawing
from kickdrift.plots import problems as plots
from tests.figures import saved_by

PENDULUM, LORENZ = kd.load("ode-pendulum"), kd.load("ode-lorenz")


@pytest.fixture
def drawn(monkeypatch) -> list:
    """The figures that were saved."""
    return saved_by(monkeypatch, drawing)


def line(axes, k: int = 0):
    return axes.lines[k].get_data()


def test_a_run_has_series_portrait_and_energy_error(tmp_path, drawn):
    path = tmp_path / "run.h5"
    kd.Simulation(PENDULUM).run(400, every=10, output=path)
    assert plots.plot_problem(path, tmp_path / "run.png") == tmp_path / "run.png"
    with kd.open(path) as run:
        times, y, energies = run.times, run.y, run.energies
    series, portrait, error = drawn[0].axes
    np.testing.assert_array_equal(line(series), [times, y[:, 0]])
    assert len(series.lines) == 1  # the position alone
    np.testing.assert_array_equal(line(portrait), y.T)
    assert (portrait.get_xlabel(), portrait.get_ylabel()) == ("y0", "y1")
    np.testing.assert_allclose(line(error)[1], np.abs(energies[1:] - energies[0]) / abs(energies[0]), rtol=1e-12)
    assert error.get_yscale() == "log"
    assert "velocity-verlet, dt = 0.05" in drawn[0].get_suptitle()


@pytest.mark.parametrize("suffix", [".h5", ".csv", ".parquet"])
def test_an_equation_of_three_has_no_energy(tmp_path, drawn, suffix):
    path = tmp_path / f"run{suffix}"
    kd.Simulation(LORENZ, "rk4", dt=0.01).run(100, output=path)
    plots.plot_problem(path, tmp_path / "run.png")
    series, portrait = drawn[0].axes
    assert [each.get_label() for each in series.lines] == ["y0", "y1", "y2"]
    assert portrait.get_ylabel() == "y1"
    plots.plot_problem(path, tmp_path / "column.png", "y2")
    with kd.open(path) as run:
        np.testing.assert_array_equal(line(drawn[1].axes[0]), [run.times, run.y[:, 2]])
    with pytest.raises(InputError, match="column 'energy': its columns are time, y0, y1, y2"):
        plots.plot_problem(path, tmp_path / "none.png", "energy")
    with pytest.raises(InputError, match="exists already"):
        plots.plot_problem(path, tmp_path / "run.png")


def test_methods_stand_side_by_side(tmp_path, drawn):
    methods = ["euler", "rk4", "leapfrog"]
    plots.plot_methods(PENDULUM, methods, tmp_path / "all.png", time=20.0, options={"dt": 0.1})
    axes = np.array(drawn[0].axes).reshape(3, 3)
    assert [each.get_title() for each in axes[0]] == [f"{name}, dt = 0.1" for name in methods]
    for name, column in zip(methods, axes.T, strict=True):
        sim, seen = kd.Simulation(PENDULUM, name, dt=0.1), []
        sim.run(200, every=1, observe=lambda sim, seen=seen: seen.append(sim.state.y))
        np.testing.assert_array_equal(line(column[1]), np.array(seen).T)
        largest = sim.report().energy.max_relative_error
        assert line(column[2])[1].max() == pytest.approx(largest, rel=1e-12)
    assert len({each.get_ylim() for each in axes[2]}) == 1  # one scale for all errors


def test_a_run_that_blows_up_is_drawn_as_far_as_it_came(tmp_path, drawn):
    plots.plot_methods(LORENZ, ["euler", "dop853"], tmp_path / "all.png", time=3.0, options={"dt": 0.05})
    titles = [each.get_title() for each in drawn[0].axes[:2]]
    assert titles[0].startswith("euler, dt = 0.05\nblows up at t = ")
    assert titles[1] == "dop853, rtol = 1e-09"


def test_what_makes_no_sense_is_said(kickdrift, tmp_path):
    run = tmp_path / "run.h5"
    kd.Simulation(PENDULUM).run(10, output=run)
    figure = ("--output", tmp_path / "a.png")
    refused = [
        (("ode-pendulum", "--integrator", "rk-4"), "rk-4 is 'rk4' here"),
        (("ode-pendulum", "--integrator", "rk4", "--rtol", "1e-6"), "rtol: rk4 does not take it"),
        (("ode-lorenz", "--integrator", "leapfrog", "--dt", "0.1"), "accelerations that depend on positions"),
        (("lj-1000", "--integrator", "rk4"), "is a system of particles"),
        (("ode-pendulum", "--kind", "rdf"), "--kind is for a run's file"),
        ((run, "--integrator", "rk4"), "--integrator, --time and options of a method are for an ODE's system file"),
        ((run, "--kind", "rdf"), "--kind is for a run's .h5md"),
    ]
    for words, message in refused:
        status, _, err = kickdrift("plot", *words, *figure)
        assert (status, err.count("\n")) == (2, 1), err
        assert message in err
    assert not (tmp_path / "a.png").exists()
    assert (
        kickdrift("plot", "ode-pendulum", "--integrator", "euler", "--integrator", "rk4", "--time", "5", *figure)[0]
        == 0
    )
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
