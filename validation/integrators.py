"""Every integrator of the registry measured against what its row states.

    python validation/integrators.py
    python validation/integrators.py --docs docs/integrators.md     (writes the table of methods there)

Fixed steps: the slope of the error on a pendulum, Kepler's problem (e = 0.3), Henon and Heiles' problem and a driven
oscillator, each against a solution that is not kickdrift's; how far ten steps are from keeping the symplectic form;
what 1000 steps there and back leave; evaluations; and where the method blows up on oscillators and decays, against what
its coefficients say. Methods that choose their steps: the power of the tolerance that the error is proportional to.
"""

from __future__ import annotations

import math
import re
import sys
from pathlib import Path
from time import perf_counter
from typing import NamedTuple
from urllib.parse import quote

from claim import Claim, claim, main
from measures import (
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
from pages import put
from problems import SOLVED, kepler_orbit, measured, pendulum

import kickdrift as kd
from kickdrift.errors import RunError
from kickdrift.integrators import INTEGRATORS, Method, integrator
from kickdrift.integrators.registration import REGISTERED
from kickdrift.integrators.splitting import ALIASES

STABLE = 0.01  # relative
PROPORTIONAL = 0.2
FAR = 100.0  # omega dt up to which a method without a bound is tried
FIXED_TITLE = """Fixed steps: slopes of the error; largest of J^T S J - S; what 1000 steps there and back leave on the
pendulum and on Kepler's problem; stable steps from the coefficients, each with where growth is measured; evaluations of
the force per step"""
LADDER = f"{TOLERANCES[0]:g} to {TOLERANCES[-1]:g}"
ADAPTIVE_TITLE = f"Chosen steps: slopes of the error against rtol = atol, {LADDER}; stable steps from the coefficients"
BEGIN, END = "<!-- methods: validation/integrators.py --docs writes them -->", "<!-- end of methods -->"
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


# --- measuring ---


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


# --- printing ---


def text_of(bound: float | None) -> str:
    if bound is None:
        return "-"
    return "∞" if math.isinf(bound) else f"{bound:.4f}".rstrip("0").rstrip(".") if bound else "0"


def text_of_found(bound: float | None, found: float | None) -> str:
    if bound is None:
        return "-"
    return f"{found:.4f}" if found is not None else f"> {FAR:g}"


def fixed_table(names: list[str]) -> dict[str, Fixed]:
    """Measure, and print a row for each on the way."""
    widths = (19, 5, *[8] * 4, 10, *[8] * 2, *[7] * 5)
    heads = (
        "method", "order", "pendulum", "kepler", "h-heiles", "driven", "symplectic", "back: p", "back: k", "ω dt",
        "grows", "-λ dt", "grows", "evals",
    )  # fmt: skip
    line(heads, widths)
    line(["---"] * len(widths), widths)
    rows = {}
    for name in names:
        rows[name] = row = measure(name)
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
            widths,
        )  # fmt: skip
    return rows


def adaptive_table(names: list[str]) -> dict[str, list[float]]:
    """The same of those that choose their steps."""
    widths = (19, 5, *[8] * len(SOLVED), 8, 8)
    line(("method", "order", *SOLVED, "ω dt", "-λ dt"), widths)
    line(["---"] * len(widths), widths)
    rows = {}
    for name in names:
        rows[name] = [tolerance_slope(name, problem) for problem in SOLVED]
        bounds = [text_of(bound) for bound in stable_steps(integrator(name))]
        line((name, str(integrator(name).order), *(f"{s:.3f}" for s in rows[name]), *bounds), widths)
    return rows


def line(cells, widths) -> None:
    print("| " + " | ".join(text.ljust(width) for text, width in zip(cells, widths, strict=True)) + " |", flush=True)


# --- judging ---


def study(names: list[str] | None = None) -> list[Claim]:
    """Measure the methods of those names, all that ship by default, print what was found, and judge."""
    names = shipped() if names is None else [integrator(name).name for name in names]
    began = perf_counter()
    print(f"{FIXED_TITLE}\n")
    with_fixed_steps = set(fixed())
    rows = fixed_table([name for name in names if name in with_fixed_steps])
    print(f"\n{ADAPTIVE_TITLE}\n")
    tolerances = adaptive_table([name for name in names if "atol" in integrator(name).tunable])
    print(f"\n{perf_counter() - began:.0f} s\n")
    return [*fixed_claims(rows), *adaptive_claims(tolerances)]


