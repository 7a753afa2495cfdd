"""Elements of a run's bodies over time, and the figure of its orbits."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import kickdrift as kd
from kickdrift.analysis.orbits import orbits as of
from kickdrift.cli.main import app
from kickdrift.errors import InputError
from kickdrift.forces import Gravity
from kickdrift.model.starts.elements import Elements, states
from kickdrift.model.state import State
from kickdrift.model.system import System
from kickdrift.plots import drawing, figures
from kickdrift.plots import orbits as plots_orbits
from kickdrift.systemfile.reading import load, loads
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.write.h5md import Writer
from tests.figures import saved_by

plot_orbits = partial(figures.plot_file, kind="orbits")

G, SUN = 1.0, 1.0


def write(path: Path, system: System, moves, times) -> Path:
    """A run's file of bodies at moves(t), positions and velocities (n, 3)."""
    s = system.state
    with Writer(path, system, method={"integrator": "kepler", "dt": 0.1}, every=1) as writer:
        for k, t in enumerate(times):
            x, v = moves(t)
            energies = {"kinetic_energy": 1.0, "potential_energy": -2.0, "total_energy": -1.0 - 1e-9 * np.sin(t)}
            state = State(np.array([x.T, v.T]), s.masses, s.ids, s.box, float(t), k)
            writer.append(state, energies, frame=True)
    return path


def planets(e=(0.1, 0.3), inc=(0.0, 0.5), a=(1.0, 4.0)):
    """Massless planets of a fixed star, whose elements are constant."""

    def moves(t):
        x, v = states(
            1.0, a=np.array(a), e=np.array(e), inc=np.array(inc), omega=0.4, Omega=0.2, M=t / np.array(a) ** 1.5
        )
        return np.vstack([np.zeros(3), x]), np.vstack([np.zeros(3), v])

    x, v = moves(0.0)
    names = ["star", *"bcdefgh"[: len(a)]]
    masses = [1.0, *[0.0] * len(a)]
    return System(x, v, masses, forces=[Gravity()], units="nbody", name="planets", names=names), moves


@pytest.fixture
def run(tmp_path):
    return write(tmp_path / "run.h5md", *planets(), np.linspace(0, 20, 60))


def test_elements_over_time_are_those_of_the_orbits(run):
    found = of.orbits(run)
    assert found.names == ("b", "c")
    assert found.times.shape == (60,)
    assert found.elements.a == pytest.approx(np.broadcast_to([1.0, 4.0], (60, 2)), rel=1e-12)
    assert found.elements.e == pytest.approx(np.broadcast_to([0.1, 0.3], (60, 2)), abs=1e-13)
    assert found.elements.inc[:, 1] == pytest.approx(0.5, abs=1e-13)
    assert np.array_equal(found.mu, np.ones((60, 2)))
    assert of.orbits(run, most_frames=7).elements.e.shape == (7, 2)
    with reader.open(run) as opened:
        assert np.array_equal(of.orbits(opened, "heliocentric").elements.e, found.elements.e)


def test_elements_as_a_table(run):
    found, table = of.orbits(run), of.orbital_elements(run)
    assert table.dtype.names == ("time", "body", "a", *found.elements._fields)
    assert table.shape == (60 * 2,)
    np.testing.assert_array_equal(table["body"], ["b", "c"] * 60)
    np.testing.assert_array_equal(table["time"], np.repeat(found.times, 2))
    np.testing.assert_array_equal(table["a"][table["body"] == "c"], found.elements.a[:, 1])
    np.testing.assert_allclose(table["e"][table["body"] == "b"], 0.1, rtol=1e-9)
    assert of.orbital_elements(run, "heliocentric", "invariable", most_frames=7).shape == (7 * 2,)


def test_the_invariable_plane_is_that_of_the_angular_momentum(tmp_path):
    system = load("solar-system")
    s = system.state
    path = write(tmp_path / "run.h5md", system, lambda t: (s.positions, s.velocities), [0.0, 1.0])
    ecliptic = of.orbits(path, plane="file")
    names = list(ecliptic.names)
    assert names == list(system.names[1:])
    tilt = np.degrees(ecliptic.elements.inc[0, names.index("Earth-Moon")])
    assert tilt == pytest.approx(23.44, abs=0.01)  # the obliquity, since the axes are those of the equator
    level = of.orbits(path, plane="invariable").elements
    assert level.a[0] == pytest.approx(ecliptic.elements.a[0], rel=1e-12)
    turn = of.paths(path).invariable_axes()
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    # Souami & Souchay 2012, Astron. Astrophys. 543, A133, doi:10.1051/0004-6361/201219011: the invariable plane has an
    # inclination of 1 deg 34' 43.3" to the ecliptic, and its node is at 107 deg 34' 56.2"
    tilt, node, obliquity = np.radians([1 + 34 / 60 + 43.3 / 3600, 107 + 34 / 60 + 56.2 / 3600, 23.4392911])
    x, y, z = np.sin(tilt) * np.sin(node), -np.sin(tilt) * np.cos(node), np.cos(tilt)
    c, s = np.cos(obliquity), np.sin(obliquity)
    assert np.degrees(np.linalg.norm(turn[2] - [x, c * y - s * z, s * y + c * z])) < 0.001


