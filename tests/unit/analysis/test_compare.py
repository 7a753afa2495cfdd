"""Work against precision, the recommendation from it, and the modified Hamiltonian."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.analysis.compare.ladder import Bench, Row, slope
from kickdrift.analysis.compare.recommendation import SAFETY, recommendation
from kickdrift.analysis.compare.reference import MODERATE, TIGHT, Reference
from kickdrift.analysis.compare.work_precision import Comparison, default_integrators, work_precision
from kickdrift.odes import harmonic_oscillator, kepler, logistic, lorenz, pendulum, van_der_pol
from kickdrift.statistics.drift import Growth, energy_growth, position_growth
from kickdrift_validation.shadow_hamiltonian import modified_hamiltonian, pendulum_potential, plot_shadow, shadow_run


@pytest.fixture(scope="module")
def orbit():
    """Kepler's ellipse over five periods, against its closed form."""
    return work_precision(kepler(0.3), ["velocity-verlet", "blanes-moan4", "rk4"], 31.4, budget=2.0)


# --- the ladder ---


def test_global_and_local_errors_have_the_slopes_of_the_order(orbit):
    assert orbit.measure == "closed form"
    for name, order in (("velocity-verlet", 2), ("rk4", 4)):
        of_all, of_one = orbit.slopes[name]
        assert of_all == pytest.approx(order, abs=0.6 if name == "rk4" else 0.05)  # rk4's phase error has order 5 too
        assert of_one == pytest.approx(order + 1, abs=0.1)


def test_rows_go_from_coarse_to_fine_at_twice_the_cost(orbit):
    assert orbit.methods == ["velocity-verlet", "blanes-moan4", "rk4"]
    for name in orbit.methods:
        rows = [row for row in orbit.of(name) if not row.failure]
        assert len(rows) >= 4
        assert all(later.dt < row.dt for row, later in pairwise(rows))
        assert rows[-1].evaluations == pytest.approx(2 * rows[-2].evaluations, rel=0.01)
        assert all(row.seconds > 0 for row in rows)


def test_errors_against_a_tight_run_are_those_against_the_closed_form(orbit):
    problem = replace_exact(kepler(0.3))
    by_run = work_precision(problem, ["velocity-verlet"], 31.4, budget=3.0)
    assert by_run.measure == "reference"
    known = {round(math.log(row.dt), 6): row.error for row in orbit.of("velocity-verlet")}
    pairs = [(row.error, known.get(round(math.log(row.dt), 6))) for row in by_run.rows if row.believed]
    pairs = [pair for pair in pairs if pair[1] is not None]
    assert len(pairs) >= 3
    for ours, closed in pairs:
        assert ours == pytest.approx(closed, rel=1e-3)


def replace_exact(problem):
    """The same problem without its closed form."""
    return kd.Problem(problem.f, problem.y0, separable=problem.separable, energy=problem.energy, name="kepler")


def test_no_error_below_the_references_own_is_believed(orbit):
    for row in orbit.rows:
        assert row.believed == (row.error is not None and row.error > 3 * orbit.reference_error)


@pytest.mark.long
def test_what_blows_up_stays_in_the_table():
    steep = kd.Problem(lambda t, y: (-500.0 * (y[0] - math.cos(t)),), [1.0], name="steep")
    found = work_precision(steep, ["rk4"], 4.0, budget=1.0)  # the reference may take ten seconds
    rows = found.of("rk4")
    assert rows[0].useless
    assert not rows[1].useless
    assert min(row.error for row in rows if row.error is not None) < 1e-6


def test_a_run_that_blows_up_says_so():
    fast = kd.Problem(lambda t, y: (-500.0 * (y[0] - math.cos(t)),), [1.0], name="steep")
    row = ladder(fast, 40.0, dt=0.02)
    assert row.error is None
    assert row.failure.startswith("blew up: rk4, dt = 0.02")


def ladder(problem, length, dt):
    """One run of a ladder."""
    plan = Reference("energy", "", length, None, np.ones(1), 0.0)
    bench = Bench(problem, problem.state, plan, length, 5, 100.0, None, 1, 1.0, True)
    return bench._row("rk4", {"steps": round(length / dt)}, 10.0)


@pytest.mark.long
def test_the_energy_is_compared_where_chaos_forbids_positions():
    def f(t, y):
        return y[2], y[3], -y[0] - 2 * y[0] * y[1], -y[1] - y[0] * y[0] + y[1] * y[1]

    def energy(t, y):
        return 0.5 * (y[0] ** 2 + y[1] ** 2 + y[2] ** 2 + y[3] ** 2) + y[0] ** 2 * y[1] - y[1] ** 3 / 3

    chaotic = kd.Problem(f, [0.0, -0.15, 0.55, 0.0], separable=True, energy=energy, name="henon-heiles")
    found = work_precision(chaotic, ["velocity-verlet"], 1000.0, budget=2.0)
    assert found.measure == "energy"
    assert found.lyapunov > 0.02
    assert any("chaos" in note for note in found.notes)
    assert found.slopes["velocity-verlet"][0] == pytest.approx(2, abs=0.1)
    assert all(row.growth.verdict for row in found.rows if row.error)


