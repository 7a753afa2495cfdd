"""gauss-radau15: its coefficients, order and accuracy, and hard problems.

The files in ``data`` name their sources: states in binary128 from published starting values, and closed forms.
"""

import json
import math
from decimal import Decimal, localcontext
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.integrators import integrator
from kickdrift.integrators.gauss_radau.loop import LOST_TIME, TIME
from kickdrift.integrators.gauss_radau.series import LOST_X, X
from kickdrift.integrators.gauss_radau.tables import nodes, tables
from kickdrift.odes import ODES
from kickdrift.systemfile.files import shipped
from kickdrift.systemfile.reading import load
from kickdrift_validation.folders import DATA
from tests import folders

NAME = "gauss-radau15"


FOLDERS = [folders.DATA, DATA / "nbody"]
STORED = {path.stem: path for folder in FOLDERS for path in folder.glob("*.json")}


def reference(file):
    return json.loads(STORED[file].read_text(encoding="utf-8"))


def bodies(name):
    """A System of the binary128 references, and its record."""
    record = reference("quad_states")[name]
    start = np.array(record["initial_state"], dtype=float).reshape(-1, 6)
    gravity = kd.Gravity(G=float(record["G"]))
    masses = np.array(record["masses"], dtype=float)
    return kd.System(start[:, :3], start[:, 3:], masses, forces=[gravity], units="nbody", name=name), record


def errors(sim, record, count):
    """Largest error of any coordinate and velocity at the first ``count`` times."""
    found = []
    for time, state in list(zip(record["times"], record["reference_states_quad"], strict=True))[:count]:
        sim.run(until=float(time), every=10**9)
        wanted = np.array(state, dtype=float).reshape(-1, 6)
        off = abs(sim.state.positions - wanted[:, :3]).max(), abs(sim.state.velocities - wanted[:, 3:]).max()
        found.append(max(off))
    return np.array(found)


# --- coefficients ---


def legendre(order, x):
    """Legendre polynomial by recurrence."""
    before, now = Decimal(1), x
    for k in range(1, order):
        before, now = now, ((2 * k + 1) * x * now - k * before) / (k + 1)
    return now


def test_nodes_are_the_zeros_of_the_sum_of_two_legendre_polynomials():
    """P_7(x) + P_8(x) with x = 2 s - 1 (Radau 1880; Hildebrand 1974, Introduction to Numerical Analysis, 8.11)."""
    with localcontext() as context:
        context.prec = 60
        found = nodes()
        assert found[0] == 0
        assert all(later - node > Decimal("0.05") for node, later in pairwise(found))
        assert found[-1] < 1
        for node in found:
            x = 2 * node - 1
            assert abs(legendre(7, x) + legendre(8, x)) < Decimal("1e-45")


def test_nodes_integrate_powers_up_to_the_fourteenth_exactly():
    """Weights are from Vandermonde's equations, in sixty digits. The fifteenth power is not exact."""
    with localcontext() as context:
        context.prec = 60
        s = nodes(60)
        weights = []
        for k, node in enumerate(s):  # integral of the node's Lagrange polynomial
            product, value = [Decimal(1)], Decimal(1)
            for other in (*s[:k], *s[k + 1 :]):
                product = [a - other * b for a, b in zip([0, *product], [*product, 0], strict=True)]
                value *= node - other
            weights.append(sum(factor / (power + 1) for power, factor in enumerate(product)) / value)
        for power in range(15):
            total = sum(w * (node**power if power else 1) for w, node in zip(weights, s, strict=True))
            assert abs(total - Decimal(1) / (power + 1)) < Decimal("1e-50")
        assert abs(sum(w * node**15 for w, node in zip(weights, s, strict=True)) - Decimal(1) / 16) > Decimal("1e-12")


def test_corrections_make_the_polynomial_go_through_a_node_and_leave_those_before():
    numbers = tables()
    for node in range(7):
        added = numbers.corrections[node]
        values = numbers.values @ added
        assert values[node] == pytest.approx(1.0, rel=1e-13)
        np.testing.assert_allclose(values[:node], 0.0, atol=1e-13 * abs(added).max())
        assert added[0] == 0.0


def test_weights_are_those_of_the_integrals():
    numbers, s = tables(), np.array([*tables().nodes[1:], 1.0])
    powers = s[:, None] ** np.arange(8)
    np.testing.assert_allclose(numbers.values, powers, rtol=1e-15)
    np.testing.assert_allclose(numbers.velocities, powers / np.arange(1, 9), rtol=1e-15)
    np.testing.assert_allclose(numbers.positions, powers / (np.arange(1, 9) * np.arange(2, 10)), rtol=1e-15)
    ahead = numbers.shifts * 0.3 ** np.arange(8)[:, None]  # row k times 0.3^k
    np.testing.assert_allclose(ahead.sum(axis=0), 1.3 ** np.arange(8), rtol=1e-14)


