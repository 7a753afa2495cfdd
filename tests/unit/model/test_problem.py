"""Problems: allowed forms of f and its results, refused input, and adaptive methods along their steps."""

import math
import pickle
import re

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kickdrift as kd
from kickdrift.model.problem import ProblemState
from kickdrift.odes import ODES

ADAPTIVE = ("bogacki-shampine23", "cash-karp45", "dormand-prince45", "dop853")
SPRING = 1.0


def as_list(t, y):
    return [y[1], -y[0]]


def as_tuple(t, y):
    return y[1], -y[0]


def as_array(t, y):
    return np.array([y[1], -y[0]])


def in_place(t, y):
    dy = np.empty_like(y)
    dy[0] = y[1]
    dy[1] = -y[0]
    return dy


def with_a_global(t, y):
    return y[1], -SPRING * y[0]


def closure(stiffness):
    def f(t, y):
        return y[1], -stiffness * y[0]

    return f


def decay(t, y):
    return (-y[0],)


def outside(t, y):
    return -y


FORMS = {
    "list": as_list,
    "array": as_array,
    "in place": in_place,
    "global": with_a_global,
    "closure": closure(1.0),
    "jitted": numba.njit(as_tuple),
    "jitted list": numba.njit(as_list),
}


def end(problem, integrator="dormand-prince45", time=3.0, **given):
    sim = kd.Simulation(problem, integrator, **given)
    sim.run(until=time)
    return sim.state.y


# --- allowed forms of f ---


@pytest.fixture(scope="module")
def plain():
    return end(kd.Problem(as_tuple, [1.0, 0.5]))


@pytest.mark.parametrize("form", FORMS)
def test_whatever_f_returns_gives_the_same_bits(form, plain):
    assert end(kd.Problem(FORMS[form], [1.0, 0.5])).tolist() == plain.tolist()


def test_python_code_gives_the_same_bits(plain):
    assert end(kd.Problem(as_list, [1.0, 0.5], compiled=False)).tolist() == plain.tolist()


def test_ints_beside_floats():
    def mixed(t, y):
        return 1, 0.5 * y[0], 2

    for compiled in (True, False):
        y = end(kd.Problem(mixed, [0, 0, 0], compiled=compiled), time=2.0)
        assert y == pytest.approx([2.0, 1.0, 4.0], rel=1e-14)


def test_a_fixed_step_method_takes_a_problem_too(plain):
    sim = kd.Simulation(kd.Problem(as_tuple, [1.0, 0.5]), "rk4", dt=0.01)
    sim.run(until=3.0)
    exact = [math.cos(3) + 0.5 * math.sin(3), -math.sin(3) + 0.5 * math.cos(3)]
    assert sim.state.y == pytest.approx(exact, abs=1e-9)
    assert plain == pytest.approx(exact, abs=2e-7)
    verlet = kd.Simulation(kd.Problem(as_tuple, [1.0, 0.5], separable=True), "velocity-verlet", dt=0.01)
    verlet.run(300)
    assert verlet.state.y == pytest.approx(exact, abs=1e-4)


def test_time_reaches_f():
    for t0 in (0.0, -2.5):
        y = end(kd.Problem(lambda t, y: (math.cos(t),), [0.0], t0=t0), time=4.0)
        assert y[0] == pytest.approx(math.sin(4.0) - math.sin(t0), abs=1e-8)


def test_a_function_that_does_not_compile_is_told_with_numbas_line():
    def f(t, y):
        return y.nothing if t > 0 else -y

    with pytest.raises(kd.InputError) as error:
        kd.Simulation(kd.Problem(f, [1.0], name="mine"))
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith("mine: f does not compile: ")
    assert "Unknown attribute 'nothing'" in message
    assert "test_problem.py" in message
    assert "compiled=False runs it as plain Python" in message


@pytest.mark.parametrize("compiled", [True, False])
def test_what_f_raises_is_one_line(compiled):
    def fails(t, y):
        if t > 0.5:
            raise ArithmeticError("no such\nspecies")
        return -y

    problem = kd.Problem(fails, [1.0], compiled=compiled)
    for integrator, step in (("rk4", {"dt": 0.1}), ("dormand-prince45", {}), ("dop853", {})):
        sim = kd.Simulation(problem, integrator, **step)
        sim.run(until=0.3)
        state = sim.state
        with pytest.raises(kd.RunError) as error:
            sim.run(until=1.0, every=100)
        how = ", dt = 0.1" if step else ""
        line = rf"{integrator}{how}: step \d+ \(t = 0\.\d+\): f raised ArithmeticError: no such species"
        assert re.fullmatch(line, str(error.value))
        assert isinstance(error.value.__cause__, ArithmeticError)
        assert (sim.time, sim.state.y.tolist()) == (state.time, state.y.tolist())


