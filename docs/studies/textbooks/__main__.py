"""What textbooks and web guides say of integrators, measured: said, verdict and why, every reading beside theory.

    python -m docs.studies.textbooks [--long] [--page docs/textbooks.md]

With ``--page`` the tables go into that page, and the figures into its folder.
"""

import argparse
import sys
from pathlib import Path

from docs.studies.textbooks import (
    evaluations,
    liquid,
    long_runs,
    orbits,
    reversal,
    stiff,
    tolerance,
    unit_oscillator,
)
from docs.studies.textbooks.article import Claim, markdown, table
from kickdrift_validation.claim import of, where
from kickdrift_validation.docs_tables import put

BEGIN, END = "<!-- docs.studies.textbooks --page writes from here -->", "<!-- to here -->"
STUDIES = {
    unit_oscillator: "Half the step, forward Euler's amplitude, RK4 against Euler",
    orbits: "The energy after 10,000 orbits with both Eulers and RK4",
    liquid: "1000 Lennard-Jones particles with leapfrog and RK4",
    reversal: "Leapfrog's way back",
    long_runs: "Leapfrog's drift after 10^9 steps",
    evaluations: "Evaluations a step, and what they buy",
    stiff: "Explicit and implicit methods on stiff problems",
    tolerance: "A relative tolerance below 1e-12",
}
FIGURES = {orbits: "euler_orbit", liquid: "lj_energy_error"}


def page(found: dict[str, list[Claim]], figures: dict[str, str]) -> str:
    """Sections of the page by their titles, each with its figure if it has one."""
    lines = [f"{where()}."]
    for title, rows in found.items():
        lines += ["", f"## {title}", *markdown(rows)]
        lines += ["", f"![{figures[title]}]({figures[title]}.png)"] if title in figures else []
    return "\n".join(lines)


def main() -> int:
    """Measure, print and write; the exit status is 1 where a measurement failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--long", action="store_true", help="also what takes more than a minute")
    parser.add_argument("--page", type=Path, metavar="FILE", help="put the tables into that page")
    given = parser.parse_args()
    found = {}
    for study, title in STUDIES.items():
        found[title] = list(of(study.claims, given.long, given.page and given.page.parent))
        print(table(found[title]), flush=True)
    if given.page:
        put(given.page, BEGIN, END, page(found, {STUDIES[study]: name for study, name in FIGURES.items()}))
    return int(any(row["verdict"] == "fail" for rows in found.values() for row in rows))


if __name__ == "__main__":
    sys.exit(main())
