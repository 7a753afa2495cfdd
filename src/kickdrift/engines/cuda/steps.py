"""Runs on the device: words of kicks and drifts, in blocks of steps between two looks at the list of neighbours.

A block takes as many steps as the list likely lasts. If a particle then has gone further than half the skin, the block
is taken back and runs again with a new list. The bits are the same, because no sum depends on the list.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from kickdrift.engines.cuda.baths import Bath
from kickdrift.engines.cuda.device import GO_ON, check_device, failure
from kickdrift.engines.cuda.forces import DeviceForces, GravityForces, PairForces
from kickdrift.engines.cuda.launches import Launches
from kickdrift.engines.cuda.motion import FAR, NOT_FINITE, TOO_LARGE, move_of
from kickdrift.engines.cuda.thermostats import Thermostat
from kickdrift.engines.job import RESCALING, Job
from kickdrift.engines.session import Session, Trouble
from kickdrift.errors import InputError
from kickdrift.forces import Gravity
from kickdrift.forces.bound.forces import Measured
from kickdrift.forces.laws.law import not_compiled
from kickdrift.integrators.options import MIXED
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.model.state import Floats

FIRST_BLOCK = 4  # steps, before the life of a list is known
LONGEST_BLOCK = 1000
GRAPHS = (64, 16, 4, 1)  # steps of one graph
SURE = 0.92  # of the expected life of a list


class CudaSession(Session):
    """Particles on the device.

    Attributes
    ----------
    lists, returns : numbers of lists made and of blocks taken back
    """

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        check_device()
        assert isinstance(job.method, Splitting)
        system, single, self.launches = job.system, job.options.precision == MIXED, Launches()
        kind = GravityForces if isinstance(system.forces[0], Gravity) else PairForces
        self.forces: DeviceForces = kind(system, self.launches, single)
        self._move = move_of(self.forces.write)
        dt = job.options.dt or 0.0
        self._stages = [(kick * dt, drift * dt) for kick, drift in job.method.stages[:2].T.tolist()]
        self._fresh = job.method.ends_fresh
        self._shaken = (job.method.further_stages[0] != 0.0).tolist()  # stages at whose end the bath acts
        last_kick, last_drift = self._stages[-1]
        # the kick that ends a step, and joins the next step's first
        self._ending = 0.0 if last_drift or self._shaken[-1] else last_kick

    def reset(self, phase: Floats, time: float) -> None:
        try:
            self._begin(phase)
        except Exception as error:
            if told := failure(error, phase.shape[2]):
                raise told from None
            raise

    def _begin(self, phase: Floats) -> None:
        self.launches.forget()
        self.particles = self.forces.upload(phase)
        self._life, self._age, self.lists, self.returns = float(FIRST_BLOCK), 0, 1, 0
        self._taken = self.steps_before
        self._bath = self._bathed()
        self._compile()
        self._keep()

    def _bathed(self) -> Bath | Thermostat | None:
        assert isinstance(self.job.method, Splitting)
        if not self.job.method.bath:
            return None
        return (Thermostat if self.job.method.further in RESCALING else Bath)(self.job, self.launches)

    def _compile(self) -> None:
        """Evaluate the forces. Raises InputError for a law that numba cannot compile for the device."""
        try:
            self.forces.evaluate(self.particles)
        except Exception as error:
            law = getattr(self.job.system.forces[0], "law", None)
            if law is None or not type(error).__module__.startswith("numba") or failure(error, self.particles.n):
                raise
            text = str(not_compiled(type(law), error)).replace(" for SIMD lanes", " for the device")
            raise InputError(f"engine 'cuda': {text}; {GO_ON}") from None

    def advance(self, steps: int, until: float) -> int:
        done = 0
        while done < steps:
            count = min(steps - done, self._lasting())
            if self._age:
                self._keep()
            self._take(count)
            if self._checked(count):
                done += count
        return steps

    def _lasting(self) -> int:
        """Number of steps that the list likely lasts; make a new list if none."""
        if int(SURE * self._life) <= self._age:
            self._anew()
        return min(max(1, int(SURE * self._life)) - self._age, LONGEST_BLOCK)

    def _keep(self) -> None:
        """Keep the state, to which a block that fails goes back."""
        self.launches.repeat("keep", self.particles.keep)
        if self._bath:
            self._bath.keep()

    def _anew(self) -> None:
        self.forces.prepare(self.particles)
        if self._bath:
            self._bath.keep()
        self._age, self.lists = 0, self.lists + 1

    def _take(self, count: int) -> None:
        repeat, left = self.launches.repeat, count - 1
        if self._bath:
            self._bath.go_to(self._taken)
        repeat("first", partial(self._walk, 1, 0.0))
        for size in GRAPHS:
            for _ in range(left // size):
                repeat(("next", size), partial(self._walk, size, self._ending))
            left %= size
        if self._ending:
            repeat("last", partial(self.moved, self._ending, 0.0, 0.0))

    def _walk(self, count: int, ending: float) -> None:
        """Take steps, after the kick that ends the step before; leave out the last kick of the last one."""
        for _ in range(count):
            fresh = self._fresh
            for stage, (kick, drift) in enumerate(self._stages):
                if kick and not fresh:
                    self.forces.evaluate(self.particles)
                    fresh = True
                if drift or (self._shaken[stage] and (kick or ending)):
                    self.moved(ending, kick, drift)
                    ending, fresh = 0.0, fresh and not drift
                else:
                    ending = kick or ending
                if self._bath and self._shaken[stage]:
                    self._bath.act(self.particles, stage)
            if self._bath:
                self._bath.step_on()

    def moved(self, ending: float, kick: float, drift: float) -> None:
        """Move the particles, see `move_of`."""
        p = self.particles
        self.launches.over(p.n, self._move, p.x, p.v, p.a, p.at, p.placed, p.marks, ending, kick, drift)

    def _checked(self, count: int) -> bool:
        """Tell whether the list lasted; if not, go back to the begin of the block."""
        marks = self.launches.read(self.particles.marks)
        way = float(np.sqrt(marks[FAR])) / self.forces.half_skin
        fits = self.forces.fits(self.particles, marks)
        if way > 1.0 or not fits:
            self.particles.settle()
            if self._bath:
                self._bath.settle()
            if fits and self._age == 0 and count == 1:
                raise Trouble("a particle moves further than the skin of its list in one step")
            self._life = max(1.0, 0.8 * (self._age + count)) if fits else self._life
            self.returns += 1
            self._anew()
            return False
        if marks[TOO_LARGE]:
            raise Trouble("the forces are too large for their sums; particles are too near to each other")
        if marks[NOT_FINITE]:
            raise Trouble("positions or velocities are no longer finite")
        self._age, self._taken = self._age + count, self._taken + count
        self._life = min(self._age / max(way, 1e-3), 2.0 * self._age + FIRST_BLOCK)
        return True

    def phase(self) -> Floats:
        return self.particles.phase()

    @property
    def heat(self) -> float:
        return self._bath.heat if self._bath else 0.0

    def finite(self) -> bool:
        return True  # `advance` raises Trouble

    def measure(self, time: float) -> Measured | None:
        accelerations, potential, virial = self.forces.measure(self.particles)
        if not (np.isfinite(accelerations).all() and np.isfinite(potential)):
            return None
        return Measured(accelerations, potential, virial, None)
