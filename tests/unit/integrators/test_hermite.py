"""hermite4: order in fixed, shared and block steps, looks, and refused systems."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

import kickdrift as kd
from kickdrift.errors import InputError, RunError
from kickdrift_validation.folders import DATA
from kickdrift_validation.problems import kepler
from tests.systems import two_bodies

MASSES = np.array([0.6, 0.4])
STATES = DATA / "nbody" / "quad_states.json"
SCHEMES = ("shared", "block")


def cluster(n: int, seed: int = 1, massless: int = 0, softening: float = 0.05) -> kd.System:
    """A ball of bodies of total mass 1 that contains a heavy pair with short steps."""
    rng = np.random.default_rng(seed)
    x, v = rng.normal(size=(2, n, 3)) * np.array([1.0, 0.4])[:, None, None]
    masses = rng.uniform(0.5, 1.5, n) / n
    masses[n - massless :] = 0.0
    masses[:2] *= 4.0
    x[1] = x[0] + [0.05, 0.02, 0.0]
    v[1] = v[0] + [0.0, 0.3, 0.6]
    return kd.System(x, v, masses, forces=[kd.Gravity(softening=softening)], units="nbody")


def published(name: str) -> tuple[kd.System, np.ndarray, np.ndarray]:
    """A published problem: the System, times, and states (times, n, 6) with 34 digits."""
    case = json.loads(STATES.read_text(encoding="utf-8"))[name]
    masses = np.array(case["masses"], dtype=float)
    start = np.array(case["initial_state"], dtype=float).reshape(len(masses), 6)
    states = np.array(case["reference_states_quad"], dtype=float).reshape(-1, len(masses), 6)
    gravity = kd.Gravity(G=float(case["G"]))
    system = kd.System(start[:, :3], start[:, 3:], masses, forces=[gravity], units="nbody", name=name)
    return system, np.array(case["times"], dtype=float), states


# --- the step ---


def accelerations_and_jerks(system: kd.System, x: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Accelerations and jerks (n, 3), from their definitions."""
    masses, softening = system.state.masses, system.forces[0].softening
    a, jerk = np.zeros_like(x), np.zeros_like(x)
    for i in range(len(x)):
        d, u = np.delete(x, i, 0) - x[i], np.delete(v, i, 0) - v[i]
        m, r2 = np.delete(masses, i)[:, None], (d**2).sum(axis=1)[:, None] + softening**2
        a[i] = (m * d / r2**1.5).sum(axis=0)
        jerk[i] = (m * (u / r2**1.5 - 3 * (d * u).sum(axis=1)[:, None] * d / r2**2.5)).sum(axis=0)
    return a, jerk


def oracle(system: kd.System, dt: float, steps: int) -> np.ndarray:
    """State (2, 3, n) after some steps. Each body's acceleration is the cubic through the values at both ends, by
    SciPy."""
    x, v = system.state.positions, system.state.velocities
    a, jerk = accelerations_and_jerks(system, x, v)
    for _ in range(steps):
        ahead_x = x + dt * v + dt**2 / 2 * a + dt**3 / 6 * jerk
        ahead_v = v + dt * a + dt**2 / 2 * jerk
        next_a, next_jerk = accelerations_and_jerks(system, ahead_x, ahead_v)
        cubic = CubicHermiteSpline([0.0, dt], np.array([a, next_a]), np.array([jerk, next_jerk]))
        x = x + dt * v + cubic.antiderivative(2)(dt)
        v = v + cubic.antiderivative()(dt)
        a, jerk = next_a, next_jerk
    return np.array([x, v])


@pytest.mark.parametrize(("n", "massless", "softening"), [(2, 0, 0.0), (3, 1, 0.0), (9, 2, 0.05), (40, 5, 0.1)])
def test_steps_are_those_of_the_oracle(n, massless, softening):
    system = cluster(n, massless=massless, softening=softening)
    sim = kd.Simulation(system, "hermite4", dt=0.002)
    sim.run(20)
    found = np.array([sim.state.positions, sim.state.velocities])
    assert sim.time == pytest.approx(0.04, rel=1e-14)
    assert np.abs(found[0] - system.state.positions).max() > 0.02
    np.testing.assert_allclose(found, oracle(system, 0.002, 20), rtol=0, atol=1e-12 * np.abs(found).max())


