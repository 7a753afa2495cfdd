"""A compiled f with other values than the Python code is refused before the first step."""

import json
import math
import re

import numba
import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.equations.equation import _states
from tests.folders import DATA

POLLU = json.loads((DATA / "pollu.json").read_text(encoding="utf-8"))
THIRDS = np.array([1.0, 3.0], dtype=np.float32)
FACTOR = 1.0


def pollu(t, y):
    """Problem as the Test Set writes it, with a list that begins as whole numbers."""
    k = (
        0.35, 26.6, 1.23e4, 8.6e-4, 8.2e-4, 1.5e4, 1.3e-4, 2.4e4, 1.65e4, 9e3, 0.022, 1.2e4, 1.88, 1.63e4, 4.8e6,
        3.5e-4, 0.0175, 1e8, 4.44e11, 1240.0, 2.1, 5.78, 0.0474, 1780.0, 3.12,
    )  # fmt: skip
    r = [
        k[0] * y[0], k[1] * y[1] * y[3], k[2] * y[4] * y[1], k[3] * y[6], k[4] * y[6], k[5] * y[6] * y[5],
        k[6] * y[8], k[7] * y[8] * y[5], k[8] * y[10] * y[1], k[9] * y[10] * y[0], k[10] * y[12],
        k[11] * y[9] * y[1], k[12] * y[13], k[13] * y[0] * y[5], k[14] * y[2], k[15] * y[3], k[16] * y[3],
        k[17] * y[15], k[18] * y[15], k[19] * y[16] * y[5], k[20] * y[18], k[21] * y[18], k[22] * y[0] * y[3],
        k[23] * y[18] * y[0], k[24] * y[19],
    ]  # fmt: skip
    d = [0] * 20
    d[0] = -(r[0] + r[9] + r[13] + r[22] + r[23]) + (r[1] + r[2] + r[8] + r[10] + r[11] + r[21] + r[24])
    d[1] = -r[1] - r[2] - r[8] - r[11] + r[0] + r[20]
    d[2] = -r[14] + r[0] + r[16] + r[18] + r[21]
    d[3] = -r[1] - r[15] - r[16] - r[22] + r[14]
    d[4] = -r[2] + 2 * r[3] + r[5] + r[6] + r[12] + r[19]
    d[5] = -r[5] - r[7] - r[13] - r[19] + r[2] + 2 * r[17]
    d[6] = -r[3] - r[4] - r[5] + r[12]
    d[7] = r[3] + r[4] + r[5] + r[6]
    d[8] = -r[6] - r[7]
    d[9] = -r[11] + r[6] + r[8]
    d[10] = -r[8] - r[9] + r[7] + r[10]
    d[11] = r[8]
    d[12] = -r[10] + r[9]
    d[13] = -r[12] + r[11]
    d[14] = r[13]
    d[15] = -r[17] - r[18] + r[15]
    d[16] = -r[19]
    d[17] = r[19]
    d[18] = -r[20] - r[21] - r[23] + r[22] + r[24]
    d[19] = -r[24] + r[23]
    return d


def whole_list(t, y):
    d = [0] * 2
    d[0] = -0.5 * y[0]
    d[1] = 0.5 * y[0]
    return d


def whole_array(t, y):
    d = np.zeros(1, np.int64)
    d[0] = 3 * y[0]
    return d / 3 + y - y


def overflow(t, y):
    k = 10**6
    return [-y[0] * (k * k * k * k) / 1e24]


def power(t, y):
    n = 10
    return [-y[0] * n**25 / 1e25]


def shift(t, y):
    n = 3
    return [-y[0] * (n << 70)]


def single(t, y):
    return [THIRDS[0] / THIRDS[1] * 0.1 * y[0]]


def later(t, y):
    """Correct at the start, where both values are zero."""
    d = [0]
    d[0] = 0.5 * y[0] * t
    return d


