"""Figures of observables: they draw the computed values with their errors, for each species."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.analysis import mean_squared_displacement, radial_distribution
from kickdrift.cli.main import app
from kickdrift.errors import InputError
from kickdrift.model.state import State
from kickdrift.plots import drawing
from kickdrift.plots import observables as of
from kickdrift.plots.figures import plot_file
from kickdrift.trajectory.write.h5md import Writer
from tests.figures import saved_by


def plot_observable(path, kind, target):
    return plot_file(path, target, kind)


def write(path, frames=200, species=None, box=(6.0, 6.0, 6.0)):
    """A gas of walkers whose velocities decorrelate in a few frames."""
    rng = np.random.default_rng(2)
    x, v = rng.uniform(0, 6, (30, 3)), rng.normal(size=(30, 3))
    system = kd.System(x, v, box=box, species=species, name="walkers")
    s = system.state
    with Writer(path, system, method={"integrator": "none", "dt": 0.01}, every=10) as writer:
        for k in range(frames):
            v = 0.5 * v + rng.normal(size=v.shape)
            x = x + 0.1 * v
            writer.append(State(np.array([x.T, v.T]), s.masses, s.ids, s.box, 0.1 * k, 10 * k), {})
    return path


@pytest.fixture
def drawn(monkeypatch):
    """Figures that were saved."""
    return saved_by(monkeypatch, drawing)


@pytest.mark.parametrize("kind", list(of.KINDS))
def test_every_kind_is_a_picture_with_its_errors(tmp_path, drawn, kind):
    path, target = write(tmp_path / "run.h5md"), tmp_path / "figure.png"
    assert plot_observable(path, kind, target) == target
    assert target.read_bytes().startswith(b"\x89PNG")
    above, below = drawn[0].axes
    assert below.get_ylabel() == "standard error"
    assert len(below.lines[0].get_xdata()) > 3
    assert above.collections, "errors must be bars or a band"
    assert below.get_xlim() == above.get_xlim()
    assert "walkers" in drawn[0].get_suptitle()


def test_lines_are_the_observables(tmp_path, drawn):
    path = write(tmp_path / "run.h5md")
    plot_observable(path, "msd", tmp_path / "msd.png")
    found = mean_squared_displacement(path)
    above, below = drawn[0].axes
    np.testing.assert_array_equal(above.lines[0].get_ydata(), found.values[1:])
    known = np.isfinite(found.error) & (found.error > 0)
    np.testing.assert_array_equal(below.lines[0].get_ydata(), found.error[known])
    assert not known[-1], "the longest lags have no error"
    plot_observable(path, "rdf", tmp_path / "rdf.png")
    with kd.open(path) as run:
        rdf = radial_distribution(run[1:])
    np.testing.assert_array_equal(drawn[1].axes[0].lines[-1].get_ydata(), rdf.g)


def test_species_have_lines_of_their_own(tmp_path, drawn):
    path = write(tmp_path / "run.h5md", species=["Ar" if k % 3 else "Kr" for k in range(30)])
    for kind, labels in (("rdf", ["Kr–Kr", "Kr–Ar", "Ar–Ar"]), ("vacf", ["Kr", "Ar"])):
        plot_observable(path, kind, tmp_path / f"{kind}.png")
        assert [text.get_text() for text in drawn[-1].axes[0].get_legend().get_texts()] == labels


def test_few_frames_have_no_errors(tmp_path, drawn):
    path = write(tmp_path / "run.h5md", frames=3)
    for kind in of.KINDS:
        with pytest.warns(UserWarning, match="points?; write") if kind in ("msd", "vacf") else nullcontext():
            plot_observable(path, kind, tmp_path / f"{kind}.png")
    assert len(drawn) == len(of.KINDS)


def test_frames_are_spread_and_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(of, "WORK", 30**2 * 20)
    with kd.open(write(tmp_path / "run.h5md")) as run:
        chosen = np.arange(len(run))[of._spread(run)]
    assert len(chosen) == 20
    assert (chosen[0], chosen[-1]) == (9, 199)


def test_on_the_command_line(tmp_path):
    path = write(tmp_path / "run.h5md")
    done = CliRunner().invoke(app, ["plot", str(path), "--kind", "vacf"])
    assert (done.exit_code, done.stdout.strip()) == (0, str(tmp_path / "run.png"))


def test_bad_input(tmp_path):
    path = write(tmp_path / "run.h5md", box=None)
    with pytest.raises(InputError, match="needs a periodic box"):
        plot_observable(path, "rdf", tmp_path / "rdf.png")
    with pytest.raises(InputError, match=r"must end in \.png"):
        plot_observable(path, "msd", tmp_path / "msd.gif")
    with pytest.raises(InputError, match="no frame to draw"):
        plot_observable(write(tmp_path / "empty.h5md", frames=0), "msd", tmp_path / "msd.png")


def test_the_displacement_says_its_diffusion_coefficient(tmp_path, drawn):
    path = write(tmp_path / "run.h5md")
    plot_observable(path, "msd", tmp_path / "msd.png")
    d = mean_squared_displacement(path).diffusion()
    (label,) = [text.get_text() for text in drawn[0].axes[0].get_legend().get_texts()]
    assert label.startswith(f"D = {d.value:.3g} ± {d.error:.1g} σ²/τ")
    assert np.isfinite(d.error)
    assert 0.4 < d.window[0] / d.window[1] < 0.6


@pytest.mark.parametrize("kind", ["msd", "vacf"])
def test_a_curve_of_two_points_has_markers_and_a_warning(tmp_path, drawn, kind):
    path = write(tmp_path / "run.h5md", frames=8)
    with pytest.warns(UserWarning, match=rf"{kind}: the curve has \d points?; write frames more often"):
        plot_observable(path, kind, tmp_path / "figure.png")
    assert drawn[0].axes[0].lines[-1].get_marker() == "o"


def overlaps(one, other) -> bool:
    return one.x0 < other.x1 and other.x0 < one.x1 and one.y0 < other.y1 and other.y0 < one.y1


def test_panels_of_an_odd_number_stand_apart():
    """A report has no g(r), as the run of a cluster, so its figure has three panels."""
    figure = kd.Simulation(kd.load("lj-1000-switch"), "velocity-verlet", 0.005).run(20, every=1).plot()
    figure.canvas.draw()
    boxes = [axes.get_tightbbox() for axes in figure.axes]
    assert len(boxes) == 3
    assert not any(overlaps(boxes[i], boxes[j]) for i in range(3) for j in range(i))


@pytest.mark.parametrize("span", [(0.02, 0.5), (0.3, 40.0), (0.011, 0.09)])
def test_labels_of_logarithmic_axes_do_not_touch(span):
    figure = drawing.new_figure(7.2, 6.0)
    axes = drawing.new_axes(figure, (4, 1, 4))
    axes.set(xscale="log", yscale="log", xlim=span, ylim=span)
    drawing.few_labels(axes)
    figure.canvas.draw()
    for axis in (axes.xaxis, axes.yaxis):
        ticks = [each for each in [*axis.get_major_ticks(), *axis.get_minor_ticks()] if each.label1.get_text()]
        shown = [each.label1.get_window_extent() for each in ticks if span[0] <= each.get_loc() <= span[1]]
        assert not any(overlaps(shown[i], shown[j]) for i in range(len(shown)) for j in range(i))
