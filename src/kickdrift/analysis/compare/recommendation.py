"""Cheapest integrator and step for a wanted accuracy and length, by the evidence of a comparison; or the reason why the
comparison cannot tell."""

from collections.abc import Sequence
from math import ceil, exp, floor, isfinite, log, log10
from statistics import median

from kickdrift.analysis.compare.comparison import SAFETY as SAFETY
from kickdrift.analysis.compare.comparison import Choice as Choice
from kickdrift.analysis.compare.comparison import Comparison
from kickdrift.analysis.compare.comparison import Recommendation as Recommendation
from kickdrift.analysis.compare.ladder import Row
from kickdrift.errors import InputError
from kickdrift.integrators import INTEGRATORS
from kickdrift.statistics.drift import SURE

FARTHEST = 1000.0  # times the pilot's length; errors that grow as a measured power are trusted no farther
CYCLES = 5.0  # of the solution that a pilot must have seen, to say what later ones do
UNRESOLVED = 0.5  # standard error of a growth exponent
ASYMPTOTIC = 0.1  # relative errors above it do not follow their power of the step


def recommendation(comparison: Comparison, accuracy: float, length: float | None = None) -> Recommendation:
    """Cheapest method and step whose error stays below half the ``accuracy`` at ``length``.

    The error is measured in the pilot and extrapolated to ``length`` by its measured growth.

    Parameters
    ----------
    comparison : result of ``work_precision``
    accuracy : wanted relative error, in the comparison's measure
    length : length of the run; default the comparison's intended length

    Raises
    ------
    InputError
        If accuracy or length are not positive finite numbers.
    """
    length = comparison.whole if length is None else length
    for key, value in (("accuracy", accuracy), ("length", length)):
        if not (isfinite(value) and value > 0):
            raise InputError(f"{key} must be a positive finite number, got {value!r}")
    ratio = length / comparison.length
    said: list[str] = []
    choices: list[Choice] = []
    refusal = _refusal(comparison, accuracy, ratio)
    if refusal is None:
        for name in comparison.methods:
            found = _choice(comparison.of(name), accuracy, length, ratio, comparison.reference_error)
            if isinstance(found, str):
                said.append(f"{name}: {found}")
            else:
                choices.append(found)
        choices.sort(key=lambda choice: choice.seconds)
        if not choices:
            refusal = _none_left(said)
    best = choices[0] if choices else None
    if best is not None:
        said.insert(0, _rests_on(comparison, best, ratio))
    return Recommendation(accuracy, length, comparison.length, ratio, best, tuple(choices[1:]), refusal, tuple(said))


def _refusal(comparison: Comparison, accuracy: float, ratio: float) -> str | None:
    """Reason why no method at all can be recommended, or None."""
    pilot = f"the pilot of {comparison.length:.4g}"
    if accuracy < SAFETY * comparison.reference_error:
        return (
            f"the wanted accuracy of {accuracy:g} is below the limit of the reference ({comparison.reference}), "
            f"{SAFETY * comparison.reference_error:.2g}"
        )
    if ratio <= 1.0 + 1e-9:
        return None
    if ratio > FARTHEST:
        return f"{pilot} is too short: the run is {ratio:.3g} times as long, and the limit is {FARTHEST:g} times"
    if comparison.measure != "energy" and comparison.lyapunov > 0:
        return (
            f"chaos: neighbouring solutions diverge as exp({comparison.lyapunov:.2g} t), so {pilot} cannot predict "
            "later positions"
        )
    if comparison.cycles < CYCLES:
        seen = f"{comparison.cycles:g} cycles" if comparison.cycles else "no cycle"
        return (
            f"{pilot} is too short: it covers {seen} of the solution, and {CYCLES:g} cycles are needed to predict the "
            "growth of errors"
        )
    return None


def _none_left(said: Sequence[str]) -> str:
    short = [line for line in said if "too short" in line]
    if short:
        return f"the pilot is too short to tell: {short[0]}"
    return "no method reaches the wanted accuracy at that length on its ladder"


