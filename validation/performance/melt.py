"""The Lennard-Jones melt that the performance scripts time, and how they time it."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np

import kickdrift as kd
from kickdrift.builders import lattice, maxwell_boltzmann

DENSITY, TEMPERATURE, CUTOFF, DT = 0.8442, 1.44, 2.5, 0.005


def melt(particles: int, steps: int, threads: int = 1) -> kd.Simulation:
    """A simple cubic lattice at T* = 1.44, cut and shifted at 2.5 sigma, after ``steps`` steps."""
    positions, edges = lattice("sc", particles, DENSITY)
    velocities = maxwell_boltzmann(np.ones(particles), TEMPERATURE, 1.0, seed=1)
    force = kd.LennardJones(cutoff=CUTOFF, truncation="shift")
    sim = kd.Simulation(kd.System(positions, velocities, box=edges, forces=[force]), dt=DT, threads=threads)
    run(sim, steps)
    return sim


def again(sim: kd.Simulation, threads: int = 1, **changes: Any) -> kd.Simulation:
    """A Simulation from the state of ``sim``; ``changes`` are arguments of System, such as other forces."""
    state = sim.state
    arguments = {"box": sim.system.box, "forces": sim.system.forces, **changes}
    return kd.Simulation(kd.System(state.positions, state.velocities, **arguments), dt=DT, threads=threads)


def run(sim: kd.Simulation, steps: int) -> None:
    """Take steps, and look at the energy at the start and at the end alone."""
    sim.run(steps, every=sim.steps_done + steps)


def timed(code: Any, steps: int) -> float:
    """Steps per second of ``code``, which has a ``run``, over ``steps`` steps."""
    began = perf_counter()
    run(code, steps) if isinstance(code, kd.Simulation) else code.run(steps)
    return steps / (perf_counter() - began)


def turns(codes: list[Any], seconds: float, count: int) -> np.ndarray:
    """(count, codes) steps per second: the codes take turns of about ``seconds`` (A B A B …), once warmed up."""
    steps = []
    for code in codes:
        speed = timed(code, max(20, int(timed(code, 20) * seconds / 2)))
        steps.append(max(20, int(speed * seconds)))
    return np.array([[timed(code, n) for code, n in zip(codes, steps, strict=True)] for _ in range(count)])
