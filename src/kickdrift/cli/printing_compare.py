"""Output of ``kickdrift compare`` on standard output."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kickdrift.cli.console import out, print_lines, print_table
from kickdrift.model.unit_systems import symbol_of
from kickdrift.text import counted, duration, measured

if TYPE_CHECKING:
    from kickdrift.analysis.ladder import Row
    from kickdrift.analysis.recommendation import Choice, Recommendation
    from kickdrift.analysis.work_precision import Comparison


def print_comparison(comparison: Comparison) -> None:
    """Print the rows, the slopes and the reference."""
    energy = comparison.measure == "energy"
    unit = measured("", symbol_of(comparison.time_unit))
    columns = ["method", "dt or rtol", "evaluations", "seconds", "error"]
    columns += [] if energy else ["energy error"]
    columns += ["error of a step"]
    body = [_cells(row, energy) for row in comparison.rows]
    print_table(f"{comparison.system}: work against precision, {comparison.length:.6g}{unit}", columns, body)
    slopes = []
    for name, (of_all, of_one) in comparison.slopes.items():
        slopes.append([name, _slope(of_all), _slope(of_one)])
    print_table("Slope against the step: p, and p + 1 for one step", ["method", "error", "error of a step"], slopes)
    lines = [
        ("error", comparison.reference if energy else f"largest of {comparison.samples} samples, relative to the "
         f"size of the motion, against {comparison.reference}"),
        ("reference", f"accurate to {comparison.reference_error:.1e}; smaller errors are not resolved"),
        *(("note", note) for note in comparison.notes),
        ("time taken", f"{duration(comparison.wall_seconds)} on {counted(comparison.threads, 'thread')}"),
    ]  # fmt: skip
    print_lines(lines)


def print_recommendation(found: Recommendation, system: str, unit: str) -> None:
    """Print the recommended method with its evidence, or the reason for a refusal."""
    unit = measured("", symbol_of(unit))
    lines = [("wanted", f"error {found.accuracy:g} over {found.length:.6g}{unit}")]
    pilot = f"{found.pilot:.6g}{unit}; the run is {found.extrapolation:.3g} times as long"
    lines.append(("pilot", pilot))
    if found.choice is None:
        lines.append(("recommended", f"nothing: {found.refusal}"))
    else:
        lines.append(("recommended", _foreseen(found.choice)))
        if found.others:
            tie = ", too close for timing to tell" if found.tie else ""
            lines.append(("next", f"{_foreseen(found.others[0])}: {found.margin:.2g} times the cost{tie}"))
        else:
            lines.append(("next", "no other method reaches this accuracy"))
    lines += [("evidence", line) for line in found.evidence]
    if found.choice is not None:
        lines.append(("to run it", f"kickdrift run {system} {found.choice.options(found.length)}"))
    out("")
    print_lines(lines)


def _foreseen(choice: Choice) -> str:
    knobs = {key: value for key in ("dt", "rtol", "atol") if (value := getattr(choice, key)) is not None}
    knob = ", ".join(f"{key} = {value:.4g}" for key, value in knobs.items())
    took = f"{choice.seconds:.2g} s" if choice.seconds < 90 else duration(choice.seconds)
    return f"{choice.method}, {knob}: {took}, {choice.evaluations:.3g} evaluations, expected error {choice.error:.1e}"


def _cells(row: Row, energy: bool) -> list[str]:
    knob = f"{row.dt:.4g}" if row.dt is not None else f"{row.rtol:.0e}"
    if row.failure:
        took = f"{row.seconds:.2g}" if row.seconds else "–"
        return [row.method, knob, "–", took, row.failure[:60], *([] if energy else ["–"]), "–"]
    error = f"{row.error:.2e}" if row.believed else f"{row.error:.0e} (of the reference)"
    others = [] if energy else ["–" if row.energy_error is None else f"{row.energy_error:.1e}"]
    local = "–" if row.local_error is None else f"{row.local_error:.1e}"
    return [row.method, knob, f"{row.evaluations:,}", f"{row.seconds:.2g}", error, *others, local]


def _slope(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
