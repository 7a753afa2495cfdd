"""Systems to and from rebound: bodies and G to the bit, and methods that continue as in the other program."""

from __future__ import annotations

import sys
import warnings

import numpy as np
import pytest
import rebound
from hypothesis import given
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.bridges.rebound_system import KERNELS, PASSAGES, SABA
from kickdrift.model.bridged import bridge
from kickdrift.model.run_defaults import RunDefaults

FIELDS = ("m", "x", "y", "z", "vx", "vy", "vz", "r")
UNITS = [None, ("AU", "yr", "Msun"), ("m", "s", "kg"), ("AU", "yr2pi", "Msun"), ("km", "day", "MEarth")]


def planets(units=None, massless: int = 2) -> rebound.Simulation:
    """A star, two planets and test particles, some with names."""
    sim = rebound.Simulation()
    if units:
        sim.units = units
    sim.add(m=1.0, r=0.005, name="Sun")
    sim.add(m=1e-3, a=1.1, e=0.1, inc=0.1, name="💫")
    sim.add(m=3e-4, a=2.3, e=0.2, omega=1.0)
    for k in range(massless):
        sim.add(a=3.5 + k, e=0.01, M=k)
    sim.N_active = 3
    sim.move_to_com()
    return sim


def bodies(sim: rebound.Simulation) -> list:
    return [[getattr(p, field) for field in FIELDS] + [p.name] for p in sim.particles]


# --- both directions ---


@pytest.mark.parametrize("units", UNITS)
def test_a_simulation_comes_back_to_the_bit(units):
    sim = planets(units)
    sim.t, sim.softening, sim.dt = 12.5, 0.01, 0.03
    sim.integrator = "leapfrog"
    back = kd.System.from_rebound(sim).to_rebound()
    assert bodies(back) == bodies(sim)
    assert back.units == sim.units
    for key in ("G", "t", "dt", "softening", "N_active", "integrator", "gravity"):
        assert getattr(back, key) == getattr(sim, key), key
    assert back.energy() == sim.energy()


def test_a_simulation_with_a_g_of_its_own_comes_back():
    sim = planets()
    sim.G = 0.1 + 0.2
    system = kd.System.from_rebound(sim)
    assert system.forces == (kd.Gravity(G=0.1 + 0.2),)
    assert system.units.name == "nbody"
    assert system.to_rebound().G == sim.G


@pytest.mark.parametrize(
    ("units", "name", "length", "force"),
    [
        (None, "nbody", "length", kd.Gravity()),
        (("yr", "msun", "AU"), "astro", "AU", kd.Gravity(G=39.476926421373)),
        (("m", "s", "kg"), "si", "m", kd.Gravity(G=6.67408e-11)),
        (("AU", "yr2pi", "Msun"), "nbody", "au", kd.Gravity()),
    ],
)
def test_units_are_ours_where_we_have_them(units, name, length, force):
    """G is rebound's: for AU, yr and Msun 7.5e-12 more than from DE421's G M of the Sun."""
    system = kd.System.from_rebound(planets(units))
    assert (system.units.name, system.units.length) == (name, length)
    assert system.forces == (force,)
    if name == "nbody" and units:
        assert system.units.unit("velocity") == "au/yr2pi"
        assert system.units.gravity == pytest.approx(1.0, rel=1e-11)


numbers = st.floats(-1e200, 1e200, allow_nan=False)
positive = st.floats(0, 1e100)


@given(
    rows=st.lists(st.tuples(*[numbers] * 6, positive, positive), min_size=1, max_size=5),
    unit=st.sampled_from(["nbody", "astro", "si"]), G=st.none() | st.floats(1e-20, 1e20), time=numbers,
)  # fmt: skip
def test_a_system_comes_back_to_the_bit(rows, unit, G, time):
    x, v = [row[:3] for row in rows], [row[3:6] for row in rows]
    masses, radii = [1.0, *(row[6] for row in rows[1:])], np.array([row[7] for row in rows])
    names = [f"body {k}" for k in range(len(rows))]
    system = kd.System(x, v, masses, None, [kd.Gravity(G=G)], unit, names=names, radii=radii)
    system = system.at(system.state.phase, time)
    back = kd.System.from_rebound(system.to_rebound())
    np.testing.assert_array_equal(back.state.phase, system.state.phase)
    np.testing.assert_array_equal(back.state.masses, system.state.masses)
    np.testing.assert_array_equal(np.zeros(len(rows)) if back.radii is None else back.radii, radii)
    assert (back.names, back.units, back.state.time) == (system.names, system.units, time)
    assert (back.forces[0].G or back.units.gravity) == (G or system.units.gravity)


