"""Replicas in turns, whose forces Python computes in one call: the bits of runs alone, failures, bad input."""

from __future__ import annotations

import threading
from functools import partial

import numpy as np
import pytest
from ase.build import bulk
from ase.calculators.calculator import Calculator, all_changes
from ase.calculators.lj import LennardJones

import kickdrift as kd
from kickdrift.ensemble import Ensemble
from kickdrift.ensemble.work import packed, timed_members
from kickdrift.forces.external.turns import in_turns
from kickdrift.forces.seam.named import _NAMED
from kickdrift.systemfile.reading import loads

SIZES: list[int] = []  # replicas in each call


def trap(x, v, t, box):
    return -2.0 * x, float((x * x).sum())


def traps(x, v, t, boxes):
    assert len(x) == len(v) == len(t) == len(boxes)
    SIZES.append(len(x))
    if (np.abs(x) > 4.0).any():
        raise ValueError("too far")
    return -2.0 * x, (x * x).sum(axis=(1, 2))


def drags(x, v, t, boxes):
    return -0.3 * v * (1.0 + t[:, None, None]), None


def system(seed, function, **traits):
    rng = np.random.default_rng(seed)
    return kd.System(rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), forces=[kd.PythonForce(function, **traits)])


def after(seed, function, method, time, /, **traits):
    given = {"dt": 0.01} if method == "velocity-verlet" else {}
    sim = kd.Simulation(system(seed, function, **traits), method, **given)
    report = sim.run(until=time)
    return sim.state.phase.tobytes(), report.energy.rms_relative_error


@pytest.mark.parametrize("method", ["velocity-verlet", "dormand-prince45"])
def test_replicas_in_turns_have_the_bits_of_runs_alone(method):
    times = [0.2, 0.5, 0.3, 0.2]
    alone = [after(seed, trap, method, time) for seed, time in enumerate(times)]
    SIZES.clear()
    threads = threading.active_count()
    assert in_turns([partial(after, k, traps, method, t, batch=True) for k, t in enumerate(times)]) == alone
    assert threading.active_count() == threads
    assert max(SIZES) == 4
    assert SIZES[-1] == 1  # the longest run ends alone
    assert SIZES.count(4) >= 20


def test_a_function_of_velocities_and_time_goes_both_ways():
    traits = {"velocity_dependent": True, "time_dependent": True, "works": True}

    def drag(x, v, t, box):
        return -0.3 * v * (1.0 + t), None

    def end(function, time, seed, **more):
        sim = kd.Simulation(system(seed, function, **traits, **more), "dop853")
        sim.run(until=time)
        return sim.state.phase.tobytes()

    for time in (0.5, -0.5):
        alone = [end(drag, time, seed) for seed in (1, 2)]
        assert in_turns([partial(end, drags, time, seed, batch=True) for seed in (1, 2)]) == alone


def test_only_the_run_of_the_culprit_fails():
    def thrown():
        fast = kd.System(np.eye(3), 9.0 * np.eye(3), forces=[kd.PythonForce(traps, batch=True)])
        with pytest.raises(kd.RunError, match=r"step \d+ \(t = 0.\d+\): traps raised ValueError: too far") as raised:
            kd.Simulation(fast, "velocity-verlet", dt=0.01).run(300)
        return str(raised.value)

    calm = [partial(after, seed, traps, "velocity-verlet", 0.9, batch=True) for seed in range(3)]
    assert in_turns([*calm, thrown]) == [*(work() for work in calm), thrown()]


def test_an_error_of_a_run_is_raised_after_all_have_ended():
    ended = []

    def wrong():
        system(0, traps, batch=True)
        raise KeyError("mine")

    def right():
        ended.append(after(1, traps, "velocity-verlet", 0.2, batch=True))

    with pytest.raises(KeyError, match="mine"):
        in_turns([right, wrong, right])
    assert len(ended) == 2
    assert ended[0] == ended[1]


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x, v, t, b: (-x, 1.0), "returned energies of shape (), expected (1,): one for each replica"),
        (lambda x, v, t, b: (-x[0], [1.0]), "returned forces of shape (3, 3), expected (1, 3, 3): 1 replica"),
        (lambda x, v, t, b: (-x, [1.0] * len(x), 0.0), "returned virials of shape (), expected (1,)"),
        (lambda x, v, t, b: -x, "expected (forces, energy) or (forces, energy, virial)"),
        (lambda x, v, t, b: (-x, None), "returned no energy; a force without potential energy needs works=True"),
        (lambda x, v, t, b: (-x, np.full(len(x), (x * x).sum())), "batch: another replica beside a replica changes"),
        (lambda x, v, t, b: (x.mean(axis=0) - 2 * x, np.zeros(len(x))), "batch: another replica beside a replica"),
    ],
)
def test_wrong_functions_are_refused_in_one_line(function, message):
    with pytest.raises(kd.InputError) as raised:
        system(0, function, batch=True)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_batch_is_true_or_false():
    with pytest.raises(kd.InputError, match="python: batch must be True or False, got 8"):
        kd.PythonForce(traps, batch=8)