@pytest.mark.parametrize(
    ("f", "y0", "plain", "compiled"),
    [
        (whole_list, [1.0, 0.0], "[0] at t = 0 is -0.5 in", "and 0 compiled"),
        (overflow, [1.0], "[0] at t = 0 is -1 in", "and -2.00376421e-06 compiled"),
        (power, [1.0], "[0] at t = 0 is -1 in", "compiled"),
        (shift, [1.0], "[0] at t = 0 is -3.54177486e+21 in", "compiled"),
        (single, [1.0], "[0] at t = 0 is", "compiled"),
        (later, [1.0], "[0] at t = 0.37 is", "and 0 compiled"),
        (pollu, POLLU["y0"], "[0] at t = 0 is", "and 0 compiled"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_other_values_than_pythons_are_refused(f, y0, plain, compiled):
    with pytest.raises(kd.InputError) as error:
        kd.Simulation(kd.Problem(f, y0, name="mine"))
    message = str(error.value)
    assert message.startswith(f"mine: f(t, y){plain}")
    assert f"{compiled}: compiled code has 64-bit whole numbers" in message
    assert message.endswith("; compiled=False runs f as plain Python, slowly")
    assert "\n" not in message


def test_the_same_f_in_plain_python_and_with_floats():
    for f, compiled in ((whole_list, False), (lambda t, y: [-0.5 * y[0], 0.5 * y[0]], True)):
        sim = kd.Simulation(kd.Problem(f, [1.0, 0.0], compiled=compiled))
        assert sim.run(until=1.0).y == pytest.approx([math.exp(-0.5), 1 - math.exp(-0.5)], rel=1e-7)


@pytest.mark.parametrize("integrator", ["radau", "rosenbrock"])
def test_pollu_as_the_test_set_writes_it(integrator):
    problem = kd.Problem(pollu, POLLU["y0"], compiled=False)
    y = kd.Simulation(problem, integrator, rtol=1e-6, atol=1e-12).run(until=POLLU["t_end"], interval=60.0).y
    assert y[:15] + y[16:] == pytest.approx(POLLU["reference"][:15] + POLLU["reference"][16:], rel=1e-4)
    assert y[15] == pytest.approx(POLLU["reference"][15], rel=1e-3)


def same(t, y):
    """Operations that numba does like Python: division, remainders, rounding and comparisons of whole numbers."""
    total = 0.0
    for n in (-7, -2, 3, 8):
        total += n // 3 + n % 3 + n / 3 + n**3 + round(n + 0.5) + (n > 0) + abs(n) + int(n / 2)
        total += math.floor(y[0] * n) + round(y[0] * n) + (y[0] * n) % 2.5 + (y[0] * n) // 0.7
    return [total * y[0] + 2**-2 * t, (True + True) * y[1] + np.sum(y) - sum(y), 1e-300 * y[0]]


def cancelling(t, y):
    return [np.sum(np.sin(y)) - (math.sin(y[0]) + math.sin(y[1]) + math.sin(y[2])), 1e16 + y[1] - 1e16, y[2] ** 7]


def beyond(t, y):
    """Undefined at later times and below zero."""
    return [math.sqrt(1e-8 - t), math.log(y[1]), -math.sqrt(y[2])]


@pytest.mark.parametrize("f", [same, cancelling, beyond], ids=lambda f: f.__name__)
def test_what_only_rounds_otherwise_is_taken(f):
    kd.Simulation(kd.Problem(f, [0.3, 1.7, 0.0]))


def test_a_function_that_was_compiled_by_its_author_is_compared_too():
    with pytest.raises(kd.InputError, match=r"f\(t, y\)\[0\] at t = 0 is -0\.5 in plain Python and 0 compiled"):
        kd.Simulation(kd.Problem(numba.njit(whole_list), [1.0, 0.0]))


def test_a_name_outside_that_changed_since(monkeypatch):
    def f(t, y):
        return [-FACTOR * y[0]]

    problem = kd.Problem(f, [1.0])
    assert kd.Simulation(problem).run(until=1.0).y == pytest.approx([math.exp(-1)], rel=1e-7)
    monkeypatch.setitem(globals(), "FACTOR", 2.0)
    with pytest.raises(kd.InputError, match=r"is -2 in plain Python and -1 compiled: .* names outside f"):
        kd.Simulation(problem)
    assert kd.Simulation(kd.Problem(f, [1.0])).run(until=1.0).y == pytest.approx([math.exp(-2)], rel=1e-7)


def test_the_states_compared_are_two_besides_the_start():
    times = []

    def f(t, y):
        times.append(round(t, 6))
        return -y

    assert len(list(_states(kd.Problem(f, [1.0, 0.0], compiled=False), f))) == 3
    assert re.fullmatch(r"\[0.*0\.37.*0\.74.*\]", str(times))
