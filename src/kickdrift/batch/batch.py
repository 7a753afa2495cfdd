"""Many small gravitational systems at once: eight systems side by side in a processor's registers, a lane each.

For one system, a step of three bodies takes longer to organise than to compute. Side by side, the organisation
disappears: every number of the formulas becomes eight, one for each system.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.engines import NATIVE, engine
from kickdrift.errors import InputError
from kickdrift.forces.central import gravitational_constant
from kickdrift.forces.gravity import Gravity
from kickdrift.integrators import integrator as method_named
from kickdrift.integrators.asked import Integrator, settled, unpacked
from kickdrift.integrators.batch_stepping import LaneStepper, Members, from_lanes, to_lanes
from kickdrift.integrators.method import Method, checked_dt
from kickdrift.integrators.option import MIXED
from kickdrift.integrators.options import Options
from kickdrift.integrators.step_length import start_warning
from kickdrift.looks.record import Record, Series
from kickdrift.model.capacity import check_room
from kickdrift.model.limits import whole_number
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.state import Floats, State
from kickdrift.model.system import System
from kickdrift.run.plan import looks_at
from kickdrift.run.report import Report, report

MOST = 32  # most bodies; side by side is 16 times as fast at 3, 4 at 16 and 2 at 32, where one system fills the lanes
PIECE = 200_000_000  # pairs and steps of one system between checks for Ctrl-C; some seconds
LOOKS = 100_000  # samples in one piece of memory
LOOK_BYTES = 2 * 64  # memory of a member's sample while the pieces become one array


def refusal(system: Any, method: Method, options: Options) -> str | None:
    """Reason why a Batch cannot run this, or None. A Simulation may refuse more."""
    if not isinstance(system, System):
        return "a batch takes Systems of particles"
    if not method.batched:
        return f"{method.name} moves one system at a time; splittings, fixed Runge-Kutta and wisdom-holman move many"
    if options.compensated:
        return "a batch has no compensated sums"
    if options.corrector:
        return "a batch has no corrector"
    if options.precision == MIXED:
        return "mixed precision needs pair forces"
    if system.box.periodic:
        return "a batch needs open space, and the box is periodic"
    if [type(force) for force in system.forces] != [Gravity]:
        return f"a batch needs exactly one force, 'gravity'; {system.name!r} has others, or none"
    if system.events:
        return "a batch watches no events"
    if len(system) > MOST:
        return f"{len(system)} bodies are too many; a batch takes up to {MOST}"
    try:
        method.check(system)
    except InputError as error:
        return str(error)
    return None


class Batch:
    """Copies of many Systems with equal numbers of bodies, run with one integrator, as Simulations would run one by
    one.

    Each member's results equal a Simulation's up to round-off, since sums have another order. Without chaos the
    difference is less than 4 eps (steps x stages)^1.5 of the largest position and velocity. A member's bits depend only
    on the member: not on the others, their number or its place in the list. A member that blows up leaves the others
    alone, and ``finite`` shows it. So does a member with bodies at the same place, which a Simulation refuses.

    Parameters
    ----------
    systems : Systems with equal numbers of bodies and of steps done, under ``Gravity`` alone, softened or not;
        starts, masses, G, units and softening may differ
    integrator : a splitting, a fixed-step Runge-Kutta method, wisdom-holman or saba; default as in a Simulation
    dt : one step for all, or one for each; default from the system files
    options : as in a Simulation: coordinates, order

    Raises
    ------
    InputError
        With the reason of `refusal` and the member, or if a shared property differs.
    """

    @np.errstate(all="ignore")  # numbers about to blow up
    def __init__(
        self,
        systems: Sequence[System],
        integrator: str | Integrator | None = None,
        dt: float | Sequence[float] | Floats | None = None,
        **options: Any,
    ) -> None:
        self.systems = tuple(systems)
        self.integrator, self.method, self.options, self.dt = common(self.systems, integrator, dt, options)
        members = members_of(self.systems, self.dt, np.array([system.state.phase for system in self.systems]))
        self.steps_done = self.systems[0].state.steps_done
        self._start = from_lanes(members.start, len(self.systems))
        self._members = members
        self._stepper: LaneStepper = self.method.in_lanes(members, self.options)
        self._begun = begin_lanes(self.systems)
        self._steps: list[int] = []
        self._looks: list[Floats] = []  # (k, LOOK, members) from each run
        self._taken, self._seconds, self._compiling = 0, 0.0, 0.0

    def __len__(self) -> int:
        return len(self.systems)

    @property
    def time(self) -> Floats:
        """Time of each member (members,) in the systems' unit."""
        return self._start + self.steps_done * self.dt

    @property
    def phase(self) -> Floats:
        """Copy of positions and velocities (members, 2, 3, n)."""
        return from_lanes(self._stepper.y, len(self))

    def states(self) -> list[State]:
        """Copies of the State of each member."""
        return [
            replace(system.state.copy(), phase=phase, time=float(time), steps_done=self.steps_done)
            for system, phase, time in zip(self.systems, self.phase, self.time, strict=True)
        ]

    @property
    def finite(self) -> NDArray[np.bool_]:
        """Tell for each member (members,) whether all its present and sampled numbers are finite. Run a member that
        blew up as a Simulation to learn why."""
        found = [np.isfinite(self.phase).all(axis=(1, 2, 3))]
        found += [np.isfinite(looks).all(axis=(0, 1)) for looks in self._looks]
        return np.logical_and.reduce(found)

    def run(self, steps: int, every: int | None = None) -> None:
        """Take ``steps`` steps. Sample energies and momenta at the start, every ``every`` steps (counted from step 0)
        and at the end; default as in ``Simulation.run``. A sample takes 64 bytes a member."""
        steps = whole_number("steps", steps, 0)
        every = whole_number("every", every, 1) if every is not None else None
        known = {system.run.every for system in self.systems}
        if every is None and len(known) > 1:
            raise InputError("every: the systems have different values; give one for all")
        most = looks_at(steps, self.method.evaluations, len(self.systems[0]))
        cadence = every or known.pop() or max(1, steps // most)
        check_room("run", steps / cadence * len(self), "samples", LOOK_BYTES, "give a larger every")
        stops = looks_between(self.steps_done, steps, cadence)
        counts = np.diff(stops, prepend=self.steps_done)
        began = perf_counter()
        self._stepper.run(0, np.zeros(0, np.int64), self.steps_done)  # compiles, if not done before
        compiled = perf_counter()
        self._compiling += compiled - began
        again = bool(self._steps) and self._steps[-1] == self.steps_done
        looks = run_lanes(self._stepper, counts[again:], self.steps_done)[0]
        self._looks.append(looks[:, :, : len(self)])
        self._steps += stops[again:].tolist()
        self.steps_done += steps
        self._taken += steps
        self._seconds += perf_counter() - compiled

    def report(self, i: int) -> Report:
        """Report of member ``i``, as from ``Simulation.run``. Its wall time is an equal share of all members' time."""
        if not self._steps:
            raise InputError("report: call run first")
        return report(Member(self, i))

    def reports(self) -> list[Report | None]:
        """Reports of all members; None for a member that blew up."""
        return [self.report(i) if finite else None for i, finite in enumerate(self.finite)]

    def record(self, i: int) -> LaneRecord:
        """Samples of member ``i`` and its cost."""
        system, looks = self.systems[i], np.concatenate([looks[:, :, i] for looks in self._looks])
        massive = int(np.count_nonzero(system.state.masses))
        warning = start_warning(system, self.method, float(self.dt[i]))
        series = Series(
            steps=(steps := np.array(self._steps)),
            times=self._start[i] + steps * self.dt[i],
            total=looks[:, 0] + looks[:, 1],
            final=float(looks[-1, 0] + looks[-1, 1]),
            kinetic=float(looks[0, 0]),
            momentum=looks[:, 2:5],
            angular_momentum=looks[:, 5:8],
            pairs=0.5 * massive * (massive - 1) + massive * (len(system) - massive),
        )
        return LaneRecord(
            begun=True,
            momentum_scale=float(self._begun[0][i]),
            angular_momentum_scale=float(self._begun[1][i]),
            steps=self._taken,
            force_evaluations=self._stepper.evaluations,
            wall_seconds=self._seconds / len(self),
            compile_seconds=self._compiling / len(self),
            warnings=[*self._stepper.warnings(i), *([warning] if warning else [])],
            found=series,
        )


@dataclass
class LaneRecord(Record):
    """Record whose samples already stand side by side."""

    found: Series | None = field(default=None)

    def series(self) -> Series:
        """Series of the samples; see Record."""
        assert self.found is not None
        return self.found


class Member:
    """Member of a Batch in the form of a Simulation, for ``report``."""

    engine, threads, processes, stopped = NATIVE, 1, 1, ""
    events: tuple[dict[str, Any], ...] = ()
    state: Any = None  # used by reports of Problems

    def __init__(self, batch: Batch, i: int) -> None:
        self.system, self.record = batch.systems[i], batch.record(i)
        self.integrator, self.method, self.dt = batch.integrator, batch.method, float(batch.dt[i])
        self.options = batch.options.changed(dt=self.dt)
        self.engine_version = engine(NATIVE).version

    def going_on(self) -> list[dict[str, Any]]:
        """Return no events."""
        return []


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
    known: dict[tuple[str, RunDefaults], Options] = {}
    found = np.empty(len(systems))
    for k, (system, step) in enumerate(zip(systems, steps, strict=True)):
        if not isinstance(system, System):
            raise InputError(f"system {k}: expected a System of particles, got {type(system).__name__}")
        name = integrator or system.run.integrator or "velocity-verlet"
        method = method_named(name)
        if (name, system.run) not in known:  # the same for most members
            known[name, system.run] = settled(method, options, system.run)
        own = known[name, system.run]
        if (why := refusal(system, method, own)) is not None:
            raise InputError(f"system {k}: {why}")
        own_dt = checked_dt(system.run.dt if step is None else step)
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


def begin_lanes(systems: Sequence[System]) -> tuple[Floats, Floats]:
    """Sums of m |v| and of m |x × v| (members,), as in ``Record.begin``."""
    phase = np.array([system.state.phase for system in systems])
    masses = np.array([system.coherent_masses for system in systems])
    x, v = np.moveaxis(phase, 1, 0)
    turning = np.linalg.norm(np.cross(x, v, axis=1), axis=1)
    return (masses * np.linalg.norm(v, axis=1)).sum(axis=1), (masses * turning).sum(axis=1)


def looks_between(done: int, steps: int, every: int) -> NDArray[np.int64]:
    """Steps of the samples: the present one, multiples of ``every``, the last."""
    inside = np.arange((done // every + 1) * every, done + steps, every)
    ends = [done, done + steps] if steps else [done]
    return np.unique(np.concatenate([ends, inside])).astype(np.int64)


def run_lanes(stepper: LaneStepper, counts: NDArray[np.int64], done: int, watch: Any = None) -> tuple[Floats, Floats]:
    """Take ``counts`` (k,) steps and sample after each, block by block. Returns (k, LOOK, members) samples and the (k,
    members) factors that rescaled deviations. The members include those that fill up the last block."""
    rows = stepper.y.shape[3]
    passed = np.cumsum(counts) * rows * rows
    pieces = np.searchsorted(passed, np.arange(PIECE, passed[-1] if len(passed) else 0, PIECE))
    pieces = np.unique(np.concatenate([pieces, np.arange(LOOKS, len(counts), LOOKS)]))
    found: list[tuple[Floats, Floats]] = []
    for block in range(len(stepper.y)):
        parts, at = [], done
        for some in np.split(counts, pieces):
            parts.append(stepper.run(block, some, at, watch))
            at += int(some.sum())
        looks, exponents = zip(*parts, strict=True)
        found.append((np.concatenate(looks), np.concatenate(exponents)))
    return np.concatenate([f[0] for f in found], axis=-1), np.concatenate([f[1] for f in found], axis=-1)
