"""Going back in a run: to the last good state after an error, or to a checkpoint."""

from dataclasses import dataclass, replace
from typing import Any

from kickdrift.errors import InputError, RunError
from kickdrift.integrators.options import C_RESCALE, PRESSURE_EVERY, RAMP_STEPS
from kickdrift.integrators.splitting.barostats.barostat import every_of, every_of_old
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import unwarned
from kickdrift.model.memory import Memory
from kickdrift.model.state import Floats, State


@dataclass
class Safe:
    """The last state known to be good. A run that blows up goes back to this state."""

    y: Floats  # its own buffer
    time: float
    step: int
    box: Box | None = None  # of a run with a barostat


def go_back(run: Any) -> None:
    """Put a run back to its last good state, and forget the events after this state."""
    safe = run.safe
    run.record.events = [event for event in run.record.events if event["time"] <= safe.time]
    if safe.box is not None:
        run.flow.box = safe.box
    run.stepper.reset(safe.y.copy(), safe.time, safe.step)
    run.at, run.replaced = None, True


@unwarned
def failure(run: Any, inside_step: bool, stopped: bool) -> tuple[BaseException, BaseException | None]:
    """Return the error to raise and its cause.

    With ``inside_step``, the current step failed; otherwise the last completed step did. ``stopped`` means that the
    method itself cannot continue. The error's ``state`` is the last good state. An exception that Ctrl-C or `sys.exit`
    raised inside a Python function is returned unchanged."""
    stepper, flow, safe = run.stepper, run.moving, run.safe
    step = stepper.steps_done + inside_step
    dt = 0.0 if run.method.chooses_steps else (run.dt or 0.0)
    time = stepper.time + (-dt if run.backward else dt) * inside_step
    with_step = "" if run.method.chooses_steps else f", dt = {run.dt:g}"
    last = run.flow.state(safe.y, safe.time, safe.step)
    if safe.box is not None and isinstance(last, State):
        last = replace(last, box=safe.box)
    if stopped:
        message = (
            f"stopped at step {step} (t = {stepper.time:.6g}): {stepper.trouble}{flow.meeting(stepper.y, stepper.time)}"
        )
    else:
        reached, before = stepper.reached(inside_step)
        message = flow.explain(reached, before, safe.y, step, time, last.steps_done)
    raised = flow.raised
    if raised is not None and not isinstance(raised, Exception):
        return raised, raised.__cause__  # KeyboardInterrupt, SystemExit
    error = RunError(f"{run.integrator}{with_step}: {message}")
    error.state, error.failed_at = last, (step, time)
    return error, raised


def checkpoint_of(run: Any) -> Memory:
    """Return a checkpoint; see ``Simulation.checkpoint``."""
    return {
        "step": run.steps_done,
        "time": run.time,
        "integrator": run.method.name,
        "options": dict(run.options),
        "stepper": run.stepper.memory(),
        "present": run.at,
        "record": run.record.memory(),
    }


def restore(run: Any, checkpoint: Memory) -> None:
    """Continue from a checkpoint; see ``Simulation.restore``."""
    try:
        if run.ramp and (steps := checkpoint["options"].get(RAMP_STEPS.name)):
            run.ramp_over(steps)
        _check(run, checkpoint)
        run.recall(checkpoint)
    except InputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, MemoryError) as error:
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"checkpoint: does not fit a run of this system: {why[:200]}") from None


def _check(run: Any, checkpoint: Memory) -> None:
    """Refuse a checkpoint whose method, options or bodies differ."""
    own = {"integrator": run.method.name, **run.options}
    for key, value in {"integrator": checkpoint["integrator"], **checkpoint["options"]}.items():
        if own.get(key) != (tuple(value) if isinstance(value, list) else value):
            raise InputError(f"checkpoint: {key} is {value!r} in the checkpoint and {own.get(key)!r} in this run")
    barostat = checkpoint["stepper"].get("barostat")
    if barostat and PRESSURE_EVERY.name not in checkpoint["options"] and (every := every_of_old(run.options, barostat)):
        name, own_every = PRESSURE_EVERY.name, every_of(C_RESCALE, run.options)
        here = f"{own_every} in this run; give {name}={every}"
        raise InputError(f"checkpoint: {name} is {every} in the checkpoint and {here}")
    there, here = checkpoint["stepper"]["y"].shape, run.stepper.y.shape
    if there != here and not run.events:
        raise InputError(f"checkpoint: holds {there[-1]} particles or unknowns; the system has {here[-1]}")