def test_paths_are_about_the_barycentre(tmp_path):
    system = load("figure-eight")
    s = system.state
    path = write(tmp_path / "run.h5md", system, lambda t: (s.positions + t, s.velocities + 1.0), [0.0, 5.0])
    found = of.paths(path)
    assert found.central is None
    assert found.positions[1] == pytest.approx(s.positions, abs=1e-14)
    assert found.velocities[1] == pytest.approx(s.velocities, abs=1e-14)
    with pytest.raises(InputError, match=r"no body has 0\.5 of all mass"):
        of.orbits(path)


@pytest.fixture
def bodies_that_leave(tmp_path):
    """Four planets: b absorbs c at t = 1, the file's third frame. At t = 2 the star absorbs d, and e is removed."""
    star, moves = planets(e=(0.1, 0.1, 0.2, 0.3), inc=(0.0, 0.3, 0.1, 0.2), a=(1.0, 2.0, 3.0, 4.0))
    masses = np.array([1.0, 1e-3, 1e-4, 1e-4, 1e-4])
    s = star.state
    system = System(s.positions, s.velocities, masses, forces=[Gravity()], units="nbody", names=star.names)

    def following(t):
        x, v = moves(t)
        for y in (x, v):
            if t >= 1.0:
                y[2] = y[1]
            if t >= 2.0:
                y[3], y[4] = y[0], np.nan
        return x, v

    return write(tmp_path / "run.h5md", system, following, np.arange(0.0, 4.0, 0.5)), masses


@pytest.mark.parametrize("frame", ["heliocentric", "jacobi", "barycentric"])
def test_bodies_that_are_gone_have_no_elements_and_the_others_do(bodies_that_leave, frame):
    path, masses = bodies_that_leave
    found = of.paths(path)
    there = np.ones((8, 5), dtype=bool)
    there[2:, 2] = there[4:, 3:] = False
    assert np.array_equal(np.isfinite(found.positions).all(axis=2), there)
    assert found.held[3] == pytest.approx([1.0, 1.1e-3, 0.0, 1e-4, 1e-4])
    assert found.held[5] == pytest.approx([1.0001, 1.1e-3, 0.0, 0.0, 0.0])
    for y in (found.positions, found.velocities):
        assert np.einsum("kn,knj->kj", found.held, np.nan_to_num(y)) == pytest.approx(np.zeros((8, 3)), abs=1e-15)
    orbits = of.orbits(path, frame)
    for values in (*orbits.elements, orbits.mu):
        assert np.array_equal(np.isfinite(values), there[:, 1:])
    assert orbits.mu[5, 0] == pytest.approx(1.0012)  # masses of the remaining bodies
    if frame == "heliocentric":  # e orbits the star, with both masses
        assert orbits.mu[0] == pytest.approx(1.0 + masses[1:])
        assert orbits.elements.e[:, 0] == pytest.approx(0.1, abs=0.01)


def test_a_run_that_bodies_leave_is_drawn(bodies_that_leave, tmp_path, drawn):
    plot_orbits(bodies_that_leave[0], tmp_path / "figure.png")
    eccentricities = [line.get_ydata() for line in panels(drawn[0])["Eccentricity"].lines]
    assert [len(each) for each in eccentricities] == [8, 2, 4, 4]


def test_bad_input(run, tmp_path):
    with pytest.raises(InputError, match="plane: expected one of file, invariable, got 'ecliptic'"):
        of.orbits(run, plane="ecliptic")
    with pytest.raises(InputError, match=r"frame: expected one of heliocentric, .*; did you mean 'jacobi'"):
        of.orbits(run, "jacobbi")
    system = System([[0.0, 0, 0], [2.0, 0, 0]], name="gas")
    s = system.state
    gas = write(tmp_path / "gas.h5md", system, lambda t: (s.positions, s.velocities), [0.0, 1.0])
    with pytest.raises(InputError, match="no gravity, so no orbits"):
        of.orbits(gas)
    for path, drawn in ((gas, False), (run, True)):
        with kd.open(path) as opened:
            assert plots_orbits.orbits_in(opened) == drawn
    run.with_suffix(".png").touch()
    with pytest.raises(InputError, match="exists already"):
        plot_orbits(run, run.with_suffix(".png"))


