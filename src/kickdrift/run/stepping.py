"""The flow of a run's system and the stepper of its method, and a step of another length in a copy of the stepper.

The copy has a flow of its own, so that the run's pair lists and its noise stay as they are. A heat bath acts in the
copy from the memory of the run's bath, and with the random numbers of the step that the copy shortens.
"""

from collections.abc import Callable
from typing import Any

from kickdrift.engines import Engine
from kickdrift.engines.job import Job
from kickdrift.engines.session import RunFlow, begin
from kickdrift.errors import InputError
from kickdrift.integrators.flows.flow import flow_of
from kickdrift.integrators.flows.particle_flow import ParticleFlow
from kickdrift.integrators.options import MIXED, coupling_of
from kickdrift.integrators.stepping.stepper import Counts
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System


def purpose_of(integrator: str, subject: System | Problem) -> str:
    """The method, and the forces or the Problem: "velocity-verlet for lennard-jones"."""
    forces = subject.forces if isinstance(subject, System) else ()
    names = dict.fromkeys(getattr(force, "name", type(force).__name__) for force in forces)
    return f"{integrator} for {' and '.join(names) or subject.name}"


def stepping(engine: Engine, job: Job) -> tuple[RunFlow, Any]:
    """A flow of the job's system, and the stepper of its method.

    Raises InputError if the method needs separable accelerations and the system has others."""
    if engine.foreign:
        return begin(engine, job)
    method, options = job.method, job.options
    method.check_constraints(job.system)
    mixed = options.precision == MIXED
    flow = flow_of(job.system, job.threads, jumps=method.trial_steps, mixed=mixed, coupling=coupling_of(options))
    carried = method.carries_unknowns and getattr(flow, "carries", False)
    if method.separable and flow.not_separable and not carried:
        raise InputError(
            f"{job.named}: needs accelerations that depend on positions and time alone, and {flow.not_separable}; "
            "Runge-Kutta methods do not"
        )
    if isinstance(job.system, System) and not method.reflects and (walls := job.system.acting("reflects")):
        raise InputError(
            f"{job.named}: integrates a force, and {walls[0]!r} has none: it turns velocities at once; "
            "splitting methods such as velocity-verlet bounce in their drift"
        )
    if method.bath and isinstance(flow, ParticleFlow):
        flow.count_bath(method.drags)
    return flow, method.stepper(flow, options)


class Shortened:
    """Shortened steps of a run, in a copy that is kept while the run goes on in one direction with the same bodies.

    It does not hold the run, so that a run that nobody holds is freed at once.

    Attributes
    ----------
    heat : energy that the bath has given by the end of the last shortened step; None without a bath
    """

    def __init__(self) -> None:
        self._last: Any = None
        self.heat: float | None = None

    def step(self, run: Any, time: float) -> tuple[int, Floats, Counts]:
        """Take one step from the run's step point to ``time``. Return a status, y and the cost."""
        assert run.dt is not None
        rest = abs(time - run.stepper.time)

        def made(dt: float) -> Any:
            return run.stepper_in(run.backward, run.options.changed(dt=dt))[1]

        self._last = stepper = of_length(rest, self._last, made)
        inner = own_stepper(stepper)
        if hasattr(inner, "begin_from"):
            inner.begin_from(own_stepper(run.stepper))
        else:
            stepper.reset(run.stepper.y.copy(), run.stepper.time, run.stepper.steps_done)
        before = stepper.counts
        status = stepper.advance(1)
        run.record.unfinished = run.dt - rest
        self.heat = getattr(inner, "heat", None)
        return status, stepper.y.copy(), stepper.counts - before


def of_length(dt: float, last: Any, made: Callable[[float], Any]) -> Any:
    """A stepper with steps of this length: the last one, where it can change their length, else one that is made."""
    inner = own_stepper(last)
    if not hasattr(inner, "retimed"):
        return made(dt)
    inner.retimed(dt)
    return last


def own_stepper(stepper: Any) -> Any:
    """The method's own stepper, without what goes back in time or watches events around it."""
    return getattr(stepper, "inner", stepper)
