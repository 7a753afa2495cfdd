"""Runs on the device: words of kicks and drifts, in blocks of steps between two looks at the list of neighbours.

A block takes as many steps as the list likely lasts. If a particle then has gone further than half the skin, the block
is taken back and run again with a new list. The bits are the same, because no sum depends on the list.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import cuda

from kickdrift.engines.cuda.device import blocks, check_device
from kickdrift.engines.cuda.motion import FAR, NOT_FINITE, TOO_LARGE, move_of
from kickdrift.engines.cuda.particles import DeviceForces, GravityForces, PairForces
from kickdrift.engines.job import Job
from kickdrift.engines.session import Session, Trouble
from kickdrift.forces import Gravity
from kickdrift.forces.bound.forces import Measured
from kickdrift.integrators.options import MIXED
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.model.state import Floats

FIRST_BLOCK = 4  # steps, before the life of a list is known
LONGEST_BLOCK = 1000
SURE = 0.9  # of the expected life of a list


class CudaSession(Session):
    """Particles on the device."""

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        check_device()
        assert isinstance(job.method, Splitting)
        system, single = job.system, job.options.precision == MIXED
        gravity = isinstance(system.forces[0], Gravity)
        self._forces: DeviceForces = GravityForces(system, single) if gravity else PairForces(system, single)
        self._move = move_of(self._forces.places)
        dt = job.options.dt or 0.0
        self._stages = [(kick * dt, drift * dt) for kick, drift in job.method.stages[:2].T.tolist()]

    def reset(self, phase: Floats, time: float) -> None:
        self._particles = self._forces.upload(phase)
        self._kept = [cuda.device_array((3, self._particles.n), np.float64) for _ in range(3)]
        self._stale, self._life, self._age = True, float(FIRST_BLOCK), 0
        self.lists = 1  # made since the start

    def advance(self, steps: int, until: float) -> int:
        done = 0
        while done < steps:
            count = min(steps - done, self._lasting())
            self._keep()
            self._take(count)
            if self._checked(count):
                done += count
        return steps

    def _lasting(self) -> int:
        """Number of steps that the list likely lasts; make a new list if none."""
        left = int(SURE * self._life) - self._age
        if left < 1:
            self._anew()
            self._age, left = 0, max(1, int(SURE * self._life))
        return min(left, LONGEST_BLOCK)

    def _anew(self) -> None:
        self._forces.prepare(self._particles)
        self.lists += 1

    def _keep(self) -> None:
        p = self._particles
        for kept, mine in zip(self._kept, (p.x, p.v, p.a), strict=True):
            kept.copy_to_device(mine)
        self._kept_stale = self._stale

    def _take(self, count: int) -> None:
        """Take steps: each move has the kick that ends one stage and the kick and the drift of the next."""
        ending = 0.0
        for _ in range(count):
            for kick, drift in self._stages:
                if kick and self._stale:
                    self._forces.evaluate(self._particles)
                    self._stale = False
                if drift:
                    self._moved(ending, kick, drift)
                    ending, self._stale = 0.0, True
                else:
                    ending = kick
        if ending:
            self._moved(ending, 0.0, 0.0)

    def _moved(self, ending: float, kick: float, drift: float) -> None:
        p = self._particles
        self._move[blocks(p.n)](p.x, p.v, p.a, p.at, p.placed, p.marks, ending, kick, drift)

    def _checked(self, count: int) -> bool:
        """Tell whether the list lasted; if not, go back to the begin of the block."""
        marks = self._particles.marks.copy_to_host()
        way = float(np.sqrt(marks[FAR])) / self._forces.half_skin
        if way > 1.0 and not marks[NOT_FINITE]:
            p = self._particles
            for kept, mine in zip(self._kept, (p.x, p.v, p.a), strict=True):
                mine.copy_to_device(kept)
            self._stale, self._life = self._kept_stale, max(1.0, 0.7 * min(self._life, self._age + count))
            if self._age == 0 and count == 1:
                raise Trouble("a particle moved further than the skin of the list in one step")
            self._anew()
            self._age = 0
            return False
        if marks[TOO_LARGE]:
            raise Trouble("the forces are too large for their sums; particles are too near to each other")
        if marks[NOT_FINITE]:
            raise Trouble("positions or velocities are no longer finite")
        self._age += count
        self._life = min(self._age / max(way, 1e-3), 2.0 * self._age + FIRST_BLOCK)
        return True

    def phase(self) -> Floats:
        return self._particles.phase()

    def finite(self) -> bool:
        return True  # `advance` raises Trouble

    def measure(self, time: float) -> Measured | None:
        accelerations, potential, virial = self._forces.measure(self._particles)
        if not (np.isfinite(accelerations).all() and np.isfinite(potential)):
            return None
        return Measured(accelerations, potential, virial, None)
