"""The model of a step on more threads: known schedules, the log of a run, and the page."""

import sys

import numpy as np
import pytest

import kickdrift as kd
from docs.studies import scaling, scaling_model
from docs.studies.scaling_model import Delays, Log, Memory, Task, makespan, predicted
from kickdrift.jit.threads.chunks import AWAKE, CODE, team_of
from tests.folders import DOCS

AT_ONCE = Delays(0.0, 0.0, 0.0, 0.0)
LATE = Delays(1.0, 5.0, 50.0, 2.0)


def task(*chunks, before=0.0, often=1.0):
    return Task(often, np.array(chunks, dtype=float), before)


@pytest.mark.parametrize(
    ("chunks", "threads", "delay", "expected"),
    [
        ((10, 10, 10, 10), 1, AT_ONCE, 40),
        ((10, 10, 10, 10), 2, AT_ONCE, 20),
        ((10, 10, 10, 10), 3, AT_ONCE, 20),
        ((10, 10, 10, 10), 8, AT_ONCE, 10),
        ((30, 10, 10, 10), 2, AT_ONCE, 30),
        ((10, 10, 10, 30), 2, AT_ONCE, 30),  # a helper begins at the end
        ((10, 30, 10, 10), 2, AT_ONCE, 40),  # the long chunk begins last
        ((10, 10), 2, LATE, 17),  # the helper: 5 + 10; the end: 2
        ((10, 10, 10), 2, LATE, 23),  # the calling thread takes the first and the third: 1 + 20 + 2
        ((10, 10, 10), 3, LATE, 22),  # the second helper begins at 10
    ],
)
def test_free_threads_take_chunks_from_both_ends(chunks, threads, delay, expected):
    assert makespan(task(*chunks), threads, delay) == expected


def test_a_helper_sleeps_after_a_long_serial_part():
    assert makespan(task(100, 100, before=AWAKE + 1.0), 2, LATE) == 152
    assert makespan(task(10, 10, before=AWAKE + 1.0), 2, LATE) == 23  # the calling thread takes both chunks


def test_a_step_is_its_serial_part_its_tasks_and_at_least_its_bytes():
    log = Log([task(10, 10, before=4.0), task(8, 8, before=2.0, often=0.5)])
    assert (log.serial, log.whole) == (5, 33)
    assert predicted(log, 1, LATE) == 33
    assert predicted(log, 2, AT_ONCE) == 5 + 10 + 4
    assert predicted(log.scaled(66.0), 2, AT_ONCE) == 38
    small, large = Memory(4000.0, 1000.0, 10.0), Memory(4000.0, 1e12, 10.0)
    assert predicted(log, 2, AT_ONCE, small) == 19
    assert predicted(log, 2, AT_ONCE, large) == 400


@pytest.mark.skipif(sys.platform != "linux", reason="threads need Linux")
def test_a_logged_run_has_the_bits_of_a_run_and_all_its_chunks():
    def sim(threads):
        return kd.Simulation(kd.load("lj-1000"), "velocity-verlet", dt=0.005, threads=threads)

    plain, watched, code = sim(1), sim(2), team_of(2)._memory[CODE // 8]
    log = scaling_model.log_of(watched, 10)
    plain.run(12)
    assert np.array_equal(plain.state.positions, watched.state.positions)
    assert team_of(2)._memory[CODE // 8] == code
    assert {len(each.chunks) for each in log.tasks} == {2}  # lj-1000 has two shares
    assert any(each.often == 0.9 for each in log.tasks)  # forces; the last step also sums energies
    assert 0.0 < log.serial < log.whole


def found(delay):
    """A study as the script makes it, from made-up numbers."""
    ratio = {"median": 1.5, "low": 1.25, "high": 1.75, "least": 1.0, "most": 2.0}
    strong = {"name": "8 particles", "particles": 8, "nanoseconds": 80.0, "threads": [1, 2]}
    strong |= {"speed_ups": [ratio, ratio]}
    weak = {"particles": [8, 16], "threads": [1, 2], "nanoseconds": 10.0, "efficiency": [ratio, ratio]}
    if delay:
        cores = [str(p) for p in (1, 2, *scaling.MORE)]
        strong |= {"model": dict.fromkeys(cores, 1.64), "model_without_memory": dict.fromkeys(cores, 3.0)}
        strong |= {"serial": 0.02, "tasks": 5.0, "asleep": 0.0, "chunks": 2}
        strong |= {"memory": {"streamed": 800.0, "arrays": 4e6, "rate": 10.0}}
        weak |= {"model": {"2": 0.9}}
    return {
        "where": "one", "load_before": None, "turns": 1, "seconds": 1.0, "strong": [strong], "weak": [weak],
        "delays": delay and LATE._asdict(), "why": "busy", "rates": {"1": 10.0, "2": 12.0},
        "engine": {"particles": 8, "rows": [], "left_out": ["LAMMPS: not here"]},
    }  # fmt: skip


def test_the_tables_show_the_model_beside_the_measurement():
    text = scaling.text_of(found(delay=True))
    assert "| 8 particles | 10.0 | 2 | 1.50 (1.25 to 1.75) | 1.64 | +9 % |" in text
    assert "| 8 | 2 | 16 | 1.50 (1.25 to 1.75) | 0.90 |" in text
    assert "| 8 particles | 1.6 (3.0) |" in text
    assert "Left out: LAMMPS: not here." in text
    without = scaling.text_of(found(delay=False))
    assert without.endswith("No model: busy.")
    assert "| 8 particles | 10.0 | 2 | 1.50 (1.25 to 1.75) | – | – |" in without
    page = (DOCS / "scaling.md").read_text(encoding="utf-8")
    assert page.count(scaling.BEGIN) == page.count(scaling.END) == 1
