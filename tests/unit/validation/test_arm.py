"""The emulated ARM processor: agreement of two runs, and errors of child processes."""

import json
import sys

import pytest

import kickdrift as kd
from docs.studies import arm, arm_kinds


def run(energies=(1.0, 1.0), positions=(2.0, -4.0), steps=1):
    return {"energies": list(energies), "positions": list(positions), "steps": steps, "seconds": 1.0}


def test_a_run_agrees_within_ten_times_what_older_processors_differ_by():
    here, older = run(), [run(positions=(2.0 + 1e-9, -4.0)), run()]
    near, far = (arm.compared("x", run(positions=(2.0 + d, -4.0)), here, older) for d in (9e-9, 11e-9))
    assert near.agrees
    assert not far.agrees
    assert near.positions == pytest.approx((9e-9 / 4, 1e-9 / 4))
    assert near.energies == (0.0, 0.0)
    assert far.cells()[:2] == ["x", "no"]


def test_rounding_units_always_agree():
    there = run(energies=(1.0, 1.0 + 9 * arm.EPS), steps=4)
    assert arm.compared("x", there, run(steps=4), [run()]).agrees
    assert arm.compared("x", there, run(), [run()]).agrees
    assert not arm.compared("x", run(energies=(1.0, 1.0 + 11 * arm.EPS)), run(), [run()]).agrees


@pytest.mark.parametrize("energies", [(1.0,), (1.0, float("nan"))])
def test_missing_or_infinite_numbers_do_not_agree(energies):
    assert not arm.compared("x", run(energies=energies), run(), [run(energies=(1.0, 2.0))]).agrees


def test_a_run_without_energies_is_compared_by_its_positions():
    row = arm.compared("x", run(energies=()), run(energies=()), [run(energies=())])
    assert row.agrees
    assert row.energies is None
    assert row.cells()[2] == "–"


def test_what_goes_wrong_is_told():
    with pytest.raises(arm.Failure, match="no program 'no-such-program'"):
        arm.output("no-such-program")
    with pytest.raises(arm.Failure, match="exit status 3: why"):
        arm.output(sys.executable, "-c", "import sys; print('why', file=sys.stderr); sys.exit(3)")
    with pytest.raises(arm.Failure, match="signal 9"):
        arm.output(sys.executable, "-c", "import os; os.kill(os.getpid(), 9)")
    with pytest.raises(arm.Failure, match=r"not done in 0\.1 s"):
        arm.output(sys.executable, "-c", "import time; time.sleep(60)", limit=0.1)


def test_a_kind_in_a_process_of_its_own():
    found = arm.Machine("here", (sys.executable,), {}).found("van der Pol's equation")
    assert found["positions"] == arm_kinds.KINDS["van der Pol's equation"]().positions
    assert len(found["positions"]) == 2
    assert found["machine"] in arm.described(found)
    json.dumps(found)


def test_side_by_side_runs_give_what_one_gives():
    found = arm_kinds.side_by_side()
    one = arm_kinds.moved(kd.load("figure-eight"), "leapfrog", 200, dt=1e-3)
    assert len(found.positions) == 8 * 9
    assert found.energies[:11] == pytest.approx(one.energies[::4], rel=1e-13)
