"""Unknowns beside the bodies: equations of the user, what they do to bodies, files, restarts, and what is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import kickdrift as kd
from kickdrift.errors import InputError
from kickdrift.forces.beside.columns import Bodies
from tests.long import rest

RATE2, PUSH = 10.0, 1e-2  # squared frequency of an oscillator, and its push on the planet
BODIES = [{"name": "star", "mass": 1.0}, {"name": "planet", "mass": 1e-3, "a": 1.0, "e": 0.1}]
METHODS = {"gauss-radau15": {}, "velocity-verlet": {"dt": 0.02}, "wisdom-holman": {"dt": 0.05}}


def oscillator(t, y, bodies):
    """An oscillator that the planet's direction drives."""
    dx, dy = bodies.x[0, 1] - bodies.x[0, 0], bodies.x[1, 1] - bodies.x[1, 0]
    return y[1], -RATE2 * y[0] + dy / np.sqrt(dx * dx + dy * dy)


def pushes(t, y, bodies, a):
    a[0, 1] += PUSH * y[0]


def growth(t, y, bodies):
    return np.array([-t * y[0], y[0]])


def faster(t, y, bodies, a):
    a[0, 1] += y[0] * bodies.v[0, 1]


def with_unknowns(f=oscillator, y0=(1.0, 0.0), names=("q", "p"), acts=pushes, events=(), more=(), **given):
    beside = kd.Beside(f, y0, names, acts, **given)
    return kd.System.from_elements(BODIES, units="nbody").with_forces(kd.Gravity(), *more, beside).watched(events)


def reference(system, time):
    """Bodies (12 numbers) and unknowns by SciPy, with the equations of two bodies written out."""
    m = system.state.masses

    def rates(t, z):
        x, v, y = z[:6].reshape(3, 2), z[6:12].reshape(3, 2), z[12:]
        d = x[:, 1] - x[:, 0]
        a = np.array([m[1] * d, -m[0] * d]).T / (d @ d) ** 1.5
        pushes(t, y, Bodies(x, v, m), a)
        return np.concatenate([v.ravel(), a.ravel(), oscillator(t, y, Bodies(x, v, m))])

    start = np.concatenate([system.state.phase.ravel(), [1.0, 0.0]])
    return solve_ivp(rates, (0.0, time), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]


def error(sim, wanted):
    return np.abs(np.concatenate([sim.state.phase.ravel(), sim.state.unknowns]) - wanted).max()


def test_bodies_and_unknowns_are_one_system():
    wanted = reference(with_unknowns(), 5.0)
    for name, given in (("gauss-radau15", {}), ("dop853", {"rtol": 1e-11, "atol": 1e-11}), ("rosenbrock", {})):
        sim = kd.Simulation(with_unknowns(), name, **given)
        sim.run(until=5.0, exact="shorten")
        assert error(sim, wanted) < {"rosenbrock": 3e-6}.get(name, 1e-9), name


@pytest.mark.parametrize(
    ("name", "order"),
    [("velocity-verlet", 2), ("leapfrog-dkd", 2), ("yoshida4", 4), ("forest-ruth", 4), rest("wisdom-holman", 2)],
)
def test_words_keep_their_order(name, order):
    wanted, errors = reference(with_unknowns(), 5.0), []
    for dt in (0.025, 0.0125):
        sim = kd.Simulation(with_unknowns(), name, dt=dt)
        sim.run(until=5.0)
        errors.append(error(sim, wanted))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


@pytest.mark.parametrize("name", METHODS)
def test_files_frames_and_restarts_hold_the_unknowns(name, tmp_path):
    path, given = tmp_path / "run.h5md", METHODS[name]
    whole = kd.Simulation(with_unknowns(), name, **given)
    whole.run(40, every=10)
    half = kd.Simulation(with_unknowns(), name, **given)
    half.run(20, every=10, output=path)
    del half
    resumed = kd.resume(path)
    resumed.run(20, every=10, output=path)
    np.testing.assert_array_equal(resumed.state.unknowns, whole.state.unknowns)
    np.testing.assert_array_equal(resumed.state.phase, whole.state.phase)
    with kd.open(path) as run:
        np.testing.assert_array_equal(run.observables["q"][[0, -1]], [1.0, whole.state.unknowns[0]])
        np.testing.assert_array_equal(run[-1].state.unknowns, whole.state.unknowns)
        again = kd.Simulation(run[-1].system, name, **given)
    np.testing.assert_array_equal(again.state.unknowns, whole.state.unknowns)
    np.testing.assert_array_equal(whole.now().forces[1].y0, whole.state.unknowns)


