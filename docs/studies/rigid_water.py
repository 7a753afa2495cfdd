"""Rigid SPC/E water against the step: equipartition at constant energy, and means in a heat bath.

    python -m docs.studies.rigid_water [--length 1]

It prints the rows of the two tables of docs/rigid-water.md. Runs of 216 molecules by velocity Verlet start from one
state of a bath; ``--length`` scales them. Their temperatures of translation and rotation are means over samples. What
the step takes from each is that of the forces and torques every 0.5 ps. Sampling errors of 64 molecules are those of
``kickdrift compare``.
"""

import argparse
import math

import numpy as np

import kickdrift as kd
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.docs_tables import table
from kickdrift_validation.rigid_water import toml, warm, water

TIMES = {1.0: 24.0, 2.0: 96.0, 3.0: 48.0, 4.0: 36.0}  # ps, by the step in fs
WARM, SETTLE, PIECE, EVERY = 6.0, 2.0, 0.5, 0.032  # ps
LONGEST, PILOT = 0.004, 1.0  # ps, of the comparison
STEP_BIAS = ["step", "translation lacks", "rotation lacks", "rotation less translation, by forces",
             "the same, measured in NVE, and the length"]  # fmt: skip
MEANS = ["step", "error of U of a particle, eV", "error of K of a particle, of k_B T"]


def equipartition(system: kd.System, state: kd.State, dt: float, time: float) -> list[str]:
    """A row of temperatures at constant energy, for a step in fs and a length in ps."""
    sim = kd.Simulation(system, "velocity-verlet", dt=1e-3 * dt)
    sim.state = system.at(state.phase, 0.0).state
    every, lacks = round(1e3 * EVERY / dt), []
    piece, settled = every * round(PIECE / EVERY), every * round(SETTLE / EVERY)
    sim.run(settled, every=every)
    for _ in range(math.ceil(time / PIECE)):
        molecules = sim.run(piece, every=every).molecules
        assert molecules is not None
        lacks.append([molecules.step_bias[kind] for kind in ("translation", "rotation")])
    looks = [sample.columns for sample in sim.record.samples if sample.step > settled]
    apart = [look["rotation_temperature"] - look["translation_temperature"] for look in looks]
    less, found = block_average(-np.diff(lacks, axis=1)[:, 0]), block_average(apart)
    translation, rotation = np.mean(lacks, axis=0)
    return [
        f"{dt:g} fs", f"{translation:.2f} K", f"{rotation:.2f} K", f"{less.value:.2f} ± {less.error:.2f} K",
        f"{found.value:.1f} ± {found.error:.1f} K, {len(apart) * every * 1e-3 * dt:.0f} ps",
    ]  # fmt: skip


def means() -> list[list[str]]:
    """Rows of the sampling errors of baoab on 64 molecules, with Ewald's sum."""
    text = kd.template("water").replace("216", "64").replace("9 angstrom", "6 angstrom").replace('"4 ps"', '"1 ps"')
    text = text.replace("accuracy = 1e-4", "accuracy = 1e-3").replace('"pme"', '"ewald"')
    found = kd.compare(kd.load(toml(text)), ["baoab"], dt=LONGEST, time=PILOT)
    assert isinstance(found, kd.analysis.SamplingComparison)
    return [
        [
            f"{1e3 * row.dt:.2g} fs", f"{row.potential:+.5f} ± {row.potential_error:.5f}",
            f"{100.0 * row.kinetic / found.thermal:+.2f} ± {100.0 * row.kinetic_error / found.thermal:.2f} %",
        ]
        for row in sorted(found.rows, key=lambda row: row.dt)
    ]  # fmt: skip


def main() -> None:
    """Run both studies and print their rows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--length", type=float, default=1.0, help="of runs at constant energy, in those of the page")
    length = parser.parse_args().length
    system = water()
    state = warm(system, WARM * length)
    rows = [equipartition(system, state, dt, time * length) for dt, time in TIMES.items()]
    for heading, each in ((STEP_BIAS, rows), (MEANS, means())):
        print(table(heading, [[cell.replace("-", "−") for cell in row] for row in each]), end="\n\n")


if __name__ == "__main__":
    main()
