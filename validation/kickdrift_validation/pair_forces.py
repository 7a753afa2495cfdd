"""Are pair forces minus the gradient of the energy, and pressures minus its slope in the volume?

A perturbed crystal of Lennard-Jones particles with each truncation, its cutoff between two shells of neighbours, so
that the energy is smooth: what the forces say along random directions, and the virial about a change of the box,
against differences of the energy, to the sixth order. force_gradients.py
has the other forces, mixtures, and the lists of a run.
"""

from collections.abc import Callable, Iterator

import numpy as np

import kickdrift as kd
from kickdrift.model.starts.builders import lattice
from kickdrift_validation.claim import Claim, at_most, largest, main

TRUNCATIONS = ("cut", "shift", "force-shift", "switch")
DENSITY, CELLS, SHAKE, CUTOFF, SWITCH_START = 0.8, 4, 0.01, 2.6, 1.8  # shells at 1.21, 1.71, 2.09, 2.42, 2.70 sigma
DIRECTIONS, STEP, SCALE = 6, 5e-4, 4e-3  # of a difference along a direction, and in the size of the box
SIXTH = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}  # of a central difference
DIFFERENCE = 1e-8
GRADIENT = "differences of the energy, sixth order"


def crystal() -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) positions of a face-centred cubic crystal, a little off their places, and the edges."""
    positions, edges = lattice("fcc", 4 * CELLS**3, DENSITY)
    return positions + SHAKE * np.random.default_rng(3).normal(size=positions.shape), np.asarray(edges)


def force(truncation: str, **more: float) -> kd.LennardJones:
    return kd.LennardJones(cutoff=CUTOFF, truncation=truncation, **more)


def slope(energy: Callable[[float], float], step: float) -> float:
    return sum(w * (energy(k * step) - energy(-k * step)) for k, w in SIXTH.items()) / step


def gradients(truncation: str) -> Iterator[Claim]:
    x, edges = crystal()
    law = force(truncation, **({"switch_start": SWITCH_START} if truncation == "switch" else {}))

    def sim(positions: np.ndarray, lengths: np.ndarray) -> kd.Simulation:
        return kd.Simulation(kd.System(positions, box=lengths, forces=[law]), dt=0.005)

    here, random = sim(x, edges), np.random.default_rng(4)
    forces, worst = here.forces(), 0.0
    for _ in range(DIRECTIONS):
        way = random.normal(size=x.shape)
        along = -slope(lambda d, way=way: sim(x + d * way, edges).energy().potential, STEP)
        worst = largest(worst, abs(float((forces * way).sum()) / along - 1.0))
    text = f"{truncation}: forces against the energy's slope, largest relative difference"
    yield at_most(text, worst, DIFFERENCE, GRADIENT)
    volume = float(np.prod(edges))
    by_scale = slope(lambda d: sim(x * (1 + d), edges * (1 + d)).energy().potential, SCALE)
    pressure, wanted = here.sample().pressure, -by_scale / (3.0 * volume)  # at rest: the virial's part is all
    text = f"{truncation}: pressure of the crystal at rest against -dU/dV, relative difference"
    yield at_most(text, abs(pressure / wanted - 1.0), DIFFERENCE, GRADIENT)


def claims(long: bool = False) -> Iterator[Claim]:
    for truncation in TRUNCATIONS:
        yield from gradients(truncation)


if __name__ == "__main__":
    main(claims, __doc__)
