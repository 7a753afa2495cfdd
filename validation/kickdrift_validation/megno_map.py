"""A map of regular and chaotic motion made by one command: do its cells say what another program says of them?

MEGNO of the Sun, Jupiter and a Saturn that is moved from 7 to 10 AU and to eccentricities up to 0.5, over 10^4 years:
16 x 16 cells, or the 64 x 64 of docs/ensembles.md with --long, by `kickdrift ensemble` on two workers and `kickdrift
plot`. Some cells of each verdict, drawn at random, are run by rebound from the same starts, with three deviations each:
by WHFast up to e = 0.2, by IAS15 above, where there are encounters. A cell counts where rebound's three say the same,
regular or chaotic; the others are told.

Where ours is undecided and theirs are not, rebound follows five more deviations, and all eight have to say the same:
MEGNO settles as 1 / t, and on secular times longer than the run its verdict hangs on the first deviation. At a = 9.905,
e = 0.222, eight of ours give 1.83 to 1.99 after 10^4 years and eight of rebound's 1.83 to 2.01, three of which happen
to call it regular; at a = 9.952, e = 0.190 they give 2.00 to 2.20 and 1.99 to 2.20. WHFast and IAS15 find the same
numbers there to 0.003, seed by seed.

A planet that is thrown out early leaves a MEGNO that falls back towards 2, later by another program, since nobody
follows an encounter for long: two programs can find 3 and 30 there, but neither finds regular motion.
"""

import math
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.analysis.chaos.report import verdict
from kickdrift_validation.chaos import SEEDS, Case, theirs
from kickdrift_validation.claim import Claim, claim, main, not_run

CELLS, LONG_CELLS = 16, 64  # along either axis
CHECKED = {"regular": 2, "chaotic": 2, "undecided": 0}  # cells that rebound runs, by our verdict
LONG_CHECKED = {"regular": 12, "chaotic": 12, "undecided": 4}
AGREED, LONG_AGREED = 2, 10  # of each class
ENCOUNTERS = 0.2  # eccentricity
A, E = "particles.elements[Saturn].a", "particles.elements[Saturn].e"
ENERGY = 1e-9  # of regular cells, relative
REFERENCE = "rebound's, where its seeds agree"
MORE = (4, 5, 6, 7, 8)  # seeds
DECIDED = ("regular", "chaotic")


class Cell(NamedTuple):
    """What both say of one."""

    a: float
    e: float
    ours: float
    theirs: list[float]  # one per seed

    @property
    def their_verdict(self) -> str | None:
        """What all of rebound's say, if they do and it is a verdict."""
        found = {verdict(value) for value in self.theirs}
        return found.pop() if len(found) == 1 and found <= {*DECIDED} else None

    @property
    def our_verdict(self) -> str:
        return verdict(self.ours)


def kickdrift(*arguments: str, folder: Path) -> None:
    """A command of the command line."""
    program = "from kickdrift.cli.main import main; main()"
    subprocess.run([sys.executable, "-c", program, *arguments], cwd=folder, check=True, stderr=subprocess.DEVNULL)


def made(cells: int, folder: Path) -> Any:
    """The table of the map, after its figure."""
    kickdrift("ensemble", "two-planets", "--measure", "megno", "--vary", f"{A}=7:10:{cells}", "--vary",
              f"{E}=0:0.5:{cells}", "--workers", "2", "--output", "map.parquet", folder=folder)  # fmt: skip
    kickdrift("plot", "map.parquet", "--output", "megno_map.png", folder=folder)
    return kd.Ensemble.read(folder / "map.parquet")


def start(a: float, e: float) -> kd.System:
    ensemble = kd.Ensemble("two-planets", {A: [a], E: [e]})
    return ensemble._recipe.system(ensemble.members[0])  # type: ignore[return-value]


def looked_at(row: Any) -> Cell:
    """A row of the table, run by rebound."""
    import rebound

    system = start(row[A], row[E])
    root = math.sqrt(system.units.gravity)  # as many of rebound's units of time, of G = 1, are a year

    def make(_: Any) -> Any:
        sim = rebound.Simulation()
        for m, x, v in zip(system.state.masses, system.state.positions, system.state.velocities / root, strict=True):
            sim.add(m=m, x=x[0], y=x[1], z=x[2], vx=v[0], vy=v[1], vz=v[2])
        return sim

    case = Case("", make, "ias15" if row[E] > ENCOUNTERS else "whfast")
    found = [theirs(rebound, case, row["time"] * root, seed) for seed in SEEDS]
    cell = Cell(row[A], row[E], row["megno"], found)
    if cell.their_verdict and cell.our_verdict == "undecided":
        cell = cell._replace(theirs=found + [theirs(rebound, case, row["time"] * root, seed) for seed in MORE])
    print(
        f"{cell.a:6.3f} {cell.e:6.3f}  {row['energy_error']:6.0e}  {cell.ours:8.3f} {cell.our_verdict:10} "
        f"{cell.their_verdict or 'not told':10} {', '.join(f'{value:.3f}' for value in cell.theirs)}",
        flush=True,
    )
    return cell


def judged(cells: list[Cell], least: int) -> Iterator[Claim]:
    """The claims about cells that were looked at."""
    for each in DECIDED:
        both = sum(cell.our_verdict == cell.their_verdict == each for cell in cells)
        yield claim(f"{each} cells on which both agree", both, f"{least} or more", both >= least, REFERENCE)
    told = [cell for cell in cells if cell.their_verdict]
    differ = [f"a = {c.a:.3f}, e = {c.e:.3f}" for c in told if c.our_verdict != c.their_verdict]
    text = f"cells with another verdict, of {len(told)}"
    yield claim(text, "; ".join(differ) or "none", "none", not differ, REFERENCE)
    untold = len(cells) - len(told)
    yield claim("cells of which rebound's seeds say nothing", untold, "told", True, f"of {len(cells)} drawn")


def claims(long: bool = False, figures: Path | None = None) -> Iterator[Claim]:
    """Claims on the large map if ``long``, else on a small one."""
    size, checked, least = (LONG_CELLS, LONG_CHECKED, LONG_AGREED) if long else (CELLS, CHECKED, AGREED)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        table = made(size, folder)
        if figures:
            (figures / "megno_map.png").write_bytes((folder / "megno_map.png").read_bytes())
    done = int((table["status"] == "done").sum())
    yield claim(f"members done, of {size**2}", done, f"all {size**2}", done == size**2, "the table's status")
    counts = table["verdict"].value_counts()
    print(", ".join(f"{counts.get(each, 0)} {each}" for each in (*DECIDED, "undecided")))
    worst = float(table[table["verdict"] == "regular"]["energy_error"].max())
    text = "largest error of the energy of a regular cell"
    yield claim(text, worst, f"at most {ENERGY:.0e}", worst <= ENERGY, "the energy at the start")
    try:
        import rebound  # noqa: F401
    except ImportError:
        yield not_run("cells with another verdict", "none", REFERENCE)
        return
    rng = np.random.default_rng(1)
    drawn = [i for each, n in checked.items() for i in rng.choice(np.flatnonzero(table["verdict"] == each), n, False)]
    print("     a      e  energy      ours verdict    rebound, each of its seeds")
    yield from judged([looked_at(table.iloc[i]) for i in drawn], least)


if __name__ == "__main__":
    main(claims, __doc__)
