"""kickdrift.solve, beside closed forms and SciPy's solve_ivp. SciPy's own tests of it are in tests/oracle."""

import fractions
import inspect
import pickle

import numpy as np
import pytest
from scipy.integrate import DOP853, RK45, solve_ivp

import kickdrift as kd
from kickdrift.forces.equations import code as equation_code
from tests.long import rest

# Methods and their options; how far the oscillator may be off after ten units of time, and inside steps.
METHODS = {
    "dormand-prince45": ({}, 1e-7),
    "RK23": ({"rtol": 1e-6, "atol": 1e-8}, 1e-4),
    "DOP853": ({}, 1e-7),
    "cash-karp45": ({}, 1e-7),
    "gauss-radau15": ({}, 1e-12),
    "rosenbrock": ({"rtol": 1e-6}, 1e-5),
    "Radau": ({}, 1e-7),
    "bdf": ({"rtol": 1e-6}, 1e-4),
    "LSODA": ({}, 1e-6),
    "velocity-verlet": ({"dt": 0.01, "separable": True}, 1e-4),
    "yoshida4": ({"dt": 0.01, "separable": True}, 1e-7),
    "rk4": ({"dt": 0.01}, 1e-8),
    "gauss-legendre4": ({"dt": 0.01}, 1e-8),
}


def oscillator(t, y, k):
    return [y[1], -k * y[0]]


def van_der_pol(t, y):
    return [y[1], (1 - y[0] ** 2) * y[1] - y[0]]


def energy(t, y, k):
    return 0.5 * (y[1] ** 2 + k * y[0] ** 2)


def position(t, y, k):
    return y[0]


def beyond(t, y):
    if not 0.0 <= t <= 1.0:
        raise KeyError("outside")
    return -y


def unknown_to_numba(t, y):
    return [float(fractions.Fraction(1, 2)) * y[0]]


def exact(t):
    return np.array([np.cos(t), -np.sin(t)])


# -- all methods, in both ways of time


@pytest.mark.parametrize("end", [10.0, rest(-9.995)])
@pytest.mark.parametrize("method", METHODS)
def test_steps_times_between_and_events_lie_on_the_solution(method, end):
    options, error = METHODS[method]
    times = np.linspace(0.0, end, 23)
    given = {"method": method, "args": (1.0,), **options}
    found = kd.solve(oscillator, (0.0, end), [1.0, 0.0], dense_output=True, events=position, energy=energy, **given)
    assert found.success
    assert (found.status, found.t[0], found.t[-1]) == (0, 0.0, end)
    assert np.all(np.diff(found.t) * end > 0)
    assert np.abs(found.y - exact(found.t)).max() < error
    assert np.abs(found.sol(times) - exact(times)).max() < error
    np.testing.assert_allclose(found.sol(found.t), found.y, rtol=1e-15, atol=1e-15)
    assert found.sol(0.5 * end).shape == (2,)
    zeros = np.sign(end) * np.pi * np.array([0.5, 1.5, 2.5])
    assert found.t_events[0] == pytest.approx(zeros, abs=error)
    assert np.abs(found.y_events[0][:, 0]).max() < 1e-12
    only = kd.solve(oscillator, (0.0, end), [1.0, 0.0], t_eval=times, **given)
    assert np.array_equal(only.t, times)
    np.testing.assert_array_equal(only.y, found.sol(times))
    report = found.report
    assert report.energy.initial == 0.5
    assert report.energy.max_relative_error < 3 * error
    assert (report.time, report.steps) == (abs(end), len(found.t) - 1)
    assert report.force_evaluations == found.nfev > 0
    assert report.y == found.y[:, -1].tolist()


def test_arguments_stand_in_scipys_order():
    ours, scipys = (list(inspect.signature(f).parameters) for f in (kd.solve, solve_ivp))
    assert ours[:9] == ["f", *scipys[1:9]]
    found = kd.solve(oscillator, (0, 1), [1, 0], "RK45", [0.5, 1.0], False, None, False, (1.0,))
    assert found.y == pytest.approx(exact(np.array([0.5, 1.0])), abs=1e-7)