def test_ctrl_c_inside_python_code_is_not_swallowed():
    calls = []

    def interrupted(t, y):
        calls.append(t)
        if len(calls) == 20:
            raise KeyboardInterrupt
        return -y

    sim = kd.Simulation(kd.Problem(interrupted, [1.0], compiled=False))
    with pytest.raises(KeyboardInterrupt):
        sim.run(until=50.0)


# --- further arguments ---


def mixture(t, y, rates, first, wait, how):
    return [-rates[first] * y[0], rates[1 - first] * y[0] if how == "all" and t > wait else 0.0]


def slopes(t, y, rates, first, wait, how):
    return [[-rates[first], 0.0], [rates[1 - first] if how == "all" and t > wait else 0.0, 0.0]]


def left(t, y, rates, first, wait, how):
    return y[0] * math.exp(rates[first] * t)


def half(t, y, rates, first, wait, how):
    return y[0] - math.exp(-rates[first] * wait)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("integrator", ["dop853", "radau"])
def test_further_arguments_reach_f_jacobian_energy_and_events(integrator, compiled):
    args = (np.array([0.5, 2.0]), 1, 0.25, "all")
    problem = kd.Problem(mixture, [1.0, 0.0], slopes, args=args, energy=left, compiled=compiled)
    assert problem.args == args
    sim = kd.Simulation(problem, integrator, events=[kd.Crossing(half, "half")], max_step=0.05)
    report = sim.run(until=1.0)
    y = [math.exp(-2.0), 0.25 * (math.exp(-0.5) - math.exp(-2.0))]
    assert sim.state.y == pytest.approx(y, abs=1e-3 if integrator == "radau" else 1e-4)  # f jumps at t = 0.25
    assert report.energy.initial == 1.0
    assert report.energy.max_relative_error < 1e-6
    assert sim.events[0]["time"] == pytest.approx(0.25, abs=1e-6)


def test_a_problem_with_arguments_travels_to_another_process_and_stands_for_its_functions():
    args = (np.array([0.5, 2.0]), 1, 0.25, "none")
    problem = kd.Problem(mixture, [1.0, 0.0], slopes, args=args, energy=left)
    kd.Simulation(problem)  # compiles f
    for other in (pickle.loads(pickle.dumps(problem)), kd.Problem(problem.f, problem.y0)):
        assert end(other, time=1.0) == pytest.approx([math.exp(-2.0), 0.0], abs=1e-7)


def test_two_problems_of_one_function_keep_their_own_arguments():
    rates = ([1.0, 1.0], np.array([1.0, 2.0]), np.array([1.0, 3.0]))  # a constant of the code, and parameters
    sims = [kd.Simulation(kd.Problem(mixture, [1.0, 0.0], args=(each, 1, 0.0, ""))) for each in rates]
    for time in (0.5, 1.0):
        for sim in sims:
            sim.run(until=time)
    assert [sim.state.y[0] for sim in sims] == pytest.approx(np.exp([-1.0, -2.0, -3.0]), abs=1e-7)


def test_arguments_that_are_no_sequence_are_refused():
    with pytest.raises(kd.InputError, match=r"`args=\(2.0,\)`"):
        kd.Problem(mixture, [1.0, 0.0], args=2.0)


