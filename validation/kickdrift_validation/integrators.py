"""Every integrator of the registry measured against what its row states.

    python -m kickdrift_validation.integrators
    python -m kickdrift_validation.integrators --docs docs/integrators.md     (writes the table of methods there)

Fixed steps: the slope of the error on a pendulum, Kepler's problem (e = 0.3), Henon and Heiles' problem and a driven
oscillator, each against a solution that is not kickdrift's; how far ten steps are from keeping the symplectic form;
what 1000 steps there and back leave; evaluations; and where the method blows up on oscillators and decays, against what
its coefficients say. Methods that choose their steps: the power of the tolerance that the error is proportional to.
"""

import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import kickdrift as kd
from kickdrift.errors import RunError
from kickdrift.integrators import INTEGRATORS, Method, integrator
from kickdrift.integrators.own.registration import REGISTERED
from kickdrift.integrators.splitting import constant_temperature as baths
from kickdrift.integrators.splitting.method import ALIASES, RESPA
from kickdrift_validation.claim import Claim, claim, main, under
from kickdrift_validation.docs_tables import put, table
from kickdrift_validation.measures import (
    COMES_BACK,
    NOT_SYMPLECTIC,
    ORDER,
    SYMPLECTIC,
    TOLERANCES,
    evaluations,
    first_blow_up,
    fixed,
    reversal_error,
    slope,
    stable_steps,
    symplecticity_error,
    tolerance_slope,
)
from kickdrift_validation.problems import SOLVED, kepler_orbit, measured, pendulum
from kickdrift_validation.registry import SCRIPTS

# Methods that take particles alone, or steps of their own making, each in a script of its own.
ELSEWHERE = {
    "leapfrog-exact": "exact-reversal", "leapfrog-adaptive": "adaptive-leapfrog", "hermite4": "hermite",
    "leapfrog-block": "cluster-results",
    "wisdom-holman": "wisdom-holman", "saba": "wisdom-holman", "trace": "trace", "gauss-radau15": "gauss-radau",
    "sei": "shearing-sheet", "eos": "embedded-splitting", "event-driven": "hard-spheres",
    **{row.name: "heat-baths" for row in baths.ROWS}, **{row.name: "multiple-time-steps" for row in RESPA},
}  # fmt: skip
STABLE = 0.01  # relative
PROPORTIONAL = 0.2
FAR = 100.0  # omega dt up to which a method without a bound is tried
FIXED_TITLE = """Fixed steps: slopes of the error; largest of J^T S J - S; what 1000 steps there and back leave on the
pendulum and on Kepler's problem; stable steps from the coefficients, each with where growth is measured; evaluations of
the force per step"""
FIXED_WIDTHS = (19, 5, *[8] * 4, 10, *[8] * 2, *[7] * 5)
FIXED_HEADS = (
    "method", "order", "pendulum", "kepler", "h-heiles", "driven", "symplectic", "back: p", "back: k", "ω dt", "grows",
    "-λ dt", "grows", "evals",
)  # fmt: skip
LADDER = f"{TOLERANCES[0]:g} to {TOLERANCES[-1]:g}"
ADAPTIVE_TITLE = f"Chosen steps: slopes of the error against rtol = atol, {LADDER}; stable steps from the coefficients"
ADAPTIVE_WIDTHS = (19, 5, *[8] * len(SOLVED), 8, 8)
BEGIN, END = "<!-- methods: kickdrift_validation.integrators --docs writes them -->", "<!-- end of methods -->"
HAIRER = "Hairer, Lubich & Wanner 2006, doi:10.1007/3-540-30666-8"
STABILITY = "Hairer & Wanner 1996, IV.2; Blanes, Casas & Murua 2008"


def shipped() -> list[str]:
    """The methods that come with kickdrift, without aliases."""
    return [name for name, method in INTEGRATORS.items() if method.name == name and name not in REGISTERED]


class Fixed(NamedTuple):
    """What was found of a method of fixed steps."""

    slopes: list[float]
    symplecticity: float
    reversal: list[float]
    stable: tuple[float | None, float | None]
    blow_up: tuple[float | None, float | None]
    evaluations: float


def measure(name: str) -> Fixed:
    return Fixed(
        [slope(name, problem) for problem in measured()],
        symplecticity_error(name),
        [there_and_back(name, subject()) for subject in (pendulum, kepler_orbit)],
        stable_steps(integrator(name)),
        blow_up(name),
        evaluations(name, pendulum())[0],
    )


