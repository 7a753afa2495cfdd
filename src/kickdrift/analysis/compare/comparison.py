"""The results of a comparison of integrators: their errors and what these cost."""

from __future__ import annotations

import platform
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from kickdrift.analysis.compare.bench import processor
from kickdrift.analysis.compare.choices import Recommendation
from kickdrift.analysis.compare.ladder import Row
from kickdrift.display.showing import Lines, Shown, Table, above
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.text import counted, duration, measured

_OTHERWISE = ("rows", "slopes", "recommendation", "begin", "asked")  # not as they are in the JSON object


def versions() -> dict[str, str]:
    """Versions of kickdrift, of Python and of the libraries under a comparison."""
    found = {name: version(name) for name in ("kickdrift", "numpy", "numba", "scipy")}
    return found | {"python": platform.python_version()}


class Compared(Shown):
    """Results by method that print as tables; ``rows`` holds a row for each method and step."""

    rows: tuple[Any, ...]
    recommendation: Any  # a Recommendation or None
    time_unit: str
    begin: float
    asked: str

    def __repr__(self) -> str:
        return str(self)

    @property
    def methods(self) -> list[str]:
        """Names of the methods, in the order of the rows."""
        return list(dict.fromkeys(row.method for row in self.rows))

    def _advice(self) -> Lines:
        """The recommendation and the command or call that runs it, after an empty line; nothing without one."""
        found = self.recommendation
        if found is None:
            return []
        to_run = ""
        if found.choice is not None:
            command = f"kickdrift run {self.asked} {found.choice.options(found.length)}"
            to_run = command if self.asked else found.choice.call(self.begin + found.length)
        return [("", ""), *found.lines(self.time_unit, to_run)]


@dataclass(frozen=True, repr=False)
class Comparison(Compared):
    """Results for a System or Problem.

    Attributes
    ----------
    system : name of the subject
    measure : "closed form", "reference" or "energy"
    reference : the measure in words
    reference_error : error of the reference, and the smallest error that counts
    lyapunov : rate at which neighbouring solutions part, 0 for solutions that do not part exponentially
    length : length of the pilot runs, in the system's unit of time
    whole : length of the intended run
    cycles : number of cycles of the solution in the pilot run; 0 for a solution that does not return
    samples : number of times at which the error is measured
    rows : by method, from coarse to fine
    slopes : of the global and the local error against the step, by method; None if too few points show a slope
    notes : remarks on the choices, for the user
    recommendation : the cheapest method for the wanted accuracy, or the reason for none; None without an accuracy

    ``print(comparison)`` shows what the command line prints, and ``as_json()`` returns what ``--json`` writes.
    """

    system: str
    measure: str
    reference: str
    reference_error: float
    lyapunov: float
    length: float
    whole: float
    cycles: float
    samples: int
    time_unit: str
    threads: int
    rows: tuple[Row, ...]
    slopes: dict[str, tuple[float | None, float | None]]
    notes: tuple[str, ...] = ()
    wall_seconds: float = field(default=0.0, compare=False)
    recommendation: Recommendation | None = None
    begin: float = 0.0  # time at the start
    asked: str = ""  # what the command line calls the subject; "" for an object in Python

    def of(self, method: str) -> list[Row]:
        """Rows of a method, from coarse to fine."""
        return [row for row in self.rows if row.method == method]

    def as_json(self) -> dict[str, Any]:
        """The comparison as one JSON object, with versions and processor."""
        return {
            **{key: value for key, value in vars(self).items() if key not in _OTHERWISE},
            "versions": versions(),
            "processor": processor(),
            "slopes": {name: {"global": pair[0], "local": pair[1]} for name, pair in self.slopes.items()},
            "rows": [row.as_json() for row in self.rows],
            "recommendation": self.recommendation and self.recommendation.as_json(),
        }

    def plot(self) -> Any:
        """Draw the error of each method against force evaluations and against seconds; a matplotlib Figure.

        An InputError if every run failed."""
        return above("comparison figure")(self)

    def _tables(self) -> list[Table]:
        energy = self.measure == "energy"
        unit = measured("", symbol_of(self.time_unit))
        columns = ["method", "dt or rtol", "evaluations", "seconds"]
        columns += [] if energy else ["energy error"]
        columns += ["step error", "error"]
        rows = [_cells(row, energy) for row in self.rows]
        slopes = [[name, _slope(of_all), _slope(of_one)] for name, (of_all, of_one) in self.slopes.items()]
        return [
            (f"{self.system}: work against precision, {self.length:.6g}{unit}", columns, rows),
            (
                "Slope against the step: p, and p + 1 for one step",
                ["method", "error", "step error"],
                slopes,
            ),
        ]

    def _lines(self) -> Lines:
        lines = [
            (
                "error",
                self.reference
                if self.measure == "energy"
                else f"largest of {self.samples} samples, relative to the size of the motion, against {self.reference}",
            ),
            ("reference", f"accurate to {self.reference_error:.1e}; smaller errors are not resolved"),
            *(("note", note) for note in self.notes),
            ("time taken", f"{duration(self.wall_seconds)} on {counted(self.threads, 'thread')}"),
        ]
        return [*lines, *self._advice()]


def _cells(row: Row, energy: bool) -> list[str]:
    knob = f"{row.dt:.4g}" if row.dt is not None else f"{row.rtol:.0e}"
    if row.failure:
        took = f"{row.seconds:.2g}" if row.seconds else "–"
        return [row.method, knob, "–", took, *([] if energy else ["–"]), "–", row.failure]
    error = f"{row.error:.2e}" if row.believed else f"{row.error:.0e} (of the reference)"
    others = [] if energy else ["–" if row.energy_error is None else f"{row.energy_error:.1e}"]
    local = "–" if row.local_error is None else f"{row.local_error:.1e}"
    return [row.method, knob, f"{row.evaluations:,}", f"{row.seconds:.2g}", *others, local, error]


def _slope(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