# --- what is refused ---


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"y0": [[1.0, 2.0]]}, "problem: y0 must be one row of numbers, got shape (1, 2)"),
        ({"y0": []}, "problem: y0 must be one row of numbers, got shape (0,)"),
        ({"y0": 1.0}, "problem: y0 must be one row of numbers, got 1.0; write [1.0]"),
        ({"y0": "two"}, "problem: y0: expected numbers: "),
        ({"y0": [1.0, [2.0]]}, "problem: y0: expected numbers: "),
        ({"y0": [1.0, math.nan]}, "problem: y0[1] is nan; expected finite numbers"),
        ({"y0": [1.0, 2.0, 3.0]}, "problem: f must return shape (3,), like y0, got (2,)"),
        ({"f": lambda t, y: [y, y]}, "problem: f must return shape (2,), like y0, got (2, 2)"),
        ({"f": lambda t, y: [y[0], math.inf]}, "problem: f(t0, y0)[1] is inf; expected finite numbers"),
        ({"f": lambda t, y: None}, "problem: f(t0, y0)"),
        ({"f": lambda t, y: [y[0], "a"]}, "problem: f(t0, y0): expected numbers: "),
        ({"f": lambda t, y: [y[0], y[2]]}, "problem: f(t0, y0) raised IndexError: index 2 is out of bounds"),
        ({"f": lambda y: y}, "problem: f must take (t, y); it takes (y)"),
        ({"f": 3}, "problem: f must be a function, got 3"),
        ({"jacobian": [[1.0]]}, "problem: jacobian must be a function, got [[1.0]]"),
        ({"jacobian": lambda t, y: [1.0, 2.0]}, "problem: jacobian must return shape (2, 2), like y0, got (2,)"),
        ({"energy": 1.0}, "problem: energy must be a function, got 1.0"),
        ({"t0": math.inf}, "problem: t0 must be a finite number, got inf"),
        ({"y0": [1.0, 2.0, 3.0], "separable": True}, "separable means positions, then as many velocities; y0 has 3"),
        ({"f": lambda t, y: [y[1] + 1, -y[0]], "separable": True}, "the first half of f is the second half of y"),
    ],
    ids=range(20),
)
def test_a_problem_that_makes_no_sense(arguments, message):
    with pytest.raises(kd.InputError) as error:
        kd.Problem(**{"f": as_list, "y0": [1.0, 2.0], **arguments})
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("integrator", "options", "message"),
    [
        ("dop853", {"rtol": 0.0}, "rtol must be a positive number, got 0.0"),
        ("dop853", {"rtol": -1e-3}, "rtol must be a positive number, got -0.001"),
        ("dop853", {"rtol": math.nan}, "rtol must be a positive number, got nan"),
        ("dop853", {"rtol": 1e-15}, "rtol must be 2.2e-14 or more, got 1e-15: smaller errors drown in rounding"),
        ("dop853", {"atol": 0.0}, "atol must be a positive number, got 0.0"),
        ("dop853", {"atol": math.inf}, "atol must be a positive number, got inf"),
        ("dop853", {"controller": "pd"}, "controller 'pd' is unknown; known are i, pi, pid"),
        ("dop853", {"compensated": True}, "compensated: dop853 does not take it; it takes dt, rtol, atol, controller"),
        ("dop853", {"dt": -0.1}, "dt must be a positive finite"),
        ("rk4", {"rtol": 1e-6, "dt": 0.1}, "rtol: rk4 does not take it; it takes dt, compensated"),
        ("rk4", {"atol": 1e-6, "dt": 0.1}, "atol: rk4 does not take it"),
        ("rk4", {"controller": "pi", "dt": 0.1}, "controller: rk4 does not take it"),
        ("rk4", {}, "dt is needed: system 'problem' has no dt in [run]"),
        ("velocity-verlet", {"dt": 0.1}, "the problem is not declared separable=True"),
    ],
    ids=range(14),
)
def test_options_that_make_no_sense(integrator, options, message):
    with pytest.raises(kd.InputError) as error:
        kd.Simulation(kd.Problem(as_list, [1.0, 2.0], compiled=False), integrator, **options)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_runs_that_make_no_sense():
    sim = kd.Simulation(kd.Problem(outside, [1.0], compiled=False), "dormand-prince45")
    sim.run(until=1.0)
    for arguments, message in [
        ({"until": math.nan}, "until must be a finite time, got nan"),
        ({"until": 2.0, "steps": 3}, "give either steps or until"),
        ({}, "give either steps or until"),
        ({"steps": 2.5}, "steps must be a whole number, zero or more, got 2.5"),
        ({"until": 2.0, "interval": 0.0}, "interval must be a positive time, got 0.0"),
        ({"until": 2.0, "interval": 0.1, "every": 3}, "give every or interval, not both"),
        ({"until": 2.0, "output": "run.h5md"}, "the name of a Problem's run must end in .h5, .csv, .parquet"),
    ]:
        with pytest.raises(kd.InputError) as error:
            sim.run(**arguments)
        assert message in str(error.value)
    with pytest.raises(kd.InputError, match="interval is for methods that choose their steps; with rk4, use every"):
        kd.Simulation(kd.Problem(outside, [1.0], compiled=False), "rk4", dt=0.1).run(10, interval=0.5)
    with pytest.raises(kd.InputError, match="forces: a Problem has no forces"):
        sim.forces()
    with pytest.raises(kd.InputError, match="a Simulation takes a System or a Problem"):
        kd.Simulation(3)


