"""Is wisdom-holman the map that rebound's WHFast is, with its errors, and are its correctors and saba what they say?

The Sun and eight planets (JPL DE421 at J2000, the Earth with the Moon), in Jacobi and democratic heliocentric
coordinates, without a corrector; both programs get the same numbers and the same step, a hundredth and a tenth of
Mercury's period. A true Wisdom-Holman map differs from another by rounding alone; how rounding grows is shown by WHFast
against itself, started one unit of rounding away (every position times 1 + 2^-52). rebound 5.2.2: Rein & Liu 2012,
doi:10.1051/0004-6361/201118085; Rein & Tamayo 2015, doi:10.1093/mnras/stv1257.
"""

from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift_validation import rebounds
from kickdrift_validation.claim import INSTALL, Claim, at_most, claim, main, not_run
from kickdrift_validation.exact_reversal import solar_system
from kickdrift_validation.rebounds import phase, simulation

MERCURY = 0.2408467  # years
COORDINATES = {"jacobi": "jacobi", "democratic-heliocentric": "democraticheliocentric"}
SHORT, LONG = 100_000, 1_000_000  # steps of the comparison of energies


def whfast(system: kd.System, dt: float, coordinates: str, factor: float = 1.0) -> Any:
    """A rebound Simulation of the same bodies; positions times ``factor``."""
    sim = simulation(system, "whfast", dt, factor=factor)
    sim.integrator.coordinates, sim.integrator.safe_mode = COORDINATES[coordinates], 0
    return sim


def energy(system: kd.System, x: np.ndarray, v: np.ndarray) -> float:
    """Relative to |E| of the system's start, less 1; in extended precision."""
    m, start, G = system.state.masses, system.state, float(system.units.gravity or 1.0)
    return float(rebounds.energy(m, x, v, G) / rebounds.energy(m, start.positions, start.velocities, G) - 1)


def trajectories(system: kd.System) -> list[Claim]:
    """The largest difference of any coordinate over the largest coordinate."""
    rows = []
    for parts in (100, 10):
        for coordinates in COORDINATES:
            dt, done = MERCURY / parts, 0
            ours = kd.Simulation(system, "wisdom-holman", dt=dt, coordinates=coordinates)
            other, nudged = (whfast(system, dt, coordinates, factor) for factor in (1.0, 1.0 + 2.0**-52))
            for steps in (10, 1000, 100_000):
                ours.run(steps - done, every=steps)
                for sim in (other, nudged):
                    sim.steps(steps - done)
                done = steps
                x, shifted = phase(other)[0], phase(nudged)[0]
                off = float(np.abs(ours.state.positions - x).max() / np.abs(x).max())
                growth = float(np.abs(shifted - x).max() / np.abs(x).max())
                bound = {10: 1e-14, 1000: 1e-11}.get(steps, 0.0) * (10 if parts == 10 else 1) or 10 * growth
                text = f"{coordinates}, dt = P / {parts}: positions after {steps} steps"
                note = f"WHFast; it differs from itself one rounding away by {growth:.1e}"
                rows.append(claim(text, off, f"at most {bound:.0e}", off <= bound, note))
    return rows


