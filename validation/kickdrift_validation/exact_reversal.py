"""Does leapfrog-exact come back to the very same bits, over 5000 steps or a million, and in another process?

Two systems: lj-1000 (a simple cubic lattice of 1000 Lennard-Jones particles that melts, dt* = 0.005) and the Sun with
eight planets (JPL DE421 at J2000, the Earth with the Moon; dt = 0.004 years, 60 steps to an orbit of Mercury). Each leg
runs in a process of its own, which is given the whole numbers of its start and nothing else of the other leg's: the
second one those of the first one's end, momenta negated.
"""

import json
import sys
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np

import kickdrift as kd
from kickdrift.integrators.exact.stepper import Lattice
from kickdrift_validation.claim import Claim, claim, main
from kickdrift_validation.folders import DATA

DE421 = DATA / "solar-system" / "de421.json"
SHORT, LONG, YEAR = 5000, 1_000_000, 365.25
DT = {"lj-1000": 0.005, "solar-system": 0.004}


def solar_system() -> kd.System:
    """Sun and planets, barycentric; AU, years of 365.25 days, solar masses."""
    bodies = json.loads(DE421.read_text(encoding="utf-8"))["bodies"].values()
    masses = np.array([body["GM"] for body in bodies])
    x = np.array([body["position"] for body in bodies])
    v = np.array([body["velocity"] for body in bodies]) * YEAR
    return kd.System(x, v, masses=masses / masses[0], forces=[kd.Gravity()], units="astro", name="solar-system")


def start(name: str) -> kd.System:
    return solar_system() if name == "solar-system" else kd.load(name)


def leg(name: str, begin: Path, end: Path, steps: int) -> None:
    """Run from the lattice in one file to that in another; positions and velocities come from the file alone."""
    lattice = Lattice(**np.load(begin))
    own = start(name)
    there = lattice.positions * lattice.spacing[:, None]
    if own.box.lengths is not None:
        there += lattice.images * np.array(own.box.lengths)[:, None]
    system = kd.System(there.T, masses=own.state.masses, box=own.box, forces=own.forces, units=own.units, name=name)
    sim = kd.Simulation(system, "leapfrog-exact", dt=DT[name])
    sim.method_state = lattice
    began, spent = perf_counter(), process_time()

    def progress(done: int, of: int) -> None:
        nonlocal began
        if perf_counter() - began > 30 or done == of:
            began = perf_counter()
            print(f"{name}: {done} of {of} steps, {process_time() - spent:.0f} s of processor", file=sys.stderr)

    sim.run(steps, every=steps, progress=progress)
    np.savez(end, **sim.method_state._asdict())


def claims(long: bool = False) -> list[Claim]:
    """There and back for each system."""
    rows: list[Claim] = []
    steps = LONG if long else SHORT
    with TemporaryDirectory() as folder:
        place = Path(folder)
        for name in DT:
            first = kd.Simulation(start(name), "leapfrog-exact", dt=DT[name]).method_state
            files = [place / f"{name}-{k}.npz" for k in ("start", "there", "turned", "back")]
            np.savez(files[0], **first._asdict())
            began = perf_counter()
            _in_new_process(name, files[0], files[1], steps)
            there = Lattice(**np.load(files[1]))
            np.savez(files[2], **there.reversed()._asdict())
            _in_new_process(name, files[2], files[3], steps)
            back = Lattice(**np.load(files[3])).reversed()
            print(f"{name}: {2 * steps} steps in {perf_counter() - began:.0f} s", file=sys.stderr)
            rows += judge(name, steps, first, there, back)
    return rows


def judge(name: str, steps: int, first: Lattice, there: Lattice, back: Lattice) -> list[Claim]:
    """What became of a system's whole numbers."""
    reference = f"{steps} steps forward and, in another process, back"
    keys = ("positions", "images", "momenta")
    moved = sum(int((getattr(first, key) != getattr(there, key)).sum()) for key in ("positions", "momenta"))
    differ = sum(int((getattr(first, key) != getattr(back, key)).sum()) for key in keys)
    rows = [
        claim(f"{name}: numbers that the way there changed", moved, "more than 0", moved > 0, reference),
        claim(f"{name}: numbers that differ after the way back", differ, "0", differ == 0, reference),
    ]
    if name != "solar-system":
        change = int(np.abs(there.momenta.sum(axis=1) - first.momenta.sum(axis=1)).max())
        rows.append(claim(f"{name}: change of total momentum", change, "0", change == 0, f"{steps} steps"))
    return rows


def _in_new_process(name: str, begin: Path, end: Path, steps: int) -> None:
    process = get_context("spawn").Process(target=leg, args=(name, begin, end, steps))
    process.start()
    process.join()
    if process.exitcode:
        raise RuntimeError(f"{name}: the process of {steps} steps ended with {process.exitcode}")


if __name__ == "__main__":
    main(claims, __doc__)