@pytest.mark.long
def test_without_an_energy_chaos_shortens_the_pilot():
    found = work_precision(lorenz(), ["dop853"], 60.0, budget=4.0)
    assert found.measure == "reference"
    assert "gauss-radau15" in found.reference
    assert 20 < found.length < 50
    assert found.reference_error <= 1e-6
    assert found.lyapunov == pytest.approx(0.9, abs=0.3)
    assert "differ by" in found.notes[0]
    refused = recommendation(found, 1e-3, 100.0)
    assert refused.choice is None
    assert "chaos" in refused.refusal


@pytest.mark.long
def test_a_stiff_problem_over_eleven_decades(monkeypatch):
    """Two special cases occur. The changed start is not near for the smallest unknown, and the warm-up step fails.

    A reference with two digits less takes a third of the steps, so the test uses one."""
    monkeypatch.setitem(TIGHT, "radau", ((1e-9, 1e-8),))
    monkeypatch.setitem(MODERATE, "radau", 1e-7)
    found = work_precision(kd.load("ode-robertson"), ["lsoda"], budget=4.0)
    assert found.lyapunov == 0.0
    assert found.reference_error < 1e-6
    assert min(row.error for row in found.of("lsoda") if row.error is not None) < 1e-4


@pytest.mark.long
def test_integrators_suit_the_subject():
    assert "blanes-moan6" in default_integrators(pendulum(), False)
    assert "velocity-verlet" not in default_integrators(lorenz(), False)
    stiff = work_precision(van_der_pol(1000.0), ["radau", "rosenbrock"], 300.0, budget=6.0)
    assert "radau" in stiff.reference
    assert min(row.error for row in stiff.of("radau") if row.error is not None) < 1e-6
    assert "radau" in default_integrators(van_der_pol(1000.0), True)


def test_particles():
    system = kd.load("two-body")
    found = work_precision(system, ["velocity-verlet", "dop853"], 12.0, budget=2.0)
    assert found.measure == "reference"
    assert found.slopes["velocity-verlet"][0] == pytest.approx(2, abs=0.1)
    assert found.of("dop853")[-1].energy_error < 1e-6


@pytest.mark.long
def test_constraints_have_a_reference_of_fixed_steps(tmp_path):
    (tmp_path / "chain.toml").write_text(CHAIN)
    found = kd.compare(tmp_path / "chain.toml", ["velocity-verlet", "yoshida4"], accuracy=1e-5)
    assert found.measure == "reference"
    assert "yoshida8 at dt = 0.01" in found.reference
    for name, order in (("velocity-verlet", 2), ("yoshida4", 4)):
        assert found.slopes[name] == pytest.approx((order, order + 1), abs=0.1)
    assert found.recommendation.choice.method == "yoshida4"
    assert default_integrators(kd.load(tmp_path / "chain.toml"), False)[0] == "velocity-verlet"


CHAIN = """
units = "lj"
[particles]
positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.5, 0.9, 0.0]]
masses = [1.0, 2.0, 1.5]
[velocities]
values = [[0.1, 0.3, -0.2], [0.2, -0.4, 0.1], [0.3, 0.0, 0.3]]
[[constraint]]
pairs = [[0, 1], [1, 2]]
[[force]]
type = "harmonic-trap"
stiffness = 1.0
[run]
dt = 0.05
steps = 200
"""


def test_slopes_leave_rounding_out():
    steps = 0.1 * 2.0 ** -np.arange(10.0)
    assert slope(steps, steps**4 + 1e-12, 1e-14) == pytest.approx(4, abs=0.15)
    assert slope(steps, steps**4, 1e-14) == pytest.approx(4)
    assert slope(steps[:2], steps[:2], 1e-14) is None


# --- growth ---


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0])
def test_growth_of_a_power_is_found(exponent):
    t = np.linspace(0, 100, 252)
    found = position_growth(t, 1e-6 * t**exponent * np.abs(np.sin(3.0 * t)))
    assert found.exponent == pytest.approx(exponent, abs=0.1)
    assert found.factor(1e-6, 4.0, 400.0) == pytest.approx(4.0**exponent, rel=0.4)
    assert found.factor(1e-6, 0.5, 50.0) == 1.0


def test_growth_is_not_told_by_few_samples():
    t = np.linspace(0, 1, 14)
    assert position_growth(t, t).exponent is None
    assert position_growth(t, t).factor(1.0, 2.0, 2.0) is None