def test_the_state_is_a_copy_that_can_be_put_back():
    sim = kd.Simulation(kd.Problem(as_tuple, [1.0, 0.0]), rtol=1e-9)
    start = sim.state
    assert (start.y.tolist(), start.time, start.steps_done, len(start)) == ([1.0, 0.0], 0.0, 0, 2)
    start.y[:] = 7.0
    assert sim.state.y.tolist() == [1.0, 0.0]
    sim.run(until=2.0)
    first = sim.state.y
    sim.state = ProblemState(np.array([1.0, 0.0]))
    assert (sim.time, sim.steps_done) == (0.0, 0)
    sim.run(until=2.0)
    assert sim.state.y.tolist() == first.tolist()
    for bad, message in [
        (ProblemState(np.array([1.0])), r"expected y of shape \(2,\), got \(1,\)"),
        (ProblemState(np.array([1.0, np.nan])), "y must be finite"),
    ]:
        with pytest.raises(kd.InputError, match=message):
            sim.state = bad
    assert sim.state.y.tolist() == first.tolist()


def test_a_problem_is_not_changed_by_its_runs():
    y0 = np.array([1.0, 0.0])
    problem = kd.Problem(as_tuple, y0)
    y0[0] = 5.0
    end(problem)
    assert problem.y0.tolist() == [1.0, 0.0]
    with pytest.raises(ValueError, match="read-only"):
        problem.y0[0] = 3.0


# --- along the steps ---


def stretched(integrator, **options):
    return kd.Simulation(ODES["arenstorf"](), integrator, **{"rtol": 1e-6, "atol": 1e-6, **options})


def test_rejected_steps_and_evaluations_are_counted():
    calls = []

    def f(t, y):
        calls.append(t)
        return arenstorf.f(t, y)

    arenstorf = ODES["arenstorf"]()
    sim = kd.Simulation(kd.Problem(f, arenstorf.y0, compiled=False), "dormand-prince45", dt=1e-4, rtol=1e-6, atol=1e-6)
    sim.run(0)
    calls.clear()
    seen = []
    report = sim.run(150, observe=lambda sim: seen.append(len(calls)))  # the final check for stiffness also calls f
    assert report.rejected_steps == sim.record.rejected_steps > 10
    assert report.force_evaluations == 1 + 6 * (150 + report.rejected_steps)
    assert seen[-1] == report.force_evaluations


def test_hairers_counts():
    # scipy.integrate.ode("dopri5"), Hairer's Fortran, beta = 0.04: 1442 evaluations, 216 accepted steps. Ours makes one
    # more evaluation, at the end of the last step
    sim = kd.Simulation(ODES["arenstorf"](), "dormand-prince45", rtol=1e-7, atol=1e-7)
    sim.run(until=17.0652165601579625588917206249)
    assert sim.steps_done == 216
    assert sim.record.force_evaluations == 1443


@pytest.mark.parametrize("controller", ["i", "pi", "pid"])
def test_every_controller_keeps_the_error_in_hand(controller):
    problem = ODES["kepler"](0.6)
    errors = []
    for rtol in (1e-6, 1e-9):
        sim = kd.Simulation(problem, "dop853", rtol=rtol, atol=rtol, controller=controller)
        sim.run(until=10.0)
        errors.append(abs(sim.state.y - problem.exact(10.0)).max() / rtol)
        assert sim.record.rejected_steps < 0.5 * sim.steps_done
    assert max(errors) < 300
    assert max(errors) / min(errors) < 30


def test_controllers_choose_other_steps():
    steps = {}
    for name in ("i", "pi", "pid", None):
        sim = stretched("dormand-prince45", controller=name)
        sim.run(until=10.0)
        steps[name] = (sim.steps_done, sim.record.rejected_steps, *sim.state.y)
    assert steps[None] == steps["pi"]
    assert len(set(steps.values())) == 3


@pytest.mark.parametrize("integrator", ADAPTIVE)
def test_a_step_that_falls_to_nothing_says_where_and_why(integrator):
    sim = kd.Simulation(kd.Problem(lambda t, y: (y[0] * y[0],), [1.0]), integrator)  # y = 1 / (1 - t)
    with pytest.raises(kd.RunError) as error:
        sim.run(until=2.0)
    message = str(error.value)
    assert "\n" not in message
    assert message.startswith(f"{integrator}: ")
    assert "t = 1" in message or "t = 0.99999" in message
    assert "step" in message


