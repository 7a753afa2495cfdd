"""Figures of ensembles: they draw the table's values and mark missing ones."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import LogNorm
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.cli.main import app
from kickdrift.ensemble import Ensemble, summary
from kickdrift.ensemble import table as tables
from kickdrift.ensemble.members import members_of
from kickdrift.ensemble.rows import row_of
from kickdrift.plots import ensemble as of
from kickdrift.plots.ensemble import grid_scale

MEGNO = {"x.e": [0.0, 0.1, 0.2], "x.a": [5.0, 5.5]}


def write(path, vary, value, column="megno", replicas=1, units="astro"):
    """A table with ``value(member)`` in a column: a number, or None for a failed member."""
    members = members_of(vary, replicas, 0)
    rows = []
    for member in (members[i] for i in range(len(members))):
        found = value(member)
        rows.append(
            row_of(member, "failed", "blew up") if found is None else row_of(member, "done", measured={column: found})
        )
    draws = {key: list(draw) for key, draw in members.draws.items()}
    provenance = {"system": "stars", "units": units, "grids": members.grids, "draws": draws}
    tables.write(tables.frame(rows, provenance), path)
    return path


@pytest.fixture
def draw(tmp_path, monkeypatch):
    """Function that writes a table, draws it and returns its figure."""
    figures = []
    save = of.save_figure

    def keep(figure, target, *more):
        figures.append(figure)
        return save(figure, target, *more)

    monkeypatch.setattr(of, "save_figure", keep)

    def drawn(vary, value, column="megno", suffix=".parquet", **options):
        path = write(tmp_path / f"table{suffix}", vary, value, column, **options)
        target = of.plot_ensemble(path, tmp_path / "figure.png", overwrite=True)
        assert target.read_bytes().startswith(b"\x89PNG")
        return figures[-1]

    return drawn


def legend(figure):
    """Texts in a figure's legend."""
    return [text.get_text() for each in figure.legends for text in each.get_texts()]


def mesh_of(figure):
    """Mesh of a map, and its values."""
    mesh = figure.axes[0].collections[-1]
    return mesh, np.ma.filled(mesh.get_array().astype(float), np.nan)


@pytest.mark.parametrize("suffix", tables.SUFFIXES)
def test_a_map_has_each_member_in_its_place(draw, suffix):
    figure = draw(MEGNO, lambda member: 10 * member.values["x.e"] + member.values["x.a"], suffix=suffix)
    axes = figure.axes[0]
    mesh, values = mesh_of(figure)
    np.testing.assert_allclose(values, [[5.0, 6.0, 7.0], [5.5, 6.5, 7.5]])
    np.testing.assert_allclose(mesh.get_coordinates()[0, :, 0], [-0.05, 0.05, 0.15, 0.25])
    np.testing.assert_allclose(mesh.get_coordinates()[:, 0, 1], [4.75, 5.25, 5.75])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x.e", "x.a (AU)")
    assert figure.get_suptitle() == "stars  ·  6 members"
    assert not legend(figure)


def test_colours_of_megno_have_regular_motion_in_their_middle(draw):
    figure = draw(MEGNO, lambda member: 2.0 + 50 * (member.values["x.e"] > 0.15))
    mesh, _ = mesh_of(figure)
    assert mesh.get_clim() == (0.0, 4.0)
    np.testing.assert_allclose(mesh.cmap(mesh.norm(2.0)), mesh.cmap(0.5))
    assert figure.axes[1].get_ylabel() == "MEGNO"
    assert mesh.colorbar.extend == "max"


def test_a_map_shows_means_over_replicas_and_where_there_is_nothing(draw):
    def value(member):
        if member.values["x.e"] == 0.1:
            return None if member.values["x.a"] == 5.0 else np.nan
        return None if member.number == 0 else 1.0 + member.replica

    figure = draw(MEGNO, value, replicas=3)
    _, values = mesh_of(figure)
    np.testing.assert_array_equal(values, [[2.5, np.nan, 2.0], [2.0, np.nan, 2.0]])
    under = figure.axes[0].collections[0]
    assert under.get_hatch() == "////"
    assert legend(figure) == ["no value"]
    assert figure.get_suptitle() == "stars  ·  18 members, 4 failed, 3 with no number"


def test_wide_values_have_logarithmic_colours_and_grids_in_any_order_are_sorted(draw):
    vary = {"dt": [0.1, 0.001, 0.01], "integrator": ["one", "two"]}
    figure = draw(vary, lambda member: member.values["dt"] ** 2, "energy_error", units="lj")
    mesh, values = mesh_of(figure)
    np.testing.assert_allclose(values, [[1e-6, 1e-4, 1e-2]] * 2)
    assert isinstance(mesh.norm, LogNorm)
    axes = figure.axes[0]
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    np.testing.assert_allclose(mesh.get_coordinates()[0, :, 0], 10.0 ** np.array([-3.5, -2.5, -1.5, -0.5]))
    assert [text.get_text() for text in axes.get_yticklabels()] == ["one", "two"]
    assert axes.get_xlabel() == "dt (τ)"
    assert [text.get_text() for text in axes.get_xticklabels()] == ["0.001", "0.01", "0.1"]
    assert figure.axes[1].get_ylabel() == "energy error"


