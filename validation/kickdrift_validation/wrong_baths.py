"""Small simulations in NumPy with faults that can be switched on: oscillators in a bath, and a gas with a barostat.

Both run many copies of a system side by side; the samples of one copy follow those of another. k_B T is 1.

The oscillators have frequency 1 and masses 1 and 3. They start at random phases, each with twice the mean energy of
equilibrium. The word is BAOAB.

The gas has N particles that repel each other at any distance: U = a N^2 / V. Its volume has the density V^N
exp(-(P V + U) / k_B T), so that the mean pressure inside is P. The barostat is that of Martyna, Tobias & Klein 1994,
doi:10.1063/1.467468, with noise and drag on its momentum p (Feller et al. 1995, doi:10.1063/1.470648):

dV/dt = 3 V p / W,  dv/dt = -(1 + 1/N) (p / W) v,  dp/dt = 3 V (P_inside - P) + 2 K / N,
P_inside = 2 K / 3 V + a N^2 / V^2.
"""

import math
from collections.abc import Callable

import numpy as np

from kickdrift.analysis.certify.sampled_run import SampledRun, kinetic_groups

COPIES, PARTICLES, SETTLING, EVERY = 40, 12, 600, 20
FRICTION, DT = 2.0, 0.02
REPULSION = 0.5  # a
INERTIA = 3.0 * PARTICLES  # W

Samples = tuple[np.ndarray, ...]


def sampled(step: Callable[[int], None], look: Callable[[], Samples], steps: int) -> list[np.ndarray]:
    """What ``look`` returns during the steps. The first axis of each array becomes copies times samples."""
    seen = []
    for done in range(SETTLING + steps):
        step(done)
        if done >= SETTLING and done % EVERY == 0:
            seen.append(look())
    return [np.concatenate(np.array(each).swapaxes(0, 1)) for each in zip(*seen, strict=True)]


def described(name: str, velocities: np.ndarray, masses: np.ndarray, species: np.ndarray) -> SampledRun:
    """A run with these velocities (samples, n, 3)."""
    groups = kinetic_groups(lambda: [velocities], masses, species, 3, False)
    return SampledRun(
        name=name, boltzmann=1.0, particles=len(masses), freedom=3.0 * len(masses),
        kinetic=np.sum([each.kinetic for each in groups[:3]], axis=0), groups=groups, potential=None,
        volume=np.full(len(velocities), np.inf), temperature=1.0, pressure=None, bath=True,
        likeness=(name, len(masses)),
    )  # fmt: skip


def oscillators(
    seed: int, steps: int = 3000, *, axes: int = 3, species: str = "AB", strength: float = 1.0, reused: int = 1
) -> SampledRun:
    """Samples of oscillators. The bath acts on the first ``axes`` axes of these ``species``; the variance of its noise
    has this ``strength``, and a number is used in so many steps."""
    rng = np.random.default_rng(seed)
    names = np.array(["A", "B"] * (PARTICLES // 2))
    masses = np.where(names == "A", 1.0, 3.0)
    shape, width = (COPIES, PARTICLES, 3), 1.0 / np.sqrt(masses)[:, np.newaxis]
    phase = rng.uniform(0.0, 2.0 * math.pi, shape)
    x, v = 2.0 * width * np.cos(phase), 2.0 * width * np.sin(phase)
    acts = np.isin(names, list(species))[:, np.newaxis] & (np.arange(3) < axes)
    kept = np.where(acts, math.exp(-FRICTION * DT), 1.0)
    spread = width * np.sqrt(strength * (1.0 - kept**2))
    noise = np.empty(shape)

    def step(done: int) -> None:
        nonlocal noise
        if done % reused == 0:
            noise = rng.normal(size=shape)
        v[...] -= 0.5 * DT * x
        x[...] += 0.5 * DT * v
        v[...] = kept * v + spread * noise
        x[...] += 0.5 * DT * v
        v[...] -= 0.5 * DT * x

    (velocities,) = sampled(step, lambda: (v.copy(),), steps)
    return described("oscillators", velocities, masses, names)


def gas(
    seed: int, pressure: float, steps: int = 3000, *, noise_mass: float = 1.0, kinetic_pressure: bool = True
) -> SampledRun:
    """Samples of the gas.

    ``noise_mass`` is the mass in the barostat's noise over the mass in its motion. Without ``kinetic_pressure`` the
    barostat leaves out 2 K / 3 V."""
    rng = np.random.default_rng(seed)
    v, p = rng.normal(size=(COPIES, PARTICLES, 3)), rng.normal(size=COPIES) * math.sqrt(INERTIA)
    volume = np.full(COPIES, PARTICLES / pressure)
    kept = math.exp(-FRICTION * DT)
    spread = math.sqrt(1.0 - kept**2)

    def push() -> None:
        """Change the barostat's momentum for half a step."""
        twice = (v * v).sum(axis=(1, 2))
        inside = REPULSION * PARTICLES**2 / volume**2 + (twice / (3.0 * volume) if kinetic_pressure else 0.0)
        p[:] += 0.5 * DT * (3.0 * volume * (inside - pressure) + twice / PARTICLES)

    def squeeze() -> None:
        """Scale the velocities for half a step."""
        v[...] *= np.exp(-0.5 * DT * (1.0 + 1.0 / PARTICLES) * p / INERTIA)[:, np.newaxis, np.newaxis]

    def step(done: int) -> None:
        push()
        squeeze()
        volume[:] *= np.exp(3.0 * DT * p / INERTIA)
        squeeze()
        push()
        v[...] = kept * v + spread * rng.normal(size=v.shape)
        p[:] = kept * p + spread * math.sqrt(noise_mass * INERTIA) * rng.normal(size=COPIES)

    velocities, volumes = sampled(step, lambda: (v.copy(), volume.copy()), steps)
    energies = REPULSION * PARTICLES**2 / volumes
    inside = (velocities**2).sum(axis=(1, 2)) / (3.0 * volumes) + energies / volumes
    run = described("gas", velocities, np.ones(PARTICLES), np.array(["A"] * PARTICLES))
    return SampledRun(
        **{**vars(run), "potential": energies, "volume": volumes, "pressure": pressure, "pressures": inside}
    )
