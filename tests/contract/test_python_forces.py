"""Contract tests: every integrator runs a Python function as it runs a compiled force, and says where the function
failed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.integrators import integrator
from tests.methods import METHODS

END = 0.2


def trap(x, v, t, box):
    return -2.0 * x, float((x * x).sum())


def options_of(name: str) -> dict[str, Any]:
    """Options that the method needs."""
    method = integrator(name)
    found: dict[str, Any] = {} if method.chooses_steps and name != "leapfrog-adaptive" else {"dt": 0.01}
    needed = [option.name for option in method.declared if option.default is None and option.type is float]
    return found | dict.fromkeys([key for key in needed if key not in ("rtol", "atol", "max_step", "eta")], 1.0)


def four(force) -> kd.System:
    rng = np.random.default_rng(2)
    return kd.System(rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), masses=[1, 2, 3, 0.5], forces=[force])


@pytest.mark.parametrize("name", METHODS)
def test_a_function_is_served_like_a_compiled_force(name):
    ends, refusals = [], []
    for force in (kd.PythonForce(trap), kd.HarmonicTrap(2.0)):
        try:
            sim = kd.Simulation(four(force), name, **options_of(name))
            sim.run(until=END, **({} if sim.method.chooses_steps else {"every": 3}))
            ends.append((sim.state.phase.tobytes(), sim.record.force_evaluations, sim.energy()))
        except kd.InputError as error:
            refusals.append(str(error).replace("'python'", "'harmonic-trap'"))
    assert len(ends) + len(refusals) == 2
    if refusals:
        assert refusals[0] == refusals[1]
    else:
        assert ends[0][:2] == ends[1][:2]
        assert ends[0][2] == pytest.approx(ends[1][2], rel=1e-14)


@pytest.mark.parametrize("name", METHODS)
def test_a_function_that_raises_stops_the_run_in_one_line(name):
    """The step is named, the cause is chained, and the state is that of the last look."""
    failing = False

    def tired(x, v, t, box):
        if failing and t > 0.5 * END:
            raise ValueError("tired")
        return trap(x, v, t, box)

    try:
        sim = kd.Simulation(four(kd.PythonForce(tired, time_dependent=True)), name, **options_of(name))
    except kd.InputError:
        pytest.skip("the method takes no function")
    failing = True
    with pytest.raises(kd.RunError, match=r"step \d+ \(t = .*\): tired raised ValueError: tired$") as raised:
        sim.run(until=END)
    assert "\n" not in str(raised.value)
    assert repr(raised.value.__cause__) == "ValueError('tired')"
    assert raised.value.failed_at[0] >= 1
    assert np.isfinite(sim.state.phase).all()
    assert sim.time <= 0.6 * END
