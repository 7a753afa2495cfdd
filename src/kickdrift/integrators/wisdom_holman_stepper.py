"""A Wisdom-Holman integration under way: its coordinates, and what to warn of."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.forces.bound import BoundForces
from kickdrift.forces.evaluate import EVALUATIONS, SLOTS
from kickdrift.forces.gravity import Gravity
from kickdrift.forces.simd import WIDTH, aligned
from kickdrift.integrators.loops import STEP
from kickdrift.integrators.splitting import Splitting
from kickdrift.integrators.stepping import Counts, Options
from kickdrift.integrators.wisdom_holman import JACOBI, corrector, undone
from kickdrift.integrators.wisdom_holman_loop import (
    GM,
    HILL,
    INSIDE,
    LIVE,
    NEAR,
    OTHERS,
    ROWS,
    SHARE,
    SOURCE,
    UNBOUND,
    WHICH,
    WORK,
    Bodies,
    wisdom_holman_loop,
)
from kickdrift.state import Floats
from kickdrift.system import System

if TYPE_CHECKING:
    from kickdrift.flow import Flow

STEPS_PER_PERIOD = 20  # of a passage of the pericentre: fewer are worth a warning (Wisdom 2015; Rein & Tamayo 2015)
FAR = 4.0  # what fills up the lanes circles so many times as far out as the farthest body


class WisdomHolmanStepper:
    """The run itself is held before the last drift of a step, which the next one's first is joined to; ``y`` is a copy
    with that drift, and the corrector, done."""

    trouble = ""

    def __init__(self, flow: Flow, table: Splitting, options: Options) -> None:
        assert options.dt is not None
        system: Any = flow.subject
        self._system, self.dt = system, options.dt
        self._jacobi, self._compensated = options.coordinates == JACOBI, options.compensated
        self._others = BoundForces(_without_gravity(system), flow.forces.threads)
        drift, kick = np.array(table.drift), np.array([*table.kick, 0.0])
        passed = np.cumsum(drift)
        begin = np.array([drift, kick, passed])
        self._begin, self._end = begin[:, :-1].copy(), begin[:, -1:].copy()
        self._step = self._begin.copy()
        self._step[0, 0] += drift[-1]  # the last drift of the step before
        self._least = self.dt / len(table.kick)
        row = corrector(options.corrector) if options.corrector else np.zeros((2, 0))
        self._correct, self._decorrect = (
            np.array([*part, np.zeros(part.shape[1])]) for part in (row, undone(row) if row.size else row)
        )
        gravity = next(force for force in system.forces if isinstance(force, Gravity))
        self._G = float(gravity.G if gravity.G is not None else system.units.gravity)
        self._place(system)

    def _place(self, system: System) -> None:
        """Which body stands in which slot, and what of it does not change."""
        masses = system.state.masses
        central = int(np.argmax(masses))
        ids = np.arange(len(masses))
        heavy, light = (np.flatnonzero(chosen & (ids != central)) for chosen in (masses > 0, masses == 0))
        order = np.concatenate([_filled(heavy), _filled(light)])
        massive, slots = len(_filled(heavy)), len(order)
        real = order >= 0
        gm = self._G * masses
        table = aligned((ROWS, slots))
        up_to = gm[central] + np.cumsum(gm[heavy])  # the mass up to and with each
        before = np.array([gm[central], *up_to[:-1]]) if len(heavy) else np.zeros(0)
        count = np.searchsorted(heavy, light)  # the massive ones listed before each massless one
        at_light = np.array([gm[central], *up_to])[count]
        table[GM], table[INSIDE] = gm.sum(), 1.0 / gm.sum()
        interior = np.zeros(slots)
        for begin, among, mass, rest in (
            (0, heavy, up_to, np.array([0.0, *np.cumsum(gm[heavy])])[: len(heavy)]),
            (massive, light, at_light, np.array([0.0, *np.cumsum(gm[heavy])])[count]),
        ):
            part = slice(begin, begin + len(among))
            table[LIVE, part], table[SOURCE, part], table[GM, part] = 1.0, gm[among], mass
            table[SHARE, part] = gm[among] / mass
            interior[part] = rest
        table[INSIDE, : len(heavy)] = 1.0 / before
        table[INSIDE, massive : massive + len(light)] = 1.0 / at_light
        table[OTHERS] = interior * table[INSIDE]
        if not self._jacobi:
            table[GM], table[OTHERS] = gm[central], table[SOURCE] / gm[central]
        inside = np.zeros(slots, np.int64)
        inside[massive : massive + len(light)] = count
        n = len(masses)
        self._real, self._heavy, self._total = real, heavy, gm.sum()
        self._bodies = Bodies(
            orbit=aligned((6, slots)), carry=aligned((6, slots if self._compensated else 0)), centre=aligned((5, WIDTH)),
            table=table, inside=inside, first=np.full((3, slots), np.nan), work=aligned((WORK, slots)),
            massive=massive, jacobi=self._jacobi, order=order, central=central, gm=float(gm[central]),
            shares=masses / masses.sum(), x=np.zeros((2, 3, n)), a=np.zeros((3, n)),
        )  # fmt: skip

    # --- coordinates ---

    def _enter(self, y: Floats) -> None:
        """The map's coordinates from positions and velocities (2, 3, n)."""
        bodies = self._bodies
        relative = y - y[:, :, bodies.central, None]
        mean = (relative * bodies.shares).sum(axis=2)  # of mass, from the central body
        bodies.centre[:] = 0.0
        bodies.centre[:2, :3] = y[:, :, bodies.central] + mean
        q = relative[:, :, bodies.order]
        if self._jacobi:
            q = q - self._interior(relative)
        else:
            q[1] -= mean[1, :, None]
        farthest = FAR * float(np.sqrt((q[0] ** 2).sum(axis=0)[self._real]).max(initial=0.0)) or 1.0
        speed = np.sqrt(bodies.table[GM] / farthest)
        for row, value in enumerate((farthest, 0.0, 0.0, 0.0, speed, 0.0)):
            bodies.orbit[row] = np.where(self._real, q.reshape(6, -1)[row], value)
        bodies.carry[:] = 0.0

    def _interior(self, relative: Floats) -> Floats:
        """(2, 3, slots) the centre of mass inside each body, of positions and velocities (2, 3, n) from the central
        one."""
        bodies, heavy = self._bodies, self._heavy
        weighted = np.cumsum(relative[:, :, heavy] * bodies.shares[heavy], axis=2)
        mass = bodies.shares[bodies.central] + np.cumsum(bodies.shares[heavy])
        means = np.concatenate([np.zeros((2, 3, 1)), weighted / mass], axis=2)
        return means[:, :, self._before]

    @property
    def _before(self) -> Any:
        """(slots,) how many massive bodies stand before each."""
        bodies = self._bodies
        count = bodies.inside.copy()
        count[: len(self._heavy)] = np.arange(len(self._heavy))
        return count

    def _leave(self, bodies: Bodies) -> Floats:
        """(2, 3, n) positions and velocities."""
        q = (bodies.orbit + bodies.carry if bodies.carry.size else bodies.orbit).reshape(2, 3, -1)
        centre = (bodies.centre[:2] + bodies.centre[2:4])[:, :3, None]
        share = np.where(self._real, bodies.shares[bodies.order], 0.0)
        if self._jacobi:
            steps = (q * bodies.table[SHARE])[:, :, : len(self._heavy)]
            offsets = np.concatenate([np.zeros((2, 3, 1)), np.cumsum(steps, axis=2)], axis=2)
            q = q + offsets[:, :, self._before]
        heavy = slice(0, len(self._heavy))
        central = centre - (q[:, :, heavy] * share[heavy]).sum(axis=2, keepdims=True)
        y = np.empty((2, 3, len(bodies.shares)))
        y[:, :, bodies.order[self._real]] = (central + q)[:, :, self._real]
        if not self._jacobi:  # velocities from the centre of mass
            own = bodies.shares[bodies.central]
            central[1] = centre[1] - (q[1, :, heavy] * share[heavy]).sum(axis=1, keepdims=True) / own
            y[1][:, bodies.order[self._real]] = (centre[1] + q[1])[:, self._real]
        y[:, :, bodies.central] = central[:, :, 0]
        return y

    # --- steps ---

    def reset(self, y: Floats, time: float, steps: int) -> None:
        self.y, self.steps_done = y, steps
        self._before_last = y[0].copy()
        self._start = time - steps * self.dt
        self._cursor = np.zeros(SLOTS, np.int64)
        self._under_way = False
        self._corrected = not self._correct.size
        self._bodies.first[:] = np.nan
        self._enter(y)
        self._look_at_start()

    @property
    def time(self) -> float:
        return self._start + self.steps_done * self.dt

    @property
    def last_step(self) -> float:
        return self.dt

    @property
    def counts(self) -> Counts:
        return Counts(int(self._cursor[EVALUATIONS]))

    def _call(self, bodies: Bodies, row: Floats, steps: int, cursor: Any) -> int:
        return self._others.call(
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

    def _synchronise(self) -> int:
        """``y`` <- the state at the step point; a status."""
        own = self._bodies
        bodies = own._replace(
            orbit=_copy(own.orbit), carry=_copy(own.carry), centre=own.centre.copy(), first=own.first.copy()
        )
        for row in (self._end, self._decorrect):
            if row.size:
                status = self._call(bodies, row, 1, np.zeros(SLOTS, np.int64))
                if status:
                    return status
        self.y = self._leave(bodies)
        return 0

    def at(self, time: float) -> Floats:
        return self.y.copy()

    def reached(self, inside_step: bool) -> tuple[Floats, Floats]:
        y = self._leave(self._bodies)
        return y, y[0] - self.dt * y[1]

    # --- warnings ---

    def _look_at_start(self) -> None:
        """Hill radii, and the body whose passage of the pericentre takes fewest steps."""
        bodies, slots = self._bodies, len(self._real)
        self._shortest: tuple[float, int] | None = None
        bodies.table[HILL] = 0.0
        for slot in range(slots):
            if not self._real[slot]:
                continue
            gm = float(bodies.table[GM, slot])
            x, v = bodies.orbit[:3, slot], bodies.orbit[3:, slot]
            r, h2 = float(np.linalg.norm(x)), float((np.cross(x, v) ** 2).sum())
            energy = 0.5 * float(v @ v) - gm / r
            e = math.sqrt(max(0.0, 1.0 + 2.0 * energy * h2 / gm**2))
            q = h2 / (gm * (1.0 + e))  # distance and time of the pericentre, 2 pi q / v there
            passage = 2.0 * math.pi * math.sqrt(q**3 / (gm * (1.0 + e)))
            if self._shortest is None or passage < self._shortest[0]:
                self._shortest = passage, int(bodies.order[slot])
            far = -0.5 * gm / energy if energy < 0.0 else r
            bodies.table[HILL, slot] = (far * (bodies.table[SOURCE, slot] / (3.0 * bodies.gm)) ** (1 / 3)) ** 2

    @property
    def warnings(self) -> list[str]:
        """Lines on what the map does not follow."""
        system, first, order = self._system, self._bodies.first, self._bodies.order
        unit = "" if system.units.reduced else f" {system.units.time}"
        found = []
        if self._shortest is not None and self._least > self._shortest[0] / STEPS_PER_PERIOD:
            passage, i = self._shortest
            found.append(
                f"dt = {self.dt:g}{unit} is long: {system.body(i)} turns at its pericentre as on a circle of period "
                f"{passage:.4g}{unit}, which takes {passage / self._least:.3g} kicks; {STEPS_PER_PERIOD} or more are right"
            )
        for slot in np.flatnonzero(~np.isnan(first[UNBOUND]) & self._real):
            found.append(
                f"{system.body(int(order[slot]))} is not bound at t = {first[UNBOUND, slot]:.6g}{unit}: a visitor that "
                "comes near a planet is followed no better than in steps of dt"
            )
        pairs: dict[tuple[int, int], float] = {}
        for slot in np.flatnonzero(~np.isnan(first[NEAR])):
            i, j = sorted((int(order[slot]), int(order[int(first[WHICH, slot])])))
            pairs[i, j] = min(float(first[NEAR, slot]), pairs.get((i, j), np.inf))
        for (i, j), time in pairs.items():
            found.append(
                f"{system.body(i)} and {system.body(j)} come within the Hill radius at t = {time:.6g}{unit}: the map "
                "does not follow close encounters; gauss-radau15 does"
            )
        return found


def _filled(ids: Any) -> Any:
    """The ids, filled up with -1 to a multiple of eight."""
    return np.concatenate([ids, np.full(-len(ids) % WIDTH, -1)]).astype(np.int64)


def _copy(array: Floats) -> Floats:
    copied = aligned(array.shape, None)
    copied[...] = array
    return copied


def _without_gravity(system: System) -> System:
    """The System with its other forces alone."""
    state = system.state
    return System(
        state.positions, state.velocities, state.masses, system.box,
        [force for force in system.forces if not isinstance(force, Gravity)], system.units,
        [system.species[k] for k in system.species_index], system.name,
    )  # fmt: skip
