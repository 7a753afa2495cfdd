"""Draw docs/charges.png: the error of the forces in molten salt against the time of an evaluation, for each method.

    python docs/charge_errors.py [--output docs/charges.png] [--overwrite]

Prints each point. Errors are relative to the root-mean-square force, from an exact sum in NumPy. Times are processor
time of one core, the best of several turns.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.charges.accuracy import Split
from kickdrift.forces.charges.sampled import forces_on
from kickdrift.plots.drawing import COLOURS, checked_target, new_axes, new_figure, save_figure

DOCS = Path(__file__).parent
TURNS, EVALUATIONS = 5, 5
ACCURACIES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
CUTOFFS = (7.0, 9.0, 11.0, 12.9)
DAMPING = 0.2  # 1/angstrom, as Fennell & Gezelter recommend


def melt() -> kd.System:
    """The molten salt that ships, melted."""
    sim = kd.Simulation(kd.load("molten-salt"))
    sim.run(2000)
    return sim.system.at(sim.state.phase, 0.0)


def cases() -> dict[str, list[Any]]:
    """The forces of each method."""
    return {
        "ewald": [kd.Coulomb(accuracy=accuracy) for accuracy in ACCURACIES],
        "pme": [kd.Coulomb("pme", accuracy=accuracy) for accuracy in ACCURACIES],
        "reaction-field": [kd.Coulomb("reaction-field", cutoff=cutoff) for cutoff in CUTOFFS],
        "damped-shifted": [kd.Coulomb("damped-shifted", cutoff=cutoff, alpha=DAMPING) for cutoff in CUTOFFS],
    }


def point(system: kd.System, force: Any, exact: np.ndarray) -> tuple[float, float]:
    """Milliseconds of an evaluation, and the relative error of the forces."""
    alone = system.with_forces(force)
    bound, phase = BoundForces(alone), alone.state.phase
    found = bound.measure(0.0, phase)
    assert found is not None
    off = (found.accelerations * alone.coherent_masses).T - exact
    taken, moved = [], phase.copy()
    moved[0] += 1e-9  # so that no evaluation finds its sums in the one before
    for _ in range(TURNS):
        begin = time.process_time()
        for k in range(EVALUATIONS):
            bound.measure(0.0, phase if k % 2 else moved)
        taken.append((time.process_time() - begin) / EVALUATIONS)
    return 1e3 * min(taken), math.sqrt(float((off**2).sum() / (exact**2).sum()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=DOCS / "charges.png")
    parser.add_argument("--overwrite", action="store_true")
    given = parser.parse_args()
    target = checked_target(given.output, given.overwrite)
    system = melt()
    fine = Split(11.0 / float(system.box.heights.min()), 0.5 * float(system.box.heights.min()), 5.0)
    exact = forces_on(np.arange(len(system)), kd.Coulomb().scaled_charges(system), system, fine)
    figure = new_figure(5.2, 3.6)
    axes = new_axes(figure, (1, 1, 1))
    for colour, (method, forces) in zip(COLOURS, cases().items(), strict=False):
        points = [point(system, force, exact) for force in forces]
        for force, (milliseconds, error) in zip(forces, points, strict=True):
            print(f"{method:15} {force.accuracy:7.0e} {force.cutoff or 0:5.1f} {milliseconds:8.3f} ms {error:8.1e}")
        axes.loglog(*zip(*points, strict=True), "o-", color=colour, label=method, markersize=4)
    axes.set_xlabel("milliseconds for the forces, 512 ions, one core")
    axes.set_ylabel("relative error of the forces")
    axes.legend(frameon=False, fontsize=8)
    print(save_figure(figure, target))


if __name__ == "__main__":
    main()
