"""Is argon in units metal (angstrom, ps, eV, u) the reduced fluid, with the constants that CODATA prints?

Rahman's 864 atoms run for 100 steps in metal, and as a reduced fluid with lengths in sigma and times in sigma
sqrt(m / epsilon), worked out here from printed constants. Both must go the same way. k and e are exact since 2019; u is
CODATA 2022's (Mohr et al. 2025, doi:10.1103/RevModPhys.97.025002).
"""

import math

import numpy as np

import kickdrift as kd
from kickdrift_validation.claim import Claim, at_most, claim, main

BOLTZMANN, CHARGE, ATOMIC_MASS = 1.380649e-23, 1.602176634e-19, 1.66053906892e-27  # J/K, C, kg
CODATA = "CODATA 2022"
YEARS_APART = 2e-9  # relative: CODATA 2018's atomic mass, which an older SciPy has, is 1.4e-9 off


def claims(long: bool = False) -> list[Claim]:
    """Positions and what is made of them."""
    steps = 100
    metal = kd.load("argon-864")
    assert isinstance(metal, kd.System)
    sigma, epsilon, mass = 3.4, 120.0 * BOLTZMANN / CHARGE, 39.948
    tau = sigma * math.sqrt(mass * ATOMIC_MASS * 1e4 / CHARGE / epsilon)  # ps
    state = metal.state
    reduced = kd.System(
        state.positions / sigma, state.velocities * (tau / sigma), box=[34.78 / sigma] * 3,
        forces=[kd.LennardJones(cutoff=7.65 / sigma, truncation="shift")],
    )  # fmt: skip
    runs = kd.Simulation(metal, "velocity-verlet", dt=0.01), kd.Simulation(reduced, "velocity-verlet", dt=0.01 / tau)
    rows, done = [], 0
    for step in (1, 10, steps):
        for sim in runs:
            sim.run(step - done, every=2**40)
        done = step
        x, y = (np.array(sim.state.positions) for sim in runs)
        moved = float(np.abs(y - reduced.state.positions).max())
        off = float(np.abs(x / sigma - y).max()) / moved
        text = f"argon, metal beside reduced units: positions after {step} steps, over the way gone"
        rows.append(at_most(text, off, YEARS_APART, f"scaled with the constants of {CODATA}"))
    samples = [sim.sample() for sim in runs]
    scales = {"energy": epsilon, "temperature": 120.0, "pressure": epsilon / sigma**3}
    for name, scale in scales.items():
        a, b = (sample.energies.total if name == "energy" else getattr(sample, name) for sample in samples)
        off = abs(a / (b * scale) - 1.0)
        rows.append(claim(f"argon: {name} after {steps} steps, relative difference", off, f"at most {YEARS_APART:g}",
                          off <= YEARS_APART, f"scaled with the constants of {CODATA}"))  # fmt: skip
    return rows


if __name__ == "__main__":
    main(claims, __doc__)
