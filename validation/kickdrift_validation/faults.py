"""Does the validation notice when kickdrift is wrong? Faults, planted one at a time.

    python -m kickdrift_validation.faults [--jobs 2] [--only NAME …] [--control]

Each fault goes into a copy of the package and of this folder, in a temporary place and with compiled code of its own;
nothing else is touched. There the claims run, the quick scripts first and in the same order for every fault, until one
fails, which is printed. Last of all, or alone with ``--control``, come the same scripts in a copy without any fault,
where all must pass. Exit status 1 if a fault is not caught, or a claim fails without one.
"""

import argparse
import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import closing
from pathlib import Path
from threading import Event
from time import monotonic
from typing import NamedTuple

import kickdrift
from kickdrift.text import duration
from kickdrift_validation.claim import Claim, text_of
from kickdrift_validation.folders import HERE
from kickdrift_validation.registry import SCRIPTS, Script
from kickdrift_validation.runner import ITSELF, LONGEST, PACKAGE, outcomes, terminable


class Fault(NamedTuple):
    """One text in one file of the package (which must stand there once), and what takes its place."""

    name: str
    what: str
    file: str
    text: str
    wrong: str
    small: bool = False


FAULTS = (
    Fault(
        "yoshida-weight", "two digits of a weight of yoshida6 swapped, 9e-8 of it", "integrators/splitting/method.py",
        "0.23557321335935813", "0.23557312335935813", small=True,
    ),
    Fault(
        "half-kick", "the last kick of a splitting step left out", "integrators/splitting/subflows.py",
        "    return np.array(stages, dtype=np.float64).T",
        "    stages[-1][0] = 0.0\n    return np.array(stages, dtype=np.float64).T",
    ),
    Fault(
        "virial-sign", "the virial of the pair forces with the wrong sign", "forces/pairs/sum.py",
        "sums[c, 1] = lane_sum(trace_of(along_sum, virial_sum))",
        "sums[c, 1] = -lane_sum(trace_of(along_sum, virial_sum))",
    ),
    Fault(
        "unit-factor", "metal's atomic mass unit of CODATA 2002, 1.2e-7 off", "model/units/unit_systems.py",
        "coherent_mass=constants.ATOMIC_MASS * (1e-10 / 1e-12) ** 2 / constants.ELEM",
        "coherent_mass=1.66053886e-27 * (1e-10 / 1e-12) ** 2 / constants.ELEM", small=True,
    ),
    Fault(
        "tableau", "-212 / 729 in dormand-prince45 copied as -212 / 792", "integrators/runge_kutta/tableaus.py",
        "-212 / 729", "-212 / 792",
    ),
    Fault(
        "tail", "the energy from beyond the cutoff counted for half of the pairs", "forces/pairs/law.py",
        "energy += density * u_part", "energy += 0.5 * density * u_part",
    ),
    Fault(
        "switch-slope", "a factor of two lost in the switch's derivative", "forces/pairs/truncations.py",
        "slope = 1260.0 *", "slope = 630.0 *",
    ),
    Fault(
        "relativity-sign", "the second term of the 1PN acceleration with the wrong sign", "forces/around/relativity.py",
        "4.0 * scale * (d @ u)", "-4.0 * scale * (d @ u)",
    ),
    Fault(
        "late-list", "the pair list refreshed after a whole skin instead of half of one", "forces/lists/pairlist.py",
        "if room >= 0.0 and 4.0 * inner <= room**2:", "if room >= 0.0 and inner <= room**2:",
    ),
    Fault(
        "kepler-series", "the series of Kepler's problem used to ten times its range",
        "integrators/wisdom_holman/kepler.py",
        "SERIES = 0.7 ", "SERIES = 7.0 ", small=True,
    ),
    Fault(
        "wall-order", "a particle bounces first off the wall that it crossed last", "integrators/splitting/mirrors.py",
        "abs(depth / speed) > longest", "(first < 0 or abs(depth / speed) < longest)",
    ),
    Fault(
        "wall-mirror", "the velocity of a bounce not mirrored", "integrators/splitting/mirrors.py",
        "            mirror(normal, v, i, 0.0)\n", "",
    ),
    Fault(
        "restraint-virial", "the virial of restraints with the wrong sign", "forces/fields/restraint_kernel.py",
        "virial -= pull * d[axis]", "virial += pull * d[axis]",
    ),
    Fault(
        "trap-image", "a trap in a periodic box pulls to its centre alone", "forces/laws/field_kernel.py",
        "    nearest_image(images.cell, d)\n", "",
    ),
    Fault(
        "wall-slope", "the repulsion of a Lennard-Jones wall 10 / 9 of its energy's slope", "forces/fields/walls.py",
        "(1.2 * near * near - 3.0)", "(4.0 / 3.0 * near * near - 3.0)",
    ),
    Fault(
        "shape-component", "the virials across yz and xy exchanged", "integrators/splitting/barostats/shape.py",
        "piston.along[c, 1, side]", "piston.along[c, 1, 2 - side]",
    ),
    Fault(
        "shape-heat", "the kinetic energy across two axes that of the first one",
        "integrators/splitting/barostats/shape.py", "(one * other)", "(one * one)",
    ),
    Fault(
        "shape-work", "no work against the shear components of a wanted stress",
        "integrators/splitting/barostats/shape.py",
        "total -= 0.5 * first * shape.stress[i, j]", "total -= (i == j) * 0.5 * first * shape.stress[i, j]",
    ),
    Fault(
        "shape-pull", "the wanted stress turned by the wrong deformation", "integrators/splitting/barostats/shape.py",
        "multiply(shape.stress, growth, half)", "multiply(shape.stress, shape.stress, half)",
    ),
)  # fmt: skip


