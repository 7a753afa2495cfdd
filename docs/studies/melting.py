"""The melting line of copper by coexistence: at which temperatures does a crystal beside its melt grow or shrink?

    python -m docs.studies.melting [--page docs/crystals.md] [--long]

A crystal of copper (Zhou, Johnson & Wadley 2004, the table with a smooth end), twice as high as wide. A position
restraint holds the lower half while the upper half melts at 2500 K or above. Then the restraint is taken off, and the
two phases stand side by side at constant pressure, the edges x and y together and z by itself. The part of the crystal
follows from the potential energy, between those of a whole crystal and a whole melt under the same conditions. If it
rises, the temperature is below the melting point. The melting point lies between the highest temperature at which the
crystal grows and the lowest at which it melts. This is an interval, with what few atoms and a short run leave open.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

import kickdrift as kd
from docs.studies.crystals import GPA, crystal, edge_at
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.docs_tables import deliver, outputs, table

BEGIN, END = "<!-- melting.py writes from here -->", "<!-- melting.py: to here -->"
DT, COMPRESSIBILITY = 0.003, 0.009 / GPA
GRIDS = {0.0: range(1000, 1401, 50), 10.0: range(1400, 1901, 50)}  # kelvin, by the pressure in GPa
HOT = {0.0: 2500.0, 10.0: 3500.0}


def pressed(system: kd.System, temperature: float, pressure: float, seed: int) -> kd.Simulation:
    """A Simulation at a temperature and a pressure in GPa."""
    return kd.Simulation(
        system, "csvr", DT, temperature=temperature, tau=0.1, pressure=pressure * GPA, pressure_tau=0.5,
        compressibility=COMPRESSIBILITY, coupling="semi-isotropic", seed=seed,
    )  # fmt: skip


def tall(pressure: float, cells: int) -> kd.System:
    """A crystal, twice as high as wide."""
    edge, force = edge_at("copper", pressure) * 1.02, crystal("copper", 3.615).forces[0]
    x, _ = lattice("fcc", 4 * cells**3, 4 / edge**3)
    x = np.vstack([x, x + np.array([0.0, 0.0, cells * edge])])
    size = (cells * edge, cells * edge, 2 * cells * edge)
    return kd.System(x, masses=63.546, box=size, forces=[force], units="metal", species=["Cu"] * len(x))


def half_molten(system: kd.System, pressure: float, time: float) -> kd.System:
    """The crystal below, and its melt above."""
    z = system.state.positions[:, 2]
    held = np.flatnonzero(z < 0.5 * system.box.lengths[2])
    force = system.forces[0]
    start = system.with_forces(force, kd.Restraint(3.0, held)).with_velocities(temperature=HOT[pressure], seed=1)
    sim = pressed(start, HOT[pressure], pressure, 2)
    sim.run(round(time / DT))
    return sim.now().with_forces(force)


def energy_of(system: kd.System, temperature: float, pressure: float, time: float) -> tuple[kd.Simulation, float]:
    """A Simulation that has run, and its potential energy of an atom over the last third."""
    sim = pressed(system.with_velocities(temperature=temperature, seed=3), temperature, pressure, 4)
    sim.run(round(2 * time / 3 / DT))
    seen: list[float] = []
    sim.run(round(time / 3 / DT), every=20, observe=lambda sim: seen.append(sim.energy().potential))
    return sim, float(np.mean(seen)) / len(system)


def line(pressure: float, long: bool) -> tuple[list[list[str]], str]:
    """Rows of a table for a pressure, and the interval of the melting point."""
    cells, settle, time = (8, 6.0, 90.0) if long else (5, 4.0, 30.0)
    start = tall(pressure, cells)
    half = half_molten(start, pressure, settle)
    molten = pressed(start.with_velocities(temperature=HOT[pressure], seed=1), HOT[pressure], pressure, 2)
    molten.run(round(settle / DT))
    rows, grows, melts = [], [-np.inf], [np.inf]
    for temperature in GRIDS[pressure]:
        ends: Any = [energy_of(each, temperature, pressure, settle)[1] for each in (start, molten.now())]
        begin, after = (energy_of(half, temperature, pressure, each)[1] for each in (settle, time))
        parts = [(ends[1] - each) / (ends[1] - ends[0]) for each in (begin, after)]
        change = parts[1] - parts[0]
        verdict = "grows" if change > 0.05 else "melts" if change < -0.05 else "open"
        {"grows": grows, "melts": melts}.get(verdict, []).append(temperature)
        rows.append([f"{pressure:g}", f"{temperature}", f"{parts[0]:.2f}", f"{parts[1]:.2f}", verdict])
        print(*rows[-1], flush=True)
    low = max(each for each in grows if each < min(melts))
    return rows, f"{pressure:g} GPa: between {low:g} and {min(melts):g} K"


def page(long: bool) -> str:
    """The table, and the intervals."""
    found = [line(pressure, long) for pressure in GRIDS]
    rows = [row for each, _ in found for row in each]
    head = ["P (GPa)", "T (K)", "crystal at first", "crystal at the end", "verdict"]
    return "\n\n".join([table(head, rows), "\n".join(f"- {text}" for _, text in found)])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--long", action="store_true", help="4,096 atoms in place of 1,000, and three times as long")
    outputs(parser)
    given = parser.parse_args()
    deliver(given, {}, page(given.long), BEGIN, END)
