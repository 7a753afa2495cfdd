"""Have the kernels of wisdom-holman the errors of the literature, and those of rebound's WHFast with the same kernel?

The Sun and five outer planets for 120 years, with corrector 17 in Jacobi coordinates; the planets' masses times 10 make
errors that rounding does not hide. Wisdom, Holman & Touma 1996, Fields Inst. Commun. 10, 217; Rein, Tamayo & Brown
2019, doi:10.1093/mnras/stz2503: the error is as epsilon^2 dt^2 with the standard kernel, and as epsilon^2 dt^4 with the
others, where epsilon is the planets' mass. ``--long`` adds 10^6 steps with each kernel.
"""

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import INSTALL, Claim, claim, main, not_run
from kickdrift_validation.rebounds import phase
from kickdrift_validation.wisdom_holman import energy, scaled, whfast

KERNELS = {"standard": "default", "lazy": "lazy", "composition": "composition", "modified-kick": "modifiedkick"}
POWERS = {"standard": 2} | dict.fromkeys(list(KERNELS)[1:], 4)  # of dt
YEARS, COARSE, FINE = 120.0, 0.5, 0.35
SOURCE = "Rein, Tamayo & Brown 2019"


def curve(system: kd.System, dt: float, kernel: str, steps: int = 0, every: int = 1) -> np.ndarray:
    """Energy errors of kickdrift, relative to the energy at the start."""
    sim, found = kd.Simulation(system, "wisdom-holman", dt=dt, kernel=kernel, corrector=17, compensated=True), []

    def look(sim: kd.Simulation) -> None:
        found.append(energy(system, sim.state.positions, sim.state.velocities))

    sim.run(steps or round(YEARS / dt), every=every, observe=look)
    return np.array(found)


def rebounds_curve(system: kd.System, dt: float, kernel: str) -> np.ndarray:
    sim, found = whfast(system, dt, "jacobi"), []
    sim.integrator.kernel, sim.integrator.corrector = KERNELS[kernel], 17
    sim.integrator.keep_unsynchronized = 1
    for _ in range(round(YEARS / dt)):
        sim.steps(1)
        found.append(energy(system, *phase(sim)))
    return np.array(found)


def largest(errors: np.ndarray) -> float:
    return float(np.abs(errors).max())


def powers(system: kd.System, kernel: str) -> list[Claim]:
    """Powers of the step and of the planets' masses in the energy error."""
    heavy = scaled(system, 10.0)
    coarse, fine = (largest(curve(heavy, dt, kernel)) for dt in (COARSE, FINE))
    light = largest(curve(system, FINE, kernel))
    by_step, by_mass, expected = np.log(coarse / fine) / np.log(COARSE / FINE), np.log10(fine / light), POWERS[kernel]
    return [
        claim(f"{kernel}: power of dt in the energy error", by_step, f"{expected} within 0.4",
              abs(by_step - expected) < 0.4, SOURCE),
        claim(f"{kernel}: power of the planets' masses in it", by_mass, "2 within 0.2", abs(by_mass - 2) < 0.2,
              SOURCE),
    ]  # fmt: skip


def beside_rebound(system: kd.System, kernel: str) -> list[Claim]:
    """The same path and the same errors as WHFast."""
    ours = kd.Simulation(system, "wisdom-holman", dt=FINE, kernel=kernel)
    rebounds, nudged = (whfast(system, FINE, "jacobi", factor) for factor in (1.0, 1.0 + 2.0**-52))
    ours.run(1000, every=1000)
    for sim in (rebounds, nudged):
        sim.integrator.kernel = KERNELS[kernel]
        sim.steps(1000)
    x, shifted = phase(rebounds)[0], phase(nudged)[0]
    off, growth = (float(np.abs(y - x).max() / np.abs(x).max()) for y in (ours.state.positions, shifted))
    heavy = scaled(system, 10.0)
    over = largest(curve(heavy, FINE, kernel)) / largest(rebounds_curve(heavy, FINE, kernel))
    return [
        claim(f"{kernel}: positions after 1000 steps without a corrector", off, "at most 1e-11", off <= 1e-11,
              f"WHFast; it differs from itself one rounding away by {growth:.1e}"),
        claim(f"{kernel}: energy error with corrector 17, over WHFast's", over, "at most 1.1", over <= 1.1,
              "rebound's WHFast with the same kernel and corrector"),
    ]  # fmt: skip


def no_drift(system: kd.System, kernel: str) -> Claim:
    """The lazy implementer's kernel is symplectic only up to its error; does the energy stay?"""
    steps = 1_000_000
    errors = curve(system, FINE, kernel, steps, steps // 2000)
    first, last = (float(np.sqrt((part**2).mean())) for part in (errors[:200], errors[-200:]))
    text = f"{kernel}: RMS energy error in the last tenth of 10^6 steps, over that in the first tenth"
    return claim(text, last / first, "at most 1.5", last <= 1.5 * first, f"first tenth {first:.1e}")


def claims(long: bool = False) -> list[Claim]:
    """All of it; what needs rebound is not run where it is not installed."""
    system = kd.load("outer-solar-system").with_forces(kd.Gravity())  # with the G of the units, as WHFast
    rows = [each for kernel in KERNELS for each in powers(system, kernel)]
    try:
        import rebound  # noqa: F401
    except ImportError:
        rows.append(not_run("the same positions as WHFast", "at most 1e-11", "rebound", INSTALL))
    else:
        rows += [each for kernel in KERNELS for each in beside_rebound(system, kernel)]
    if long:
        rows += [no_drift(system, kernel) for kernel in KERNELS]
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
