"""Wisdom-Holman integration: its coordinates and its warnings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from kickdrift.forces.bound.forces import BoundForces
from kickdrift.forces.bound.table import SLOTS
from kickdrift.forces.gravity.direct import Gravity
from kickdrift.forces.laws.central import gravitational_constant
from kickdrift.integrators.options import JACOBI, KERNEL, STANDARD, Options
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.splitting.unknowns import unknowns_of
from kickdrift.integrators.stepping.loops import STEP
from kickdrift.integrators.stepping.stepping import CompiledSteps, Regular, Retimed
from kickdrift.integrators.wisdom_holman import bodies as rows
from kickdrift.integrators.wisdom_holman.corrector import corrector, undone
from kickdrift.integrators.wisdom_holman.kernels import CORRECTION, KICKS, kernel_of
from kickdrift.integrators.wisdom_holman.loop import (
    enter,
    first_step,
    leave,
    listed_masses,
    shown_steps,
    wisdom_holman_loop,
)
from kickdrift.jit.handle import address_of
from kickdrift.jit.lanes.memory import aligned
from kickdrift.jit.lanes.vectors import WIDTH
from kickdrift.model.memory import Memory
from kickdrift.model.starts.coordinates import to_democratic
from kickdrift.model.state import Floats
from kickdrift.text import measured

if TYPE_CHECKING:
    from kickdrift.integrators.flows.flow import Flow
    from kickdrift.model.system import System

STEPS_PER_PERIOD = 20  # least steps in a pericentre passage (Wisdom 2015; Rein & Tamayo 2015)


class WisdomHolmanStepper(Retimed, Regular):
    """Integration that stays before the last drift of a step, which is joined to the next step's first.

    ``y`` is a copy with that drift, and the corrector, done. A checkpoint holds the orbits there, the centre of mass,
    the carries of compensated sums, and the data of warnings.
    """

    trouble = ""
    _loop_at: int | None = None  # the address of the loop's machine code, once known
    _shows: bool = False  # whether ``_shown`` is at the step point
    _shortest: tuple[float, int] | None = None  # steps of the shortest pericentre passage, and its body
    saved: ClassVar[tuple[str, ...]] = (
        "_cursor", "_start", "_under_way", "_corrected", "_shortest", "_hill",
        "_bodies.orbit", "_bodies.carry", "_bodies.centre", "_bodies.first",
    )  # fmt: skip

    def __init__(self, flow: Flow, table: Splitting, options: Options) -> None:
        assert options.dt is not None
        system: Any = flow.subject
        self._system, self.dt = system, options.dt
        self._jacobi, self._compensated = options.coordinates == JACOBI, options.compensated
        others = system.under(force for force in system.forces if not isinstance(force, Gravity))
        self._others = BoundForces(others, flow.forces.threads)
        flow.others = self._others  # type: ignore[union-attr]
        self._beside = unknowns_of(self._others)
        self._looks = BoundForces(others, flow.forces.threads, thin=True)  # for the corrector of samples
        drift, kick = np.array(table.drift), np.array([*table.kick, 0.0])
        passed = np.cumsum(drift)
        kernel = options.get(KERNEL.name) or STANDARD
        self._kernel = kernel if kernel in KICKS else None
        begin = np.array([drift, kick, passed, np.full(len(kick), CORRECTION)])
        self._begin, self._end = begin[:, :-1].copy(), begin[:, -1:].copy()
        self._step = self._begin.copy()
        self._step[0, 0] += drift[-1]  # the last drift of the step before
        mirrored = kernel != STANDARD
        self._least = self.dt / (1 if mirrored else len(table.kick))
        row = corrector(options.corrector, mirrored) if options.corrector else np.zeros((2, 0))
        self._correct, self._decorrect = (
            np.array([*part, *np.zeros((2, part.shape[1]))]) for part in (row, undone(row) if row.size else row)
        )
        gravity = next(force for force in system.forces if isinstance(force, Gravity))
        self._G = gravitational_constant(gravity.name, gravity.G, system)
        self._place(system)

    def _place(self, system: System) -> None:
        """Assign bodies to slots, and fill in their constants."""
        masses = system.state.masses
        central = int(np.argmax(masses))
        others = np.delete(np.arange(len(masses)), central)
        heavy, light = others[masses[others] > 0], others[masses[others] == 0]
        order = np.concatenate([_filled(heavy), _filled(light)])
        massive, slots = len(_filled(heavy)), len(order)
        self._real = order >= 0
        self._listed = np.array([central, *others])  # in the order of coordinates.py
        self._row = 1 + np.searchsorted(others, order)  # of each slot in that list
        self._row[~self._real] = 0
        gm = self._G * masses
        before = np.zeros(slots)  # G times the mass of the other bodies listed before
        before[self._real] = (np.cumsum(gm[others]) - gm[others])[self._row[self._real] - 1]
        before[~self._real] = gm[others].sum()
        table, source = aligned((rows.ROWS, slots)), np.zeros(slots)
        table[rows.LIVE, self._real], source[self._real] = 1.0, gm[order[self._real]]
        rows.fill_table(table, gm[central], source, before, self._jacobi)
        inside = np.searchsorted(heavy, order)
        self._bodies = rows.Bodies(
            orbit=aligned((6, slots)), carry=aligned((6, slots if self._compensated else 0)),
            centre=aligned((5, WIDTH)), table=table, inside=inside, first=np.full((3, slots), np.nan),
            work=aligned((rows.WORK, slots)), massive=massive, jacobi=self._jacobi, order=order, central=central,
            gm=float(gm[central]), shares=masses / masses.sum(), x=np.zeros((2, 3, len(masses))),
            a=np.zeros((3, len(masses))),
        )  # fmt: skip
        if self._beside is not None:
            self._bodies = self._bodies._replace(beside=np.array([self._beside.address, self._beside.work]))
        own = self._bodies
        self._shown = own._replace(  # at the step point
            orbit=aligned(own.orbit.shape), carry=aligned(own.carry.shape), centre=aligned(own.centre.shape),
            first=np.empty(own.first.shape),
        )  # fmt: skip
        if self._kernel:
            self._bodies, self._shown = (
                each._replace(kernel=kernel_of(self._kernel, each)) for each in (own, self._shown)
            )
        self._slots = np.zeros(len(masses), np.int64)
        self._slots[self._row[self._real]] = np.flatnonzero(self._real)
        self._masses = listed_masses(own.shares[self._listed])
        self._aside = np.zeros(SLOTS, np.int64)

    # --- coordinates ---

    def _enter(self, y: Floats) -> None:
        """The map's coordinates from positions and velocities (2, 3, n)."""
        bodies = self._bodies
        if not self._jacobi:
            x, v = y.transpose(0, 2, 1)[:, self._listed]
            q = np.array(to_democratic(x, v, bodies.shares[self._listed])).transpose(0, 2, 1)
            bodies.centre[...] = 0.0
            bodies.centre[:2, :3] = q[:, :, 0]
            bodies.orbit[...] = q.reshape(6, -1)[:, self._row]
        enter(bodies, self._slots, self._listed, self._masses, y)

    def _leave(self, bodies: rows.Bodies) -> Floats:
        """(2, 3, n) positions and velocities."""
        y = np.empty((2, 3, len(self._listed)))
        leave(bodies.orbit, bodies.carry, bodies.centre, self._slots, self._listed, self._masses, self._jacobi, y)
        return y if self._beside is None else self._beside.joined(y)

    # --- steps ---

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self.begin_at(y, time, steps)
        self._enter(y)
        self._look_at_start()

    def begin_at(self, y: Floats, time: float, steps: int) -> None:
        """Begin at y, but for the map's coordinates."""
        self.y, self.steps_done = y, steps
        self._start = time - steps * self.dt
        self._hold(y)
        self._cursor = np.zeros(SLOTS, np.int64)
        self._under_way = self._shows = False
        self._corrected = not self._correct.size
        self._others.forget()
        self._bodies.first[:] = np.nan

    def begin_from(self, run: Self) -> None:
        """Start anew at the step point of another stepper of the same method, without a change of coordinates."""
        if run._under_way and not run._shows:
            run._synchronise()
        own, there = self._bodies, run._shown if run._under_way else run._bodies
        self.begin_at(run.y.copy(), run.time, run.steps_done)
        for key in ("orbit", "carry", "centre"):
            getattr(own, key)[...] = getattr(there, key)
        own.table[rows.HILL], self._shortest = run._hill, run._shortest

    def recall(self, memory: Memory) -> None:
        """See Stepper."""
        super().recall(memory)
        self._shows = False
        self._hold(self.y)

    def _hold(self, y: Floats) -> None:
        """Go on with the unknowns of y, whose bodies the map has in its own coordinates."""
        if self._beside is not None:
            self._beside.hold(y)

    @property
    def _lists(self) -> BoundForces:
        return self._others

    @property
    def _hill(self) -> Floats:
        """Squared Hill radii at the start."""
        return self._bodies.table[rows.HILL]

    def _call(
        self, bodies: rows.Bodies, row: Floats, steps: int, cursor: Any, others: BoundForces | None = None
    ) -> int:
        return (others or self._others).call(
            wisdom_holman_loop, bodies, row, self.dt, self._start, self.steps_done, steps, cursor
        )  # fmt: skip

    def advance(self, steps: int, until: float = np.inf) -> int:
        if not steps:
            return self._call(self._bodies, self._step, 0, self._cursor)
        status, rows = 0, []
        if not self._corrected:
            rows.append((self._correct, 1, 0))
        if not self._under_way:
            rows.append((self._begin, 1, 1))
        done = sum(row[2] for row in rows)
        for row, count, forward in [*rows, (self._step, steps - done, steps - done)]:
            self._cursor[STEP:] = 0
            status = self._call(self._bodies, row, count, self._cursor)
            self.steps_done += min(int(self._cursor[STEP]), forward)
            if status:
                return status
            self._corrected = True
            self._under_way = self._under_way or forward > 0
        return self._synchronise()

    @property
    def steady(self) -> bool:  # type: ignore[override]
        return self._under_way and self._corrected

    @property
    def compiled_steps(self) -> CompiledSteps | None:
        if self._others.forces:  # their lists are made anew for the shown state
            return None
        own, shown, others = self._bodies, self._shown, self._others
        given = (
            others.table, self._address(), own, shown, self._step, self._end, self._decorrect, self._aside, self._slots,
            self._listed, self._masses, self.dt, self._start, self.y,
        )  # fmt: skip
        return shown_steps, others, given

    @property
    def compiled_start(self) -> CompiledSteps:
        """The first step from ``y``, likewise; its driver takes the cursor alone after these arguments."""
        given = (
            self._address(), self._bodies, self._begin, self._slots, self._listed, self._masses, self.dt, self._start,
            self.y,
        )  # fmt: skip
        return first_step, self._others, given

    def _address(self) -> int:
        """Address of the loop's machine code."""
        if self._loop_at is None:
            given = self._bodies, self._step, self.dt, self._start, self.steps_done, 1, self._cursor
            self._loop_at = address_of(wisdom_holman_loop, self._others.table, *given)
        return self._loop_at

    def _synchronise(self) -> int:
        """y <- the state at the step point. Return a status."""
        own, shown = self._bodies, self._shown
        shown.orbit[...], shown.carry[...] = own.orbit, own.carry
        shown.centre[...], shown.first[...] = own.centre, own.first
        self._cursor[STEP:] = 0
        self._looks.forget()
        for row in (self._end, self._decorrect):
            if row.size:
                self._aside[:] = 0
                if status := self._call(shown, row, 1, self._aside, self._looks):
                    return status
        self.y, self._shows = self._leave(shown), True
        return 0

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        y = self._leave(self._bodies)
        return y, y[0] - self.dt * y[1]

    # --- warnings ---

    def _look_at_start(self) -> None:
        """Find Hill radii, and the body whose pericentre passage takes fewest steps."""
        bodies, real = self._bodies, np.flatnonzero(self._real)
        self._shortest = None
        bodies.table[rows.HILL] = 0.0
        if not len(real):
            return
        orbit, table = bodies.orbit[:, real], bodies.table[:, real]
        passages, hill = passages_and_hill(orbit[:3], orbit[3:], table[rows.GM], table[rows.SOURCE], bodies.gm)
        bodies.table[rows.HILL, real] = hill
        k = int(np.argmin(passages))
        if passages[k] < np.inf:
            self._shortest = float(passages[k]), int(bodies.order[real[k]])

    @property
    def warnings(self) -> list[str]:
        """Warnings about effects that the map does not follow."""
        first, order = self._bodies.first, self._bodies.order
        unbound = np.flatnonzero(~np.isnan(first[rows.UNBOUND]) & self._real)
        near = np.flatnonzero(~np.isnan(first[rows.NEAR]))
        return warning_lines(
            self._system, self.dt, self._least, self._shortest,
            [(int(order[k]), float(first[rows.UNBOUND, k])) for k in unbound],
            [(int(order[k]), int(order[int(first[rows.WHICH, k])]), float(first[rows.NEAR, k])) for k in near],
        )  # fmt: skip


