"""Liquid argon beside Rahman's (1964): self-diffusion, and the first peak of the radial distribution function.

Rahman, Phys. Rev. 136, A405 (1964), doi:10.1103/PhysRev.136.A405, ran 864 atoms at 94.4 K and found D = 2.43e-5 cm^2/s
and the first maximum of g(r) at 3.7 angstrom; both are also quoted, beside a repetition with LAMMPS that gave 2.47e-5,
at https://hunterheidenreich.com/projects/rahman-1964-replication. The height of that maximum stands in his figure 2
alone, just under 3, and 2.7 to 3.1 for what can be read off such a figure: from memory, and the weakest claim here. He
averaged over some 10 ps and gives no error of D; how far off a run of that length is by chance is measured here, on
pieces of that length, and is the bound.

Runs of systems/argon-864.toml at three temperatures about his, each from velocities of its own, go through files and
kickdrift.analysis. A run at constant energy has a mean temperature of its own, so D is a straight line through all
runs' temperatures, read at 94.4 K. Einstein's slope is taken from 2 to 6 ps, where the displacement is linear, Green
and Kubo's integral goes to 4 ps. A box of 34.78 angstrom holds its particles back; the correction of Yeh & Hummer 2004,
doi:10.1021/jp0477147, needs the viscosity, which is the integral of the correlation of the pressure tensor's five
independent components (Allen & Tildesley 2017, eq. 2.118, doi:10.1093/oso/9780198803195.001.0001). It is given apart:
Rahman's D is of the same box.
"""

import math
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, claim, main

TEMPERATURES = (91.4, 94.4, 97.4)  # K
WANTED = 94.4
EVERY = 4  # steps of 10 fs: velocities lose their memory over some 20 of them
RAHMAN_D, RAHMAN_PEAK, RAHMAN_HEIGHT = 2.43, 3.7, (2.7, 3.1)  # 1e-5 cm^2/s, angstrom
RAHMAN_TIME = 10.0  # ps
REPLICAS, TIME = 2, 200.0  # runs at each temperature, two or more; ps
EINSTEIN, GREEN_KUBO = (2.0, 6.0), 4.0  # ps
SHORT = (1.0, 2.4)  # ps, of the slope of a piece as long as his run
CM2_S = 10.0  # angstrom^2/ps in 1e-5 cm^2/s
RDF_EVERY, STRESS_EVERY, VISCOUS = 20, 3, 2.4  # frames, frames, ps
PA_S = 1.602176634e-19 * 1e30 * 1e-12  # eV ps / angstrom^3


class Found(NamedTuple):
    """What one run gives: diffusion coefficients in 1e-5 cm^2/s with their errors, viscosity in Pa s."""

    temperature: float
    einstein: kd.analysis.Diffusion
    green_kubo: kd.analysis.Diffusion
    pieces: list[float]  # D of pieces as long as Rahman's run
    g: np.ndarray
    g_error: np.ndarray
    viscosity: float


def simulate(temperature: float, seed: int, time: float, path: Path) -> None:
    sim = kd.Simulation(kd.load("argon-864", seed))
    sim.equilibrate(temperature, 20.0)
    sim.run(until=time, every=EVERY, output=path)


def analysed(path: Path) -> Found:
    with kd.open(path) as run:
        temperature = float(run.observables["temperature"].mean())
        step = float(run.times[1] - run.times[0])
        displacements = kd.analysis.mean_squared_displacement(run, lags=round(EINSTEIN[1] / step) + 1)
        velocities = kd.analysis.velocity_autocorrelation(run, lags=round(GREEN_KUBO / step) + 1)
        length = round(RAHMAN_TIME / step)
        pieces = [
            kd.analysis.mean_squared_displacement(
                run[start : start + length], lags=round(SHORT[1] / step) + 1
            ).diffusion(*SHORT)
            for start in range(0, len(run) - length, length)
        ]
        rdf = kd.analysis.radial_distribution(run[::RDF_EVERY], r_max=10.0, bins=200)
        stress = kd.analysis.pressure_tensor(run[::STRESS_EVERY])
        heat = run.units.boltzmann * temperature
        return Found(
            temperature,
            displacements.diffusion(*EINSTEIN),
            velocities.diffusion(GREEN_KUBO),
            [CM2_S * piece.value for piece in pieces],
            rdf.g,
            rdf.error,
            viscosity(stress.tensors, stress.times, run.box.volume / heat),
        )


def viscosity(tensors: np.ndarray, times: np.ndarray, scale: float) -> float:
    """``scale`` (V / k_B T) times the integral of the autocorrelation of the traceless pressure, in Pa s."""
    xx, yy, zz = (tensors[:, k, k] for k in range(3))
    parts = (tensors[:, 0, 1], tensors[:, 0, 2], tensors[:, 1, 2], (xx - yy) / 2, (xx + yy - 2 * zz) / math.sqrt(12))
    step = float(times[1] - times[0])
    lags = round(VISCOUS / step) + 1
    correlation = np.mean([[np.mean(part[m:] * part[: len(part) - m]) for m in range(lags)] for part in parts], axis=0)
    return float(scale * np.trapezoid(correlation, dx=step) * PA_S)


def peak(g: np.ndarray) -> tuple[float, float]:
    """Position and height of the maximum of g: the top of a parabola through five bins of 0.05 angstrom."""
    top = int(np.argmax(g))
    bins = np.arange(top - 2, top + 3)
    a, b, c = np.polyfit(bins - top, g[bins], 2)
    shift = -b / (2 * a)
    return 0.05 * (top + 0.5 + shift), c + b * shift / 2