# -- the figure


@pytest.fixture
def drawn(monkeypatch) -> list:
    """Figures that were saved."""
    return saved_by(monkeypatch, drawing)


def panels(figure):
    return {axes.get_title(): axes for part in figure.subfigs for axes in part.axes}


def test_a_planetary_run_shows_orbits_elements_and_error(run, tmp_path, drawn):
    plot_orbits(run, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000
    found = panels(drawn[0])
    assert list(found)[:2] == ["In the x-y plane", "In space"]
    assert set(found) >= {"Semi-major axis", "Eccentricity", "Inclination (degrees)"}
    plane = found["In the x-y plane"]
    assert plane.get_aspect() == 1.0, "to scale"
    assert np.ptp(plane.get_xlim()) == pytest.approx(np.ptp(plane.get_ylim()))
    space = found["In space"]
    sizes = [np.ptp(limits) for limits in (space.get_xlim(), space.get_ylim(), space.get_zlim())]
    assert np.allclose(np.array(sizes) / sizes[0], space._box_aspect / space._box_aspect[0]), "to scale"
    names = [text.get_text() for text in drawn[0].subfigs[0].legends[0].get_texts()]
    assert names == ["star", "b", "c"]
    assert found["Eccentricity"].lines[1].get_ydata() == pytest.approx(0.3, abs=1e-12)
    assert found["Inclination (degrees)"].lines[1].get_ydata() == pytest.approx(np.degrees(0.5), abs=1e-10)


def test_frames_too_far_apart_for_a_path_are_drawn_as_the_orbit(tmp_path, drawn):
    system, moves = planets()
    path = write(tmp_path / "run.h5md", system, moves, np.linspace(0, 40, 15))
    plot_orbits(path, tmp_path / "figure.png")
    lines = [line for line in panels(drawn[0])["In the x-y plane"].lines if len(line.get_xdata()) == 361]
    assert len(lines) == 2 * plots_orbits.TURNS
    x, y = lines[0].get_data()
    assert np.hypot(x, y).min() == pytest.approx(0.9, rel=1e-3)
    assert np.hypot(x, y).max() == pytest.approx(1.1, rel=1e-3)


def test_two_equal_bodies_go_around_their_barycentre(tmp_path, drawn):
    def moves(t):
        x, v = states(1.0, a=1.0, e=0.5, M=t)
        return np.array([-x, x]) / 2, np.array([-v, v]) / 2

    system = System(*moves(0.0), [0.5, 0.5], forces=[Gravity()], units="nbody", name="pair")
    path = write(tmp_path / "run.h5md", system, moves, np.linspace(0, 40, 15))
    plot_orbits(path, tmp_path / "figure.png")
    lines = [line for line in panels(drawn[0])["In the x-y plane"].lines if len(line.get_xdata()) == 361]
    assert len(lines) == 2 * plots_orbits.TURNS
    for line in lines:
        x, y = line.get_data()
        assert np.hypot(x, y).min() == pytest.approx(0.25, rel=1e-3)
        assert np.hypot(x, y).max() == pytest.approx(0.75, rel=1e-3)


def test_a_wide_gap_gives_the_inner_bodies_a_panel(tmp_path, drawn):
    system, moves = planets(e=(0.0, 0.1, 0.05), inc=(0.0, 0.0, 0.0), a=(1.0, 1.5, 30.0))
    path = write(tmp_path / "run.h5md", system, moves, np.linspace(0, 40, 200))
    plot_orbits(path, tmp_path / "figure.png")
    inner = panels(drawn[0])["Inner bodies"]
    assert 1.65 < inner.get_xlim()[1] < 2.0


def test_bodies_without_a_centre_have_paths_alone(tmp_path, drawn):
    system = load("figure-eight")
    s = system.state
    path = write(
        tmp_path / "run.h5md", system, lambda t: (s.positions * np.cos(t), s.velocities), np.linspace(0, 1, 20)
    )
    plot_orbits(path, tmp_path / "figure.png")
    titles = list(panels(drawn[0]))
    assert titles[:2] == ["In the x-y plane", "In space"]
    assert len(titles) == 3
    assert titles[2].startswith("Relative energy error")


@pytest.mark.parametrize(("name", "elements"), [("test-particles", True), ("cluster", False)])
def test_many_bodies_are_points(tmp_path, drawn, name, elements):
    text = {
        "test-particles": """units = "astro"
[particles]
central = { body = "Sun", mass = 1.0 }
elements = [{ count = 30, mass = 0.0, a = [2.1, 3.3], e = [0.0, 0.2], inc = [0.0, 15.0], M = [0.0, 360.0] }]
seed = 1
""",
        "cluster": 'units = "nbody"\n[particles]\nplummer = { count = 30, seed = 1 }\n',
    }[name]
    system = loads(text + '[[force]]\ntype = "gravity"\n', name)
    s = system.state
    path = write(tmp_path / "run.h5md", system, lambda t: (s.positions, s.velocities), [0.0, 1.0])
    plot_orbits(path, tmp_path / "figure.png")
    found = [axes for part in drawn[0].subfigs for axes in part.axes]
    assert found[0].get_title().endswith("plane, at the end")
    assert len(found[0].lines[0].get_xdata()) == len(system)
    assert len(found) == (5 if elements else 3)
    assert name in drawn[0].get_suptitle()


def test_the_command_draws_orbits_where_there_is_gravity(run, tmp_path, monkeypatch):
    asked = []
    for kind in ("orbits", "energies"):
        draw = figures.KINDS[kind]
        monkeypatch.setitem(figures.KINDS, kind, lambda run, kind=kind, draw=draw: asked.append(kind) or draw(run))
    for flags in ((), ("--kind", "energies"), ("--kind", "orbits")):
        assert CliRunner().invoke(app, ["plot", str(run), "--overwrite", *flags]).exit_code == 0
    assert asked == ["orbits", "energies", "orbits"]
    wrong = CliRunner().invoke(app, ["plot", "--stability", "rk4", "--kind", "orbits"])
    assert isinstance(wrong.exception, InputError)


# --- elements of a Simulation ---


@pytest.mark.parametrize("frame", ["heliocentric", "jacobi", "barycentric"])
def test_the_table_of_the_present_is_what_a_file_of_it_gives(frame, tmp_path):
    sim, path = kd.Simulation(load("outer-solar-system"), "gauss-radau15"), tmp_path / "run.h5md"
    tables = {"invariable": sim.elements(frame, "invariable")}  # its plane is that of the file's first frame
    sim.run(until=3.0, every=1_000_000, output=path)
    tables["file"] = sim.elements(frame)
    for plane, table in tables.items():
        found, row = of.orbits(path, frame, plane), {"invariable": 0, "file": -1}[plane]
        assert (table.names, table.central, table.frame, table.plane) == (sim.system.names[1:], "Sun", frame, plane)
        assert table.time == found.times[row]
        for key in Elements._fields:
            expected = getattr(found.elements, key)[row]
            expected = expected if key in ("q", "e") else np.degrees(expected)
            np.testing.assert_allclose(getattr(table, key), expected, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(table.P, found.elements.period(found.mu)[row], rtol=1e-12)


def test_the_table_reads_by_name_and_prints():
    sim = kd.Simulation(load("trappist-1"))
    table = sim.elements()
    assert list(table) == list("bcdefgh")
    assert table["c"].a == table.a[1]
    lines = repr(table).splitlines()
    headings = [each.split()[0] for each in lines[0].split("  ") if each]
    assert headings == ["a", "e", "inc", "Omega", "omega", "f", "M", "P"]
    assert ("a (AU)" in lines[0], "inc (deg)" in lines[0], "P (yr)" in lines[0]) == (True, True, True)
    assert lines[2].split()[:2] == ["c", f"{table.a[1]:.8g}"]
    assert "(AU)" not in repr(kd.Simulation(load("kepler-e09")).elements())  # no unit has a name there
    with pytest.raises(InputError, match=r"elements: no body 'k' in the table \(known: b, c, d"):
        table["k"]


def test_bodies_that_left_are_not_in_the_table():
    bodies = [{"name": "star", "mass": 1.0}, {"name": "a", "mass": 1e-3, "a": 1.0}]
    system = System.from_elements([*bodies, {"name": "b", "mass": 1e-3, "q": 1.0, "e": 2.0, "f": 90.0}], units="nbody")
    sim = kd.Simulation(system.watched([kd.Escape(5.0, action="remove")]), "velocity-verlet", dt=0.01)
    sim.run(1000)
    assert sim.elements().names == ("a",)
    assert sim.elements()["a"].a == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("ode-lorenz", {}, "elements: a Problem has no bodies"),
        ("lj-1000", {}, "elements: units 'lj' define no G"),
        ("figure-eight", {}, "orbits: no body has 0.5 of all mass"),
        ("sun-jupiter", {"frame": "jacobian"}, "frame: expected one of heliocentric, jacobi, barycentric"),
        ("sun-jupiter", {"plane": "ecliptic"}, "plane: expected one of file, invariable"),
    ],
)
def test_no_table_where_there_are_no_orbits(name, options, expected):
    with pytest.raises(InputError, match=expected):
        kd.Simulation(load(name)).elements(**options)