def test_names_are_kept_and_made_where_only_some_have_one():
    assert kd.System.from_rebound(planets()).names == ("Sun", "💫", "particle 2", "particle 3", "particle 4")
    sim = rebound.Simulation()
    sim.add(m=1)
    sim.add(a=1)
    assert kd.System.from_rebound(sim).names == ()
    assert [p.name for p in kd.System.from_rebound(sim).to_rebound().particles] == [None, None]
    system = kd.System(np.eye(3), names=["Sun", "Jupiter", "Io"], units="nbody", forces=[kd.Gravity()])
    assert system.to_rebound().particles["Io"].z == 1.0


def test_massless_bodies_are_test_particles():
    assert kd.System.from_rebound(planets()).to_rebound().N_active == 3
    assert kd.System.from_rebound(planets(massless=0)).to_rebound().N_active == 2**64 - 1
    inner = kd.System(np.eye(3), masses=[1, 0, 1], units="nbody", forces=[kd.Gravity()])
    assert inner.to_rebound().N_active == 2**64 - 1


def test_free_bodies_stay_free():
    sim = kd.System(np.eye(3), np.eye(3), units="nbody").to_rebound()
    assert sim.gravity == "none"
    assert kd.System.from_rebound(sim).forces == ()
    forces = [kd.Gravity(), kd.PostNewtonian(c=1e4)]
    assert kd.System.from_rebound(planets(), forces=forces).forces == tuple(forces)


# --- methods ---


def set_fields(sim: rebound.Simulation, integrator: str, fields: dict) -> None:
    sim.integrator = integrator
    for key, value in fields.items():
        setattr(sim.integrator, key, value)


METHODS = [
    ("leapfrog", {}, RunDefaults("leapfrog-dkd")),
    ("leapfrog", {"order": 4}, RunDefaults("forest-ruth")),
    ("whfast", {}, RunDefaults("wisdom-holman", coordinates="jacobi", corrector=0)),
    (
        "whfast",
        {"coordinates": "DEMOCRATICHELIOCENTRIC"},
        RunDefaults("wisdom-holman", coordinates="democratic-heliocentric", corrector=0),
    ),
    *(
        ("whfast", {"kernel": theirs}, RunDefaults("wisdom-holman", corrector=0, kernel=ours))
        for theirs, ours in KERNELS.items()
        if theirs != "DEFAULT"
    ),
    *(
        (
            "trace",
            {"peri_mode": mode, "r_crit_hill": 2.5},
            RunDefaults("trace", hill_radii=2.5, pericentre=way, inner=inner),
        )
        for mode, (way, inner) in PASSAGES.items()
    ),
    (
        "trace",
        {"peri_mode": "FULL_BS", "peri_crit_eta": np.inf},
        RunDefaults("trace", hill_radii=3.0, pericentre="none", inner="bulirsch-stoer"),
    ),
    ("ias15", {"epsilon": 1e-8}, RunDefaults("gauss-radau15", rtol=1e-8)),
    *(("saba", {"type": kind}, RunDefaults("saba", coordinates="jacobi", order=order)) for kind, order in SABA.items()),
]


@pytest.mark.parametrize(("integrator", "fields", "run"), METHODS)
def test_a_run_goes_on_as_rebounds(integrator, fields, run):
    """The path is the same from a Simulation in progress, and after conversion back with the same method."""
    sim = planets()
    set_fields(sim, integrator, fields)
    sim.dt = 0.05
    ours = kd.System.from_rebound(sim)
    assert ours.run == run.changed(dt=0.05)
    back = ours.to_rebound()
    assert back.dt == sim.dt
    assert str(back.integrator) == integrator
    assert all(getattr(back.integrator, key) == getattr(sim.integrator, key) for key in fields)
    steps = 100
    mine = kd.Simulation(ours)
    mine.run(until=steps * 0.05)
    if integrator == "ias15":
        sim.integrate(steps * 0.05)
    else:
        sim.steps(steps)
    positions = np.array([p.xyz for p in sim.particles])
    np.testing.assert_allclose(mine.state.positions, positions, rtol=0, atol=1e-12)


