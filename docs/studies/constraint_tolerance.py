"""Drift of the energy of rigid water against the tolerance of its constraints.

    python -m docs.studies.constraint_tolerance [--picture docs/constraint-tolerance.png] [--walk]

It prints the rows of a table of docs/rigid-water.md: 27 SPC/E molecules by velocity Verlet with steps of 2 fs from one
state, with forces that end smoothly at 4.6 angstrom. With ``--walk`` it prints how far the energy goes in 1, 10 and 50
ps, by the step and by the sum over charges.
"""

import argparse
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift.statistics.drift import drift as energy_drift
from kickdrift_validation.docs_tables import table
from kickdrift_validation.rigid_water import toml, warm

TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-16)
DT, STEPS, EVERY, CUTOFF = 0.002, 20_000, 50, "4.6 angstrom"
LAGS, WALK = (1, 10, 50), 200.0  # ps
PME = 'method = "pme"\naccuracy = 1e-4  # of the forces'


def water(tolerance: float = 1e-16) -> kd.System:
    """27 molecules whose forces end smoothly at the cutoff."""
    text = kd.template("water").replace("216", "27").replace("9 angstrom", CUTOFF)
    text = text.replace(PME, f'method = "damped-shifted"\ncutoff = "{CUTOFF}"\nalpha = 0.3')
    text = text.replace("[[constraint]]", f"[[constraint]]\ntolerance = {tolerance}")
    system = kd.load(toml(text))
    assert isinstance(system, kd.System)
    return system


def walk(system: kd.System, state: kd.State, dt: float, time: float) -> list[str]:
    """How far the mean energy of a picosecond goes in 1, 10 and 50 ps, relative to the energy; the verdict; the largest
    relative error of a distance."""
    sim = kd.Simulation(system, "velocity-verlet", dt=dt)
    sim.state = system.at(state.phase, 0.0).state
    sim.run(round(time / dt), every=round(0.02 / dt))
    looks = sim.record.samples
    totals = np.array([look.energies.total for look in looks])
    means = totals[1:].reshape(-1, 50).mean(axis=1) / abs(totals[0])
    found = energy_drift([look.time for look in looks], totals)
    far = [f"{np.sqrt(np.mean((means[lag:] - means[:-lag]) ** 2)):.1e}" for lag in LAGS]
    worst = max(float(look.columns["constraint_error"]) for look in looks)
    return [f"{1e3 * dt:g} fs", *far, found.verdict, f"{worst:.0e}"]


def drift(state: kd.State, tolerance: float) -> tuple[float, float, float, float]:
    """Drift of the energy of a degree of freedom in k_B T per ns, its error, the fluctuation, and the largest relative
    error of a distance."""
    system = water(tolerance)
    sim = kd.Simulation(system, "velocity-verlet", dt=DT)
    sim.state = system.at(state.phase, 0.0).state
    sim.run(STEPS, every=EVERY)
    looks = sim.record.samples
    unit = 298.0 * system.units.boltzmann * system.degrees_of_freedom
    totals, times = np.array([look.energies.total for look in looks]) / unit, np.array([look.time for look in looks])
    found, covariance = np.polyfit(1e-3 * times, totals, 1, cov=True)
    worst = max(float(look.columns["constraint_error"]) for look in looks)
    return float(found[0]), float(np.sqrt(covariance[0, 0])), float(np.std(totals)), worst


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--picture", type=Path, help="where to write the picture")
    parser.add_argument("--walk", action="store_true", help="how far the energy goes")
    asked = parser.parse_args()
    state = warm(water(), 6.0)
    if asked.walk:
        whole = water()
        mesh = kd.Coulomb("ewald", accuracy=1e-6, cutoff=4.6)
        sums = {"damped and shifted": whole, "Ewald, 1e-6": whole.with_forces(whole.forces[0], mesh)}
        walks = [[name, *walk(each, state, dt, WALK)] for name, each in sums.items() for dt in (0.002, 0.001)]
        print(table(["charges", "step", "1 ps", "10 ps", "50 ps", "verdict", "distances"], walks))
        return
    rows = [(tolerance, *drift(state, tolerance)) for tolerance in TOLERANCES]
    heading = ["tolerance", "drift, k_B T per ns and degree of freedom", "largest error of a distance"]
    cells = [[f"{row[0]:.0e}", f"{row[1]:+.1e} ± {row[2]:.0e}", f"{row[4]:.0e}"] for row in rows]
    print(table(heading, [[cell.replace("-", "−") for cell in row] for row in cells]))
    if asked.picture:
        draw(rows, asked.picture)


def draw(rows: list[tuple[float, ...]], path: Path) -> None:
    """Draw the size of the drift against the tolerance."""
    import matplotlib.pyplot as plt

    x, drifts, errors = np.array(rows)[:, :3].T
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    axes.errorbar(x, np.abs(drifts), errors, fmt="o-", capsize=3)
    axes.set(xscale="log", yscale="log", xlabel="tolerance of the constraints", ylabel="|drift|, $k_B T$ per ns")
    axes.set_title("27 SPC/E molecules, 2 fs, 40 ps")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main()
