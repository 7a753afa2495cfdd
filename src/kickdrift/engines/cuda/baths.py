"""Heat baths of random velocities on the device: friction with noise, and collisions.

The random numbers are the processor's: Philox at a particle's id, the stage and the step, see
``integrators.splitting.baths.velocity_noise``. Each particle keeps the heat that it has got, so that no sum depends on
the order of the particles.
"""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
from numba import cuda

from kickdrift.engines.cuda.launches import Launches, zeros
from kickdrift.engines.cuda.law_code import on_device
from kickdrift.engines.cuda.particles import Particles
from kickdrift.engines.job import Job
from kickdrift.integrators.options import FRICTION, RATE, TEMPERATURE
from kickdrift.integrators.splitting.baths.bath import bathed
from kickdrift.integrators.splitting.baths.velocity_noise import CHOICE, RULES, shares
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.jit.lanes.random import MULTIPLIERS, ROUNDS, WEYL

LOW, WORD = np.uint64(0xFFFFFFFF), np.uint64(32)
FIRST, SECOND = (np.uint64(each) for each in MULTIPLIERS)
FIRST_KEY, SECOND_KEY = (np.uint64(each) for each in WEYL)
COLLISIONS = "D"


@on_device
def uniforms(number, stage, step, seed):
    """Four numbers between 0 and 1, see ``jit.lanes.random.uniforms``."""
    number, step, seed = np.uint64(number), np.uint64(step), np.uint64(seed)
    a, c, d = number & LOW, step & LOW, step >> WORD
    b = (((number >> WORD) << np.uint64(16)) + np.uint64(stage)) & LOW
    key, other = seed & LOW, seed >> WORD
    for _ in range(ROUNDS):
        first, second = a * FIRST, c * SECOND
        a, b, c, d = (second >> WORD) ^ b ^ key, second & LOW, (first >> WORD) ^ d ^ other, first & LOW
        key, other = (key + FIRST_KEY) & LOW, (other + SECOND_KEY) & LOW
    scale = 2.0**-32
    return (
        (np.float64(a) + 0.5) * scale, (np.float64(b) + 0.5) * scale,
        (np.float64(c) + 0.5) * scale, (np.float64(d) + 0.5) * scale,
    )  # fmt: skip


@on_device
def normals(first, second, third, fourth):
    """Three standard normal numbers, see ``jit.lanes.random.normals``."""
    radius, half = math.sqrt(-2.0 * math.log(first)), (second - 0.5) * math.pi
    radius3, other = math.sqrt(-2.0 * math.log(third)), math.sin((fourth - 0.5) * math.pi)
    s, c = math.sin(half), math.cos(half)
    return radius * (1.0 - 2.0 * s * s), radius * 2.0 * s * c, radius3 * (1.0 - 2.0 * other * other)


@cuda.jit
def shake(v, ids, names, masses, spread, heat, steps, seed, stage, kept, noise, likely):
    """v <- kept v + noise sqrt(k_B T / m) R for velocities (axes, n) of each particle, with probability ``likely``."""
    i = cuda.grid(1)
    if i < ids.size:
        own, step = ids[i], steps[0]
        first, second, third, fourth = uniforms(names[own], stage, step, seed)
        x, y, z = normals(first, second, third, fourth)
        if likely < 1.0:
            first, _, _, _ = uniforms(names[own], stage + CHOICE, step, seed)
        if first < likely:
            some = noise * spread[own]
            p, q, r = kept * v[0, i] + some * x, kept * v[1, i] + some * y, kept * v[2, i] + some * z
            change = (p * p - v[0, i] ** 2) + (q * q - v[1, i] ** 2) + (r * r - v[2, i] ** 2)
            v[0, i], v[1, i], v[2, i] = p, q, r
            heat[own] += 0.5 * masses[own] * change


@cuda.jit
def count_step(steps):
    """Go to the numbers of the next step."""
    if cuda.grid(1) == 0:
        steps[0] += 1


@cuda.jit
def set_step(steps, step):
    """Go to the numbers of a step."""
    if cuda.grid(1) == 0:
        steps[0] = step


class Bath:
    """The bath of a run's method."""

    def __init__(self, job: Job, launches: Launches) -> None:
        assert isinstance(job.method, Splitting)
        system, options, self._launches = job.system, job.options, launches
        flow: Any = SimpleNamespace(subject=system)
        collides = job.method.further == COLLISIONS
        bath = bathed(flow, options, (TEMPERATURE, RATE if collides else FRICTION), conserving=False)
        n, dt = len(system), options.dt or 0.0
        self._seed = bath.seed
        self._names, self._masses, self._spread = (
            cuda.to_device(np.ascontiguousarray(each[:n])) for each in (bath.ids, bath.masses, bath.spread)
        )
        self._heat, self._kept, self._steps = zeros(n, float), zeros(n, float), zeros(1, np.int64)
        spans = (job.method.further_stages[0] * dt).tolist()
        if collides:
            self._parts = [(0.0, 1.0, -math.expm1(-float(options.collision_rate) * span)) for span in spans]
        else:
            rule, friction = RULES[job.method.further], float(options.friction)
            self._parts = [(*shares.py_func(rule, friction * span), 1.0) for span in spans]

    def act(self, particles: Particles, stage: int) -> None:
        """Let the bath act at the end of a stage."""
        p, own = particles, (self._names, self._masses, self._spread, self._heat, self._steps, self._seed)
        self._launches.over(p.n, shake, p.v, p.ids, *own, stage, *self._parts[stage])

    def step_on(self) -> None:
        """Go to the numbers of the next step."""
        self._launches.over(1, count_step, self._steps)

    def go_to(self, step: int) -> None:
        """Go to the numbers of a step of the run."""
        self._launches.over(1, set_step, self._steps, step)

    def keep(self) -> None:
        """Keep the heat of each particle."""
        self._kept.copy_to_device(self._heat, stream=self._launches.stream)

    def settle(self) -> None:
        """Take the heat that was kept."""
        self._heat.copy_to_device(self._kept, stream=self._launches.stream)

    @property
    def heat(self) -> float:
        """Energy that the bath has given."""
        return float(self._launches.read(self._heat).sum())