def _choice(rows: list[Row], accuracy: float, length: float, ratio: float, hidden: float) -> Choice | str:
    """Coarsest step or tolerance of a method that meets the accuracy; else the reason why there is none.

    An error below the reference's own is uncertain by at most ``hidden``, the reference's own error. It is assumed to
    grow like the last error that was measured."""
    foreseen: list[tuple[Row, float]] = []
    unknown = 0
    growth = 1.0 if ratio <= 1.0 else None
    for row in rows:
        if row.error is None or row.error > ASYMPTOTIC:
            continue
        if not row.believed:
            if growth is not None:
                foreseen.append((row, (row.error + hidden) * growth))
            continue
        factor = growth = _factor(row, ratio, length)
        if factor is None:
            unknown += 1
        else:
            foreseen.append((row, row.error * factor))
    if not foreseen:
        if unknown:
            return "the pilot is too short to measure the growth of its error"
        return "no run with an error above the reference's own and below 0.1"
    target = accuracy / SAFETY
    best = min(range(len(foreseen)), key=lambda k: foreseen[k][1])  # finer rows may show only rounding
    if foreseen[best][1] > target:
        return f"reaches {foreseen[best][1]:.2g} at that length, not {target:.2g}" + (
            "; the pilot is too short to predict finer runs" if unknown else ""
        )
    good = best  # all rows from the coarsest good row on meet the target
    while good and foreseen[good - 1][1] <= target:
        good -= 1
    row, error = foreseen[good]
    knob, cost = _knob(row), float(row.evaluations)
    if good:
        coarse, its_error = foreseen[good - 1]
        part = log(target / error) / log(its_error / error) if its_error > error else 0.0
        knob *= exp(part * log(_knob(coarse) / knob))
        cost *= exp(part * log(coarse.evaluations / cost))
        error = target
    seconds = median(r.seconds / r.evaluations for r, _ in foreseen)
    cost *= ratio
    if row.dt is not None:
        method = INTEGRATORS.get(row.method.split()[0])
        if method and method.chooses_steps:  # dt is the first step
            return Choice(row.method, float(f"{knob:.3g}"), None, None, None, error, cost, cost * seconds)
        steps = ceil(length / knob * (1 - 1e-12))
        return Choice(row.method, length / steps, steps, None, None, error, cost, cost * seconds)
    assert row.rtol is not None
    digits = 1 - floor(log10(knob))
    rtol = floor(knob * 10**digits) / 10**digits
    atol = None if row.atol is None else float(f"{row.atol * rtol / row.rtol:.3g}")
    return Choice(row.method, None, None, rtol, atol, error, cost, cost * seconds)


def _knob(row: Row) -> float:
    knob = row.dt if row.dt is not None else row.rtol
    assert knob is not None
    return knob


def _factor(row: Row, ratio: float, length: float) -> float | None:
    """Factor by which the error grows; None if its growth is not resolved."""
    if row.growth is None or row.error is None:
        return None
    if ratio > 1.0 and (row.growth.exponent_error or 0.0) > UNRESOLVED:
        return None
    return row.growth.factor(row.error, max(ratio, 1.0), length)


def _rests_on(comparison: Comparison, choice: Choice, ratio: float) -> str:
    measured = [row for row in comparison.of(choice.method) if row.error is not None]
    rows = [row for row in measured if row.believed] or measured
    nearest = min(rows, key=lambda row: abs(log(_knob(row) / (choice.dt or choice.rtol or 1.0))))
    known = f"pilot at {'dt' if choice.dt else 'rtol'} = {_knob(nearest):.3g}: error {nearest.error:.2g}"
    growth = nearest.growth
    if ratio <= 1.0 or growth is None:
        return f"{choice.method}: {known}; no extrapolation in time"
    if growth.drift is not None:
        return f"{choice.method}: {known}, energy {growth.verdict}, drift at most {growth.drift:.2g} per unit of time"
    exponent, error = growth.exponent or 0.0, growth.exponent_error or 0.0
    return f"{choice.method}: {known}, growing as t^({exponent:.2f} ± {SURE * error:.2f})"