@pytest.mark.parametrize("vertical", [None, 3.6])
def test_a_patch_in_hills_frame_comes_and_goes(vertical):
    sim = rebound.Simulation()
    sim.integrator, sim.OMEGA, sim.dt, sim.softening = "sei", 0.5, 0.02, 0.05
    if vertical:
        sim.OMEGAZ = 0.5 * vertical
    sim.add(m=1e-3, x=0.1, vy=-0.05)
    sim.add(x=-0.3, y=0.4, z=0.1, vy=0.2)
    ours = kd.System.from_rebound(sim)
    assert ours.run == RunDefaults("sei", dt=0.02)
    assert ours.forces == (kd.Gravity(softening=0.05), kd.Hill(0.5, vertical=vertical or 1.0))
    mine, back = kd.Simulation(ours), ours.to_rebound()
    mine.run(100, every=100)
    for there in (sim, back):
        there.steps(100)
        np.testing.assert_allclose(mine.state.positions, [p.xyz for p in there.particles], atol=1e-13)


def test_hills_frame_needs_sei():
    system = kd.System([[1.0, 0.0, 0.0]], masses=[1.0], forces=[kd.Hill(1.0)], units="nbody")
    with pytest.raises(kd.InputError, match="rebound has no force 'hill'; expected only gravity"):
        system.to_rebound()


def test_a_corrector_is_taken():
    """Ours differs from rebound's corrector by the second power of the planets' masses."""
    sim = planets()
    set_fields(sim, "whfast", {"corrector": 11})
    system = kd.System.from_rebound(sim)
    assert system.run.options["corrector"] == 11
    assert system.to_rebound().integrator.corrector == 11


@pytest.mark.parametrize(
    ("integrator", "fields", "untaken"),
    [
        ("mercurius", {}, "integrator 'mercurius' with its settings and its step"),
        ("bs", {}, "integrator 'bs'"),
        ("leapfrog", {"order": 8}, "integrator 'leapfrog' with its settings"),
        ("whfast", {"corrector2": 1}, "integrator 'whfast'"),
        ("whfast", {"coordinates": "DEMOCRATICHELIOCENTRIC", "kernel": "LAZY"}, "integrator 'whfast'"),
        ("whfast", {"coordinates": "WHDS"}, "integrator 'whfast'"),
        ("saba", {"type": "CM_2"}, "integrator 'saba'"),
        ("trace", {"peri_crit_eta": 0.5}, "integrator 'trace'"),
        ("ias15", {"adaptive_mode": "GLOBAL"}, "integrator 'ias15'"),
        ("ias15", {"min_dt": 1e-3}, "ias15's min_dt"),
    ],
)
def test_what_is_not_taken_is_said(integrator, fields, untaken):
    sim = planets()
    set_fields(sim, integrator, fields)
    with pytest.warns(
        UserWarning, match=f"from_rebound: left out, without an equivalent in kickdrift: {untaken}"
    ) as seen:
        system = kd.System.from_rebound(sim)
    assert seen[0].filename == __file__
    assert (system.run.integrator is None) == (untaken != "ias15's min_dt")


def test_a_central_body_elsewhere_is_no_wisdom_holman():
    """rebound takes the first body as central, kickdrift the heaviest."""
    sim = rebound.Simulation()
    sim.add(m=1e-3, x=1, vy=1)
    sim.add(m=1.0)
    sim.integrator = "whfast"
    with pytest.warns(UserWarning, match="integrator 'whfast'"):
        kd.System.from_rebound(sim)
    system = kd.System(np.eye(2, 3), masses=[1e-3, 1], units="nbody", run=RunDefaults("wisdom-holman", 0.1))
    with pytest.warns(
        UserWarning, match="to_rebound: left out, without an equivalent in kickdrift: integrator 'wisdom-holman'"
    ):
        assert str(system.to_rebound().integrator) == "ias15"


