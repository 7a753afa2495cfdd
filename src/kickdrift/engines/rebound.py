"""rebound: its leapfrog, whfast, saba, trace and ias15 under its own gravity.

Whfast and saba run without safe mode and keep the unsynchronised state (Rein & Tamayo 2015, doi:10.1093/mnras/stv1257).
A sample is a synchronised copy, so it never changes a run. Inside a step of ias15, a copy goes back from the last step
point to the requested time.

Forces and potential energy come from rebound's direct sum over a second set of the same bodies at rest.
"""

import ctypes
import warnings
from copy import copy
from typing import Any

import numpy as np

from kickdrift.bridges.rebound_system import COORDINATES, SABA, key_of
from kickdrift.engines.job import Job
from kickdrift.engines.session import Session, Trouble
from kickdrift.forces import Gravity
from kickdrift.forces.bound.forces import Measured
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import Floats
from kickdrift.model.system import System

ADAPTIVE = "gauss-radau15"
KEPLER = ("wisdom-holman", "saba")
OWN = ("kernel", "hill_radii", "pericentre", "inner")  # further options that rebound has


def refusal(job: Job) -> str | None:
    """See Engine."""
    system, options, masses = job.system, job.options, job.system.state.masses
    strange = [force.name for force in system.forces if type(force) is not Gravity]
    if strange:
        return f"force {strange[0]!r}: rebound runs only gravity"
    if len(system.forces) > 1:
        return "force 'gravity': the system has two"
    if system.box.periodic:
        return "box: rebound's periodic boundaries differ from kickdrift's"
    if system.units.coherent_mass != 1.0:
        return f"units {system.units.name!r}: rebound needs units in which force is mass times acceleration"
    if job.method.name in (*KEPLER, "trace"):
        if not system.forces or system.forces[0].softening:
            return f"integrator {job.named!r}: Kepler orbits need gravity without softening"
        if np.argmax(masses) != 0:
            return f"integrator {job.named!r}: rebound's central body is the first, but {system.body(0)} is lighter"
        known = COORDINATES.values() if job.method.name == "wisdom-holman" else ("jacobi",)
        if job.method.name in KEPLER and options.coordinates not in known:
            return f"coordinates {options.coordinates!r}: rebound's {job.method.name} has jacobi"
    if job.method.name == "saba" and not key_of(SABA, options.order or ""):
        return f"order {options.order!r}: rebound's saba has {', '.join(SABA.values())}"
    return None


class ReboundSession(Session):
    """A running rebound.Simulation, and one for samples."""

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        options = job.options
        self._plain = _asked(job.system, RunDefaults())
        self._system = _asked(
            job.system,
            RunDefaults(
                job.method.name, options.dt, rtol=options.rtol, coordinates=options.coordinates,
                corrector=options.corrector, order=options.order,
                **{name: options.get(name) for name in OWN},
            ),
        )  # fmt: skip
        self._probe: Any = None

    def reset(self, phase: Floats, time: float) -> None:
        from kickdrift.bridges.rebound import simulation_of

        with warnings.catch_warnings():
            warnings.simplefilter("error")  # a warning names what is left out
            self._sim = simulation_of(self._system.at(phase, time))
            self._probe = self._probe or simulation_of(self._plain)
        if self.hint:
            self._sim.dt = self.hint
        if self.job.method.name in KEPLER:
            self._sim.integrator.safe_mode = 0
            self._sim.integrator.keep_unsynchronized = 1
        self.last_step, self._inside = 0.0, (time, self._sim)

    @property
    def time(self) -> float:  # type: ignore[override]
        return float(self._sim.t)

    def advance(self, steps: int, until: float) -> int:
        try:
            return self._advanced(steps, until)
        except RuntimeError as error:  # rebound's messages
            raise Trouble(f"rebound: {' '.join(str(error).split())}") from None

    def _advanced(self, steps: int, until: float) -> int:
        sim, taken = self._sim, 0
        if self.job.method.name != ADAPTIVE:
            sim.steps(steps)
            return steps
        while taken < steps and sim.t < until:
            before = sim.t
            sim.steps(1)
            taken += 1
            if sim.t == before:
                raise Trouble(f"ias15's step fell to {sim.dt:.3g}, too short to change t = {sim.t:.9g}")
        self.last_step, self.hint = sim.dt_last_done, sim.dt
        self._inside = sim.t, sim
        return taken

    def phase(self) -> Floats:
        if not self._sim.is_synchronized:  # rebound 5's saba fails on this before its first step
            self._sim.synchronize()
        return _phase(self._sim)

    def _at(self, time: float) -> Any:
        """Simulation at a time inside the last step."""
        if self._inside[0] != time:
            there = self._sim.copy()
            there.dt = time - there.t
            there.integrate(time, exact_finish_time=1)
            self._inside = time, there
        return self._inside[1]

    def at(self, time: float) -> Floats:
        return _phase(self._at(time))

    def measure(self, time: float) -> Measured | None:
        import rebound

        x = self.at(time)[0] if self.job.method.name == ADAPTIVE else self.phase()[0]
        probe, still = self._probe, np.zeros((len(self._system), 3))
        probe.set_serialized_particle_data(xyz=np.ascontiguousarray(x.T), vxvyvz=still)
        rebound.clibrebound.reb_simulation_update_acceleration(ctypes.byref(probe))
        accelerations = np.array([(p.ax, p.ay, p.az) for p in probe.particles]).T
        potential = probe.energy()  # of bodies at rest
        if not np.isfinite(accelerations).all() or not np.isfinite(potential):
            return None
        return Measured(np.ascontiguousarray(accelerations), potential, np.nan, None)


session = ReboundSession  # see Engine


def _asked(system: System, run: RunDefaults) -> System:
    """System with this method in its run defaults."""
    other = copy(system)
    object.__setattr__(other, "run", run)
    return other


def _phase(sim: Any) -> Floats:
    x, v = np.zeros((sim.N, 3)), np.zeros((sim.N, 3))
    sim.serialize_particle_data(xyz=x, vxvyvz=v)
    return np.array([x.T, v.T])
