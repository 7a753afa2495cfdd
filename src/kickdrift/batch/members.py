"""Members of a batch: which Systems it takes, and their numbers side by side in lanes."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.batch.lane_events import refusal_of
from kickdrift.errors import InputError
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import Integrator, settled, unpacked
from kickdrift.integrators.method import Method, checked_dt
from kickdrift.integrators.options import DT, KERNEL, MIXED, STANDARD, Options
from kickdrift.integrators.stepping.batch_loops import LaneStepper, Members, to_lanes
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem

MOST_BODIES = (
    32  # most bodies; side by side is 16 times as fast at 3, 4 at 16 and 2 at 32, where one system fills the lanes
)


def refusal(system: Any, method: Method, options: Options) -> str | None:
    """Reason why a Batch cannot run this, or None. A Simulation may refuse more."""
    if not isinstance(system, System):
        return "a batch takes Systems of particles"
    if system.held_by:
        return f"a batch moves each particle freely, and {system.name!r} has {system.held_by}"
    if not method.batched:
        return f"{method.name} moves one system at a time; splittings, fixed Runge-Kutta and wisdom-holman move many"
    if options.compensated:
        return "a batch has no compensated sums"
    if options.corrector:
        return "a batch has no corrector"
    if options.get(KERNEL.name) not in (None, STANDARD):
        return "a batch has the standard kernel only"
    if options.precision == MIXED:
        return "mixed precision needs pair forces"
    if system.box.periodic:
        return "a batch needs open space, and the box is periodic"
    if [type(force) for force in system.forces] != [Gravity]:
        return f"a batch needs exactly one force, 'gravity'; {system.name!r} has others, or none"
    if (why := refusal_of(system, method)) is not None:
        return why
    if len(system) > MOST_BODIES:
        return f"{len(system)} bodies are too many; a batch takes up to {MOST_BODIES}"
    try:
        method.check(system)
    except InputError as error:
        return str(error)
    return None


def common(
    systems: tuple[System, ...], which: str | Integrator | None, dt: Any, options: dict[str, Any]
) -> tuple[str, Method, Options, Floats]:
    """Shared integrator name, method and options, and each member's dt (members,)."""
    integrator, options = unpacked(which, options)
    dt = options.pop("dt", None) if dt is None else dt
    if not systems:
        raise InputError("systems: expected one system or more")
    steps = [dt] * len(systems) if dt is None or np.ndim(dt) == 0 else list(dt)
    if len(steps) != len(systems):
        raise InputError(f"dt: expected one number or {len(systems)}, one for each system, got {len(steps)}")
    shared: tuple[Any, ...] | None = None
    known: dict[tuple[str, RunDefaults, UnitSystem], Options] = {}
    found = np.empty(len(systems))
    for k, (system, step) in enumerate(zip(systems, steps, strict=True)):
        if not isinstance(system, System):
            raise InputError(f"system {k}: expected a System of particles, got {type(system).__name__}")
        name = integrator or system.run.integrator or "velocity-verlet"
        method = method_named(name)
        kind = name, system.run, system.units
        if kind not in known:  # the same for most members
            known[kind] = settled(method, options, system.run, system.units)
        own = known[kind]
        if (why := refusal(system, method, own)) is not None:
            raise InputError(f"system {k}: {why}")
        own_dt = checked_dt(system.run.dt if step is None else DT.in_units(step, system.units))
        if own_dt is None:
            raise InputError(f"dt is needed: system {system.name!r} has none in [run]")
        found[k] = own_dt
        alike = name, len(system), system.state.steps_done, own.changed(dt=None)
        shared = shared or alike
        for what, mine, first in zip(("integrator", "bodies", "steps_done", "options"), alike, shared, strict=True):
            if mine != first:
                raise InputError(
                    f"system {k}: all systems of a batch need the same {what}; it has {mine}, system 0 has {first}"
                )
    assert shared is not None
    return shared[0], method_named(shared[0]), shared[3], found


