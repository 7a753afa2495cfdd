"""Figures are valid pictures, change nothing outside themselves, and refuse bad input."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.jit.cache import folders
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.plots import drawing, figures
from kickdrift.plots import runs as plots
from kickdrift.trajectory.write.h5md import Writer
from tests.figures import saved_by

plot_run, plot_orbits = (partial(figures.plot_file, kind=kind) for kind in ("energies", "orbits"))


@pytest.fixture
def output(tmp_path) -> Path:
    return tmp_path / "figure.png"


def write_run(path: Path, box=(6.0, 6.0, 6.0), temperature=True, samples=50, units="lj") -> Path:
    rng = np.random.default_rng(3)
    system = System(rng.uniform(0, 6, (60, 3)), rng.normal(size=(60, 3)), box=box, units=units, name="some-system")
    s = system.state
    with Writer(path, system, method={"integrator": "velocity-verlet", "dt": 0.005}, every=10) as writer:
        for k in range(samples):
            noise = rng.normal() * 1e-3
            observables = {"kinetic_energy": 90.0 + k / 10, "potential_energy": -300.0 - k / 10 + noise}
            observables["total_energy"] = observables["kinetic_energy"] + observables["potential_energy"]
            if temperature:
                observables["temperature"] = 1.0
            writer.append(State(s.phase, s.masses, s.ids, s.box, k * 0.05, k * 10), observables, frame=k % 5 == 0)
    return path


def rows() -> list[dict]:
    times = np.linspace(0, 100, 400)
    error = np.abs(np.sin(times)) * 1e-5
    error[0] = 0.0
    blown = np.where(times < 50, times * 1e-3, np.nan)
    common = {"dt": 0.005, "times": times}
    return [
        {"method": "velocity-verlet", "table": "same step", "relative_error": error, "verdict": "bounded", **common},
        {"method": "rk4", "table": "same step", "relative_error": times * 1e-8, "verdict": "drift", **common},
        {"method": "euler", "table": "same cost", "relative_error": blown, **common},
    ]


@pytest.fixture
def drawn(monkeypatch) -> list:
    """Figures that were saved."""
    return saved_by(monkeypatch, drawing)


def png_size(path: Path) -> tuple[int, int]:
    data = path.read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")


def test_a_run_has_four_panels_with_true_units(tmp_path, output, drawn):
    assert plot_run(write_run(tmp_path / "run.h5md"), output) == output
    assert png_size(output) == (1200, 840)
    axes = drawn[0].axes
    assert len(axes) == 4
    assert [a.get_xlabel() for a in axes] == ["time (τ)", "time (τ)", "time (τ)", "r (σ)"]
    assert axes[0].get_ylabel() == "energy (ε)"
    assert "some-system" in drawn[0].get_suptitle()
    total = axes[0].lines[2].get_ydata()
    assert len(total) == 50
    error = axes[1].lines[-1].get_ydata()
    assert np.max(np.abs(error)) < 10
    assert np.max(np.abs(error)) >= 1, "the power of ten must be in the label"


def test_an_open_box_and_no_temperature_leave_two(tmp_path, output, drawn):
    plot_run(write_run(tmp_path / "run.h5md", box=None, temperature=False, units="nbody"), output)
    assert len(drawn[0].axes) == 2
    assert png_size(output)[1] < 500


def test_an_open_box_leaves_three(tmp_path, output, drawn):
    plot_run(write_run(tmp_path / "run.h5md", box=None), output)
    assert len(drawn[0].axes) == 3


def test_a_single_sample_can_be_drawn(tmp_path, output):
    plot_run(write_run(tmp_path / "run.h5md", samples=1), output)
    assert output.exists()


def test_long_series_keep_their_extremes():
    x = np.arange(100_000.0)
    y = np.sin(x)
    y[54_321] = 7.0
    thin_x, thin_y = drawing.thin(x, y)
    assert len(thin_x) <= drawing.MAX_POINTS
    assert thin_y.max() == 7.0
    assert thin_x[np.argmax(thin_y)] == 54_321
    assert np.all(np.diff(thin_x) > 0)


def test_a_benchmark_has_a_panel_for_each_table(output, drawn):
    plots.plot_benchmark(rows(), output)
    axes = drawn[0].axes
    assert [a.get_title() for a in axes] == ["Same step", "Same cost"]
    assert all(a.get_yscale() == "log" for a in axes)
    labels = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert labels == ["velocity-verlet, dt = 0.005: bounded", "rk4, dt = 0.005: drift"]
    assert axes[1].lines[0].get_xdata().max() < 50, "nothing may be drawn after a blow-up"
    faint, strong = axes[0].lines[:2]
    assert len(strong.get_xdata()) == plots.WINDOWS
    raw = np.abs(np.sin(np.linspace(0, 100, 400)))[1:] * 1e-5
    np.testing.assert_allclose(strong.get_ydata()[0], np.sqrt(np.mean(raw[:8] ** 2)))
    assert len(faint.get_xdata()) == 399


@pytest.mark.parametrize("suffix", [".pdf", ".svg"])
def test_other_formats(tmp_path, suffix):
    target = tmp_path / f"figure{suffix}"
    plots.plot_benchmark(rows(), target)
    assert target.stat().st_size > 1000


def test_bad_input(tmp_path, output):
    with pytest.raises(InputError, match=r"must end in \.png, \.pdf, \.svg"):
        plots.plot_benchmark(rows(), tmp_path / "figure.bmp")
    with pytest.raises(InputError, match="there is no folder"):
        plots.plot_benchmark(rows(), tmp_path / "nowhere" / "figure.png")
    with pytest.raises(InputError, match="nothing to draw"):
        plots.plot_benchmark([], output)
    output.write_text("precious")
    with pytest.raises(InputError, match="exists already"):
        plots.plot_benchmark(rows(), output)
    with pytest.raises(InputError, match="is not a figure that kickdrift wrote; it is not replaced"):
        plots.plot_benchmark(rows(), output, overwrite=True)
    assert output.read_text() == "precious"
    output.unlink()
    plots.plot_benchmark(rows(), output)
    plots.plot_benchmark(rows(), output, overwrite=True)
    assert png_size(output)
    with pytest.raises(InputError, match="no such file"):
        plot_run(tmp_path / "none.h5md", tmp_path / "b.png")
    with pytest.raises(InputError, match="no sample"):
        plot_run(write_run(tmp_path / "empty.h5md", samples=0), tmp_path / "b.png")


def test_drawing_stays_out_of_the_home_folder_and_out_of_pyplot(tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    code = """
import os, sys
before = dict(os.environ)
from kickdrift.plots import orbits
from kickdrift.plots import runs as plots
assert "matplotlib" not in sys.modules
row = {"method": "a", "dt": 1.0, "table": "t", "times": [1.0, 2.0], "relative_error": [1e-3, 1e-4]}
plots.plot_benchmark([row], sys.argv[1])
assert "matplotlib.pyplot" not in sys.modules and "numba" not in sys.modules
assert dict(os.environ) == before
"""
    environment = {
        k: v for k, v in os.environ.items() if k not in ("MPLCONFIGDIR", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")
    }
    environment["HOME"] = str(home)
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "f.png")], check=True, env=environment)
    assert not list(home.iterdir())


def test_the_cache_folder_is_writable_and_falls_back(tmp_path, monkeypatch):
    assert folders.folder() == Path(folders.__file__).resolve().parents[2] / "__pycache__"
    blocked = tmp_path / "site-packages"
    blocked.write_text("a file where a folder would be")
    monkeypatch.setattr(folders, "__file__", str(blocked / "jit" / "cache" / "folders.py"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert folders.folder.__wrapped__() == tmp_path / "xdg" / "kickdrift"


def test_the_energy_error_excludes_what_a_merger_takes_out(tmp_path, monkeypatch):
    """The figure shows the report's number."""
    system = kd.System(
        [[0, 0, 0], [1.0, 0, 0], [9.0, 0, 0]], [[0.1, 0, 0], [-0.1, 0, 0], [0, 0.1, 0]], masses=[1, 1, 1e-3],
        forces=[kd.Gravity(G=0.01)], units="nbody", radii=0.2, events=[kd.Collision(action="merge")],
    )  # fmt: skip
    path = tmp_path / "run.h5md"
    report = kd.Simulation(system, "leapfrog", dt=0.01).run(500, every=5, output=path)
    assert report.energy_taken
    titles = []
    for draw in (plot_run, plot_orbits):
        monkeypatch.setattr(
            drawing, "save_figure",
            lambda figure, target, *more: titles.extend(
                axes.get_title() for sub in (figure, *figure.subfigs) for axes in sub.axes
            ),
        )  # fmt: skip
        draw(path, tmp_path / "figure.png")
    wanted = f"Relative energy error (RMS {report.energy.rms_relative_error:.2g})"
    assert titles.count(wanted) >= 2