@pytest.mark.parametrize("name", ["RK23", "RK45", "DOP853", "Radau", "BDF", "LSODA"])
def test_scipys_names_give_scipys_solution(name):
    given = {"t_span": (0.0, 20.0), "y0": [2.0, 0.0], "method": name, "rtol": 1e-6, "atol": 1e-8}
    ours, scipys = (solve(van_der_pol, **given) for solve in (kd.solve, solve_ivp))
    assert ours.y[:, -1] == pytest.approx(scipys.y[:, -1], abs=1e-3)
    assert ours.nfev == pytest.approx(scipys.nfev, rel=0.25)
    assert (ours.njev, ours.nlu, ours.message) == (scipys.njev, scipys.nlu, scipys.message)


def test_a_class_of_scipy_means_its_name_and_any_other_solver_runs_as_it_is():
    class Own(RK45):
        pass

    given = {"t_span": (0.0, 5.0), "y0": [1.0, 0.0], "args": (1.0,), "rtol": 1e-6}
    assert kd.solve(oscillator, method=DOP853, **given).report.integrator == "dop853"
    own, scipys = kd.solve(oscillator, method=Own, **given), solve_ivp(oscillator, method=RK45, **given)
    np.testing.assert_array_equal(own.t, scipys.t)
    assert (own.report.integrator, own.report.rtol, own.nfev) == ("Own", 1e-6, scipys.nfev)


def test_an_integrators_value_stands_in_place_of_its_name():
    found = kd.solve(oscillator, (0, 10), [1, 0], kd.integrator("dop853", rtol=1e-12), args=(1.0,))
    assert (found.report.integrator, found.report.rtol) == ("dop853", 1e-12)
    assert np.abs(found.y - exact(found.t)).max() < 1e-9


