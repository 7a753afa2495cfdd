"""Does MDAnalysis' own test suite for readers pass on a file that we wrote?

    python -m kickdrift_validation.mdanalysis_readers    (pip install MDAnalysisTests, of MDAnalysis' version, 60 MB)

The tests are those that MDAnalysis runs on its H5MD reader: `MultiframeReaderTest` and what its test_h5md.py adds. They
compare with a reference of the suite: five atoms and five frames, atom k of frame i at 2^i (3k, 3k+1, 3k+2), a tenth of
that as velocities and a hundredth as forces. Its box leans and changes from frame to frame. Our Writer writes that
trajectory, and no test may fail.
"""

import tempfile
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from scipy import constants

import kickdrift as kd
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.write.h5md import Writer
from kickdrift_validation.claim import Claim, claim, main, not_run

REFERENCE = "MDAnalysisTests' H5MDReference"
FIRST = np.array([81.1, 82.2, 83.3, 75.0, 80.0, 85.0])  # the reference's lengths and angles in the first frame
LATER = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])  # how much larger they are in each frame than in the one before


def box(lengths_and_angles: np.ndarray) -> kd.Box:
    """The box with edges of three lengths that stand at three angles in degrees: between b and c, a and c, a and b."""
    a, b, c = lengths_and_angles[:3]
    cos_bc, cos_ac, cos_ab = np.cos(np.deg2rad(lengths_and_angles[3:]))
    sin_ab = np.sqrt(1 - cos_ab**2)
    cx, cy = c * cos_ac, c * (cos_bc - cos_ac * cos_ab) / sin_ab
    return kd.Box(matrix=[[a, 0, 0], [b * cos_ab, b * sin_ab, 0], [cx, cy, np.sqrt(c**2 - cx**2 - cy**2)]])


def write(path: Path) -> None:
    """The reference's trajectory, in metal units, which are MDAnalysis' own."""
    first = np.arange(15.0).reshape(5, 3)
    system = kd.System(first, first / 10, box=box(FIRST), units="metal")
    per_mole = constants.e * constants.N_A / 1000  # of an eV, in kJ/mol
    options = FileOptions(write=("forces",))
    with Writer(path, system, method={"dt": 1.0}, every=1, overwrite=True, options=options) as writer:
        for frame in range(5):
            x = first * 2**frame
            phase = np.array([x.T, x.T / 10])
            state = system.state
            there = kd.State(phase, state.masses, state.ids, box(FIRST + frame * LATER), float(frame), frame)
            writer.append(there, {}, forces=x / 100 / per_mole)


if find_spec("MDAnalysisTests"):
    from MDAnalysisTests.coordinates import test_h5md

    class TestOurFile(test_h5md.TestH5MDReaderBaseAPI):
        """Against the suite's reference."""

        @staticmethod
        @pytest.fixture
        def ref(tmp_path):
            write(tmp_path / "run.h5md")
            reference = test_h5md.H5MDReference()
            reference.trajectory = str(tmp_path / "run.h5md")
            return reference


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
    text = "reader tests on a file of ours"
    if not find_spec("MDAnalysisTests"):
        return [not_run(text, "all pass", REFERENCE)]
    found = outcomes("TestOurFile")
    for each in sorted(found["failed"]):
        print(f"fails: {each}")
    count = Counter({kind: len(those) for kind, those in found.items()})
    value = ", ".join(f"{number} {kind}" for kind, number in count.items() if number)
    return [claim(text, value, "all pass", not count["failed"] and count["passed"] > 40, REFERENCE)]


if __name__ == "__main__":
    main(claims, __doc__)