def there_and_back(name: str, problem: kd.Problem) -> float:
    """What 1000 steps and back leave; infinite where the method does not get there (backward-euler falls into the
    centre)."""
    try:
        return reversal_error(name, problem, 0.02, 1000)
    except RunError:
        return math.inf


def blow_up(name: str) -> tuple[float | None, float | None]:
    """The smallest omega dt of an oscillator, and -lambda dt of a decay, that grows; None where none does, or where the
    method does not run it. What is stable may swing, and Runge-Kutta steps below their bounds multiply the size by less
    than 1: the former must grow 10^4 times, the latter at all."""
    method = integrator(name)
    oscillator, decay = stable_steps(method)
    if oscillator is None:
        return None, None
    if decay is None:
        # coarsely all over, and long where the growth sets in: at a resonance the gap is narrow and the growth slow
        ranges = ((2000, (0.02, 1.05, 516)), (60_000, (0.99, 1.01, 401)))
        tried = [first_blow_up(name, oscillator, steps, 1e4, rates=rates) for steps, rates in ranges]
        return min((found for found in tried if found is not None), default=None), None
    return _grows(name, oscillator, decaying=False), _grows(name, decay, decaying=True)


def _grows(name: str, bound: float, decaying: bool) -> float | None:
    if math.isinf(bound):  # few, since implicit methods solve for all at once
        dt, rates = 1.0, (0.5, FAR, 20)
    else:
        dt, rates = bound or 1.0, (0.02, 1.05, 516)
    return first_blow_up(name, dt, 500, 1.0 + 1e-9, rates=rates, decaying=decaying)


def agrees(bound: float | None, found: float | None) -> bool:
    """Whether a method grows just beyond the bound; at once, where that is 0, and never, where it is infinite."""
    if bound is None or math.isinf(bound):
        return found is None
    if bound == 0.0:
        return found == 0.02
    return found is not None and abs(found / bound - 1.0) <= STABLE


def text_of(bound: float | None) -> str:
    if bound is None:
        return "-"
    return "∞" if math.isinf(bound) else f"{bound:.4f}".rstrip("0").rstrip(".") if bound else "0"


def text_of_found(bound: float | None, found: float | None) -> str:
    if bound is None:
        return "-"
    return f"{found:.4f}" if found is not None else f"> {FAR:g}"


def fixed_row(name: str, row: Fixed) -> None:
    """Print what was found of a method."""
    bounds = [
        text
        for bound, found in zip(row.stable, row.blow_up, strict=True)
        for text in (text_of(bound), text_of_found(bound, found))
    ]
    line(
        (
            name, str(integrator(name).order), *(f"{s:.3f}" for s in row.slopes), f"{row.symplecticity:.1e}",
            *(f"{e:.1e}" for e in row.reversal), *bounds, f"{row.evaluations:g}",
        ),
        FIXED_WIDTHS,
    )  # fmt: skip


def adaptive_row(name: str, slopes: list[float]) -> None:
    """The same of one that chooses its steps."""
    bounds = [text_of(bound) for bound in stable_steps(integrator(name))]
    line((name, str(integrator(name).order), *(f"{s:.3f}" for s in slopes), *bounds), ADAPTIVE_WIDTHS)


def heads(title: str, names: tuple[str, ...], widths: tuple[int, ...]) -> None:
    print(f"\n{title}\n")
    line(names, widths)
    line(["---"] * len(widths), widths)


def line(cells, widths) -> None:
    print("| " + " | ".join(text.ljust(width) for text, width in zip(cells, widths, strict=True)) + " |", flush=True)


def study(names: list[str] | None = None) -> Iterator[Claim]:
    """Measure the methods of those names, all that ship by default, print what was found, and judge."""
    names = shipped() if names is None else [integrator(name).name for name in names]
    heads(FIXED_TITLE, FIXED_HEADS, FIXED_WIDTHS)
    with_fixed_steps = set(fixed())
    for name in names:
        if name in with_fixed_steps:
            row = measure(name)
            fixed_row(name, row)
            yield from fixed_claims(name, row)
    heads(ADAPTIVE_TITLE, ("method", "order", *SOLVED, "ω dt", "-λ dt"), ADAPTIVE_WIDTHS)
    for name in names:
        if "atol" in integrator(name).tunable:
            slopes = [tolerance_slope(name, problem) for problem in SOLVED]
            adaptive_row(name, slopes)
            yield from adaptive_claims(name, slopes)