def oscillator(separable):
    return kd.Problem(
        lambda t, y: (y[1], -y[0]), [1.0, 0.0], separable=separable, name="oscillator",
        exact=lambda t: np.array([math.cos(t), -math.sin(t)]),
    )  # fmt: skip


def fading():
    return kd.Problem(
        lambda t, y: (-2.0 * t * y[0],), [1.0], name="fading", exact=lambda t: np.array([math.exp(-t * t)])
    )


@pytest.mark.parametrize(
    ("problem", "steps"), [(oscillator(True), np.linspace(1.8, 3.0, 5)), (fading(), np.linspace(0.6, 0.86, 4))]
)
def test_the_error_of_one_step_falls_as_its_sixteenth_power(problem, steps):
    found = []
    for step in steps:
        sim = kd.Simulation(problem, NAME, dt=step, rtol=1e3)
        sim.run(1, every=1)
        assert sim.time == step
        found.append(abs(sim.state.y - problem.exact(step)).max())
    slope = np.polyfit(np.log(steps), np.log(found), 1)[0]
    assert slope == pytest.approx(16.0, abs=0.8), found
    assert found[0] > 1e-15


# --- closed forms and binary128 ---


@pytest.mark.parametrize("e", [0.0, 0.3, 0.6, 0.9, 0.99])
def test_keplers_ellipse_over_ten_periods(e):
    """Bounds of rounding. A rounding error of the speed v at pericentre changes the semi-major axis by 2 v^2 times its
    size, the time of a later passage by as much in each period, and the velocity there by that time times the
    acceleration."""
    problem = ODES["kepler"](e)
    sim = kd.Simulation(problem, NAME)
    sim.run(until=20 * math.pi, interval=20 * math.pi)
    amplified = (1 + e) / (1 - e) ** 3
    assert abs(sim.state.y - problem.exact(20 * math.pi)).max() < 2e-14 * amplified
    assert sim.energy().total == pytest.approx(-0.5, rel=1e-13)
    assert sim.record.rejected_steps == 0


@pytest.mark.long
def test_published_closed_forms():
    sims = {}
    for case in reference("kepler_closed_form")["cases"]:
        e, time = float(case["e"]), float(case["t"])
        if time > 1000:
            continue
        sim = sims.setdefault(case["e"], kd.Simulation(ODES["kepler"](e), NAME))
        if time < sim.time:
            sim.state = ODES["kepler"](e).state
        sim.run(until=time, interval=time)
        assert sim.state.y == pytest.approx([float(x) for x in case["state"]], abs=1e-14 * (1 + time))


@pytest.mark.parametrize(
    ("name", "bounds"),
    [
        ("figure_eight", [3e-15, 3e-15, 2e-14, 2e-13]),
        # each close encounter multiplies earlier rounding errors; IAS15 in double has an error of 0.04 at 70
        ("pythagorean_burrau", [5e-11, 1e-8, 2e-8, 2e-7, 1e-4, 1e-2, 0.5]),
        ("pleiades", [3e-15, 5e-13, 2e-12]),
        ("hairer_outer_solar", [1e-14, 1e-13, 1e-12, 3e-12, 5e-12]),
    ],
)
def test_n_bodies_to_round_off(name, bounds):
    """Errors stay within a small factor of those of IAS15 in double, which the file gives."""
    system, record = bodies(name)
    sim = kd.Simulation(system, NAME)
    found = errors(sim, record, len(bounds))
    assert (found < bounds).all(), found
    assert sim.report().energy.max_relative_error < (1e-9 if name == "pythagorean_burrau" else 1e-12)


def test_arenstorfs_orbit_as_a_first_order_problem():
    data = reference("arenstorf")["arenstorf_4loop"]
    problem = ODES["arenstorf"]()
    assert not problem.separable
    sim = kd.Simulation(problem, NAME)
    for time, state in zip(data["times"], data["states_quad_x_y_vx_vy"], strict=True):
        sim.run(until=float(time))
        assert sim.state.y == pytest.approx(list(map(float, state)), abs=1e-11 if float(time) < 17 else 1e-8)


@pytest.mark.parametrize("name", [n for n in shipped() if n.startswith("ode-")])
def test_every_ode_that_ships_gets_through(name):
    """Includes problems that are stiff for a part of the time: an explicit method can solve these."""
    problem = load(name)
    length = {"ode-robertson": 0.1, "ode-hires": 0.3, "ode-orego": 0.1, "ode-van-der-pol-stiff": 0.01}.get(name, 17.0)
    sim = kd.Simulation(problem, NAME)
    sim.run(until=problem.t0 + length)
    tight = kd.Simulation(problem, "dop853", rtol=1e-13, atol=1e-14)
    tight.run(until=problem.t0 + length)
    chaotic = 1e-5 if name == "ode-pleiades" else 1e-9
    assert sim.state.y == pytest.approx(tight.state.y, rel=chaotic, abs=chaotic)