@pytest.mark.parametrize("e", [0.3, 0.9])
def test_order_in_fixed_steps(e):
    errors = []
    for dt in 0.02 * (1 - e) ** 1.5 / 2.0 ** np.arange(3):
        sim = kd.Simulation(two_bodies(e), "hermite4", dt=dt)
        sim.run(until=math.pi)
        errors.append(np.linalg.norm(sim.state.phase - two_bodies(e, math.pi).state.phase))
    assert np.log2(errors[:-1]) - np.log2(errors[1:]) == pytest.approx(np.full(2, 4.0), abs=0.1)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_order_in_chosen_steps(scheme):
    """Steps scale as the root of eta, so the error scales as eta squared."""
    steps, errors = [], []
    for eta in (2e-3, 5e-4, 1.25e-4):
        sim = kd.Simulation(two_bodies(0.7), "hermite4", eta=eta, scheme=scheme)
        sim.run(until=3 * math.pi)
        steps.append(sim.steps_done)
        errors.append(np.linalg.norm(sim.state.phase - two_bodies(0.7, 3 * math.pi).state.phase))
    slopes = -np.diff(np.log(errors)) / np.diff(np.log(steps))
    assert slopes == pytest.approx(np.full(2, 4.0), abs=0.25)
    assert steps[2] == pytest.approx(4 * steps[0], rel=0.1)


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize(("name", "looks", "bound"), [("figure_eight", 3, 1e-8), ("pythagorean_burrau", 1, 2e-6)])
def test_published_problems(name, looks, bound, scheme):
    """Compare with 34 digits. The Pythagorean bodies start at rest, without a jerk for the choice of the first step."""
    system, times, states = published(name)
    sim = kd.Simulation(system, "hermite4", eta=1e-4, scheme=scheme)
    for time, state in zip(times[:looks], states, strict=False):
        sim.run(until=time)
        found = np.hstack([sim.state.positions, sim.state.velocities])
        assert np.abs(found - state).max() < bound * np.abs(state).max()


# --- chosen steps ---


def test_block_steps_are_powers_of_two_that_stay_in_step():
    sim = kd.Simulation(cluster(30), "hermite4", scheme="block")
    bodies = sim.integration.stepper._bodies
    seen = set()
    for _ in range(300):
        sim.run(1)
        exponents = np.log2(bodies.steps)
        assert (exponents == np.round(exponents)).all()
        assert (bodies.times % bodies.steps == 0.0).all()  # each step began at a multiple of its length
        now = sim.integration.stepper.time
        assert (bodies.times <= now).all()
        assert (now <= bodies.times + bodies.steps).all()
        seen |= set(exponents)
    assert len(seen) >= 5


def energy_error(scheme: str, eta: float, **how) -> tuple[float, float]:
    """Largest relative energy error over a crossing time at some hundred times, and evaluations of all bodies."""
    sim = kd.Simulation(cluster(128), "hermite4", eta=eta, scheme=scheme)
    report = sim.run(until=2.0, **how)
    assert report.energy is not None
    return report.energy.max_relative_error, report.force_evaluations


def test_block_steps_cost_less_and_energy_errs_as_the_square_of_eta():
    """Measured: 867 and 201 evaluations; ratios of 14 and 46, while the leading term alone gives 16."""
    coarse, fine = ({scheme: energy_error(scheme, eta) for scheme in SCHEMES} for eta in (0.005, 0.00125))
    assert coarse["block"][1] < coarse["shared"][1] / 4
    for scheme in SCHEMES:
        assert fine[scheme][1] == pytest.approx(2 * coarse[scheme][1], rel=0.02)
        assert fine[scheme][0] < coarse[scheme][0] / 12


@pytest.mark.parametrize("scheme", SCHEMES)
def test_energies_between_steps_are_as_good_as_at_them(scheme):
    """A velocity predicted by jerk alone has third order and would show."""
    at_points = energy_error(scheme, 0.02, every=1)[0]
    between = energy_error(scheme, 0.02, interval=0.00937)[0]
    assert between < 3 * at_points


@pytest.mark.parametrize("scheme", SCHEMES)
def test_looks_lie_on_the_path(scheme):
    """States inside steps are as accurate as at their ends, and have no jump there."""
    sim = kd.Simulation(two_bodies(0.3), "hermite4", eta=0.005, scheme=scheme)
    errors = []

    def look(sim):
        exact = -MASSES[1] * np.array(kepler(sim.time, 0.3))[:, 0]
        errors.append(sim.state.phase[:, 0, 0] - exact)

    sim.run(until=6.0, interval=0.004, observe=look)
    position, velocity = np.array(errors[:-1]).T
    assert len(position) == 1500
    assert 1e-8 < np.abs(position).max() < 1e-5
    assert np.abs(np.diff(position)).max() < 3e-7
    assert np.abs(np.diff(velocity)).max() < 3e-7


# --- special cases ---


