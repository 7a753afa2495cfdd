"""Tables of energies: a tabulated Lennard-Jones beside the exact one, its virial, and a liquid at constant energy.

The tables have 4000 rows from 0.7 to 2.5 sigma, evenly in r. Errors of forces and energies are over their size,
and over 1 where that is smaller, at 20,000 places between the rows.
"""

from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.forces.pairs.terms import force_over_r
from kickdrift_validation.claim import Claim, at_most, claim, main
from kickdrift_validation.nve_drift import CUTOFF, DT, EQUILIBRATION_TIME, TEMPERATURE, liquid

ROWS, START, PLACES = 4000, 0.7, 20_000
FORCES, ENERGIES, TOGETHER = 1e-9, 1e-9, 1e-9
SHORT, LONG, SAMPLES = 20_000, 200_000, 1000  # steps
EXACT = "the formula"


def exact(r: Any) -> tuple[Any, Any]:
    """Energy and force of Lennard-Jones."""
    s6 = r**-6.0
    return 4.0 * (s6 * s6 - s6), 24.0 * (2.0 * s6 * s6 - s6) / r


def errors() -> list[Claim]:
    """A table with a column of forces, and one of energies alone."""
    found, r = [], np.random.default_rng(1).uniform(START, CUTOFF, PLACES)
    energy, force = exact(r)
    for columns, name in ((3, "energies and forces"), (2, "energies")):
        rows = np.linspace(START, CUTOFF, ROWS)
        table = kd.Tabulated(table=np.column_stack([rows, *exact(rows)])[:, :columns], truncation="cut")
        off = np.abs(force_over_r(table, "A", "A", r * r) * r - force) / np.maximum(np.abs(force), 1.0)
        energies = np.array([table.law.law(each * each)[0] for each in r.tolist()])
        apart = np.abs(energies - energy) / np.maximum(np.abs(energy), 1.0)
        found.append(at_most(f"force of a table of {ROWS} {name}, relative error", float(off.max()), FORCES, EXACT))
        found.append(
            at_most(f"energy of a table of {ROWS} {name}, relative error", float(apart.max()), ENERGIES, EXACT)
        )
    return found


def conservation(steps: int) -> list[Claim]:
    """A liquid at constant energy under a table, and its sums beside those of the formula."""
    plain = liquid(1, "switch")
    start = plain.system.at(plain.state.phase, 0.0)
    force = kd.Tabulated.of(start.forces[0], START, ROWS)
    law, table = (
        kd.Simulation(each, integrator="velocity-verlet", dt=DT) for each in (start, start.with_forces(force))
    )
    ours, theirs = table.sample(), law.sample()
    rows = [
        at_most(f"{name} of a liquid, relative difference", abs(one / other - 1.0), TOGETHER, EXACT)
        for name, one, other in (
            ("energy", ours.energies.potential, theirs.energies.potential),
            ("pressure", ours.pressure, theirs.pressure),
        )
    ]  # fmt: skip
    reports = [each.run(steps, every=max(1, steps // SAMPLES)).energy for each in (law, table)]
    for name, energy in zip(("formula", "table"), reports, strict=True):
        print(f"{name}: rms error {energy.rms_relative_error:.2e}, {energy.verdict}")
    verdict, text = reports[1].verdict, f"verdict on the energy of {steps} steps at T* near {TEMPERATURE}"
    rows.append(claim(text, verdict, "bounded", verdict == "bounded", f"{EQUILIBRATION_TIME:g} of melting before"))
    return rows


def claims(long: bool = False) -> list[Claim]:
    """Every claim; the long set takes ten times the steps."""
    return [*errors(), *conservation(LONG if long else SHORT)]


if __name__ == "__main__":
    main(claims, __doc__)