def test_a_drift_hidden_in_the_pilot_counts_over_the_length():
    t = np.linspace(0, 100, 128)
    energies = 1.0 + 1e-6 * np.sin(2.1 * t)
    bounded = energy_growth(t, energies, np.abs(energies - 1.0))
    assert bounded.factor(7e-7, 10.0, 1000.0) < 2
    drifting = energy_growth(t, energies + 1e-7 * t, np.abs(energies - 1.0 + 1e-7 * t))
    assert drifting.factor(6e-6, 10.0, 1000.0) == pytest.approx(1e-4 / math.sqrt(3) / 6e-6, rel=0.1)


# --- the recommendation, on tables whose answer is known ---


def table(**given):
    """Two methods: "second" with error dt^2 and 1 us per step, "fourth" with 10 dt^4 and 4; errors grow as t."""
    rows = []
    for name, order, constant, per_step in (("second", 2, 1.0, 1), ("fourth", 4, 10.0, 4)):
        for dt in 0.1 * 2.0 ** -np.arange(8.0):
            steps = round(100 / dt)
            rows.append(
                Row(
                    name, float(dt), None, None, float(dt), steps, 0, per_step * steps, 1e-6 * per_step * steps,
                    constant * dt**order, growth=Growth(1.0, 0.0), believed=True,
                )
            )  # fmt: skip
    known = Comparison("known", "reference", "a run", 1e-12, 0.0, 100.0, 1000.0, 20.0, 251, "", 1, tuple(rows), {})
    return replace(known, **given)


def test_the_cheapest_is_found_and_its_step():
    found = recommendation(table(), 2e-4)
    # Ten times the pilot: 10 dt^2 and 100 dt^4 must stay below 1e-4.
    second, fourth = math.sqrt(1e-5), 1e-6**0.25
    assert found.choice.method == "fourth"
    assert found.choice.dt == pytest.approx(fourth, rel=1e-3)
    assert found.choice.steps * found.choice.dt == pytest.approx(1000.0)
    assert found.choice.seconds == pytest.approx(4e-6 * 1000 / fourth, rel=1e-2)
    assert [other.method for other in found.others] == ["second"]
    assert found.margin == pytest.approx(1 / second / (4 / fourth), rel=1e-2)
    assert found.extrapolation == 10
    assert "--integrator fourth" in found.choice.options(found.length)


def test_another_accuracy_has_another_winner():
    assert recommendation(table(), 0.02, 100.0).choice.method == "second"


def test_no_step_beyond_the_ladder_is_recommended():
    assert recommendation(table(), 0.09, 100.0).choice.dt <= 0.1


@pytest.mark.parametrize(
    ("given", "accuracy", "length", "reason"),
    [
        ({}, 1e-4, 1e6, "too short"),
        ({"cycles": 2.0}, 1e-4, 1000.0, "it covers 2 cycles"),
        ({"lyapunov": 0.5}, 1e-4, 1000.0, "chaos"),
        ({"reference_error": 1e-3}, 1e-4, 50.0, "below the limit of the reference"),
        ({}, 1e-11, 1000.0, "no method reaches"),
    ],
)
def test_refusals(given, accuracy, length, reason):
    found = recommendation(table(**given), accuracy, length)
    assert found.choice is None
    assert reason in found.refusal
    assert found.as_json()["choice"] is None


def test_growth_that_is_not_resolved_is_refused():
    rows = tuple(replace(row, growth=Growth(1.0, 2.0)) for row in table().rows)
    assert "too short to tell" in recommendation(table(rows=rows), 1e-4).refusal
    assert recommendation(table(rows=rows), 1e-4, 100.0).choice is not None  # no error is extrapolated


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_accuracy_and_length_must_be_positive(value):
    with pytest.raises(kd.InputError, match="positive"):
        recommendation(table(), value)
    with pytest.raises(kd.InputError, match="positive"):
        recommendation(table(), 1e-3, value)


