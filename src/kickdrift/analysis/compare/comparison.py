"""The results of a comparison of integrators: their errors, what these cost, and the recommendation."""

from __future__ import annotations

import platform
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from kickdrift.analysis.compare.bench import processor
from kickdrift.analysis.compare.ladder import Row
from kickdrift.display.showing import Lines, Shown, Table, above
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.text import counted, duration, measured

SAFETY = 2.0  # the error foreseen is to stay below the wanted one by that factor
TIE = 1.2  # costs closer than that are the same, for all that timing can tell
_OTHERWISE = ("rows", "slopes", "recommendation", "begin", "asked")  # not as they are in the JSON object


@dataclass(frozen=True)
class Choice:
    """A method with the step or tolerance that meets the wanted accuracy.

    Attributes
    ----------
    method, dt, steps, rtol, atol : what to run (see `Row`); dt divides the length
    error : foreseen at the end of the run, the safety factor not in it
    evaluations, seconds : foreseen for the whole run
    """

    method: str
    dt: float | None
    steps: int | None
    rtol: float | None
    atol: float | None
    error: float
    evaluations: float
    seconds: float

    @property
    def foreseen(self) -> str:
        """The method with its knob, its cost and its error, in words."""
        knobs = {key: value for key in ("dt", "rtol", "atol") if (value := getattr(self, key)) is not None}
        knob = ", ".join(f"{key} = {value:.4g}" for key, value in knobs.items())
        took = f"{self.seconds:.2g} s" if self.seconds < 90 else duration(self.seconds)
        return f"{self.method}, {knob}: {took}, {self.evaluations:.3g} evaluations, expected error {self.error:.1e}"

    def call(self, until: float) -> str:
        """As a Simulation takes it in Python."""
        name, *pairs = self.method.split(" -o ")
        knobs = {key: value for key in ("dt", "rtol", "atol") if (value := getattr(self, key)) is not None}
        said = [repr(name), *(f"{key}={value!r}" for key, value in knobs.items()), *pairs]
        return f"kd.Simulation(system, {', '.join(said)}).run({self.steps or f'until={until!r}'})"

    def options(self, length: float) -> str:
        """As ``kickdrift run`` takes it."""
        if self.dt is not None:
            end = f"--steps {self.steps}" if self.steps else f"--time {length!r}"
            return f"--integrator {self.method} --dt {self.dt!r} {end}"
        absolute = "" if self.atol is None else f" --atol {self.atol:g}"
        return f"--integrator {self.method} --rtol {self.rtol:g}{absolute} --time {length!r}"


@dataclass(frozen=True)
class Recommendation:
    """A recommended method and step, or the reason for none. Nothing switches by itself.

    Attributes
    ----------
    accuracy, length : wanted
    choice : the cheapest, None where nothing is recommended
    others : the other methods that meet the accuracy, from cheap to dear
    refusal : why there is no choice
    margin : how many times the cheapest the next one costs; None where there is no other
    pilot, extrapolation : length of the pilot, and how many times that the run is
    evidence : one line on each method that is out, and what the choice rests on
    """

    accuracy: float
    length: float
    pilot: float
    extrapolation: float
    choice: Choice | None
    others: tuple[Choice, ...]
    refusal: str | None
    evidence: tuple[str, ...]

    @property
    def margin(self) -> float | None:
        if self.choice is None or not self.others:
            return None
        return self.others[0].seconds / self.choice.seconds

    @property
    def tie(self) -> bool:
        """Whether timing cannot tell the first two apart."""
        return self.margin is not None and self.margin < TIE

    def lines(self, time_unit: str, to_run: str) -> Lines:
        """The recommended method with its evidence, or the reason for a refusal; ``to_run`` runs the choice."""
        unit = measured("", symbol_of(time_unit))
        lines = [
            ("wanted", f"error {self.accuracy:g} over {self.length:.6g}{unit}"),
            ("pilot", f"{self.pilot:.6g}{unit}; the run is {self.extrapolation:.3g} times as long"),
        ]
        if self.choice is None:
            lines.append(("recommended", f"nothing: {self.refusal}"))
        else:
            lines.append(("recommended", self.choice.foreseen))
            if self.others:
                tie = ", too close for timing to tell" if self.tie else ""
                lines.append(("next", f"{self.others[0].foreseen}: {self.margin:.2g} times the cost{tie}"))
            else:
                lines.append(("next", "no other method reaches this accuracy"))
        lines += [("evidence", line) for line in self.evidence]
        if self.choice is not None:
            lines.append(("to run it", to_run))
        return lines

    def as_json(self) -> dict[str, Any]:
        """In plain numbers."""
        return {
            **vars(self),
            "choice": vars(self.choice) if self.choice else None,
            "others": [vars(other) for other in self.others],
            "margin": self.margin,
            "safety": SAFETY,
        }


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