# What is quick, and each with as few loops to compile as may be; then all that has a short set, the quickest first.
FIRST = (
    "unit-systems", "polish-splittings", "butcher-tableaus", "shadow-hamiltonian", "kepler-flow", "jpl-de421",
    "nist-lj", "pair-forces", "force-gradients",
)  # fmt: skip
SOURCE = Path(kickdrift.__file__).parent


class Verdict(NamedTuple):
    """The claim that failed first, if any, the script that it is of, and how long it took to come to it."""

    script: str
    claim: Claim | None
    seconds: float
    passed: int


class _Failed(Exception):
    """A claim failed: no more are needed."""


def in_order(scripts: Sequence[Script] = SCRIPTS, first: Sequence[str] = FIRST) -> list[Script]:
    """The short set, in the order in which it is tried."""
    named = {script.name: script for script in scripts}
    rest = sorted((script for name, script in named.items() if name not in first), key=lambda script: script.seconds)
    return [*(named[name] for name in first), *rest]


def copied(place: Path, fault: Fault | None) -> str:
    """Copy kickdrift, with the fault, its system files and these scripts; the PYTHONPATH that has both packages."""
    shutil.copytree(SOURCE, place / "src" / "kickdrift", ignore=shutil.ignore_patterns("__pycache__", "systems"))
    systems = next(each for each in (SOURCE.parents[1] / "systems", SOURCE / "systems") if each.is_dir())
    shutil.copytree(systems, place / "systems")
    shutil.copytree(HERE, place / "validation" / HERE.name, ignore=shutil.ignore_patterns("__pycache__"))
    if fault:
        file = place / "src" / "kickdrift" / fault.file
        text = file.read_text(encoding="utf-8")
        if text.count(fault.text) != 1:
            raise ValueError(f"{fault.name}: {fault.text!r} stands {text.count(fault.text)} times in {fault.file}")
        file.write_text(text.replace(fault.text, fault.wrong), encoding="utf-8")
    return os.pathsep.join([str(place / "src"), str(place / "validation"), os.environ.get("PYTHONPATH", "")])


def tried(
    fault: Fault | None, scripts: Sequence[Script], stop: Event, limit: float = LONGEST, package: str = PACKAGE
) -> Verdict:
    """Run the scripts, modules of ``package``, in a copy with the fault until a claim fails."""
    began, passed, name, failed = monotonic(), 0, "", None

    def tell(script: Script, row: Claim | None) -> None:
        nonlocal passed, failed, name
        if row and row["verdict"] == "fail":
            name, failed = script.name, row
            raise _Failed
        passed += row is not None and row["verdict"] == "pass"

    with tempfile.TemporaryDirectory(prefix="kickdrift-fault-") as place:
        environment = {"PYTHONPATH": copied(Path(place), fault)}
        for script in scripts:
            scratch = Path(place) / "figures"
            runs = outcomes(
                [script], scratch, package=package, limit=limit, environment=environment, tell=tell, stop=stop
            )
            try:
                with closing(runs):
                    for _ in runs:
                        pass
            except _Failed:
                break
    return Verdict(name, failed, monotonic() - began, passed)


def line(name: str, what: str, found: Verdict) -> str:
    if found.claim is None:
        return f"{name:16} {what}: no claim of {found.passed} failed, {duration(found.seconds)}"
    row = found.claim
    caught = f"{found.script}: {row['claim']}: {text_of(row['value'])}, bound {row['bound']}"
    by = "the runner, no measurement: " if row["reference"] == ITSELF else ""
    return f"{name:16} {what}: caught in {duration(found.seconds)} by {by}{caught}"


def main() -> int:
    """Plant the faults and print what came of each."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--jobs", type=int, default=2, help="faults at a time")
    parser.add_argument("--only", nargs="+", choices=[fault.name for fault in FAULTS], metavar="NAME", default=None)
    parser.add_argument("--control", action="store_true", help="no fault, all claims")
    given = parser.parse_args()
    faults = [] if given.control else [fault for fault in FAULTS if given.only is None or fault.name in given.only]
    began, scripts, missed = monotonic(), in_order(), 0
    used, stop = 0, Event()
    try:
        with terminable(), ThreadPoolExecutor(given.jobs) as pool:
            runs = {pool.submit(tried, fault, scripts, stop): fault for fault in faults}
            try:
                for run in as_completed(runs):
                    fault, found = runs[run], run.result()
                    print(line(fault.name, fault.what, found), flush=True)
                    missed += found.claim is None
                    names = [script.name for script in scripts]
                    used = max(used, names.index(found.script) + 1 if found.claim else len(scripts))
            except BaseException:
                stop.set()
                pool.shutdown(cancel_futures=True)
                raise
        with terminable():
            control = tried(None, scripts[:used] if faults else scripts, stop)
    except KeyboardInterrupt:
        print("faults.py: interrupted", file=sys.stderr)
        return 130
    print(line("(none)", "the same scripts without a fault", control))
    print(f"{len(faults) - missed} of {len(faults)} faults caught, {duration(monotonic() - began)}")
    return int(missed > 0 or control.claim is not None)


if __name__ == "__main__":
    sys.exit(main())