@pytest.mark.long
def test_the_recommended_run_meets_the_accuracy():
    problem = pendulum()
    found = work_precision(problem, ["velocity-verlet", "blanes-moan4"], 200.0, whole=2000.0, budget=3.0)
    advice = recommendation(found, 1e-4)
    assert advice.choice.method == "blanes-moan4"
    sim = kd.Simulation(problem, advice.choice.method, dt=advice.choice.dt)
    exact = kd.Simulation(problem, "dop853", rtol=1e-13, atol=1e-15)
    worst = 0.0
    for _ in range(8):
        sim.run(advice.choice.steps // 8, every=10**9)
        exact.run(until=sim.time, every=10**9)
        worst = max(worst, abs(sim.state.y[0] - exact.state.y[0]) / 2.0)
    assert 1e-4 / SAFETY / 30 < worst < 1e-4


# --- the command line ---


def test_command_line(monkeypatch, kickdrift, tmp_path):
    monkeypatch.setattr("kickdrift.analysis.compare.work_precision.work_precision.__kwdefaults__", {
        **work_precision.__kwdefaults__, "budget": 3.0,
    })  # fmt: skip
    out, figure = tmp_path / "compare.json", tmp_path / "compare.png"
    status, shown, _ = kickdrift(
        "compare", "ode-pendulum", "--time", 100, "--integrator", "velocity-verlet", "--integrator",
        "rk4", "--accuracy", 1e-2, "--length", 300, "--json", out, "--plot", figure,
    )  # fmt: skip
    assert status == 0
    assert "recommended" in shown
    assert "kickdrift run ode-pendulum --integrator" in shown
    found = json.loads(out.read_text())
    assert found["measure"] == "reference"
    assert {row["method"] for row in found["rows"]} == {"velocity-verlet", "rk4"}
    assert found["recommendation"]["choice"]["method"] in {"velocity-verlet", "rk4"}
    assert found["versions"]["kickdrift"] == kd.__version__
    assert figure.stat().st_size > 10_000


def test_a_refusal_is_exit_status_1(monkeypatch, kickdrift):
    monkeypatch.setattr("kickdrift.analysis.compare.work_precision.work_precision.__kwdefaults__", {
        **work_precision.__kwdefaults__, "budget": 1.0,
    })  # fmt: skip
    arguments = ("ode-pendulum", "--time", 5, "--integrator", "rk4", "--accuracy", 1e-3, "--quiet")
    status, out, _ = kickdrift("compare", *arguments)
    assert status == 1
    assert "recommended       nothing: the pilot of 5 is too short" in out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("ode-pendulum", "--integrator", "velocty-verlet"), "did you mean velocity-verlet"),
        (("ode-pendulum", "--time", -1), "time must be a positive"),
        (("ode-pendulum", "--accuracy", 0), "accuracy must be a positive"),
        (("ode-pendulum", "--accuracy", 1e-3, "--length", "nan"), "length must be a positive"),
        (("ode-lorenz", "--integrator", "velocity-verlet"), "accelerations that depend on positions"),
        (("no-such-system",), "neither a file nor a shipped system"),
        (("ode-pendulum", "--threads", 2**64), "threads must be 1 to"),
    ],
)
def test_bad_input_is_one_line(kickdrift, arguments, words):
    status, _, said = kickdrift("compare", *arguments)
    assert status == 2
    assert words in said
    assert said.count("\n") == 1


def test_a_length_is_needed():
    with pytest.raises(kd.InputError, match="has no length"):
        work_precision(logistic(), ["rk4"])


# --- the modified Hamiltonian ---


def test_modified_hamiltonian_oscillates_by_the_powers_of_the_step():
    problem, potential = pendulum(), pendulum_potential()
    runs = [shadow_run(problem, potential, dt, 20.0) for dt in (0.2, 0.1, 0.05)]
    for order in (0, 2, 4):
        sizes = [run.oscillation(order) for run in runs]
        assert np.polyfit(np.log([run.dt for run in runs]), np.log(sizes), 1)[0] == pytest.approx(order + 2, abs=0.1)


def test_modified_hamiltonian_of_the_oscillator_is_known():
    """Velocity Verlet on x'' = -x conserves p^2 / (1 - dt^2 / 4) + q^2 exactly, up to a factor."""
    dt, potential = 0.01, (lambda q: q * q / 2, lambda q: q, lambda q: 1.0 + 0 * q, lambda q: 0 * q, lambda q: 0 * q)
    q, p = np.array([1.0, 0.3]), np.array([0.0, -0.7])
    found = modified_hamiltonian(q, p, dt, potential)
    exact = np.arcsin(dt / 2) / (dt / 2) / np.sqrt(1 - dt**2 / 4) * (p**2 + q**2 * (1 - dt**2 / 4)) / 2
    assert found == pytest.approx(exact, rel=1e-12)


def test_shadow_figure_and_refusals(tmp_path):
    run = shadow_run(pendulum(), pendulum_potential(), 0.1, 5.0)
    assert plot_shadow(run, [run], tmp_path / "shadow.png").stat().st_size > 10_000
    with pytest.raises(kd.InputError, match="order"):
        modified_hamiltonian(0.0, 0.0, 0.1, pendulum_potential(), 3)
    with pytest.raises(kd.InputError, match="one degree of freedom"):
        shadow_run(kepler(), pendulum_potential(), 0.1, 1.0)
    with pytest.raises(kd.InputError, match="derivatives"):
        modified_hamiltonian(0.0, 0.0, 0.1, pendulum_potential()[:3])


def test_the_oscillators_closed_form_needs_no_reference_run():
    found = work_precision(harmonic_oscillator(), ["pefrl"], 60.0, budget=1.0)
    assert found.measure == "closed form"
    assert found.reference_error < 1e-13
