"""Predicted and measured speeds of the groups of `kickdrift bench speed` that are not among the usual ones.

    python -m docs.studies.predictions [--from FILE.json] [--page docs/roofline.md]

The predictions follow from the step budget of one thread, from counted operations and from bytes. They were written
before the measurement beside which the table shows them, but earlier measurements of most groups were known. With
``--from`` the measured numbers come from a file that `kickdrift bench speed --json` wrote. Otherwise the script
measures these groups.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any, NamedTuple

from kickdrift_validation.docs_tables import deliver, outputs, table
from kickdrift_validation.performance.groups import Goal
from kickdrift_validation.performance.speed import chosen, judged, measure

BEGIN, END = "<!-- predictions.py writes from here -->", "<!-- predictions.py: to here -->"


class Prediction(NamedTuple):
    """A predicted ratio of the speeds of two rows of a group, and its reasons."""

    group: str
    against: str
    ratio: float
    reason: str
    ours: str = "kickdrift"


# Budgets are those of step_budget.py on one thread of a Zen 5, in ns a particle and step: 61.5 at 1000 particles, 70.7
# at 10,648, 101 at 97,336. Forces take 36.3, 40.4 and 63.1 of these, prunings 13.8, 11.3 and 13.8.
PREDICTIONS = (
    Prediction(
        "lj-1000000", "LAMMPS", 4.4,
        "its arrays of 210 MB exceed the last cache. 540 bytes a particle at 10 bytes/ns are 54 ns. If arithmetic "
        "hides half, a step costs 128 ns and not 101. LAMMPS loses a tenth: 5.1 at 97,336 particles × 101 / 128 × 1.1",
    ),
    Prediction(
        "lj-1000-threads", "kickdrift, 1 thread", 1.76,
        "4.7 of 61.5 ns are serial: sweeps 1.2, the rest between the parts. 4.5 tasks cost 0.4 µs each, or 1.8 ns a "
        "particle: 61.5 / (4.7 + 28.4 + 1.8)",
    ),
    Prediction(
        "lj-10000-threads", "kickdrift, 1 thread", 1.93,
        "2.1 of 70.7 ns are serial: sweeps and the sums of the search. Tasks cost 0.2 ns: 70.7 / (2.1 + 34.3 + 0.2)",
    ),
    Prediction(
        "lj-100000-threads", "kickdrift, 1 thread", 1.97,
        "0.5 of 101 ns are serial; a chunk of eight that is late costs 1 %: 101 / (0.5 + 50.3 + 0.5)",
    ),
    Prediction(
        "lj-1000000-threads", "kickdrift, 1 thread", 1.9,
        "540 bytes in 64 ns are 8.4 bytes/ns of 13 that the memory gives: no bound, but loads wait for one another",
    ),
    Prediction(
        "lj-1000-mixed", "kickdrift", 1.56,
        "6.3 tiles of 2.7 ns and 5 ns of row ends replace 36.3 ns, prunings take 6 ns and not 13.8: 61.5 / 39.4",
        "kickdrift mixed",
    ),
    Prediction(
        "lj-100000-mixed", "kickdrift", 1.28,
        "the same 22 ns less, since 27 of the 63 ns of the forces wait for the last cache: 101 / 79",
        "kickdrift mixed",
    ),
    Prediction(
        "plummer-100000", "kickdrift, 1 thread", 1.95,
        "0.01 of 2.3 µs a body is serial, and tasks of 64 chunks end half a chunk apart: 2.3 / (0.01 + 1.145 + 0.02)",
    ),
    Prediction(
        "plummer-100000", "rebound tree", 13.0,
        "at 1e-3 a body meets 1800 nodes and bodies of 0.65 ns, and 2.3 µs in all; at 1e-2 two thirds of that, on two "
        "threads 0.77 µs. rebound walks some 1000 nodes of 10 ns for each body",
    ),
    Prediction(
        "batch-2", "rebound whfast512", 1.6,
        "lanes are full in both. WHFast512 has one chain of 400 cycles; two planets are two chains that wait less",
    ),
    Prediction("batch-3", "rebound whfast512", 2.4, "three chains, and WHFast512 fills 6 of 8 lanes: 1.8 × 8 / 6"),
    Prediction("batch-4", "rebound whfast512", 1.9, "four chains; WHFast512's lanes are full"),
    Prediction(
        "batch-8", "rebound whfast512", 1.8,
        "eight chains: arithmetic of 190 cycles a step, where one chain takes 400. The states exceed the registers",
    ),
)  # fmt: skip


def groups() -> list[str]:
    """Names of the groups with a prediction."""
    return list(dict.fromkeys(each.group for each in PREDICTIONS))


def rows(found: dict[str, Any]) -> list[list[str]]:
    """Rows of the table; ``found`` is what `bench speed --json` writes."""
    there = {group["name"]: group for group in found["groups"]}
    listed = []
    for each in PREDICTIONS:
        measured, beside = "–", each.against
        if each.group in there:
            (claim, *_) = judged(there[each.group], Goal(each.against, each.ratio, ours=each.ours))
            if isinstance(claim["value"], float):
                measured, beside = f"{claim['value']:.2f}", str(claim["reference"])
        listed.append([each.group, f"{each.ours} over {beside}", f"{each.ratio:g}", each.reason, measured])
    return listed


def text_of(found: dict[str, Any]) -> str:
    """The table with the machine on which it was measured."""
    head = (
        f"{found['processor']}, {found['cores']} cores, {found['simd']}; {found['turns']} turns of "
        f"{found['seconds']:g} s; the load of the machine before was {found['load_before'] or 0:.1f}:"
    )
    return f"{head}\n\n{table(['group', 'speed of', 'predicted', 'because', 'measured'], rows(found))}"


def main() -> int:
    """Measure or read, then print or write the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--from", dest="source", type=Path, metavar="FILE.json", help="measure nothing, read this")
    parser.add_argument("--turns", type=int, default=5, help="of each")
    parser.add_argument("--seconds", type=float, default=0.5, help="length of a turn")
    outputs(parser)
    given = parser.parse_args()
    if given.source:
        found = json.loads(given.source.read_text(encoding="utf-8"))
    else:
        found = measure(chosen(groups()), given.turns, given.seconds)
    deliver(given, found, text_of(found), BEGIN, END)
    return 0


if __name__ == "__main__":
    sys.exit(main())
