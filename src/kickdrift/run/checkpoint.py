"""Checkpoints: everything that the rest of a run depends on, and a restart from a checkpoint."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.model.memory import Memory

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration


def checkpoint_of(run: Integration) -> Memory:
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


def restore(run: Integration, checkpoint: Memory) -> None:
    """Continue from a checkpoint; see ``Simulation.restore``."""
    try:
        _check(run, checkpoint)
        run.recall(checkpoint)
    except InputError:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError, MemoryError) as error:
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"checkpoint: does not fit a run of this system: {why[:200]}") from None


def _check(run: Integration, checkpoint: Memory) -> None:
    """Refuse a checkpoint whose method, options or bodies differ."""
    own = {"integrator": run.method.name, **run.options}
    for key, value in {"integrator": checkpoint["integrator"], **checkpoint["options"]}.items():
        if own.get(key) != (tuple(value) if isinstance(value, list) else value):
            raise InputError(f"checkpoint: {key} is {value!r} in the checkpoint and {own.get(key)!r} in this run")
    there, here = checkpoint["stepper"]["y"].shape, run.stepper.y.shape
    if there != here and not run.events:
        raise InputError(f"checkpoint: holds {there[-1]} particles or unknowns; the system has {here[-1]}")
