"""A recommended method with its step or tolerance, and what the recommendation rests on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from kickdrift.display.showing import Lines
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.text import duration, measured

SAFETY = 2.0  # the error foreseen is to stay below the wanted one by that factor
TIE = 1.2  # costs closer than that are the same, for all that timing can tell


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