@pytest.mark.parametrize(("method", "order"), [("velocity-verlet", 2), ("rk4", 4), ("yoshida4", 4)])
def test_the_last_step_is_shorter_where_the_interval_is_no_whole_number_of_steps(method, order):
    errors = []
    for dt in (0.03, 0.015):
        found = kd.solve(oscillator, (0, 1), [1, 0], method, args=(1.0,), separable=True, dt=dt)
        assert found.t[-1] == 1.0
        assert np.diff(found.t)[:-1] == pytest.approx(dt)
        assert found.t[-1] - found.t[-2] == pytest.approx(1.0 % dt)
        errors.append(np.abs(found.y[:, -1] - exact(1.0)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.25)


def test_a_whole_number_of_steps_ends_at_the_end_of_the_interval_to_the_last_bit():
    found = kd.solve(oscillator, (0.1, 0.4), [1, 0], "rk4", args=(1.0,), dt=0.1)
    assert len(found.t) == 4
    assert found.t[-1] == 0.4


@pytest.mark.parametrize("method", ["dormand-prince45", "DOP853", "gauss-radau15", "BDF"])
@pytest.mark.parametrize("end", [3.0, rest(-3.0)])
def test_complex_numbers(method, end):
    matrix = np.array([[1j, 0.5], [0.0, -0.3 + 2j]])

    def f(t, y, matrix):
        return [matrix[0, 0] * y[0] + matrix[0, 1] * y[1], matrix[1, 1] * y[1]]

    times = np.linspace(0, end, 7)
    given = {"t_span": (0, end), "y0": [1.0 + 0j, 2.0 - 1j], "args": (matrix,), "t_eval": times}
    found = kd.solve(f, method=method, rtol=1e-8, **given)
    close = solve_ivp(f, method="DOP853", rtol=1e-13, atol=1e-13, **given)
    assert found.y.dtype == complex
    assert np.abs(found.y - close.y).max() < (2e-5 if method == "BDF" else 1e-6)
    assert not found.report.warnings
    assert found.report.rtol == 1e-8


# -- f: compiled, plain, or raising


def test_f_that_does_not_compile_runs_as_plain_python_and_the_report_says_why():
    found = kd.solve(unknown_to_numba, (0, 1), [1.0])
    assert found.y[0, -1] == pytest.approx(np.exp(0.5), abs=1e-7)
    (warning,) = found.report.warnings
    assert warning.startswith("runs as plain Python, slowly: unknown_to_numba: f does not compile: ")
    assert not kd.solve(unknown_to_numba, (0, 1), [1.0], compiled=False).report.warnings
    with pytest.raises(kd.InputError, match="does not compile"):
        kd.solve(unknown_to_numba, (0, 1), [1.0], compiled=True)


def test_compiled_and_plain_python_take_the_same_steps():
    found = [kd.solve(oscillator, (0, -10), [1, 0], args=(1.0,), compiled=compiled) for compiled in (True, False)]
    assert found[0].t == pytest.approx(found[1].t, rel=1e-9)
    assert found[0].nfev == found[1].nfev


@pytest.mark.parametrize("compiled", [None, True, False])
@pytest.mark.parametrize("method", ["dormand-prince45", rest("Radau"), rest("rk4")])
def test_what_f_raises_comes_out_unchanged(method, compiled):
    fixed = {"dt": 0.1} if method == "rk4" else {}
    with pytest.raises(KeyError, match="outside"):
        kd.solve(beyond, (0, 2), [1.0], method, compiled=compiled, **fixed)
    found = kd.solve(beyond, (0, 1), [1.0], method, compiled=compiled, **fixed)
    assert found.y[0, -1] == pytest.approx(np.exp(-1), abs=1e-5)


def test_columns_as_scipy_gives_them_to_a_vectorized_f():
    def f(t, y):
        return np.vstack((y[1], -y[0]))

    for method in ("RK45", "Radau"):
        found = kd.solve(f, (0, 3), [1, 0], method, vectorized=True)
        assert np.abs(found.y - exact(found.t)).max() < 1e-6


def test_one_number_may_stand_for_a_row_of_one():
    assert kd.solve(lambda t, y: -2.0 * y[0], (0, 1), [1.0]).y[0, -1] == pytest.approx(np.exp(-2), abs=1e-7)


def test_other_values_of_args_need_no_compilation(monkeypatch):
    made, compile_one = [], equation_code._compiled
    monkeypatch.setattr(equation_code, "_compiled", lambda *args: made.append(args) or compile_one(*args))

    def f(t, y, rate, row, power, name):
        return [-rate * row[1] * y[0] ** power if name == "decay" else 0.0]

    for rate, row in ((1.0, [0.0, 2.0]), (3.0, [0.0, 0.5]), (2.0, [5.0, 1.0])):
        found = kd.solve(f, (0, 1), [1.0], args=(rate, np.array(row), 1, "decay"))
        assert found.y[0, -1] == pytest.approx(np.exp(-rate * row[1]), abs=1e-7)
    assert len(made) == 1
    assert kd.solve(f, (0, 1), [1.0], args=(1.0, np.zeros(2), 1, "none")).y[0, -1] == 1.0
    assert len(made) == 2


def test_two_solutions_of_one_function_do_not_share_its_parameters():
    given = {"method": "cash-karp45", "dense_output": True}  # whose interpolant calls f
    first, second = (kd.solve(oscillator, (0, 3), [1, 0], args=(k,), **given) for k in (1.0, 4.0))
    assert first.sol(1.03)[0] == pytest.approx(np.cos(1.03), abs=1e-7)
    assert second.sol(1.03)[0] == pytest.approx(np.cos(2.06), abs=1e-7)


def test_a_changed_name_outside_f_is_seen():
    scope = {"rate": 1.0}
    exec("def f(t, y): return [-rate * y[0] if t > 0.5 else 0.0 * y[0]]", scope)
    for rate in (1.0, 2.0):
        scope["rate"] = rate
        found = kd.solve(scope["f"], (0, 1), [1.0], max_step=0.01)
        assert found.y[0, -1] == pytest.approx(np.exp(-rate / 2), abs=1e-6)


# -- results


def test_a_terminal_event_ends_the_solution_and_the_report_names_it():
    def fall(t, y):
        return y[0]

    fall.terminal, fall.direction = True, -1
    found = kd.solve(lambda t, y: [y[1], -10.0], (0, np.inf), [5.0, 0.0], events=fall, dense_output=True)
    assert (found.status, found.message) == (1, "A termination event occurred.")
    assert found.t[-1] == found.t_events[0][0] == pytest.approx(1.0, abs=1e-12)
    assert found.sol(0.5) == pytest.approx([3.75, -5.0])
    assert found.report.stopped == "a terminal event at t = 1"
    assert found.report.time == pytest.approx(1.0)


def test_the_first_of_two_terminal_events_in_one_step_counts_in_either_way():
    def early(t, y):
        return t * t - 1e-4

    def late(t, y):
        return t * t - 4e-4

    early.terminal = late.terminal = True
    for end in (1.0, -1.0):
        found = kd.solve(lambda t, y: 0.0 * y, (0, end), [1.0], events=[late, early], first_step=0.5)
        assert found.t[-1] == pytest.approx(0.01 * end)
        assert [len(times) for times in found.t_events] == [0, 1]


def test_a_failed_step_is_a_status_and_no_error():
    for method, options in (("dormand-prince45", {}), ("rk4", {"dt": 0.01}), ("Radau", {})):
        found = kd.solve(lambda t, y: y * y, (0, 2), [1.0], method, **options)
        assert (found.status, found.success) == (-1, False)
        assert found.message
        assert np.isfinite(found.y).all()
        assert found.t[-1] == pytest.approx(1.0, abs=0.05)


def test_the_report_warns_when_stability_sets_the_steps():
    found = kd.solve(lambda t, y: [-1000.0 * (y[0] - np.cos(t))], (0, 20), [0.0], rtol=1e-4)
    assert any("limited by stability" in line for line in found.report.warnings)


def test_a_solution_shows_its_times_and_travels_to_another_process():
    found = kd.solve(oscillator, (0, 1), [1, 0], args=(1.0,), dense_output=True)
    there = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(there.sol(0.3), found.sol(0.3))
    assert "dormand-prince45" in repr(found)
    assert len(repr(found).splitlines()) < 20


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"t_span": (0,)}, "t_span: expected two times"),
        ({"t_span": (np.inf, 0)}, r"t_span\[0\]: expected a finite time"),
        ({"t_span": (0, np.nan)}, r"t_span\[1\]: expected a time"),
        ({"f": 3}, "f: expected a function"),
        ({"f": lambda t, y: [1.0]}, r"f must return shape \(2,\)"),
        ({"y0": [[1, 0]]}, "must be 1-dimensional"),
        ({"y0": ["a", 0]}, "y0: expected numbers"),
        ({"y0": [np.nan, 0]}, r"y0\[0\] is nan"),
        ({"method": "rk5"}, "did you mean rk4"),
        ({"method": int}, "derived from OdeSolver"),
        ({"method": "rk4"}, "dt is needed"),
        ({"method": "velocity-verlet", "dt": 0.1}, "not declared separable=True"),
        ({"method": "wisdom-holman", "dt": 0.1}, "wisdom-holman"),
        ({"t_eval": [2.0]}, r"t_eval\[0\] is 2.0. Values in `t_eval` are not within `t_span`"),
        ({"t_eval": [0.5, 0.5]}, "not properly sorted"),
        ({"t_eval": 0.5}, "1-dimensional"),
        ({"events": 3}, "events: expected functions"),
        ({"events": [3]}, r"events\[0\]: expected a function"),
        ({"events": lambda t, y: y}, r"events\[0\]: expected one real number at t = 0, got \[1.0, 0.0\]"),
        ({"first_step": 3}, "`first_step` must be positive"),
        ({"first_step": 0.1, "dt": 0.1}, "not both"),
        ({"max_step": -1}, "`max_step` must be positive"),
        ({"atol": [1, 1, 1]}, "atol: expected one number, or 2"),
        ({"rtoll": 1}, "did you mean 'rtol'"),
        ({"args": 1.0}, "Supplied 'args' cannot be unpacked"),
    ],
)
def test_bad_input_is_one_line(given, message):
    arguments = {"f": lambda t, y: [y[1], -y[0]], "t_span": (0, 1), "y0": [1.0, 0.0], **given}
    with pytest.raises(kd.InputError, match=message) as error:
        kd.solve(**arguments)
    assert "\n" not in str(error.value)
