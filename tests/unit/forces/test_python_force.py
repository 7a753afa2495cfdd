"""A plain Python function as a force: beside compiled forces, restarts, bad input."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import kickdrift as kd
from kickdrift.forces.seam.named import _NAMED
from kickdrift.integrators.own.registration import load_code
from kickdrift.systemfile.reading import loads

X = np.array([[0.0, 0, 0], [1.1, 0, 0], [2.0, 0.3, 0], [3.0, 0, 0.2]])
V = np.array([[0.1, 0, 0.2], [0, -0.1, 0], [0.2, 0, 0], [-0.3, 0.1, -0.2]])
SYSTEM = f"""
units = "lj"
[particles]
positions = {X.tolist()}
mass = 1
[[force]]
type = "python"
function = "{{function}}"
"""


def trap(x, v, t, box):
    return -2.0 * x, float((x * x).sum())


def drag(x, v, t, box):
    return -0.3 * v, None


def wave(x, v, t, box):
    push = 0.4 * np.cos(2 * np.pi * 0.5 * t + 0.1) * np.ones((len(x), 1)) * [1.0, 0.0, 0.0]
    return push, -float((push * x).sum())


def four(*forces, **more) -> kd.System:
    return kd.System(X, V, forces=forces, **more)


@pytest.mark.parametrize(
    ("function", "traits", "compiled", "method"),
    [
        (drag, {"velocity_dependent": True, "works": True}, kd.LinearDrag(0.3), {"integrator": "dop853"}),
        (wave, {"time_dependent": True, "works": True}, kd.DrivenField((0.4, 0, 0), 0.5, 0.1), {"dt": 0.01}),
    ],
)
@pytest.mark.parametrize("until", [0.5, -0.5])
def test_a_function_of_velocity_or_time_is_the_compiled_force_both_ways(function, traits, compiled, method, until):
    forces = kd.PythonForce(function, **traits), compiled
    ours, theirs = (kd.Simulation(four(force), **method) for force in forces)
    for sim in (ours, theirs):
        sim.run(until=until)
    np.testing.assert_allclose(ours.state.phase, theirs.state.phase, rtol=0, atol=1e-13)
    assert ours.energy() == pytest.approx(theirs.energy(), abs=1e-13)
    assert ours.report().energy.verdict == "not conserved: python"


def test_a_splitting_refuses_a_function_of_velocity():
    with pytest.raises(kd.InputError, match="force 'python' depends on velocity"):
        kd.Simulation(four(kd.PythonForce(drag, velocity_dependent=True, works=True)), "velocity-verlet", dt=0.01)


def shown_to(seen):
    def look(x, v, t, box):
        seen.append((x.copy(), v.copy(), t, box))
        assert not x.flags.writeable
        assert not v.flags.writeable
        return 0.0 * x, 0.0, -3.0

    return look


def test_a_function_sees_the_particles_and_gives_a_pressure():
    seen = []
    system = kd.System(X, V, box=(9.0, 9.0, 9.0), forces=[kd.PythonForce(shown_to(seen), external=False)])
    sim = kd.Simulation(system, "velocity-verlet", dt=0.1)
    seen.clear()
    sim.run(1)
    x, v, time, box = seen[-1]
    assert x.shape == v.shape == (4, 3)
    np.testing.assert_array_equal(x, sim.state.positions)
    assert (time, box) == (0.1, system.box)
    sample = sim.sample()
    assert sample.pressure == pytest.approx((2 * sample.energies.kinetic - 3.0) / (3 * 729))
    assert sample.temperature > 0
    assert sample.pairs is None


def test_samples_call_the_function_no_second_time():
    calls = []
    function = lambda x, v, t, box: (calls.append(t), trap(x, v, t, box))[1]  # noqa: E731
    system = four(kd.PythonForce(function, external=False))  # of an external force the length of a step is checked
    calls.clear()
    kd.Simulation(system, "velocity-verlet", dt=0.01).run(30, every=1)
    assert len(calls) == 31


def test_a_box_without_a_virial_has_no_pressure_and_says_why(tmp_path):
    system = kd.System(X, V, box=(9.0, 9.0, 9.0), forces=[kd.PythonForce(trap)])
    report = kd.Simulation(system, "velocity-verlet", dt=0.01).run(4, output=tmp_path / "run.h5md")
    assert report.pressure is None
    assert report.warnings == ["pressure is left out: the function trap returns no virial"]
    with kd.open(tmp_path / "run.h5md") as run:
        assert "pressure" not in run.observables


def test_a_function_may_be_a_slow_force_of_respa():
    x = 1.2 * np.indices((3, 3, 3)).reshape(3, -1).T
    v = np.random.default_rng(3).normal(size=x.shape)
    ends = []
    for slow in (
        kd.PythonForce(lambda x, v, t, box: (-x, 0.5 * float((x * x).sum())), group=1),
        kd.HarmonicTrap(1.0, group=1),
    ):
        sim = kd.Simulation(kd.System(x, v, forces=[kd.LennardJones(cutoff=1.7), slow]), "respa", dt=0.004)
        sim.run(20, every=5)
        ends.append(sim.state.phase.tobytes())
    assert ends[0] == ends[1]


def test_a_file_names_the_function_and_a_resumed_run_has_the_same_bits(tmp_path):
    path = tmp_path / "run.h5md"
    kd.Simulation(four(kd.PythonForce(trap)), "yoshida4", dt=0.01).run(20, every=5, output=path)
    there = kd.resume(path)
    there.run(20)
    whole = kd.Simulation(four(kd.PythonForce(trap)), "yoshida4", dt=0.01)
    whole.run(40)
    assert there.state.phase.tobytes() == whole.state.phase.tobytes()


def test_a_function_that_nobody_has_named_is_asked_for_in_one_line(tmp_path, monkeypatch):
    path = tmp_path / "run.h5md"
    system = four(kd.PythonForce(trap))
    kd.Simulation(system, dt=0.01).run(4, output=path)
    monkeypatch.delitem(_NAMED, f"{__name__}.trap")
    with pytest.raises(kd.InputError, match=rf"python: function: {__name__}.trap is code, .* --load FILE.py") as raised:
        kd.resume(path)
    assert "\n" not in str(raised.value)
    kd.open(path).close()
    assert kd.resume(path, system=system).steps_done == 4


def test_a_function_without_a_path_needs_the_system(tmp_path):
    path = tmp_path / "run.h5md"
    system = four(kd.PythonForce(partial(trap)))
    kd.Simulation(system, dt=0.01).run(4, output=path)
    with pytest.raises(kd.InputError, match=r"functools.partial is code"):
        kd.resume(path)
    assert kd.resume(path, system=system).steps_done == 4


def test_a_system_file_names_a_function_of_a_loaded_file(tmp_path):
    file = tmp_path / "own_trap_7.py"
    file.write_text(
        "import kickdrift as kd\n\n@kd.register_force\ndef pull(x, v, t, box):\n"
        "    return -x, 0.5 * float((x * x).sum())\n"
    )
    text = SYSTEM.format(function="own_trap_7.pull")
    with pytest.raises(kd.InputError, match=r"force\[0\]: python: function: own_trap_7.pull is code"):
        loads(text)
    load_code(file)
    system = loads(text)
    assert kd.Simulation(system, dt=0.01).energy().potential == pytest.approx(0.5 * (X * X).sum())
    assert 'function = "own_trap_7.pull"' in system.to_toml()
    with pytest.raises(kd.InputError, match="expected an import path"):
        loads(SYSTEM.format(function="pull"))


def test_failing_particles_are_written_beside_the_file_which_stays_whole(tmp_path):
    path = tmp_path / "run.h5md"
    broken = []

    def breaks(x, v, t, box):
        forces, energy = trap(x, v, t, box)
        if t > 0.305:
            broken.append(x.copy())
            forces[2] = np.nan
        return forces, energy

    system = four(kd.PythonForce(breaks, time_dependent=True))
    broken.clear()
    with pytest.raises(kd.RunError) as raised:
        kd.Simulation(system, "velocity-verlet", dt=0.01).run(50, every=5, output=path)
    beside = tmp_path / "run-step-31.extxyz"
    assert str(raised.value) == (
        "velocity-verlet, dt = 0.01: step 31 (t = 0.31): breaks returned a force on particle 2 that is not finite; its "
        f"particles are in {beside}"
    )
    head, comment, *rows = beside.read_text().splitlines()
    assert head == "4"
    assert re.fullmatch(r'Properties=species:S:1:pos:R:3 pbc="F F F" step=31 time=0.31', comment)
    np.testing.assert_array_equal([[float(word) for word in row.split()[1:]] for row in rows], broken[0])
    with kd.open(path) as run:
        assert run.steps.tolist() == [0, 5, 10, 15, 20, 25, 30]
    with pytest.raises(kd.RunError, match=r"run-step-31-2.extxyz"):
        kd.resume(path, system=system).run(50)


def wrong(value):
    return lambda x, v, t, box: value


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: kd.PythonForce(3), "python: function: expected a function, got 3"),
        (lambda: kd.PythonForce(lambda x: x), "python: function must take (positions, velocities, time, box), not (x)"),
        (lambda: kd.PythonForce(trap, works=1), "python: works must be True or False, got 1"),
        (lambda: kd.PythonForce("os.system"), "python: function: os.system is code, and a file runs no code"),
        (lambda: kd.PythonForce(wrong(None)), "returned None, expected (forces, energy)"),
        (lambda: kd.PythonForce(wrong((np.zeros((3, 3)), 0.0))), "returned forces of shape (3, 3), expected (4, 3)"),
        (lambda: kd.PythonForce(wrong((np.zeros((4, 3)), None))), "returned no energy"),
        (lambda: kd.PythonForce(wrong((np.zeros((4, 3)), "much"))), "returned 'much' as its energy, expected a number"),
        (lambda: kd.PythonForce(drag, works=True), "drag: depends on velocity, or on chance; say so: velocity_dep"),
        (lambda: kd.PythonForce(wave), "wave: depends on time, or on chance; say so: time_dependent=True"),
        (lambda: kd.PythonForce(lambda x, v, t, box: 1 / 0), "raised ZeroDivisionError: division by zero at the"),
    ],
)
def test_functions_that_do_not_fit_are_refused_before_the_run(make, message):
    with pytest.raises(kd.InputError, match=re.escape(message)) as raised:
        four(make())
    assert "\n" not in str(raised.value)


def test_particles_without_mass_and_pushes_out_of_a_plane_are_refused():
    with pytest.raises(kd.InputError, match="particle 1 has no mass"):
        four(kd.PythonForce(trap), masses=[1, 0, 1, 1])
    flat = kd.System(X[:, :2], dimensions=2, forces=[kd.PythonForce(lambda x, v, t, box: (0.0 * x + 1.0, 0.0))])
    with pytest.raises(kd.InputError, match="the forces push particle 0 out of the system's two dimensions"):
        kd.Simulation(flat, dt=0.01)


def test_a_raise_inside_a_sample_names_the_step(tmp_path: Path):
    failing = []

    def late(x, v, t, box):
        if failing:
            raise RuntimeError("two\nlines")
        return trap(x, v, t, box)

    sim = kd.Simulation(four(kd.PythonForce(late)), "leapfrog-dkd", dt=0.01)
    sim.run(3)
    sim.advance(1)
    failing.append(True)
    with pytest.raises(kd.RunError, match=r"step 4 \(t = 0.04\): late raised RuntimeError: two lines") as raised:
        sim.sample()
    assert isinstance(raised.value.__cause__, RuntimeError)