def at_wanted(temperatures: np.ndarray, values: np.ndarray) -> tuple[float, float, float]:
    """The straight line through values at temperatures, read at WANTED: value, its error from the scatter, slope."""
    apart = temperatures - WANTED
    slope, value = np.polyfit(apart, values, 1)
    noise = float(np.sum((values - value - slope * apart) ** 2)) / (len(values) - 2)
    spread = np.sum((apart - apart.mean()) ** 2)
    return float(value), math.sqrt(noise * (1 / len(values) + apart.mean() ** 2 / spread)), float(slope)


def claims(long: bool = False) -> list[Claim]:
    """All runs, printed as they come, and the claims; there is no short set."""
    print(f"{len(TEMPERATURES) * REPLICAS} runs of {TIME:g} ps")
    found: list[Found] = []
    with tempfile.TemporaryDirectory() as scratch:
        for k, temperature in enumerate(TEMPERATURES * REPLICAS):
            path = Path(scratch) / f"argon-{k}.h5md"
            simulate(temperature, k, TIME, path)
            f = analysed(path)
            found.append(f)
            path.unlink()
            position, height = peak(f.g)
            einstein, kubo = (f"{CM2_S * d.value:.3f} ({CM2_S * d.error:.3f})" for d in (f.einstein, f.green_kubo))
            print(
                f"  T {f.temperature:.2f} K: D {einstein} Einstein, {kubo} Green-Kubo, 1e-5 cm^2/s; "
                f"viscosity {1e3 * f.viscosity:.3f} mPa s; g({position:.3f} angstrom) = {height:.3f}",
                flush=True,
            )
    return judged(found)


def judged(found: list[Found]) -> list[Claim]:
    temperatures = np.array([f.temperature for f in found])
    rows: list[Claim] = []
    reference = "Rahman 1964: 2.43"
    scatter = float(np.std(np.concatenate([np.array(f.pieces) - np.mean(f.pieces) for f in found]), ddof=len(found)))
    values: dict[str, tuple[float, float, float]] = {}
    for name, given in (("Einstein", [f.einstein for f in found]), ("Green-Kubo", [f.green_kubo for f in found])):
        value, error, slope = at_wanted(temperatures, np.array([CM2_S * d.value for d in given]))
        values[name] = value, error, slope
        bars = math.sqrt(np.mean([(CM2_S * d.error) ** 2 for d in given]))
        together = math.hypot(scatter, error)
        print(
            f"{name}: D({WANTED:g} K) = {value:.3f} ({error:.3f}) 1e-5 cm^2/s, dD/dT = {slope:.4f} a K; a run's own "
            f"bar is {bars:.3f}, the scatter of runs of {RAHMAN_TIME:g} ps {scatter:.3f}"
        )
        rows.append(
            claim(
                f"self-diffusion of argon at {WANTED:g} K, {name}, 1e-5 cm^2/s",
                f"{value:.3f} ({error:.3f})",
                f"{RAHMAN_D} within 2 x {together:.3f}, the scatter of runs as short as his",
                abs(value - RAHMAN_D) <= 2 * together,
                reference,
            )
        )
    (einstein, e_error, _), (kubo, k_error, _) = values.values()
    apart = math.hypot(e_error, k_error)
    rows.append(
        claim(
            "Einstein's and Green and Kubo's D agree, 1e-5 cm^2/s",
            f"{einstein - kubo:+.4f}",
            f"within {2 * apart:.3f}, two errors",
            abs(einstein - kubo) <= 2 * apart,
            "the same number by theory",
        )
    )
    eta, eta_error, _ = at_wanted(temperatures, np.array([f.viscosity for f in found]))
    units = kd.load("argon-864").units
    larger = kd.analysis.Diffusion(einstein / CM2_S, e_error / CM2_S, EINSTEIN)
    corrected = larger.at_infinite_size(WANTED, eta / PA_S, 34.78, units.boltzmann).value * CM2_S
    print(
        f"viscosity {1e3 * eta:.3f} ({1e3 * eta_error:.3f}) mPa s; D of an infinite box (Yeh & Hummer) "
        f"{corrected:.3f}, {corrected - einstein:+.3f} to the box's own"
    )
    middle = [f for f in found if abs(f.temperature - WANTED) < 1.5] or found
    peaks = np.array([peak(f.g) for f in middle])
    (position, height), scatters = (
        peaks.mean(axis=0),
        peaks.std(axis=0, ddof=1) if len(peaks) > 1 else (math.nan, math.nan),
    )
    rows.append(
        claim(
            "first maximum of g(r), angstrom",
            f"{position:.3f} ({scatters[0]:.3f})",
            f"{RAHMAN_PEAK} +- 0.05, as he rounds",
            abs(position - RAHMAN_PEAK) <= 0.05,
            "Rahman 1964: 3.7",
        )
    )
    rows.append(
        claim(
            "height of the first maximum of g(r)",
            f"{height:.3f} ({scatters[1]:.3f})",
            f"{RAHMAN_HEIGHT[0]} to {RAHMAN_HEIGHT[1]}",
            RAHMAN_HEIGHT[0] <= height <= RAHMAN_HEIGHT[1],
            "Rahman 1964, figure 2 (from memory)",
        )
    )
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
