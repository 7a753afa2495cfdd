"""Verdicts on the ensemble of a run: rows of tests, and the page that shows these rows."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from kickdrift.display.showing import Lines, Shown, Table
from kickdrift.text import counted

PASS, FAIL = "pass", "fail"


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

    def __repr__(self) -> str:
        return str(self)

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