def test_a_curve_is_of_means_with_their_standard_errors(draw):
    rng = np.random.default_rng(4)
    noise = rng.normal(size=15)
    figure = draw(
        {"velocities.temperature": "100:300:3"}, lambda member: noise[member.number], "pressure", replicas=5,
        units="metal",
    )  # fmt: skip
    axes = figure.axes[0]
    bars = axes.containers[0]
    at = noise.reshape(5, 3)
    np.testing.assert_allclose(bars.lines[0].get_xdata(), [100, 200, 300])
    np.testing.assert_allclose(bars.lines[0].get_ydata(), at.mean(axis=0))
    ends = np.array([segment[:, 1] for segment in bars.lines[2][0].get_segments()])
    np.testing.assert_allclose(np.diff(ends)[:, 0] / 2, at.std(axis=0, ddof=1) / np.sqrt(5))
    np.testing.assert_allclose(axes.lines[0].get_ydata(), noise)
    np.testing.assert_allclose(axes.lines[0].get_xdata(), [100, 200, 300] * 5)
    assert axes.get_xscale() == "linear"
    assert axes.get_xlabel() == "velocities.temperature (K)"
    assert axes.get_ylabel() == "pressure (eV/Å³)"
    assert legend(figure) == ["members", "mean ± standard error"]


def test_a_curve_marks_what_failed(draw):
    figure = draw({"dt": "log:0.001:1:4"}, lambda member: None if member.number == 2 else 10.0**-member.number, "x")
    axes = figure.axes[0]
    np.testing.assert_allclose(axes.containers[0].lines[0].get_xdata(), [0.001, 0.01, 1.0])
    crosses = axes.lines[-1]
    assert crosses.get_marker() == "x"
    np.testing.assert_allclose(crosses.get_xdata(), [0.1])
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    assert legend(figure) == ["no value"]
    assert figure.get_suptitle() == "stars  ·  4 members, 1 failed"


def test_names_are_points_without_a_line(draw):
    figure = draw({"integrator": ["rk4", "euler", "rk4"]}, lambda member: float(member.number))
    axes = figure.axes[0]
    line = axes.containers[0].lines[0]
    assert line.get_linestyle() == "None"
    np.testing.assert_array_equal(line.get_ydata(), [0, 1, 2])
    assert [text.get_text() for text in axes.get_xticklabels()] == ["rk4", "euler", "rk4"]
    assert legend(figure) == ["regular motion: 2"]


def test_replicas_alone_are_a_histogram(draw):
    figure = draw({}, lambda member: None if member.number == 8 else float(member.number % 4), "pressure", replicas=9)
    axes = figure.axes[0]
    heights = [patch.get_height() for patch in axes.patches if hasattr(patch, "get_height")]
    assert sum(heights[:4]) == 8
    assert heights[:4] == [2, 2, 2, 2]
    error = np.std([0, 1, 2, 3] * 2, ddof=1) / np.sqrt(8)
    assert legend(figure) == [f"mean 1.50 ± {error:.2f} (standard error)"]
    np.testing.assert_allclose(axes.lines[0].get_xdata(), 1.5)
    assert axes.get_ylabel() == "members"


@pytest.mark.parametrize("value", [2.0, 0.0, -1e-9])
def test_members_that_agree_are_one_bar(draw, value):
    axes = draw({}, lambda member: value, "x", replicas=5).axes[0]
    bars = axes.containers[0]
    assert [bar.get_height() for bar in bars] == [5]
    assert bars[0].get_x() < value < bars[0].get_x() + bars[0].get_width()


def test_a_wide_histogram_has_bars_that_are_even_in_the_logarithm(draw):
    axes = draw({}, lambda member: 10.0**member.number, "x", replicas=8).axes[0]
    assert axes.get_xscale() == "log"
    assert [bar.get_height() for bar in axes.containers[0]] == [2, 2, 2, 2]


def test_a_drawn_key_is_the_axis_of_points(draw):
    vary = {"x[1].mass": "log-uniform:1e-6:1e-3"}
    figure = draw(vary, lambda member: None if member.number == 3 else member.values["x[1].mass"], "y", replicas=9)
    axes = figure.axes[0]
    points, crosses = axes.lines
    assert len(points.get_xdata()) == 8
    np.testing.assert_array_equal(points.get_xdata(), points.get_ydata())
    assert crosses.get_xdata() == members_of(vary, 9, 0)[3].values["x[1].mass"]
    assert axes.get_xscale() == "log"
    assert axes.get_xlabel() == "x[1].mass (Msun)"


def test_two_drawn_keys_are_points_with_colours(draw):
    vary = {"x.omega": "uniform:0:360", "y": "normal:0:1"}
    figure = draw(vary, lambda member: None if member.number == 3 else member.values["y"], "z", replicas=9)
    axes = figure.axes[0]
    dots = axes.collections[0]
    np.testing.assert_array_equal(dots.get_offsets()[:, 1], dots.get_array())
    assert len(dots.get_array()) == 8
    assert len(axes.lines[0].get_xdata()) == 1
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x.omega (deg)", "y")
    assert legend(figure) == ["no value"]