class Alone(Calculator):
    """Lennard-Jones, begun anew at each call."""

    implemented_properties = ["energy", "forces", "stress"]  # noqa: RUF012

    def __init__(self, sigma=2.0):
        super().__init__()
        self.sigma = sigma

    def of(self, atoms):
        inner = LennardJones(sigma=self.sigma, epsilon=0.1, rc=3.4)
        inner.calculate(atoms, ["energy", "forces", "stress"], all_changes)
        return inner.results

    def calculate(self, atoms=None, properties=("energy",), system_changes=all_changes):
        self.results = self.of(atoms)


class Together(Alone):
    made = 0

    def __init__(self, sigma=2.0):
        super().__init__(sigma)
        Together.made += 1

    def calculate_batch(self, atoms, properties):
        SIZES.append(len(atoms))
        assert properties == ["energy", "forces", "stress"]
        return [self.of(each) for each in atoms]


def warm(seed, calculator):
    atoms = bulk("Cu", a=3.61, cubic=True) * (2, 1, 1)
    atoms.set_momenta(3.0 * np.random.default_rng(seed).normal(size=atoms.positions.shape))
    return kd.System.from_ase(atoms, [kd.CalculatorForce(calculator, {"sigma": 2.2})])


def test_a_calculator_that_takes_batches_gets_all_replicas_and_is_made_once(tmp_path):
    def end(seed, calculator):
        path = tmp_path / f"{calculator.__name__}-{seed}.h5md"
        sim = kd.Simulation(warm(seed, calculator), "velocity-verlet", dt=0.002)
        report = sim.run(8, every=2, output=path)
        with kd.open(path) as run:
            return run.positions.tobytes(), report.pressure, run.energies.total.tobytes()

    made, beside = Together.made, warm(0, Together)
    SIZES.clear()
    assert in_turns([partial(end, seed, Together) for seed in range(3)]) == [end(seed, Alone) for seed in range(3)]
    assert SIZES == [3] * 9
    assert Together.made == made + 1
    assert beside.forces[0].batch


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda each: None, "calculate_batch returned None for 1 Atoms, expected a list of as many"),
        (lambda each: [], "calculate_batch returned 0 results for 1 Atoms, expected a list of as many"),
        (lambda each: [3.0], "calculate_batch returned a list with 3.0, expected tables of results"),
        (lambda each: [None], "calculate_batch returned a list with None, expected tables of results"),
        (lambda each: [{"energy": 1.0}], "returned no forces"),
    ],
)
def test_wrong_results_of_a_calculator_end_the_run_in_one_line(answer, message):
    class Wrong(Alone):
        def calculate_batch(self, atoms, properties):
            return answer(atoms)

    with pytest.raises(kd.RunError) as raised:
        kd.Simulation(warm(0, Wrong), "velocity-verlet", dt=0.002).run(2)
    assert f"step 0 (t = 0): Wrong {message}" in str(raised.value)


def test_the_members_of_a_task_ask_together(monkeypatch):
    monkeypatch.setitem(_NAMED, f"{__name__}.traps", traps)
    monkeypatch.setitem(_NAMED, f"{__name__}.trap", trap)
    text = """
units = "lj"
[particles]
count = 4
lattice = "fcc"
density = 0.1
mass = 1
[velocities]
temperature = 0.5
seed = 1
[[force]]
type = "python"
function = "{}"
{}
[run]
dt = 0.01
steps = 20
"""

    def table(function, more):
        whole = loads(text.format(f"{__name__}.{function}", more))
        ensemble = Ensemble(lambda seed: whole.with_velocities(temperature=0.5, seed=seed), replicas=4)
        rows, _, _ = timed_members(packed(ensemble._recipe), [ensemble.members[k] for k in range(4)])
        assert {row["status"] for row in rows} == {"done"}
        return [{key: value for key, value in row.items() if key not in ("wall_seconds", "warnings")} for row in rows]

    SIZES.clear()
    assert table("traps", "batch = true") == table("trap", "")
    assert SIZES[-10:] == [4] * 10