def _filled(ids: Any) -> Any:
    """The ids, filled up with -1 to a multiple of eight."""
    return np.concatenate([ids, np.full(-len(ids) % WIDTH, -1)]).astype(np.int64)


# --- effects that the map does not follow ---


def passages_and_hill(
    x: Floats, v: Floats, gm: Floats, source: Floats, central: Floats | float
) -> tuple[Floats, Floats]:
    """Durations of pericentre passages and squared Hill radii for bodies at x and v (3, …).

    A passage takes 2 pi q / v, as on a circle; it is infinite if the pericentre is past for ever. gm belongs to the
    Kepler motion, and ``source`` and ``central`` are G times the masses of the body and of the central one.
    """
    r, h2 = np.sqrt((x * x).sum(axis=0)), (np.cross(x, v, axis=0) ** 2).sum(axis=0)
    energy, outward = 0.5 * (v * v).sum(axis=0) - gm / r, (x * v).sum(axis=0)
    e = np.sqrt(np.maximum(0.0, 1.0 + 2.0 * energy * h2 / gm**2))
    q = h2 / (gm * (1.0 + e))
    passage = 2.0 * math.pi * np.sqrt(q**3 / (gm * (1.0 + e)))
    bound = energy < 0.0
    far = np.where(bound, -0.5 * gm / np.where(bound, energy, -1.0), r)
    hill = far * (source / (3.0 * central)) ** (1 / 3)
    return np.where(bound | (outward < 0.0), passage, np.inf), hill * hill