def members_of(systems: Sequence[System], dt: Floats, y: Floats) -> Members:
    """Systems side by side at y (members, 2, 3, n or 2 n)."""
    forces: list[Any] = [system.forces[0] for system in systems]
    G = [gravitational_constant(force.name, force.G, system) for force, system in zip(forces, systems, strict=True)]
    masses = np.array([system.state.masses for system in systems])
    time = np.array([system.state.time - system.state.steps_done * h for system, h in zip(systems, dt, strict=True)])
    return Members(
        systems=systems,
        done=systems[0].state.steps_done,
        y=to_lanes(y),
        gm=to_lanes(np.array(G)[:, None] * masses),
        masses=to_lanes(np.array([system.units.coherent_mass for system in systems])[:, None] * masses),
        softening2=to_lanes(np.array([force.softening**2 for force in forces])),
        dt=to_lanes(dt),
        start=to_lanes(time),
    )


PAIR_STEPS = 200_000_000  # pairs and steps of one system between checks for Ctrl-C; some seconds
PIECE_SAMPLES = 100_000  # samples in one piece of memory
TRANSPOSED = 64  # samples of all members that are put in another order at once, within a cache


def momentum_scales(systems: Sequence[System]) -> tuple[Floats, Floats]:
    """Sums of m |v| and of m |x × v| (members,), as in ``Record.begin``."""
    phase = np.array([system.state.phase for system in systems])
    masses = np.array([system.coherent_masses for system in systems])
    x, v = np.moveaxis(phase, 1, 0)
    turning = np.linalg.norm(np.cross(x, v, axis=1), axis=1)
    return (masses * np.linalg.norm(v, axis=1)).sum(axis=1), (masses * turning).sum(axis=1)


def sampled_steps(done: int, steps: int, every: int) -> NDArray[np.int64]:
    """Steps of the samples: the present step, multiples of ``every``, and the last step."""
    inside = np.arange((done // every + 1) * every, done + steps, every)
    ends = [done, done + steps] if steps else [done]
    return np.unique(np.concatenate([ends, inside])).astype(np.int64)


def run_lanes(stepper: LaneStepper, counts: NDArray[np.int64], done: int, watch: Any = None) -> tuple[Floats, Floats]:
    """Take ``counts`` (k,) steps and sample after each, block by block.

    Returns samples (k, LOOK, members) and the factors (k, members) that rescaled deviations. The members include those
    that fill up the last block."""
    rows = stepper.y.shape[3]
    passed = np.cumsum(counts) * rows * rows
    pieces = np.searchsorted(passed, np.arange(PAIR_STEPS, passed[-1] if len(passed) else 0, PAIR_STEPS))
    pieces = np.unique(np.concatenate([pieces, np.arange(PIECE_SAMPLES, len(counts), PIECE_SAMPLES)]))
    found: list[tuple[Floats, Floats]] = []
    for block in range(len(stepper.y)):
        parts, at = [], done
        for some in np.split(counts, pieces):
            parts.append(stepper.run(block, some, at, watch))
            at += int(some.sum())
        looks, exponents = zip(*parts, strict=True)
        found.append((np.concatenate(looks), np.concatenate(exponents)))
    return np.concatenate([f[0] for f in found], axis=-1), np.concatenate([f[1] for f in found], axis=-1)


def by_member(looks: Sequence[Floats]) -> Floats:
    """Samples (members, LOOK, k) of runs with samples (k, LOOK, members) each, one after the other."""
    _, numbers, members = looks[0].shape
    found = np.empty((members, numbers, sum(map(len, looks))))
    at = 0
    for some in looks:
        for begin in range(0, len(some), TRANSPOSED):
            part = some[begin : begin + TRANSPOSED]
            found[:, :, at : at + len(part)] = part.transpose(2, 1, 0)
            at += len(part)
    return found
