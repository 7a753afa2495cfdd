"""The liquid of rigid water models: density, structure, diffusion, dielectric constant and heat of vaporisation.

    python -m docs.studies.water_liquid FOLDER --run NAME [--steps 100000]
    python -m docs.studies.water_liquid FOLDER

The first form begins a run or makes it longer, in a file of FOLDER; the second prints the rows of docs/rigid-water.md
from the files that are there. Runs are of 216 molecules at 298 K with steps of 2 fs: ``spce-nve`` at 0.997 g/cm3 and
constant energy, ``spce-npt`` and ``tip4p-npt`` at 1 bar, with Lennard-Jones forces cut at 9 angstrom and their tail.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import kickdrift as kd
from kickdrift_validation.docs_tables import table
from kickdrift_validation.rigid_water import toml

DT, KELVIN, BAR, EVERY = 0.002, 298.0, 6.241509e-7, 100
MELT, MEAN, SETTLE = 8.0, 24.0, 4.0  # ps
MOLECULES, KJ, GAS = 216, 96.48533212331, 8.31446261815e-3  # kJ/mol of 1 eV; the gas constant in kJ/mol/K
GRAM = MOLECULES * 18.0154 * 1.66053906660  # g/cm3 times cubic angstrom
VISCOSITY = 0.729e-3 * 6.241509  # of SPC/E, Pa s in eV ps / angstrom^3
MODELS = {"spce": None, "tip4p": "tip4p2005"}
NAMES = ("spce-nve", "spce-npt", "tip4p-npt")
BATH = {"temperature": KELVIN, "friction": 2.0}
PRESSED = {"pressure": BAR, "pressure_tau": 0.5, "compressibility": 4.6e-5 / BAR}


def water(model: str, tail: bool) -> kd.System:
    """216 molecules; with their tail beyond the cutoff, or with forces that end there smoothly."""
    text = kd.template("water", MODELS[model]) if MODELS[model] else kd.template("water")
    if tail:
        text = text.replace('truncation = "switch"', 'truncation = "cut"\ntail = true')
    system = kd.load(toml(text))
    assert isinstance(system, kd.System)
    return system


def begun(name: str) -> kd.Simulation:
    """The simulation of a run at its start, after the equilibration."""
    model, kind = name.split("-")
    system = water(model, kind == "npt")
    sim = kd.Simulation(system, "baoab", dt=DT, **BATH | {"friction": 5.0})
    sim.run(time=MELT)
    if kind == "npt":
        pressed = kd.Simulation(system, "baoab", dt=DT, **BATH, **PRESSED)
        pressed.state = system.at(sim.state.phase, 0.0).state
        pressed.run(time=MELT)
        return pressed
    state, before = sim.state, len(sim.record.samples)
    sim.run(time=MEAN, every=10)
    looks = sim.record.samples[before:]
    wanted = float(np.mean([look.energies.total for look in looks]))
    state = sim.state
    state.phase[1] -= (state.phase[1] @ state.masses / state.masses.sum())[:, None]
    free = kd.Simulation(system, "velocity-verlet", dt=DT)
    free.state = system.at(state.phase, 0.0).state
    now = free.energy()
    state.phase[1] *= np.sqrt((wanted - now.potential) / now.kinetic)  # the mean energy of 298 K
    free.state = system.at(state.phase, 0.0).state
    return free


def lengthen(path: Path, name: str, steps: int) -> None:
    if path.exists():
        kd.resume(path).run(steps)
    else:
        sim = begun(name)
        sim.run(steps, every=EVERY, output=path)


def lines(path: Path) -> Iterator[tuple[str, str]]:
    """What a run shows, as quantities with their values and errors."""
    run = kd.open(path)
    first = round(SETTLE / run.times[1])
    energy = kd.analysis.block_average(KJ * run.observables["potential_energy"][first:] / MOLECULES)
    yield "length", f"{run.times[-1]:.0f} ps"
    yield "potential energy of a molecule", f"{energy.value:.2f} ± {energy.error:.2f} kJ/mol"
    pressed = "volume" in run.observables
    if pressed:
        density = kd.analysis.block_average(GRAM / run.observables["volume"][first:])
        yield "density", f"{density.value:.4f} ± {density.error:.4f} g/cm3"
        yield "heat of vaporisation", f"{GAS * KELVIN - energy.value:.2f} ± {energy.error:.2f} kJ/mol"
    found = kd.analysis.dielectric_constant(run[first:])
    yield "dielectric constant", f"{found.value:.0f} ± {found.error:.0f}"
    if pressed:
        return
    temperatures = {kind: run.observables[f"{kind}_temperature"][first:] for kind in ("translation", "rotation")}
    for kind, series in temperatures.items():
        mean = kd.analysis.block_average(series)
        yield f"temperature of {kind}", f"{mean.value:.2f} ± {mean.error:.2f} K"
    apart = kd.analysis.block_average(temperatures["rotation"] - temperatures["translation"])
    yield "rotation less translation", f"{apart.value:.2f} ± {apart.error:.2f} K"
    totals = run.observables["total_energy"]
    slope, times = np.polyfit(run.times, totals, 1)[0], run.times[-1]
    yield "energy", f"{slope * times:.1e} eV of drift beside fluctuations of {np.std(totals):.1e} eV"
    yield "largest error of a distance", f"{np.abs(run.observables['constraint_error']).max():.1e}"
    rdf = kd.analysis.radial_distribution(run[first::5], pair=("O", "O"), bins=180)
    peak = int(rdf.g.argmax())
    yield "first peak of g_OO", f"{rdf.g[peak]:.2f} ± {rdf.error[peak]:.2f} at {rdf.r[peak]:.2f} angstrom"
    own = kd.analysis.mean_squared_displacement(run, lags=60, of="O", remove_drift=True).diffusion(2.0, 10.0)
    edge = run.box.lengths[0]
    wide = own.at_infinite_size(KELVIN, VISCOSITY, edge, run.units.boltzmann)
    yield "diffusion in this box", f"{10.0 * own.value:.2f} ± {10.0 * own.error:.2f} 1e-9 m2/s"
    yield "diffusion in an infinite box", f"{10.0 * wide.value:.2f} ± {10.0 * wide.error:.2f} 1e-9 m2/s"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--run", choices=NAMES)
    parser.add_argument("--steps", type=int, default=100_000)
    asked = parser.parse_args()
    if asked.run:
        lengthen(asked.folder / f"{asked.run}.h5md", asked.run, asked.steps)
        return
    for name in NAMES:
        if (path := asked.folder / f"{name}.h5md").exists():
            print(table([name, "value"], [list(line) for line in lines(path)]), end="\n\n")


if __name__ == "__main__":
    main()
