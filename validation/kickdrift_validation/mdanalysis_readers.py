"""Does MDAnalysis' own test suite for readers pass on a file that we wrote?

    python -m kickdrift_validation.mdanalysis_readers    (pip install MDAnalysisTests, of MDAnalysis' version, 60 MB)

The tests are those that MDAnalysis runs on its H5MD reader: `MultiframeReaderTest` and what its test_h5md.py adds. They
compare with a reference that the suite has: five atoms and five frames, atom k of frame i at 2^i (3k, 3k+1, 3k+2), a
tenth of that as velocities and a hundredth as forces, and a triclinic box that changes. Our Writer writes that
trajectory as far as a run of ours can have it, and the tests run twice: against the reference as it is, where
`EXCEPTIONS` says which fail and why, and against the reference with an orthorhombic box that stays, where none may.
"""

from __future__ import annotations

import sys
import tempfile
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy import constants

import kickdrift as kd
from kickdrift.trajectory.h5md import Writer
from kickdrift.trajectory.options import FileOptions
from kickdrift_validation.claim import Claim, claim, main, not_run

REFERENCE = "MDAnalysisTests' H5MDReference"
BOX = (81.1, 82.2, 83.3)  # the reference's edges, at right angles
TRICLINIC = "our boxes are orthorhombic and stay as they are; the reference's is triclinic and changes"
EXCEPTIONS = dict.fromkeys(  # of the tests against the reference as it is
    ("test_first_dimensions", "test_changing_dimensions", "test_volume"), TRICLINIC
)


def write(path: Path) -> None:
    """The reference's trajectory, in metal units, which are MDAnalysis' own."""
    first = np.arange(15.0).reshape(5, 3)
    system = kd.System(first, first / 10, box=BOX, units="metal")
    per_mole = constants.e * constants.N_A / 1000  # of an eV, in kJ/mol
    options = FileOptions(write=("forces",))
    with Writer(path, system, method={"dt": 1.0}, every=1, overwrite=True, options=options) as writer:
        for frame in range(5):
            x = first * 2**frame
            phase = np.array([x.T, x.T / 10])
            state = system.state
            writer.append(
                kd.State(phase, state.masses, state.ids, state.box, float(frame), frame), {}, forces=x / 100 / per_mole
            )


if find_spec("MDAnalysisTests"):
    from MDAnalysis.lib.mdamath import box_volume
    from MDAnalysisTests.coordinates import test_h5md

    class TestAsItIs(test_h5md.TestH5MDReaderBaseAPI):
        """Against the reference as it is."""

        @staticmethod
        @pytest.fixture
        def ref(tmp_path):
            write(tmp_path / "run.h5md")
            reference = test_h5md.H5MDReference()
            reference.trajectory = str(tmp_path / "run.h5md")
            return reference

    class TestAsARunCanBe(test_h5md.TestH5MDReaderBaseAPI):
        """Against the reference with a box that a run of ours can have."""

        @staticmethod
        @pytest.fixture
        def ref(tmp_path):
            write(tmp_path / "run.h5md")
            reference = Ours()
            reference.trajectory = str(tmp_path / "run.h5md")
            return reference

    class Ours(test_h5md.H5MDReference):
        def __init__(self) -> None:
            super().__init__()
            self.dimensions = np.array([*BOX, 90, 90, 90], dtype=np.float32)
            self.volume = box_volume(self.dimensions)
            self.changing_dimensions = False


class Outcomes:
    """A pytest plugin that keeps what came of each test."""

    def __init__(self) -> None:
        self.of: dict[str, list[str]] = {"passed": [], "failed": [], "skipped": []}

    def pytest_runtest_logreport(self, report) -> None:
        if report.when == "call" or report.outcome != "passed":
            self.of[report.outcome].append(report.nodeid.split("::")[-1])


def outcomes(name: str) -> dict[str, list[str]]:
    """What came of the tests of that class, by outcome."""
    found = Outcomes()
    with tempfile.TemporaryDirectory() as folder:
        options = ["-q", "--no-header", "--no-summary", "--tb=no", "-p", "no:cacheprovider", "-W", "ignore"]
        places = ["-c", "/dev/null", "--rootdir", folder, "--basetemp", f"{folder}/tests"]
        pytest.main([*options, *places, f"{__file__}::{name}"], plugins=[found])
    return found.of


def claims(long: bool = False) -> list[Claim]:
    texts = ("reader tests on a file of ours, reference as it is", "… reference with our box")
    if not find_spec("MDAnalysisTests"):
        return [not_run(text, "all but three pass", REFERENCE) for text in texts]
    whole, ours = outcomes("TestAsItIs"), outcomes("TestAsARunCanBe")
    failed = {each.split("[")[0] for each in whole["failed"]}
    for name, cause in EXCEPTIONS.items():
        print(f"{name} fails: {cause}")
    for each in sorted(failed - EXCEPTIONS.keys()):
        print(f"fail, and nobody knows why: {each}")
    rows = []
    for text, found, expected in zip(texts, (whole, ours), (set(EXCEPTIONS), set()), strict=True):
        names = {each.split("[")[0] for each in found["failed"]}
        bound = f"{len(expected)} fail, the cause given" if expected else "all pass"
        count = Counter({kind: len(those) for kind, those in found.items()})
        value = ", ".join(f"{number} {kind}" for kind, number in count.items() if number)
        rows.append(claim(text, value, bound, names == expected and count["passed"] > 40, REFERENCE))
    return rows


if __name__ == "__main__":
    sys.exit(main(claims, __doc__))