def curves(system: kd.System, steps: int) -> list[Claim]:
    """The energy error of both at a thousand times of a long run."""
    rows = []
    for coordinates in COORDINATES:
        dt, looks = MERCURY / 100, 1000
        ours = kd.Simulation(system, "wisdom-holman", dt=dt, coordinates=coordinates)
        other, errors = whfast(system, dt, coordinates), []
        other.integrator.keep_unsynchronized = 1

        def look(sim: kd.Simulation, other: Any = other, errors: list[list[float]] = errors) -> None:
            other.steps(sim.steps_done - other.steps_done)
            state = sim.state
            errors.append([energy(system, state.positions, state.velocities), energy(system, *phase(other))])

        ours.run(steps, every=steps // looks, observe=look)
        found = np.array(errors)
        rms, apart = np.sqrt((found**2).mean(axis=0)), float(np.sqrt((np.diff(found, axis=1) ** 2).mean()))
        text = f"{coordinates}: RMS difference of the energy errors over {steps} steps, of their RMS"
        rows.append(at_most(text, apart / float(rms[1]), 0.01, f"WHFast, RMS {rms[1]:.3e}; ours {rms[0]:.3e}"))
    return rows


def scaled(system: kd.System, factor: float) -> kd.System:
    """The same with planets of other masses."""
    masses = system.state.masses.copy()
    masses[1:] *= factor
    own = system.state
    return kd.System(own.positions, own.velocities, masses, forces=system.forces, units=system.units)


def energy_error(system: kd.System, parts: float, name: str = "wisdom-holman", **options: Any) -> float:
    """The largest in ten of Mercury's periods, in steps of that period over ``parts``."""
    sim, found = kd.Simulation(system, name, dt=MERCURY / parts, compensated=True, **options), []

    def look(sim: kd.Simulation) -> None:
        found.append(energy(system, sim.state.positions, sim.state.velocities))

    sim.run(round(10 * parts), every=1, observe=look)
    return float(np.abs(np.array(found) - found[0]).max())


def orders(system: kd.System) -> list[Claim]:
    """Powers of the step and of the planets' masses."""
    rows = []
    light = scaled(system, 0.1)
    for coordinates in COORDINATES:
        coarse, fine, less = (
            energy_error(body, parts, coordinates=coordinates)
            for body, parts in ((system, 20), (system, 40), (light, 40))
        )
        by_step, by_mass = np.log2(coarse / fine), np.log10(fine / less)
        rows += [
            claim(f"{coordinates}: power of dt in the energy error", by_step, "2 within 0.1", abs(by_step - 2) < 0.1,
                  "Wisdom & Holman 1991"),
            claim(f"{coordinates}: power of the masses in it, over the planets' energy", by_mass, "1 within 0.1",
                  abs(by_mass - 1) < 0.1, "Wisdom & Holman 1991"),
        ]  # fmt: skip
        before = fine
        for order in (3, 5, 7, 11, 17):
            corrected = energy_error(system, 40, coordinates=coordinates, corrector=order)
            text = f"{coordinates}: energy error with corrector {order}, over that without"
            bound = 0.01
            rows.append(claim(text, corrected / before, f"at most {bound}", corrected < bound * before, "Wisdom 2006"))
        heavy, normal = (
            energy_error(body, 20, coordinates=coordinates, corrector=17) for body in (scaled(system, 10.0), system)
        )
        power = np.log10(heavy / normal)
        text = f"{coordinates}: power of the masses with corrector 17"
        rows.append(claim(text, power, "2 within 0.3", abs(power - 2) < 0.3, "Wisdom, Holman & Touma 1996"))
    errors = {order: energy_error(system, 4, "saba", order=order) for order in ("4,2", "8,4", "10,4", "10,6,4")}
    falling = all(a > b for a, b in zip(errors.values(), list(errors.values())[1:], strict=False))
    shown = ", ".join(f"{order}: {error:.1e}" for order, error in errors.items())
    rows.append(claim("saba at P / 4: the higher the order, the smaller the error", shown, "falling", falling,
                      "Laskar & Robutel 2001; Blanes et al. 2013"))  # fmt: skip
    return rows


def claims(long: bool = False) -> list[Claim]:
    """All of it; what needs rebound is not run where it is not installed."""
    system = solar_system()
    try:
        import rebound  # noqa: F401
    except ImportError:
        return [not_run("the same positions as WHFast", "at most 1e-11", "rebound", INSTALL), *orders(system)]
    return [*trajectories(system), *curves(system, LONG if long else SHORT), *orders(system)]


if __name__ == "__main__":
    main(claims, __doc__)