def test_a_function_without_a_value_past_some_time_says_where():
    sim = kd.Simulation(kd.Problem(lambda t, y: (math.sqrt(1.0 - t),), [0.0]), "dormand-prince45")
    with pytest.raises(kd.RunError, match=r"stopped at step \d+ \(t = (1|0\.99999\d*)\): the step fell to "):
        sim.run(until=2.0)
    assert np.isfinite(sim.state.y).all()


def test_energy_and_report_of_a_problem():
    sim = kd.Simulation(ODES["pendulum"](), "dop853", rtol=1e-10, atol=1e-12)
    report = sim.run(until=20.0)
    assert report.energy.max_relative_error < 1e-8
    assert sim.energy().total == pytest.approx(0.4161468365471424, rel=1e-8)
    silent = kd.Simulation(kd.Problem(outside, [1.0], compiled=False)).run(until=1.0)
    assert silent.energy is None


# --- dense output ---

DENSE = {"bogacki-shampine23": 1e-6, "dormand-prince45": 1e-8, "dop853": 1e-10}


@pytest.fixture(scope="module")
def orbits():
    problem = ODES["kepler"](0.3)
    return problem, {
        name: kd.Simulation(problem, name, rtol=rtol, atol=rtol) for name, rtol in DENSE.items()
    }  # one dictionary for all examples, since compiling takes longest


@given(st.sampled_from(list(DENSE)), st.lists(st.floats(0.0, 6.0), min_size=1, max_size=20))
@settings(deadline=None, max_examples=60)
def test_dense_output_is_as_good_as_the_steps(orbits, integrator, times):
    problem, sims = orbits
    sim = sims[integrator]
    sim.state = problem.state
    worst = 0.0
    for time in sorted(times):
        sim.run(until=time)
        assert sim.time == time
        worst = max(worst, abs(sim.state.y - problem.exact(time)).max())
    assert worst < 300 * DENSE[integrator]


def test_dense_output_costs_no_evaluations_but_dop853s_three_a_step():
    for integrator, extra in (("dormand-prince45", 0), ("bogacki-shampine23", 0), ("dop853", 3)):
        counts = []
        for looks in (1, 50):
            sim = kd.Simulation(ODES["harmonic-oscillator"](), integrator, dt=0.01, rtol=1e-6)
            sim.run(until=3.0, interval=3.0 / looks)
            counts.append((sim.record.force_evaluations, sim.steps_done))
        assert counts[0][1] == counts[1][1]
        assert counts[1][0] - counts[0][0] <= extra * counts[0][1]


def test_what_a_problem_refuses_of_its_functions():
    with pytest.raises(kd.InputError, match="f depends on velocities"):
        kd.Problem(lambda t, y: [y[1], -y[0] - 0.5 * y[1]], [1.0, 0.0], separable=True)

    def careless(t, y):
        y[0] *= 2.0
        return [1.0]

    with pytest.raises(kd.InputError, match="f changes its argument y"):
        kd.Problem(careless, [1.0])
    with pytest.raises(kd.InputError, match="t0 must be a finite number"):
        kd.Problem(lambda t, y: y, [1.0], t0="now")


def test_what_a_simulation_refuses():
    decay = kd.Problem(lambda t, y: -y, [1.0], energy=lambda t, y: 1 / (1.0 if t < 1 else 0.0))
    sim = kd.Simulation(decay, "dop853")
    for state, part in (
        (3, "expected a ProblemState, got int"),
        (type(sim.state)(np.array([1.0]), float("nan")), "time must be finite"),
    ):
        with pytest.raises(kd.InputError, match=part):
            sim.state = state
    with pytest.raises(kd.InputError, match="energy raised ZeroDivisionError"):
        sim.run(until=3.0)
    for options, part in (
        ({"integrator": 3}, "integrator must be a name, got 3"),
        ({"integrator": "dop853", "rtol": "1e-8"}, "rtol must be a positive number"),
        ({"integrator": "rk4", "dt": 0.1, "rtol": 0.0}, "rtol: rk4 does not take it"),
        ({"integrator": "rk4", "dt": 0.1, "compensated": "no"}, "compensated must be True or False"),
    ):
        with pytest.raises(kd.InputError, match=part):
            kd.Simulation(decay, **options)