def warning_lines(
    system: System,
    dt: float,
    least: float,
    shortest: tuple[float, int] | None,
    unbound: Iterable[tuple[int, float]],
    near: Iterable[tuple[int, int, float]],
) -> list[str]:
    """Warnings about effects that the map does not follow.

    ``shortest`` is the shortest passage and its body, ``least`` the time between two kicks, ``unbound`` the first
    unbound bodies with their times, ``near`` the first near pairs with their times.
    """
    unit = measured("", system.units.symbol("time"))
    found = []
    if shortest is not None and least > shortest[0] / STEPS_PER_PERIOD:
        passage, i = shortest
        found.append(
            f"dt = {dt:g}{unit} is long: {system.body(i)} passes its pericentre as on a circle of period "
            f"{passage:.4g}{unit}, in {passage / least:.3g} kicks; {STEPS_PER_PERIOD} or more resolve it"
        )
    found += [
        f"{system.body(i)} is on a hyperbola from t = {time:.6g}{unit} on: the map is for bound orbits; "
        "use gauss-radau15"
        for i, time in unbound
    ]
    pairs: dict[tuple[int, int], float] = {}
    for i, j, time in near:
        pair = (min(i, j), max(i, j))
        pairs[pair] = min(time, pairs.get(pair, np.inf))
    for (i, j), time in pairs.items():
        found.append(
            f"{system.body(i)} and {system.body(j)} come within the Hill radius at t = {time:.6g}{unit}: the map "
            "does not follow close encounters; use gauss-radau15"
        )
    return found