@pytest.mark.parametrize("name", METHODS)
def test_a_run_goes_back_in_time(name):
    sim = kd.Simulation(with_unknowns(), name, **METHODS[name])
    sim.run(until=2.0)
    assert abs(sim.state.unknowns[1]) > 0.1
    sim.run(until=0.0)
    np.testing.assert_allclose(sim.state.unknowns, [1.0, 0.0], atol=3e-6)  # Runge-Kutta steps do not go back exactly


def test_rates_may_depend_on_time_and_bodies_need_not_feel_them():
    alone = kd.Simulation(kd.System.from_elements(BODIES, units="nbody"), "gauss-radau15")
    sim = kd.Simulation(with_unknowns(growth, acts=None), "gauss-radau15")
    for each in (alone, sim):
        each.run(until=2.0)
    assert sim.state.unknowns[0] == pytest.approx(np.exp(-0.5 * sim.time**2), rel=1e-12)
    assert sim.run(until=2.5).energy.max_relative_error < 1e-13
    word = kd.Simulation(with_unknowns(growth, acts=None), "velocity-verlet", dt=0.01)
    word.run(until=2.0)
    assert word.state.unknowns[0] == pytest.approx(np.exp(-2.0), rel=1e-4)


def test_unknowns_have_tolerances_of_their_own():
    errors = []
    for atol in (None, 1e-10, (1e-10, 1e-3)):
        sim = kd.Simulation(with_unknowns(growth, atol=atol, acts=None), "dop853", rtol=1e-13, atol=1e-3)
        sim.run(until=3.0, exact="shorten")
        errors.append(abs(sim.state.unknowns[0] - np.exp(-4.5)))
    assert errors[0] > 1e3 * max(errors[1:])


def test_an_event_sees_the_unknowns():
    falls = kd.Crossing(lambda t, x, v, y: y[0] - 0.5, "half", -1)
    sim = kd.Simulation(with_unknowns(growth, acts=None, events=[falls]), "gauss-radau15")
    sim.run(until=2.0)
    (found,) = sim.events
    assert found["time"] == pytest.approx(np.sqrt(2.0 * np.log(2.0)), rel=1e-10)
    with pytest.raises(InputError, match=r"crossing 'half': function must take \(t, x, v, y\)"):
        with_unknowns(events=[kd.Crossing(lambda t, x, v: x[0, 0], "half")])


def test_spins_and_unknowns_stand_side_by_side():
    tides = {"k2": 0.3, "radius": [0.1, 0.05], "inertia": 0.25, "spin": [(0.0, 0.1, 0.7), (0.3, 0.0, 2.0)], "tau": 0.01}
    both = kd.Simulation(with_unknowns(growth, acts=None, more=[kd.TidesSpin(**tides)]), "gauss-radau15")
    report = both.run(until=2.0, interval=0.1)
    assert report.angular_momentum_error < 1e-14
    assert both.state.spins.shape == (3, 2)
    assert both.state.unknowns[0] == pytest.approx(np.exp(-0.5 * both.time**2), rel=1e-12)


def test_the_work_of_the_unknowns_is_in_the_balance_of_energy():
    report = kd.Simulation(with_unknowns(), "gauss-radau15").run(until=10.0, interval=0.01)
    assert report.energy.work["beside"] != 0.0
    assert report.energy.max_relative_error < 1e-7


def two_numbers(t, y, bodies):
    return y[0], y[1], 0.0


def no_number(t, y, bodies):
    return y[0], np.log(-1.0 - y[1])


def raises(t, y, bodies):
    return y[5], 0.0


def text(t, y, bodies, a):
    return "much"


