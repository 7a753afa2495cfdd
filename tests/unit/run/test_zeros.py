"""Zeros of events inside a step: several in one step, their times, and functions without a value everywhere."""

import math

import numpy as np
import pytest

import kickdrift as kd
from kickdrift_validation.events import polynomial_errors
from kickdrift_validation.problems import kepler
from tests.long import rest


def cubic_slope(t, y):
    return [3 * t * t + 12 * t - 4]  # of (t + 6) (t + 2) (t - 2)


def value(t, y):
    return y[0]


def still(t, y):
    return [1.0]


@pytest.mark.parametrize(("count", "seed"), [(12, 1), rest(1000, 2)])
def test_no_zero_of_random_polynomials_is_missed_in_steps_of_any_length(count, seed):
    missed, worst = polynomial_errors(count, seed)
    assert missed == 0
    assert worst < 1e-12


@pytest.mark.parametrize("method", ["dormand-prince45", "dop853", "Radau", "gauss-radau15"])
def test_three_zeros_in_one_step_in_either_way(method):
    for span, order in (((-8.0, 4.0), [-6, -2, 2]), ((4.0, -8.0), [2, -2, -6])):
        start = (span[0] + 6) * (span[0] + 2) * (span[0] - 2)
        found = kd.solve(cubic_slope, span, [start], method, events=value)
        assert found.t_events[0] == pytest.approx(order, abs=1e-9)
        assert np.abs(found.y_events[0]).max() < 1e-9


def test_directions_and_numbers_of_terminal_zeros_count_inside_a_step():
    def event(direction, terminal):
        def g(t, y):
            return y[0]

        g.direction, g.terminal = direction, terminal
        return g

    cases = [(0, 1, [-6]), (0, 2, [-6, -2]), (0, 3, [-6, -2, 2]), (1, 2, [-6, -2, 2][::2]), (-1, 1, [-2])]
    for direction, terminal, zeros in cases:
        found = kd.solve(cubic_slope, (-8.0, 4.0), [-120.0], events=[event(direction, terminal), value])
        assert found.t_events[0] == pytest.approx(zeros, abs=1e-10)
        assert (found.status, found.t[-1]) == (1, found.t_events[0][-1])
        assert found.t_events[1] == pytest.approx([z for z in (-6, -2, 2) if z <= zeros[-1]], abs=1e-10)
    back = kd.solve(cubic_slope, (4.0, -8.0), [120.0], events=event(1, 1))
    assert back.t_events[0] == pytest.approx([-2.0], abs=1e-10)  # y rises there on the way back


@pytest.mark.parametrize("scale", [1.0, 1e-30])
def test_the_error_of_a_time_follows_the_step(scale):
    """An electron in 1e9 V/m moves by 1e-6 m in 1.07e-13 s; also in units in which this time is 1e-43."""
    acceleration = 1.602176634e-19 * 1e9 / 9.1093837015e-31

    def f(t, y, a):
        return [y[1], a]

    def there(t, y, a):
        return y[0] - 1e-6

    there.terminal = True
    exact = math.sqrt(2e-6 / acceleration) * scale
    given = {"args": (acceleration / scale**2,), "atol": 1e-300}
    found = kd.solve(f, (0.0, 1e-11 * scale), [0.0, 0.0], events=there, first_step=0.3 * exact, **given)
    assert found.t[-1] == pytest.approx(exact, rel=1e-12)
    problem = kd.Problem(f, [0.0, 0.0], args=given["args"])
    sim = kd.Simulation(problem, "dormand-prince45", atol=1e-300, dt=0.3 * exact, events=[kd.Crossing(there, "there")])
    assert sim.run(until=2 * exact).events[0]["time"] == pytest.approx(exact, rel=1e-12)


def test_no_times_asked_for_before_a_terminal_event_are_empty_arrays():
    def soon(t, y):
        return t - 0.1

    soon.terminal = True
    for start in ([1.0, 2.0], [1.0 + 0j, 2.0]):
        found = kd.solve(lambda t, y: -y, (0, 1), start, t_eval=[0.5, 0.7], events=soon)
        assert (found.t.shape, found.y.shape) == ((0,), (2, 0))
        assert found.y.dtype == np.asarray(start).dtype
        assert found.t_events[0] == pytest.approx([0.1])


def test_a_zero_between_two_steps_counts_once():
    found = kd.solve(
        still, (0.0, 3.0), [0.0], "euler", dt=0.5, events=[lambda t, y: y[0] - 1, lambda t, y: (y[0] - 2) ** 2]
    )
    assert [times.tolist() for times in found.t_events] == [[1.0], [2.0]]


@pytest.mark.parametrize("method", ["rk4", "dormand-prince45"])
def test_oscillations_in_step_with_the_run_are_found(method):
    """A function whose values at the ends of steps are all alike."""

    def g(t, y):
        return 0.5 + math.sin(2 * math.pi * y[0])

    exact = np.add.outer(np.arange(8), [7 / 12, 11 / 12]).reshape(-1)
    options = {"dt": 1.0} if method == "rk4" else {"dt": 1.0, "max_step": 1.0}
    found = kd.solve(still, (0.0, 8.0), [0.0], method, events=g, **options)
    assert found.t_events[0] == pytest.approx(exact, abs=1e-12)
    sim = kd.Simulation(kd.Problem(still, [0.0]), method, **options, events=[kd.Crossing(g, "g")])
    sim.run(8)
    assert [event["time"] for event in sim.events] == pytest.approx(exact, abs=1e-12)


def test_a_function_may_have_no_value_inside_steps():
    def at_ends(t, *y):
        if t % 1.0:
            raise ValueError("between")
        return 1.0 + t

    assert not kd.solve(still, (0.0, 4.0), [0.0], "rk4", dt=1.0, events=at_ends).t_events[0].size
    sim = kd.Simulation(kd.Problem(still, [0.0]), "rk4", 1.0, events=[kd.Crossing(at_ends, "at ends")])
    assert not sim.run(4).events


def test_kinks_and_jumps_are_found():
    def notch(t, y):
        return abs(y[0] - 1.0) - 0.01

    def window(t, y):
        return -1.0 if 0.6 < y[0] < 1.4 else 1.0

    found = kd.solve(still, (0.0, 2.05), [0.0], max_step=1.5, first_step=0.5, events=[notch, window])
    assert found.t_events[0] == pytest.approx([0.99, 1.01], abs=1e-12)
    assert found.t_events[1] == pytest.approx([0.6, 1.4], abs=1e-12)


def test_two_nodes_in_one_step():
    """Steps of 0.55 periods, in which wisdom-holman is exact."""
    x, v = kepler(0.3, 0.0)
    turn = np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]])
    system = kd.System(
        [[0, 0, 0], turn @ x], [[0, 0, 0], turn @ v], masses=[1.0, 0.0], forces=[kd.Gravity()], units="nbody"
    )
    watched = [kd.Crossing.ascending_node(1, 0), kd.Crossing.descending_node(1, 0)]
    sim = kd.Simulation(system, "wisdom-holman", 0.55 * 2 * math.pi, events=watched).run(40)
    times = np.array([event["time"] for event in sim.events])
    assert len(times) == 44
    assert np.diff(times) == pytest.approx(math.pi, abs=1e-9)