def test_three_drawn_keys_are_a_histogram(draw):
    figure = draw(dict.fromkeys("abc", "uniform:0:1"), lambda member: float(member.number), "z", replicas=9)
    assert figure.axes[0].get_ylabel() == "members"


@pytest.mark.parametrize(
    ("values", "log"),
    [
        (np.linspace(1, 3, 9), False),
        (np.linspace(-1, 1, 9), False),
        (np.geomspace(1, 1.1, 9), True),
        ([0.001, 0.002, 0.005, 0.01], True),
        ([1, 2, 3, 5], False),
        ([1, 100], False),
        ([0, 1, 10, 100], False),
    ],
)
def test_which_grids_are_logarithmic(values, log):
    assert grid_scale([float(value) for value in values]).log == log


def test_points_of_a_grid_are_told_by_number_even_where_values_are_lists(tmp_path):
    vary = {"a": [[1.0, 2.0], [3.0, 4.0]], "b": [1], "c": [7, 7]}
    table = tables.read(write(tmp_path / "table.h5", vary, lambda member: float(member.number)))
    table.loc[table["member"] == 1, "status"] = "failed"
    found = summary.by_point(table, "megno")
    assert list(found.index) == [0, 2, 3]
    assert list(found["a"]) == [[1.0, 2.0], [3.0, 4.0], [3.0, 4.0]]
    assert list(found.columns) == ["a", "c", "mean", "error", "members"]


def test_names_bring_their_units(draw):
    axes = draw({"velocities.temperature": ["10 K", "20 K"]}, lambda member: 1.0, units="metal").axes[0]
    assert axes.get_xlabel() == "velocities.temperature"
    assert axes.get_xlim() == (-0.5, 1.5)


def test_a_list_is_a_name(draw):
    figure = draw({"box.lengths": [[4, 4, 4], [5, 5, 5]]}, lambda member: float(member.number), suffix=".parquet")
    assert [text.get_text() for text in figure.axes[0].get_xticklabels()] == ["[4, 4, 4]", "[5, 5, 5]"]


def test_labels_without_units():
    assert Ensemble("two-body", {"dt": [0.01, 0.02]}).provenance()["units"] == "nbody"
    assert Ensemble("ode-lorenz", {"dt": [0.01, 0.02]}).provenance()["units"] == ""
    assert Ensemble("sun-jupiter", {"dt": [0.01, 0.02]}).provenance()["units"] == "astro"


@pytest.mark.parametrize(("units", "label"), [("nbody", "dt"), ("", "dt"), ("si", "dt (s)")])
def test_plain_numbers_have_no_unit(draw, units, label):
    assert draw({"dt": [0.1, 0.2]}, lambda member: 1.0, units=units).axes[0].get_xlabel() == label


def test_refusals(tmp_path):
    three = write(tmp_path / "three.parquet", {key: [1, 2] for key in "abc"}, lambda member: 1.0)
    target = tmp_path / "figure.png"
    with pytest.raises(kd.InputError, match=r"three.parquet: 3 keys vary on grids, a, b, c, .* --vary c=VALUE"):
        of.plot_ensemble(three, target)
    two = write(tmp_path / "two.h5", MEGNO, lambda member: 1.0)
    with pytest.raises(kd.InputError, match=r"two.h5: column: expected one of megno, got 'mego'; did you mean 'megno'"):
        of.plot_ensemble(two, target, "mego")
    failed = write(tmp_path / "failed.h5", MEGNO, lambda member: None)
    with pytest.raises(kd.InputError, match=r"failed.h5: no member has a measured number"):
        of.plot_ensemble(failed, target)
    with pytest.raises(kd.InputError, match=r"nothing.h5: no such file"):
        of.plot_ensemble(tmp_path / "nothing.h5", target)
    with pytest.raises(kd.InputError, match=r"must end in .png"):
        of.plot_ensemble(two, tmp_path / "figure.gif")
    assert not target.exists()


def test_the_command(tmp_path):
    path = write(tmp_path / "table.parquet", MEGNO, lambda member: 2.0)

    def kickdrift(*words):
        return CliRunner().invoke(app, ["plot", *map(str, words)])

    assert kickdrift(path).stdout == f"{tmp_path / 'table.png'}\n"
    assert (tmp_path / "table.png").read_bytes().startswith(b"\x89PNG")
    assert "exists already" in str(kickdrift(path).exception)
    assert kickdrift(path, "--overwrite", "--column", "megno").exit_code == 0
    assert kickdrift(path, "--output", tmp_path / "other.svg").exit_code == 0
    assert "expected one of megno" in str(kickdrift(path, "--overwrite", "--column", "x").exception)
    assert "--kind is for a run's" in str(kickdrift(path, "--kind", "rdf").exception)
    assert "--kind or --column" in str(kickdrift("run.h5md", "--column", "megno", "--kind", "rdf").exception)
    assert "give FILE or --stability" in str(kickdrift("--stability", "rk4", "--column", "x").exception)