def not_pushed(t, y, bodies, a):
    a[0, 1] += y[1] / y[1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"f": two_numbers}, "beside: f(t, y, bodies) must return 2 numbers; it returned 3"),
        ({"f": no_number}, "beside: f(t, y, bodies) must return finite numbers; the rate of p is nan"),
        ({"f": raises}, "beside: f raised IndexError: index 5 is out of bounds"),
        ({"f": "os.system"}, "beside: f: os.system is code, and a file runs no code by itself"),
        ({"f": 3.0}, "beside: f: expected a function, got 3.0"),
        ({"f": pushes}, "beside: f must take (t, y, bodies), not (t, y, bodies, a)"),
        ({"acts": text}, "beside: acts(t, y, bodies, a) must return the energy or None; it returned 'much'"),
        ({"acts": not_pushed}, "beside: acts(t, y, bodies, a) must return finite numbers; the value for particle 1 is"),
        ({"acts": faster}, "beside: acts depends on velocity; say so: velocity_dependent=True"),
        ({"names": ("star", "p")}, "beside: names: 'star' is a body of the system; give the unknown another name"),
        ({"names": ("p", "p")}, "beside: names: 'p' is given twice"),
        ({"names": ("p", "q", "r")}, "beside: names: expected 2, one for each number of y0, got 3"),
        ({"names": ("a b", "q")}, "beside: names: expected words such as theta or y_1, got 'a b'"),
        ({"y0": (1.0, np.nan)}, "beside: y0[1]: expected a finite number"),
        ({"y0": "12"}, "beside: y0: expected a list, got '12'"),
        ({"atol": (1e-3,)}, "beside: atol: expected one number or 2, got 1"),
        ({"atol": -1.0}, "beside: atol must be a positive number"),
        ({"more": [kd.Beside(growth, (1.0, 0.0))]}, "beside: a system takes one force of this kind"),
        ({"more": [kd.LennardJones(cutoff=2.5)]}, "force 'lennard-jones': does not go with beside"),
    ],
)
def test_what_is_refused(change, message):
    with pytest.raises(InputError, match=f"^{re.escape(message)}"):
        kd.Simulation(with_unknowns(**change), "gauss-radau15")


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("blanes-moan4", {"dt": 0.1}, "blanes-moan4: needs .* force 'beside' has unknowns beside the bodies"),
        ("hermite4", {"dt": 0.1}, "hermite4: needs .* force 'beside' has unknowns beside the bodies"),
        ("trace", {"dt": 0.1}, "trace: moves bodies, and force 'beside' also changes unknowns"),
        ("wisdom-holman", {"dt": 0.1, "corrector": 5}, "corrector: 5 does not go with unknowns beside the bodies"),
        (
            "csvr",
            {"dt": 0.1, "temperature": 1.0, "tau": 1.0, "pressure": 1.0, "pressure_tau": 10.0, "allow_gravity": True},
            "beside: takes neither mixed precision nor a barostat",
        ),
    ],
)
def test_methods_without_unknowns_are_refused(name, given, message):
    with pytest.raises(InputError, match=f"^{message}"):
        kd.Simulation(with_unknowns(), name, **given)


def test_derivatives_are_refused_by_name():
    with pytest.raises(InputError, match=r"^force 'beside': unknowns that evolve have no variational equations"):
        kd.transition_matrix(with_unknowns(), 1.0)


def test_a_run_that_fails_names_the_unknown():
    def explodes(t, y, bodies):
        return (y[0] * y[0],)

    system = with_unknowns(explodes, (1.0,), ("fuel",), None)
    with pytest.raises(kd.RunError, match=r"beside: fuel is .*; the last good point is step 11"):
        kd.Simulation(system, "velocity-verlet", dt=0.1).run(until=5.0)
    with pytest.raises(kd.RunError, match=r"too short to change t = 1; beside: fuel is .*, and changes by"):
        kd.Simulation(system, "gauss-radau15").run(until=5.0)


@pytest.mark.parametrize("method", METHODS)
def test_a_function_that_does_not_compile_is_named(method):
    with pytest.raises(InputError, match=r"beside: law does not compile, .*Untyped global name 'eval'"):
        kd.Simulation(with_unknowns(lambda t, y, bodies: (y[1], eval("0.0"))), method, **METHODS[method]).run(1)
