"""Verdicts on the ensemble of a run and on a force: rows of tests, and the pages that show these rows."""

from dataclasses import asdict, dataclass, field
from typing import Any

from kickdrift.display.showing import Lines, Shown, Table, above
from kickdrift.model.state import Floats
from kickdrift.text import counted, duration

PASS, FAIL = "pass", "fail"
SKIPPED = "not tested"


@dataclass(frozen=True)
class Check:
    """One test of one run, or of two runs together.

    Attributes
    ----------
    run : name of the run; "" for a test of two runs
    test : what is tested
    measured, expected : numbers in the run's units; None for a test that compares whole distributions
    deviation : measured less expected, in standard errors; None for a comparison of whole distributions
    p_value : probability of so large a deviation if the run is right
    samples : number of independent samples behind the test
    verdict : "pass" or "fail"
    """

    run: str
    test: str
    measured: float | None
    expected: float | None
    deviation: float | None
    p_value: float
    samples: int
    verdict: str


@dataclass(frozen=True, repr=False)
class EnsembleChecks(Shown):
    """Results of `ensemble_checks`: a verdict for each test.

    Attributes
    ----------
    rows : tuple of Check
    level : probability that a right run fails any of the tests; each test has an equal share of this probability
    notes : remarks for the user, such as degrees of freedom and tests that a run does not allow

    ``print(checks)`` shows the page of ``kickdrift certify``, and ``as_json()`` returns what ``--json`` writes.
    """

    rows: tuple[Check, ...]
    level: float
    notes: tuple[str, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no test failed."""
        return all(row.verdict == PASS for row in self.rows)

    @property
    def failed(self) -> list[Check]:
        """The tests that failed."""
        return [row for row in self.rows if row.verdict != PASS]

    def as_json(self) -> dict[str, Any]:
        """The page as one JSON object."""
        return {
            "passed": self.passed,
            "level": self.level,
            "rows": [asdict(row) for row in self.rows],
            "notes": list(self.notes),
        }

    def _tables(self) -> list[Table]:
        found: list[Table] = []
        columns = ["test", "measured", "expected", "deviation", "p-value", "samples", "verdict"]
        for run in dict.fromkeys(row.run for row in self.rows):
            rows = [row for row in self.rows if row.run == run]
            found.append((run or "Both runs", columns, [_cells(row) for row in rows]))
        return found

    def _lines(self) -> Lines:
        failed = len(self.failed)
        verdict = f"{counted(failed, 'test')} of {len(self.rows)} failed" if failed else "all tests passed"
        share = self.level / max(len(self.rows), 1)
        return [
            *(("note", note) for note in self.notes),
            (
                "threshold",
                f"a test fails below p = {share:.2g}; a right run fails any test in {self.level:.0%} of cases",
            ),
            ("verdict", verdict),
        ]


def _cells(row: Check) -> list[str]:
    measured, expected = ("–" if each is None else f"{each:.5g}" for each in (row.measured, row.expected))
    deviation = "–" if row.deviation is None else f"{row.deviation:+.1f} errors"
    return [row.test, measured, expected, deviation, f"{row.p_value:.2g}", str(row.samples), row.verdict]


@dataclass(frozen=True)
class ForceCheck:
    """One test of a force.

    Attributes
    ----------
    test : what is tested
    measured, bound : largest deviation, and the largest that passes; None for a test without a number
    verdict : "pass", "fail" or "not tested"
    remark : what was found, or why the test does not apply
    """

    test: str
    measured: float | None
    bound: float | None
    verdict: str
    remark: str = ""


@dataclass(frozen=True, repr=False)
class ForceChecks(Shown):
    """Results of `force_checks`: a verdict for each test.

    Attributes
    ----------
    system : name of the system whose forces were tested
    rows : tuple of ForceCheck
    evaluations : number of evaluations of the forces
    seconds : wall time of all tests
    notes : remarks for the user
    curves : what ``plot()`` draws, by name; arrays of shape (2, m)

    ``print(checks)`` shows the page of ``kickdrift certify``, and ``as_json()`` returns what ``--json`` writes.
    """

    system: str
    rows: tuple[ForceCheck, ...]
    evaluations: int
    seconds: float = field(compare=False)
    notes: tuple[str, ...] = ()
    curves: dict[str, Floats] = field(default_factory=dict, compare=False)

    @property
    def passed(self) -> bool:
        """Whether no test failed."""
        return not self.failed

    @property
    def failed(self) -> list[ForceCheck]:
        """The tests that failed."""
        return [row for row in self.rows if row.verdict == FAIL]

    def row(self, test: str) -> ForceCheck:
        """The row of one test. Raises KeyError for a test that is not on the page."""
        for row in self.rows:
            if row.test == test:
                return row
        raise KeyError(test)

    def as_json(self) -> dict[str, Any]:
        """The page as one JSON object."""
        return {
            "system": self.system,
            "passed": self.passed,
            "rows": [asdict(row) for row in self.rows],
            "evaluations": self.evaluations,
            "seconds": self.seconds,
            "notes": list(self.notes),
            "curves": {name: curve.tolist() for name, curve in self.curves.items()},
        }

    def plot(self) -> Any:
        """Draw energy and force along a line, the error of the force, and the energy of a run; a matplotlib Figure."""
        return above("force figure")(self)

    def _tables(self) -> list[Table]:
        columns = ["test", "measured", "bound", "verdict", "remark"]
        return [(f"Forces of {self.system}", columns, [_cells_of_force(row) for row in self.rows])]

    def _lines(self) -> Lines:
        tested = [row for row in self.rows if row.verdict != SKIPPED]
        failed = len(self.failed)
        verdict = f"{counted(failed, 'test')} of {len(tested)} failed" if failed else f"all {len(tested)} tests passed"
        return [
            *(("note", note) for note in self.notes),
            ("time taken", f"{duration(self.seconds)}, {counted(self.evaluations, 'evaluation', ',')} of the forces"),
            ("verdict", verdict),
        ]


def _cells_of_force(row: ForceCheck) -> list[str]:
    measured, bound = ("–" if each is None else f"{each:.1e}" for each in (row.measured, row.bound))
    return [row.test, measured, bound, row.verdict, row.remark]


def judged(test: str, measured: float, bound: float, remark: str = "") -> ForceCheck:
    """Row of a deviation that passes up to ``bound``; a deviation that is not a number fails."""
    return ForceCheck(test, measured, bound, PASS if measured <= bound else FAIL, remark)


def skipped(test: str, why: str) -> ForceCheck:
    """Row of a test that does not apply."""
    return ForceCheck(test, None, None, SKIPPED, why)