def test_forces_that_depend_on_velocities():
    """x'' = -g x - r x': exp(-r t / 2) cos(w t + p), with all three in one dimension each."""
    system = kd.System(
        [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]], [[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]],
        forces=[kd.HarmonicTrap(4.0), kd.LinearDrag(0.3)],
    )  # fmt: skip
    sim = kd.Simulation(system, NAME)
    sim.run(until=5.0)
    w, t = math.sqrt(4.0 - 0.15**2), 5.0
    decay = math.exp(-0.15 * t)
    still = decay * (math.cos(w * t) + 0.15 / w * math.sin(w * t))
    pushed = decay * math.sin(w * t) / w
    assert sim.state.positions == pytest.approx(np.array([[still, 0.0, pushed], [0.0, 2 * still, 0.0]]), abs=3e-15)


def test_sums_keep_what_rounding_loses():
    """The steps of a free particle, each four times as long as the last, add up with twice the digits."""
    speed, first = 0.1, 0.7
    free = kd.Problem(lambda t, y: (y[1], 0.0), [1e6, speed], separable=True, name="free")
    sim = kd.Simulation(free, NAME, dt=first)
    sim.run(10)
    clock, work = sim.integration.stepper._clock, sim.integration.stepper._work
    with localcontext() as context:
        context.prec = 60
        time, x = (Decimal(float(a)) + Decimal(float(b)) for a, b in (clock[[TIME, LOST_TIME]], work[[X, LOST_X], 0]))
        assert abs(time - 349525 * Decimal(first)) < Decimal("1e-26")  # 4^0 + 4^1 + … + 4^9
        assert abs(x - 1000000 - Decimal(speed) * time) < Decimal("1e-22")


def test_energy_of_the_outer_planets_over_a_thousand_years():
    """Barycentric, since rounding grows with the distance that the centre of mass travels. IAS15's error is 9e-16."""
    system, _ = bodies("hairer_outer_solar")
    start, masses = system.state, system.state.masses
    x, v = (part - masses @ part / masses.sum() for part in (start.positions, start.velocities))
    sim = kd.Simulation(kd.System(x, v, masses, forces=system.forces, units="nbody"), NAME)
    report = sim.run(until=365250.0, every=10)
    assert report.energy.max_relative_error < 5e-15


# --- steps ---


def test_the_step_is_that_of_pham_rein_and_spiegel_on_a_circle():
    """The step is (7! rtol)^(1/7) / omega."""
    x, v = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]], [[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]]
    pair = kd.System(x, v, [0.5, 0.5], forces=[kd.Gravity()], units="nbody")
    for rtol in (1e-9, 1e-7):
        sim = kd.Simulation(pair, NAME, rtol=rtol)
        sim.run(50)
        assert sim.integration.stepper.last_step == pytest.approx((5040 * rtol) ** (1 / 7), rel=1e-4)


def pushed(power):
    def exact(t):
        x, v = (((t - 0.5) ** k - (-0.5) ** k) / math.perm(k, k - power) for k in (power + 2, power + 1))
        return np.array([x + t * (1.0 - (-0.5) ** (power + 1) / (power + 1)), 1.0 + v])

    return kd.Problem(lambda t, y: (y[1], (t - 0.5) ** power), [0.0, 1.0], separable=True, name="pushed", exact=exact)


@pytest.mark.parametrize("power", [1, 2, 3, 5])
def test_accelerations_and_derivatives_pass_through_zero(power):
    problem = pushed(power)
    sim = kd.Simulation(problem, NAME, dt=0.03)
    sim.run(until=1.0)
    assert sim.state.y == pytest.approx(problem.exact(1.0), abs=3e-16)
    assert sim.steps_done < 100


def test_a_body_in_the_midst_of_a_ring_sets_no_steps():
    """Six accelerations cancel for this body, so only rounding remains."""
    angles = 2 * np.pi * np.arange(6) / 6
    ring = np.array([np.cos(angles), np.sin(angles), 0 * angles]).T
    speed = math.sqrt(1.0 + 0.1 * sum(1 / (4 * math.sin(math.pi * k / 6)) for k in range(1, 6)))
    around = speed * np.array([-np.sin(angles), np.cos(angles), 0 * angles]).T
    x, masses = np.vstack([ring, np.zeros(3)]), np.array([*[0.1] * 6, 1.0])
    for v in (np.vstack([around, np.zeros(3)]), np.zeros((7, 3))):
        sim = kd.Simulation(kd.System(x, v, masses, forces=[kd.Gravity()], units="nbody"), NAME)
        sim.run(until=0.5)
        assert sim.steps_done < 30


