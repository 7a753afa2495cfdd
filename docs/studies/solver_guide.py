"""Which solver for which problem: the table of docs/which-integrator.md, from a comparison on a system for each row.

    python -m docs.studies.solver_guide [--docs docs/which-integrator.md] [--json guide.json]

Each row is `kickdrift compare SYSTEM --accuracy X`: every method over a ladder of steps or tolerances, errors against a
closed form or a reference run (of liquids: the energy's), and the cheapest that meets the error wanted. Beside it stand
the next best and what the methods that guides usually name would cost. A quarter of an hour; seconds are those of the
machine named below the table.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import NamedTuple

import kickdrift as kd
from kickdrift.analysis.compare.recommendation import Choice, Recommendation, recommendation
from kickdrift.analysis.compare.work_precision import equilibrated, work_precision
from kickdrift_validation.claim import where
from kickdrift_validation.docs_tables import put, table

BEGIN, END = "<!-- guide: docs.studies.solver_guide --docs writes it -->", "<!-- end of the guide -->"


class Problem(NamedTuple):
    """A row: a kind of problem, the system that stands for it, the error wanted, and what is compared."""

    kind: str
    system: str
    accuracy: float
    methods: tuple[str, ...]
    usual: str  # what guides name
    length: float | None = None  # default the file's
    pilot: float | None = None  # default what the time allows


PLANAR = (
    "velocity-verlet",
    "blanes-moan4",
    "yoshida6",
    "yoshida8",
    "rk4",
    "dormand-prince45",
    "dop853",
    "gauss-radau15",
)
STIFF = ("bdf", "radau", "rosenbrock", "lsoda", "dormand-prince45", "rk4")
PROBLEMS = (
    Problem(
        "games: springs and masses", "spring-net", 3e-2,
        ("euler", "symplectic-euler", "velocity-verlet", "midpoint", "rk4", "implicit-midpoint"),
        "symplectic-euler", 10.0,
    ),
    Problem(
        "planets around a star", "solar-system", 1e-6,
        ("wisdom-holman", "saba", "velocity-verlet", "blanes-moan6", "dop853", "gauss-radau15"), "wisdom-holman", 100.0,
    ),
    Problem("an eccentric orbit", "kepler-e09", 1e-6, PLANAR, "rk4", 628.0),
    Problem(
        "molecular dynamics", "lj-1000", 1e-3, ("velocity-verlet", "pefrl", "blanes-moan4", "rk4"), "velocity-verlet",
        100.0, 2.0,
    ),
    Problem("smooth, some digits", "ode-lotka-volterra", 1e-5, ("midpoint", "rk4", "bogacki-shampine23",
        "dormand-prince45", "dop853", "gauss-radau15"), "rk4"),
    Problem("high accuracy", "ode-pleiades", 1e-10, ("yoshida8", "rk4", "dormand-prince45", "dop853", "gauss-radau15"),
        "dop853"),
    Problem("stiff", "ode-robertson", 1e-4, STIFF, "bdf"),
    Problem("stiff, oscillating", "ode-van-der-pol-stiff", 1e-4, STIFF, "bdf"),
    Problem("long, Hamiltonian", "ode-pendulum", 1e-4, PLANAR, "velocity-verlet", 50_000.0, 500.0),
    Problem("teaching", "ode-harmonic", 1e-2,
        ("euler", "symplectic-euler", "midpoint", "velocity-verlet", "rk4"), "euler", 100.0),
)  # fmt: skip


def advice(problem: Problem) -> Recommendation:
    """What a comparison says of a row."""
    subject = kd.load(problem.system)
    if isinstance(subject, kd.System):
        subject = subject.watched(())
    found = work_precision(
        subject, problem.methods, problem.pilot, whole=problem.length, accuracy=problem.accuracy,
        start=equilibrated(subject, 1),
    )  # fmt: skip
    return recommendation(found, problem.accuracy)


def step(choice: Choice) -> str:
    return f"dt = {choice.dt:.2g}" if choice.dt is not None else f"rtol = {choice.rtol:.1g}"


def cells(problem: Problem, found: Recommendation) -> list[str]:
    length = f"{found.length:g}"
    first = [problem.kind, f"`{problem.system}`", f"{problem.accuracy:.0e}", length]
    if found.choice is None:
        return [*first, f"nothing: {found.refusal}", "", "", ""]
    best, others = found.choice, found.others
    costs = {choice.method: choice.seconds / best.seconds for choice in (best, *others)}
    near = ", ".join(f"`{c.method}` {costs[c.method]:.2g}" for c in others[:3]) or "none"
    usual = f"{costs[problem.usual]:.2g}" if problem.usual in costs else "not shown to get there"
    evaluations = f"{best.evaluations:.2g}"
    return [*first, f"`{best.method}`, {step(best)}", evaluations, near, f"`{problem.usual}`: {usual}"]


def main() -> None:
    """Compare, print, and write where told to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--docs", type=Path, metavar="PAGE.md", help="put the table there")
    parser.add_argument("--json", type=Path, metavar="FILE", help="every recommendation with its evidence")
    parser.add_argument("--only", metavar="SYSTEM", help="one row")
    given = parser.parse_args()
    if given.docs and given.only:
        parser.error("--only is one row, and --docs wants all")
    rows, evidence = [], {}
    for problem in PROBLEMS:
        if given.only in (None, problem.system):
            found = advice(problem)
            rows.append(cells(problem, found))
            evidence[problem.kind] = found.as_json()
            print(" | ".join(rows[-1]), *found.evidence, sep="\n    ", flush=True)
    heading = ["for", "system", "error", "over", "take", "evaluations", "the next, cost", "usually named, cost"]
    note = (
        "A cost is a wall time over the wall time of the method to take, on a busy machine. Costs below 1.2 are no "
        "difference."
    )
    text = f"{table(heading, rows)}\n\n{note} {where('numpy', 'scipy')}."
    if given.docs:
        put(given.docs, BEGIN, END, text)
    if given.json:
        given.json.write_text(json.dumps(evidence, indent=1), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