def fixed_claims(name: str, row: Fixed) -> Iterator[Claim]:
    """Claims on a method with fixed steps."""
    method = integrator(name)
    found, order = ", ".join(f"{s:.3f}" for s in row.slopes), method.order
    near = sum(abs(s - order) <= ORDER for s in row.slopes)
    bound = f"over {order - ORDER:g}, two within {ORDER:g}"
    text = f"{name}: order {order}: slopes of the error on pendulum, Kepler, Henon-Heiles, driven"
    yield claim(text, found, bound, min(row.slopes) > order - ORDER and near >= 2, "closed forms, and DOP853 at 1e-13")
    form, size = f"{HAIRER}, VI.2", row.symplecticity
    if method.symplectic:
        yield under(f"{name}: symplectic: ten steps leave of the form", size, SYMPLECTIC, form)
    else:
        least = NOT_SYMPLECTIC if name == "rk4" else SYMPLECTIC
        yield claim(f"{name}: not symplectic: ten steps leave of the form", size, f"over {least:g}", size > least, form)
    if method.reversible:
        text, back = f"{name}: reversible: 1000 steps there and back leave", max(row.reversal)
        yield under(text, back, COMES_BACK, f"{HAIRER}, V.1")
    bounds = list(zip(row.stable, row.blow_up, strict=True))
    grows = " and ".join(text_of_found(*pair) for pair in bounds)
    wanted = f"{' and '.join(text_of(bound) for bound, _ in bounds)}, to {STABLE:.0%}"
    text = f"{name}: grows from ω dt and -λ dt of"
    yield claim(text, grows, wanted, all(agrees(*pair) for pair in bounds), f"its coefficients; {STABILITY}")
    if method.evaluations:
        text, count = f"{name}: force evaluations a step", row.evaluations
        yield claim(text, count, f"{method.evaluations}", count == method.evaluations, "the registry")


def adaptive_claims(name: str, slopes: list[float]) -> Iterator[Claim]:
    """Claims on kickdrift's own methods; SciPy chooses its steps itself. There are two problems: on an orbit, the part
    of the error that grows with time may change its sign from one tolerance to another (rosenbrock's does, near
    1e-8)."""
    if integrator(name).family != "SciPy":
        near = sum(abs(s - 1.0) <= PROPORTIONAL for s in slopes)
        text = f"{name}: powers of the tolerance that the error grows with, on {', '.join(SOLVED)}"
        value, bound = ", ".join(f"{s:.3f}" for s in slopes), f"1 to {PROPORTIONAL:g}, on two or more"
        reference = "error per step, local extrapolation: Hairer, Norsett & Wanner 1993, II.4"
        yield claim(text, value, bound, near >= 2, reference)


def coverage() -> Claim:
    """That no method of the registry is left out."""
    here = {name for name in shipped() if name in fixed() or "atol" in integrator(name).tunable}
    names = {script.name for script in SCRIPTS}
    left = [name for name in shipped() if name not in here and ELSEWHERE.get(name) not in names]
    text = f"methods of {len(shipped())} that no script measures; elsewhere {', '.join(sorted(ELSEWHERE))}"
    return claim(text, ", ".join(left) or "none", "none", not left, "the registry")


def docs_table() -> str:
    """The methods that ship, as the table of docs/integrators.md."""
    aliases = {name: alias for alias, name in (ALIASES | baths.ALIASES).items()}
    rows = []
    for name in shipped():
        method = integrator(name)
        names = f"`{name}`" + (f", `{aliases[name]}`" if name in aliases else "")
        bounds = (text_of(bound).replace("-", "–") for bound in stable_steps(method))
        evaluations = str(method.evaluations or "varies")
        rows.append([names, order_of(method), evaluations, *map(mark, symmetries(method)), *bounds, source(method)])
    return table(["name", "order", "evaluations", "symplectic", "reversible", "ω dt", "−λ dt", "source"], rows)


def order_of(method: Method) -> str:
    return f"{method.order}, adaptive" if method.adaptive else str(method.order)


def symmetries(method: Method) -> tuple[bool, bool]:
    return method.symplectic, method.reversible


def mark(holds: bool) -> str:
    return "yes" if holds else "no"


def source(method: Method) -> str:
    """Where it was published, its DOIs as links."""
    return re.sub(r"doi:(\S+?)(?=[,;]?(\s|$))", linked, method.source)


def linked(doi: re.Match[str]) -> str:
    return f"[doi:{doi[1]}](https://doi.org/{quote(doi[1])})"


def write_docs(page: Path) -> None:
    """Put the table between its markers."""
    put(page, BEGIN, END, docs_table())


def claims(long: bool = False) -> Iterator[Claim]:
    yield coverage()
    yield from study()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--docs"]:
        write_docs(Path(sys.argv[2]))
    else:
        main(claims, __doc__)
