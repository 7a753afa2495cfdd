"""Threads of Python: one Simulation refuses a second thread, and what may be shared gives the same results."""

from __future__ import annotations

from collections.abc import Callable
from threading import Barrier, Thread
from typing import Any

import pytest

import kickdrift as kd
from kickdrift.errors import InputError
from tests.processes import python
from tests.systems import liquid

BUSY = "{}: the Simulation is busy in another thread; give each thread its own"
USES = {
    "run": lambda sim: sim.run(1),
    "advance": lambda sim: sim.advance(1),
    "equilibrate": lambda sim: sim.equilibrate(1.0, steps=1),
    "minimize": lambda sim: sim.minimize(steps=1),
    "restore": lambda sim: sim.restore({}),
    "checkpoint": lambda sim: sim.checkpoint(),
    "report": lambda sim: sim.report(),
    "state": lambda sim: sim.state,
    "energy": lambda sim: sim.energy(),
    "sample": lambda sim: sim.sample(),
    "forces": lambda sim: sim.forces(),
    "accelerations": lambda sim: sim.accelerations(),
    "elements": lambda sim: sim.elements(),
    "method_state": lambda sim: sim.method_state,
}
HOLDS = {  # how another thread holds a Simulation while it calls a function
    "run": lambda sim, act: sim.run(1, every=1, observe=act),
    "advance": lambda sim, act: sim.advance(1, visit=act),
    "equilibrate": lambda sim, act: sim.equilibrate(1.0, steps=1, progress=lambda done, of: act(sim)),
    "minimize": lambda sim, act: sim.minimize(steps=1, progress=lambda done, of: act(sim)),
}


def simulation() -> kd.Simulation:
    return kd.Simulation(liquid(27, 1.2), "velocity-verlet", dt=0.002)


def in_thread(work: Callable[[], Any]) -> Any:
    """What a function returns in another thread, or the InputError that it raises."""
    found: list[Any] = []

    def act() -> None:
        try:
            found.append(work())
        except InputError as error:
            found.append(str(error))

    thread = Thread(target=act)
    thread.start()
    thread.join()
    return found[0]


def assign(sim: kd.Simulation) -> None:
    sim.state = sim.system.state


@pytest.mark.parametrize("hold", HOLDS)
def test_a_simulation_refuses_a_second_thread(hold):
    sim, said = simulation(), []

    def act(sim: kd.Simulation) -> None:
        if not said:
            said.extend(in_thread(lambda use=use: use(sim)) for use in USES.values())
            said.append(in_thread(lambda: assign(sim)))
            assert in_thread(lambda: (repr(sim), sim.time, sim.steps_done, sim.running))[1] == sim.time

    HOLDS[hold](sim, act)
    assert said == [BUSY.format(name) for name in (*USES, "state")]
    assert in_thread(lambda: sim.run(1).steps) >= 1  # later, another thread may


def test_two_threads_at_the_same_moment():
    """In a child process, since a fault would end it with a signal. At least one of the threads runs."""
    run = python(f"from {__name__} import tries; print(tries(8))", timeout=300)
    assert run.returncode == 0, run.stderr[-2000:]
    assert run.stdout.split()[-1] == "8"


def tries(count: int) -> int:
    """Tries in which two threads ran one Simulation, of ``count``: each thread ended, or was refused."""
    good = 0
    for _ in range(count):
        sim, both, ends = simulation(), Barrier(2), []

        def go(sim=sim, both=both, ends=ends) -> None:
            both.wait()
            try:
                ends.append(sim.run(20).steps)
            except InputError as error:
                ends.append(str(error))

        threads = [Thread(target=go) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        ran = [each for each in ends if each != BUSY.format("run")]
        good += len(ends) == 2 and ran in ([20], [20, 40]) and sim.steps_done == ran[-1]
    return good


def test_simulations_of_one_system_run_beside_each_other():
    system = liquid(27, 1.2)
    methods = ["velocity-verlet", "velocity-verlet", "leapfrog-exact", "rk4"]

    def end(name: str) -> bytes:
        sim = kd.Simulation(system, name, dt=0.002)
        sim.run(30, every=3)
        return sim.state.phase.tobytes()

    assert beside_each_other([lambda name=name: end(name) for name in methods]) == [end(name) for name in methods]


def test_one_file_is_read_by_several_threads(tmp_path):
    simulation().run(30, every=1, output=tmp_path / "run.h5md")

    def sums(run: Any) -> list[float]:
        return [float(frame.positions.sum()) for frame in run]

    def opened() -> list[float]:
        with kd.open(tmp_path / "run.h5md") as run:
            return sums(run)

    with kd.open(tmp_path / "run.h5md") as one:
        found = beside_each_other([opened, lambda: sums(one), opened, lambda: sums(one)])
        assert found == [sums(one)] * 4


def test_two_runs_into_one_file(tmp_path):
    """One of two threads writes the file, and the other is refused."""
    path = tmp_path / "run.h5md"
    for _ in range(5):

        def write() -> str:
            try:
                return str(simulation().run(20, every=2, output=path, overwrite=True).steps)
            except InputError as error:
                return str(error)

        ends = beside_each_other([write] * 2)
        assert "20" in ends
        assert set(ends) <= {"20", f"{path}: is open in another program or run; close it there first"}
        with kd.open(path) as run:
            assert len(run) == 11


def beside_each_other(works: list[Callable[[], Any]]) -> list[Any]:
    """What functions return that begin at the same moment in threads of their own."""
    found: list[Any] = [None] * len(works)
    all_there = Barrier(len(works))

    def go(k: int) -> None:
        all_there.wait()
        found[k] = works[k]()

    threads = [Thread(target=go, args=(k,)) for k in range(len(works))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found