def test_massless_bodies_feel_and_do_not_pull():
    system = cluster(12, massless=4)
    state = system.state
    alone = kd.System(state.positions[:8], state.velocities[:8], state.masses[:8], forces=system.forces, units="nbody")
    sims = [kd.Simulation(each, "hermite4", dt=0.01) for each in (system, alone)]
    for sim in sims:
        sim.run(50)
    np.testing.assert_array_equal(sims[0].state.phase[:, :, :8], sims[1].state.phase)
    assert np.abs(sims[0].state.velocities[8:] - state.velocities[8:]).min() > 1e-3


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_body_at_a_centre_of_symmetry_stalls_nothing(scheme):
    """The body's acceleration and its derivatives are only rounding, and would give a meaningless step."""
    x, v = [[1.0, 0, 0], [-1.0, 0, 0], [0.0, 0, 0]], [[0.0, 0.5, 0], [0.0, -0.5, 0], [0.0, 0, 0]]
    system = kd.System(x, v, masses=[1.0, 1.0, 0.0], forces=[kd.Gravity()], units="nbody")
    sim = kd.Simulation(system, "hermite4", scheme=scheme)
    sim.run(until=20.0)
    assert sim.steps_done < 2000
    assert np.linalg.norm(sim.state.positions[2]) < 1e-9


@pytest.mark.parametrize("scheme", SCHEMES)
def test_bodies_that_begin_at_one_place_part_in_short_steps(scheme):
    """Forces are zero at the start, but soon grow."""
    x, v = np.zeros((2, 3)), [[1.0, 0, 0], [0.0, 0, 0]]
    system = kd.System(x, v, masses=[1.0, 1.0], forces=[kd.Gravity(softening=0.1)], units="nbody")
    report = kd.Simulation(system, "hermite4", scheme=scheme).run(until=1.0)
    assert report.energy.max_relative_error < 1e-5


@pytest.mark.parametrize("scheme", SCHEMES)
def test_a_body_that_nothing_pulls_goes_straight_on(scheme):
    sim = kd.Simulation(
        kd.System([[1.0, 2.0, 3.0]], [[1.0, 0.0, -1.0]], forces=[kd.Gravity()], units="nbody"),
        "hermite4",
        scheme=scheme,
    )
    sim.run(until=1000.5)
    np.testing.assert_allclose(sim.state.positions, [[1001.5, 2.0, -997.5]], rtol=1e-14)
    assert sim.steps_done < 20


def test_a_state_put_in_place_starts_anew():
    sim = kd.Simulation(cluster(10), "hermite4", scheme="block")
    sim.run(50)
    end = sim.state
    sim.state = cluster(10).state
    sim.run(50)
    np.testing.assert_array_equal(sim.state.phase, end.phase)


def test_a_head_on_collision_ends_the_run():
    falling = kd.System([[1.0, 0, 0], [-1.0, 0, 0]], masses=[1.0, 1.0], forces=[kd.Gravity()], units="nbody")
    for scheme in SCHEMES:
        with pytest.raises(RunError, match=r"hermite4: (stopped|blew up) at step \d+ \(t = 2\.22"):
            kd.Simulation(falling, "hermite4", scheme=scheme).run(until=3.0)  # they meet at pi / sqrt 2


def test_what_was_chosen_is_in_the_report():
    report = kd.Simulation(cluster(10), "hermite4").run(3)
    assert report.options == {"eta": 0.02, "scheme": "shared"}
    assert report.dt is None
    fixed = kd.Simulation(cluster(10), "hermite4", dt=0.01).run(3)
    assert fixed.dt == 0.01
    assert fixed.options == {"scheme": "shared"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rtol": 1e-6}, "rtol: hermite4 does not take it; it takes dt, eta, scheme, pairs"),
        ({"eta": 0.0}, "eta must be above 0 and at most 1, got 0.0"),
        ({"eta": math.nan}, "eta must be above 0 and at most 1, got nan"),
        ({"eta": "fine"}, "eta must be above 0 and at most 1, got 'fine'"),
        ({"scheme": "tree"}, "scheme 'tree' is unknown; known are shared, block"),
        ({"dt": 0.1, "eta": 0.1}, "dt: fixes the step of hermite4; give either dt, or eta, scheme and pairs"),
        ({"dt": 0.1, "scheme": "block"}, "dt: fixes the step of hermite4; give either dt, or eta, scheme and pairs"),
        ({"dt": -0.1}, "dt must be a positive finite time, got -0.1"),
    ],
)
def test_options_that_make_no_sense(options, message):
    with pytest.raises(InputError) as caught:
        kd.Simulation(two_bodies(0.3), "hermite4", **options)
    assert str(caught.value) == message


def test_what_it_cannot_run():
    fluid = kd.System(np.eye(3) * 3, forces=[kd.LennardJones(cutoff=2.0)])
    with pytest.raises(
        InputError, match=r"hermite4: .* gravity; force 'lennard-jones' has no time derivative; dop853 takes"
    ):
        kd.Simulation(fluid, "hermite4")
    with pytest.raises(InputError, match=r"hermite4: .* one force, gravity; the system has 0"):
        kd.Simulation(kd.System(np.eye(3)), "hermite4")
    ode = kd.Problem(lambda t, y: [y[1], -y[0]], [1.0, 0.0], separable=True, name="oscillator")
    with pytest.raises(InputError, match=r"hermite4: .*'oscillator' is an ODE; use dop853"):
        kd.Simulation(ode, "hermite4")