def fixed_claims(rows: dict[str, Fixed]) -> list[Claim]:
    """Of all methods together, each with the worst."""
    if not rows:
        return []
    found: list[Claim] = []

    def worst(text: str, values: dict[str, float], bound: float, reference: str, least: bool = False) -> None:
        if values:
            name = (min if least else max)(values, key=lambda key: values[key])
            holds = values[name] > bound if least else values[name] < bound
            which = f"{'smallest' if least else 'largest'} of {len(values)}: {name}"
            bounds = f"{'over' if least else 'under'} {bound:g}"
            found.append(claim(f"{text}, {which}", values[name], bounds, holds, reference))

    def of(kind: str, is_so: bool = True) -> dict[str, Fixed]:
        return {name: row for name, row in rows.items() if getattr(integrator(name), kind) is is_so}

    order = {name: integrator(name).order for name in rows}
    solutions = "closed forms, and DOP853 at 1e-13"
    worst("slope below the order stated", {n: order[n] - min(row.slopes) for n, row in rows.items()}, ORDER, solutions)
    near = {n: sum(abs(s - order[n]) <= ORDER for s in row.slopes) for n, row in rows.items()}
    least = min(near, key=lambda name: near[name])
    text = f"problems of 4 with the order stated, to {ORDER:g}, fewest of {len(near)}: {least}"
    found.append(claim(text, near[least], "at least 2", near[least] >= 2, solutions))
    form = f"{HAIRER}, VI.2"
    worst("symplectic form", {n: row.symplecticity for n, row in of("symplectic").items()}, SYMPLECTIC, form)
    if "rk4" in rows:
        worst("symplectic form, the same step", {"rk4": rows["rk4"].symplecticity}, NOT_SYMPLECTIC, form, least=True)
    others = {n: row.symplecticity for n, row in of("symplectic", False).items()}
    worst("symplectic form, methods that do not keep it", others, SYMPLECTIC, form, least=True)
    back = {n: max(row.reversal) for n, row in of("reversible").items()}
    worst("1000 steps there and back", back, COMES_BACK, f"{HAIRER}, V.1")
    off = [n for n, row in rows.items() if not all(map(agrees, row.stable, row.blow_up))]
    text = f"methods of {len(rows)} that do not grow where their coefficients say"
    found.append(claim(text, ", ".join(off) or "none", f"none, to {STABLE:.0%}", not off, STABILITY))
    stated = {n: integrator(n).evaluations for n in rows if integrator(n).evaluations}
    off = [n for n, count in stated.items() if rows[n].evaluations != count]
    text = f"methods of {len(stated)} with other force evaluations a step than stated"
    found.append(claim(text, ", ".join(off) or "none", "none", not off, "the registry"))
    return found


def adaptive_claims(rows: dict[str, list[float]]) -> list[Claim]:
    """Of kickdrift's own methods: SciPy's steps are SciPy's business. On two problems, for on an orbit the part of the
    error that grows with time may change its sign from one tolerance to another (rosenbrock's does, near 1e-8)."""
    own = {name: slopes for name, slopes in rows.items() if integrator(name).family != "SciPy"}
    if not own:
        return []
    near = {name: sum(abs(s - 1.0) <= PROPORTIONAL for s in slopes) for name, slopes in own.items()}
    name = min(near, key=lambda key: near[key])
    power = f"problems of {len(SOLVED)} with the error as the tolerance, its power 1 to {PROPORTIONAL:g}"
    text = f"{power}, fewest of {len(near)}: {name}"
    reference = "error per step, local extrapolation: Hairer, Norsett & Wanner 1993, II.4"
    return [claim(text, near[name], "at least 2", near[name] >= 2, reference)]


# --- the page ---


def docs_table() -> str:
    """The methods that ship, as the table of docs/integrators.md."""
    aliases = {name: alias for alias, name in ALIASES.items()}
    rows = ["| name | order | evaluations | symplectic | reversible | ω dt | −λ dt | source |", "| --- " * 8 + "|"]
    for name in shipped():
        method = integrator(name)
        names = f"`{name}`" + (f", `{aliases[name]}`" if name in aliases else "")
        cells = (names, order_of(method), str(method.evaluations or "varies"), *map(mark, symmetries(method)),
                 *(text_of(bound).replace("-", "–") for bound in stable_steps(method)), source(method))  # fmt: skip
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


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


def claims(long: bool = False) -> list[Claim]:
    """All methods that ship."""
    return study()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--docs"]:
        write_docs(Path(sys.argv[2]))
    else:
        sys.exit(main(claims, __doc__))