def test_what_rebound_does_not_have_is_said():
    system = kd.System(
        np.eye(3), units="nbody", forces=[kd.Gravity()], run=RunDefaults("velocity-verlet", 0.1),
        events=[kd.Escape(5.0)], radii=0.1,
    )  # fmt: skip
    with pytest.warns(UserWarning, match="integrator 'velocity-verlet' as it is set here; event escape"):
        sim = system.to_rebound()
    assert sim.particles[2].r == 0.1
    sim.exit_max_distance = 5.0
    with pytest.warns(UserWarning, match="exit_max_distance"):
        kd.System.from_rebound(sim)


# --- bad input ---


def spoil(sim):
    sim.particles[1].x = np.nan


def heavy(sim):
    sim.particles[4].m = 1e-9


def twins(sim):
    sim.particles[2].name = "Sun"


def refused(key, value):
    return lambda sim: setattr(sim, key, value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda sim: sim.add_variation(), "variational particles; use kd.megno for variations"),
        (refused("additional_forces", lambda sim: None), "has additional_forces, which only rebound can call"),
        (refused("post_timestep_modifications", lambda sim: None), "has post_timestep_modifications"),
        (lambda sim: sim.create_ode(length=2), "its own ODEs have no equivalent"),
        (refused("boundary", "open"), "boundary 'open' has no equivalent in kickdrift; expected 'none'"),
        (refused("collision", "direct"), r"collisions \('direct'\) cannot be read; .* events=\[kd.Collision\(…\)\]"),
        (refused("gravity", "tree"), r"gravity 'tree' has no equivalent in kickdrift; give forces, for example"),
        (heavy, r"particle 4 is a test particle \(N_active = 3\) with mass 1e-09; test particles in kickdrift have no"),
        (spoil, "positions: particle 1 has nan in x; expected finite numbers"),
        (refused("G", -1.0), "gravity: G must be a positive number, got -1.0"),
        (refused("t", np.nan), "sim: t is nan; expected a finite time"),
        (twins, "names: particle 2 is called 'Sun'; expected unique names"),
    ],
)
def test_simulations_that_do_not_fit_are_refused(change, message):
    sim = planets()
    change(sim)
    with pytest.raises(kd.InputError, match=message) as raised:
        kd.System.from_rebound(sim)
    assert "\n" not in str(raised.value)


def test_a_simulation_inside_a_step_is_refused():
    sim, seen = planets(), []

    def look(pointer):
        try:
            seen.append(len(kd.System.from_rebound(pointer.contents)))
        except kd.InputError as error:
            seen.append(str(error))

    set_fields(sim, "whfast", {"safe_mode": 0})
    sim.heartbeat = look
    sim.steps(2)
    assert seen == [5, *["sim: is inside a step; call sim.synchronize() first"] * 2]


def test_what_is_no_simulation_is_refused():
    with pytest.raises(kd.InputError, match="expected one particle or more, got none"):
        kd.System.from_rebound(rebound.Simulation())
    with pytest.raises(kd.InputError, match="sim: expected a rebound"):
        kd.System.from_rebound("archive.bin")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"box": (9, 9, 9)}, "the box is periodic"),
        ({"forces": [kd.LennardJones()]}, "rebound has no force 'lennard-jones'; expected only gravity"),
        ({"forces": [kd.Gravity(), kd.Oblateness(1e-3, 1.0)]}, "rebound has no force 'j2'"),
        ({"forces": [kd.Gravity(), kd.Gravity(softening=0.1)]}, "expected one gravity force, got two"),
        ({"units": "metal"}, "cannot express units 'metal'"),
    ],
)
def test_systems_that_rebound_cannot_run_are_refused(options, message):
    system = kd.System(np.eye(3), **({"units": "nbody"} | options))
    with warnings.catch_warnings(), pytest.raises(kd.InputError, match=message):
        system.to_rebound()


def test_rebound_that_is_not_installed_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "rebound", None)
    with pytest.raises(kd.InputError, match=r"System.to_rebound needs rebound: pip install 'kickdrift\[rebound\]'"):
        bridge("rebound", "System.to_rebound")
