"""Bad input does not break the program: first cases of every generator; `kickdrift validate robustness` runs more.

A failure names the case. ``python -m kickdrift_validation.fuzzing KIND NUMBER`` repeats it and shows the output.
"""

from __future__ import annotations

import io
import math
import sys

import h5py
import pytest

from kickdrift.trajectory.layout import names as layout

if sys.platform != "linux":
    pytest.skip("forks, and reads /proc", allow_module_level=True)

from kickdrift_validation.fuzzing import misdeeds, run_files
from kickdrift_validation.fuzzing.kinds import KINDS
from kickdrift_validation.fuzzing.rules import Ended, broken, culprit, signature
from kickdrift_validation.fuzzing.session import session
from kickdrift_validation.fuzzing.watch import Limits
from tests.long import rest

pytestmark = pytest.mark.fuzzing

COUNTS = {"system-files": 24, "command-lines": 16, "run-files": 20, "flipped-bytes": 20, "kills": 3}
COUNTS |= {"archives": 6, "hosts": 12, "lammps-data": 8, "dicts": 12}
COUNTS |= {"tables": 16, "more-commands": 12}
# Far above a case's needs, even on a busy machine; limits on memory and blocked processes stay strict.
LIMITS = Limits(seconds=60, wall=300, blocked=30)
# Known defects: the signature of the finding and the reason for its delay. There are none.
KNOWN: dict[str, str] = {}


@pytest.fixture(scope="module")
def tried():
    with session(2, LIMITS) as found:
        yield found


@pytest.mark.parametrize("share", [0.1, rest(1.0)])
@pytest.mark.parametrize("kind", KINDS)
def test_no_case_breaks_a_rule(tried, kind, share):
    results = tried((KINDS[kind], number) for number in range(math.ceil(share * COUNTS[kind])))
    found = [
        f"{kind} {result['number']}: {text} ({result['about']})"
        for result in sorted(results, key=lambda result: result["number"])
        for text in result["found"]
        if signature(text) not in KNOWN
    ]
    assert not found, "\n".join(["python -m kickdrift_validation.fuzzing KIND NUMBER repeats a case", *found])


@pytest.mark.parametrize("kind", KINDS)
def test_a_case_is_always_the_same(tried, kind):
    """``tried`` first writes the files for the cases."""
    make = KINDS[kind]
    cases = [make(number) for number in range(6)]
    assert cases == [make(number) for number in range(6)]
    assert cases != [make(number, seed=1) for number in range(6)]
    assert len({(case.commands, tuple(case.files.values()), case.about) for case in cases}) > 4
    assert [case.number for case in cases] == list(range(6))


def test_forged_files_carry_the_hash_of_what_they_say(tried):
    """With a wrong hash, a file would be refused before its names are read."""
    number = next(k for k in range(200) if run_files.case(k).about.startswith("bodies: force "))
    with h5py.File(io.BytesIO(run_files.case(number).files[run_files.NAME])) as file:
        assert file["kickdrift/system"].attrs["sha256"] == layout.system_hash(file)
        if "sha256" in file["kickdrift"].attrs:
            assert file["kickdrift"].attrs["sha256"] == layout.run_hash(file)


def test_what_a_case_must_not_do_is_noticed():
    with session(2, Limits(seconds=2, blocked=3, memory=2**28), warm=False) as quick:
        results = {each["number"]: each for each in quick((misdeeds.case, k) for k in range(len(misdeeds.DEEDS)))}
    for number, (deed, (_, said)) in enumerate(misdeeds.DEEDS.items()):
        found = results[number]["found"]
        assert bool(found) == bool(said), deed
        assert not said or any(said in text for text in found), (deed, found)


def test_a_run_that_was_interrupted_is_right_where_it_may_be_long():
    goes_on = Ended(
        ("run",), 130, "", "kickdrift: interrupted; all written files are whole", stopped="goes on", computing=True
    )
    assert broken(goes_on, may_compute=True) == []
    assert broken(goes_on) == ["goes on, while it computed a run"]


def test_findings_of_one_cause_have_one_signature():
    text = 'Traceback (most recent call last):\n  File "/x/kickdrift/a/b.py", line 3, in f\nValueError: row {}\n'
    found = [f"traceback: {culprit(text.format(k))}" for k in (1, 22)]
    assert found[0] == "traceback: ValueError: row 1 in kickdrift/a/b.py, f"
    assert signature(found[0]) == signature(found[1]) == "traceback: ValueError in a/b.py, f"
