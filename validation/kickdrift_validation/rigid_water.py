"""Rigid water: constraints at rounding, energy without drift, and equipartition against the step.

Velocity Verlet keeps an energy near the true one, in whose equilibrium fast motion has less kinetic energy at whole
steps h: m v^2 lacks h^2 / 6 times the mean of F^2 / m, for each degree of freedom, to leading order (Eastwood et al.
2010, doi:10.1021/ct9002916). Torques on water are strong, and forces on its centres weak. So rotation shows a lower
temperature than translation, by a part that grows with the square of the step (Asthagiri & Beck 2024,
arXiv:2308.08383). Forces at one moment give this part to a few per cent; the temperatures need nanoseconds for that.
"""

from collections.abc import Iterator

import numpy as np

import kickdrift as kd
from kickdrift.statistics.blocks import block_average
from kickdrift_validation.claim import Claim, at_most, claim, main

STEPS, ALL_STEPS = (1.0, 2.0, 4.0), (0.5, 1.0, 2.0, 3.0, 4.0)  # fs; all with --long
TIME, LONG, WARM = 24.0, 2000.0, 4.0  # ps; LONG takes three hours of a core for all steps together
WANTED = 0.2  # K, error of the difference after LONG


def water(count: int = 216) -> kd.System:
    """SPC/E water on a lattice, each molecule turned at random."""
    text = kd.template("water").replace("216", str(count)).replace("accuracy = 1e-4", "accuracy = 1e-3")
    system = kd.load(toml(text))
    assert isinstance(system, kd.System)
    return system


def toml(text: str) -> dict[str, object]:
    import tomllib

    return tomllib.loads(text)


def warm(system: kd.System, time: float) -> kd.State:
    """A state of the liquid at 298 K, at rest as a whole."""
    sim = kd.Simulation(system, "baoab", dt=0.002, temperature=298.0, friction=5.0)
    sim.run(time=time)
    state = sim.state
    state.phase[1] -= (state.phase[1] @ state.masses / state.masses.sum())[:, None]
    return state


def temperatures(system: kd.System, state: kd.State, dt: float, time: float) -> dict[str, tuple[float, float]]:
    """Temperatures of translation and rotation, and their difference, with errors, at constant energy."""
    sim = kd.Simulation(system, "velocity-verlet", dt=1e-3 * dt)
    sim.state = system.at(state.phase, 0.0).state
    report = sim.run(time=time, every=round(16.0 / dt))
    samples = sim.record.samples[20:]
    moving, turning = (
        np.array([sample.columns[f"{kind}_temperature"] for sample in samples]) for kind in ("translation", "rotation")
    )
    found = {"translation": moving, "rotation": turning, "difference": turning - moving}
    errors = {kind: (float(row.mean()), float(block_average(row).error)) for kind, row in found.items()}
    assert report.molecules is not None
    bias = report.molecules.step_bias
    found_bias = bias["translation"] - bias["rotation"], 0.05 * bias["rotation"]
    return errors | {"residual": (report.molecules.error, 0.0), "bias": found_bias}


def claims(long: bool = False) -> Iterator[Claim]:
    system = water()
    state = warm(system, WARM)
    for dt in ALL_STEPS if long else STEPS:
        each = temperatures(system, state, dt, LONG if long else TIME)
        yield at_most(f"{dt:g} fs: largest relative error of a distance", each["residual"][0], 1e-13, "rounding")
        mean, error = each["difference"]
        text = f"{dt:g} fs: rotation less translation, {each['translation'][0]:.1f} K, in K, ± {error:.1f}"
        expected, spread = each["bias"]
        yield claim(
            text, mean, f"{expected:.2f} by the forces and torques, within 4 errors",
            abs(mean - expected) < 4.0 * (error + spread), "modified energy of velocity Verlet",
        )  # fmt: skip
        if long:
            yield at_most(f"{dt:g} fs: error of that difference, in K", error, WANTED, "two nanoseconds")


if __name__ == "__main__":
    main(claims, __doc__)