@pytest.mark.parametrize("jump", [0.3, 0.5])
def test_a_force_that_jumps_is_passed(jump):
    problem = kd.Problem(lambda t, y: (y[1], 1.0 if t > jump else 0.0), [0.0, 1.0], separable=True, name="jump")
    sim = kd.Simulation(problem, NAME)
    sim.run(until=1.0)
    assert sim.state.y == pytest.approx([1.0 + (1.0 - jump) ** 2 / 2, 2.0 - jump], abs=sim.options.rtol)
    assert sim.record.rejected_steps > 0


def test_particles_without_a_force_fly_on():
    sim = kd.Simulation(kd.System([[0.0, 0.0, 0.0]], [[1.0, 2.0, 3.0]], forces=[]), NAME)
    sim.run(until=1e6)
    assert sim.state.positions == pytest.approx(np.array([[1e6, 2e6, 3e6]]), rel=3e-16)
    assert sim.steps_done < 30


def test_a_first_step_that_is_far_too_long_is_rejected():
    problem = ODES["kepler"](0.5)
    sim = kd.Simulation(problem, NAME, dt=100.0)
    sim.run(1)  # so no end limits the step
    assert sim.record.rejected_steps >= 2
    sim.run(until=10.0)
    assert sim.state.y == pytest.approx(problem.exact(10.0), abs=1e-13)


def test_a_singularity_is_named():
    sim = kd.Simulation(kd.Problem(lambda t, y: (y[0] * y[0],), [1.0]), NAME)  # y = 1 / (1 - t)
    with pytest.raises(
        kd.RunError, match=r"^gauss-radau15: stopped at step \d+ \(t = (1|0\.99999\d*)\): the step fell to "
    ):
        sim.run(until=2.0)


def test_bodies_that_fall_onto_each_other_are_named():
    x = [[0.0, 0, 0], [1.0, 0, 0], [50.0, 0, 0], [0.0, 1e-3, 30.0], [0.0, 0, 30.0]]
    masses, names = [1.0, 1e-3, 0.0, 0.0, 0.0], ["star", "stone", "far", "dust", "more dust"]
    sim = kd.Simulation(kd.System(x, masses=masses, forces=[kd.Gravity()], units="nbody", names=names), NAME)
    with pytest.raises(kd.RunError, match=r"too short to change t = \S+; star and stone are nearest, \S+ apart$"):
        sim.run(until=3.0)


@pytest.fixture(scope="module")
def orbits():
    return {rtol: kd.Simulation(ODES["kepler"](0.5), NAME, rtol=rtol) for rtol in (1e-9, 1e-4)}


@given(st.sampled_from([1e-9, 1e-4]), st.lists(st.floats(0.0, 6.0), min_size=1, max_size=10))
@settings(deadline=None, max_examples=30)
def test_states_between_step_points_are_as_good_as_those(orbits, rtol, times):
    problem, sim = ODES["kepler"](0.5), orbits[rtol]
    sim.state = problem.state
    for time in sorted(times):
        sim.run(until=time)
        assert sim.time == time
        assert abs(sim.state.y - problem.exact(time)).max() < (2e-14 if rtol == 1e-9 else 1e-8)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"atol": 1e-10}, "atol: gauss-radau15 does not take it; it takes dt, rtol"),
        ({"controller": "pi"}, "controller: gauss-radau15 does not take it; it takes dt, rtol"),
        ({"compensated": True}, "compensated: gauss-radau15 does not take it; it takes dt, rtol"),
        ({"rtol": 0.0}, "rtol must be a positive number, got 0.0"),
        ({"rtol": 1e-15}, "rtol must be 2.2e-14 or more, got 1e-15"),
        ({"dt": -1.0}, "dt must be a positive finite time, got -1.0"),
    ],
)
def test_bad_options_are_named(given, message):
    with pytest.raises(kd.InputError, match=message):
        kd.Simulation(ODES["kepler"](0.5), NAME, **given)


def test_its_own_default_tolerance():
    system, _ = bodies("figure_eight")
    report = kd.Simulation(system, NAME).run(3)
    assert (report.rtol, report.atol, report.dt) == (1e-9, None, None)
    assert integrator(NAME).tunable == ("rtol", "max_step")
    arenstorf = kd.Simulation(load("ode-arenstorf"), NAME)
    assert arenstorf.options.rtol == 1e-10  # from the file
