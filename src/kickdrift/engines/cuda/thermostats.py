"""Heat baths on the device that rescale all velocities by one factor: velocity rescaling and chains of Nosé-Hoover.

The factor comes from the code of the processor's baths. The kinetic energy is a sum in the order of the caller,
whatever the order of the list. An engine's particles are in the frame of their centre of mass, so all of this energy is
heat.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from kickdrift.engines.cuda.baths import count_step, normals, set_step, uniforms
from kickdrift.engines.cuda.launches import Launches, zeros
from kickdrift.engines.cuda.law_code import HELPERS, Code, in_precision
from kickdrift.engines.cuda.particles import Particles
from kickdrift.engines.job import Job
from kickdrift.integrators.options import TAU, TEMPERATURE
from kickdrift.integrators.splitting.baths import csvr, nose_hoover
from kickdrift.integrators.splitting.baths.bath import bathed
from kickdrift.integrators.splitting.method import Splitting

SUMS = (16_384, 128)  # sums of each pass over the particles
DRAWS = 8
CHAIN = "N"
FACTOR, HEAT = 0, 1  # places in the numbers of a bath; those of a chain follow


class Wanted(NamedTuple):
    """What the processor's code reads of a bath."""

    freedom: float
    thermal: float
    seed: int


class Chain(NamedTuple):
    """What the processor's code reads of a chain."""

    bath: Wanted
    masses: Any
    state: Any


def draw(places, room, stage, step, seed):
    """Fill ``room`` (3, 8) with draws, see ``csvr.draw``."""
    for k in range(DRAWS):
        first, second, third, fourth = uniforms(k, stage, step, seed)
        x, y, _ = normals(first, second, third, fourth)
        room[0, k], room[1, k], room[2, k] = x, y, third


HELPERS[csvr.draw] = draw


@cuda.jit
def write_energies(v, ids, masses, energies):
    """Write the kinetic energy of each particle, in the order of ``ids``."""
    i = cuda.grid(1)
    if i < ids.size:
        energies[ids[i]] = 0.5 * masses[ids[i]] * (v[0, i] * v[0, i] + v[1, i] * v[1, i] + v[2, i] * v[2, i])


@cuda.jit
def add_up(numbers, sums):
    """Write the sum of every so many numbers."""
    t = cuda.grid(1)
    if t < sums.size:
        total = 0.0
        for k in range(t, numbers.size, sums.size):
            total += numbers[k]
        sums[t] = total


@cuda.jit
def scale(v, own):
    """Scale the velocities (3, n)."""
    i = cuda.grid(1)
    if i < v.shape[1]:
        for k in range(3):
            v[k, i] *= own[FACTOR]


def rescaling_of(wanted: Wanted, tau: float) -> Code:
    """Kernel that writes the factor of velocity rescaling, and adds the heat."""
    factor_of = in_precision(csvr.factor_of, False)
    freedom, thermal, seed = wanted

    @cuda.jit
    def rescaling(sums, room, span, steps, stage, own):
        if cuda.grid(1) == 0:
            energy, factor = 0.0, 1.0
            for k in range(sums.size):
                energy += sums[k]
            if energy > 0.0:
                factor = factor_of(energy, Wanted(freedom, thermal, seed), tau, room, room, span, steps[0], stage)
            own[FACTOR] = factor
            own[HEAT] += energy * (factor * factor - 1.0)

    return rescaling


def chain_of(wanted: Wanted) -> Code:
    """Kernel that writes the factor of a chain, moves the chain and writes the heat."""
    chain_step = in_precision(nose_hoover.chain_step, False)
    chain_energy = in_precision(nose_hoover.chain_energy, False)
    first, second, third = (float(step) for step in nose_hoover.STEPS)
    freedom, thermal, seed = wanted

    @cuda.jit
    def chain(sums, masses, state, span, own):
        if cuda.grid(1) == 0:
            energy, factor = 0.0, 1.0
            for k in range(sums.size):
                energy += sums[k]
            parts = Chain(Wanted(freedom, thermal, seed), masses, state)
            for part in (first, second, third):
                factor *= chain_step(parts, energy * factor * factor, part * span)
            own[FACTOR], own[HEAT] = factor, -chain_energy(parts)

    return chain


class Thermostat:
    """The bath of a run's method; the parts are those of `baths.Bath`."""

    def __init__(self, job: Job, launches: Launches) -> None:
        assert isinstance(job.method, Splitting)
        system, options, self._launches = job.system, job.options, launches
        flow: Any = SimpleNamespace(subject=system)
        bath = bathed(flow, options, (TEMPERATURE, TAU), conserving=True)
        n, tau, wanted = len(system), float(options.tau), Wanted(bath.freedom, bath.thermal, bath.seed)
        self._spans = (job.method.further_stages[0] * (options.dt or 0.0)).tolist()
        self._masses, self._energies = cuda.to_device(np.ascontiguousarray(bath.masses[:n])), zeros(n, float)
        self._sums = [zeros(min(n, size), float) for size in SUMS]
        self._own, self._steps, self._room = zeros(2, float), zeros(1, np.int64), zeros((3, DRAWS), float)
        chained = job.method.further == CHAIN
        masses = np.full(int(options.chain) if chained else 1, bath.thermal * tau**2)
        masses[0] *= bath.freedom
        self._chain, self._state = cuda.to_device(masses), zeros((2, len(masses)), float)
        self._factor = chain_of(wanted) if chained else rescaling_of(wanted, tau)
        self._chained = chained
        self._kept = [cuda.to_device(each.copy_to_host()) for each in (self._own, self._state)]

    def act(self, particles: Particles, stage: int) -> None:
        """Let the bath act at the end of a stage."""
        p, over, numbers, span = particles, self._launches.over, self._energies, self._spans[stage]
        over(p.n, write_energies, p.v, p.ids, self._masses, numbers)
        for sums in self._sums:
            over(sums.size, add_up, numbers, sums)
            numbers = sums
        if self._chained:
            over(1, self._factor, numbers, self._chain, self._state, span, self._own)
        else:
            over(1, self._factor, numbers, self._room, span, self._steps, stage, self._own)
        over(p.n, scale, p.v, self._own)

    def step_on(self) -> None:
        """Go to the numbers of the next step."""
        self._launches.over(1, count_step, self._steps)

    def go_to(self, step: int) -> None:
        """Go to the numbers of a step of the run."""
        self._launches.over(1, set_step, self._steps, step)

    def keep(self) -> None:
        """Keep the heat and the chain."""
        for kept, own in zip(self._kept, (self._own, self._state), strict=True):
            kept.copy_to_device(own, stream=self._launches.stream)

    def settle(self) -> None:
        """Take the heat and the chain that were kept."""
        for kept, own in zip(self._kept, (self._own, self._state), strict=True):
            own.copy_to_device(kept, stream=self._launches.stream)

    @property
    def heat(self) -> float:
        """Energy that the bath has given."""
        return float(self._launches.read(self._own)[HEAT])
