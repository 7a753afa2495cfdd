"""Contacts of a `Collision`: pairs of bodies that touch in a step."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.events.collision import Collision
from kickdrift.model.memory import Checkpointed, Memory, put_back
from kickdrift.model.patch import HERE, Image
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.run.watch.courses import AHEAD, STRONG, all_far, room, soon, suspects
from kickdrift.run.watch.encounters import contacts
from kickdrift.run.watch.overlaps import overlapping
from kickdrift.run.watch.span import Act, Exact, Own, Part, Span, attraction

LATE = 0.01  # of a step: the cubic and the method's own solution tell the time of a contact closer than this
SHORT = 1e-6  # of a step: the square of a shorter time is below rounding
STEPS = 4  # most steps of Newton's method
ALL_PAIRS = 256  # most bodies whose pairs are all searched; a tree finds the pairs of more bodies


Who = NDArray[np.int64] | None


def of(values: Any, who: Who) -> Any:
    """Values of these bodies; None stands for all of them, and there may be no values."""
    return values if who is None or not len(values) else values[who]


class Contacts(Checkpointed):
    """Contacts of a `Collision`. With many bodies, only pairs that a step may bring together are searched."""

    saved = ("radii", "_touching")
    evaluated = (1.0, 0.0)  # latest and earliest evaluation of the forces in a step; see `span.evaluated`
    _newton = False  # whether to try a step of Newton's method from the contact on the cubic curve

    def __init__(self, event: Collision, system: System) -> None:
        self.event = event
        self.radii = event.radii_in(system)
        self._approaching = event.action in ("bounce", "fragment", "rule")  # bodies that touch may separate
        self.begin(system)

    def begin(self, system: System) -> None:
        """Watch these bodies, without any known contact."""
        self._begin_with(system)
        self._many = len(system) > ALL_PAIRS
        if self._many:
            pairs = np.zeros((2, 0), np.int64)
        else:
            pairs = np.array(np.triu_indices(len(system), 1), dtype=np.int64)
            pairs = pairs[:, self._massive[pairs].any(axis=0)]
        self._take(np.ascontiguousarray(pairs), np.zeros(pairs.shape[1], dtype=np.bool_))

    def _begin_with(self, system: System) -> None:
        """Take the bodies and their attraction."""
        self._system, self._massive = system, system.state.masses > 0
        self.gm, self.softening2 = attraction(system)
        self._sources = self.gm
        self._strength: tuple[Any, float] = (None, 0.0)
        self._measured: Any = None

    def _take(self, pairs: np.ndarray, touching: np.ndarray) -> None:
        self._pairs, self._touching = pairs, touching
        self._rows, self._near = np.zeros((pairs.shape[1], 4)), np.zeros(pairs.shape[1] + 1, np.int64)
        self._calm, self._measured = False, None

    @property
    def _known(self) -> np.ndarray:
        """Rows (2, T) of the pairs whose contact is known."""
        return self._pairs[:, self._touching]

    def scan(self, step_parts: list[Part], step: int) -> int:
        """Search a step up to its first part with a contact. Return the number of pairs in contact."""
        if self._calm:
            self._calm, self._count = False, 0
            return 0
        begin, length = step_parts[0].t0, step_parts[-1].t1 - step_parts[0].t0
        for part in step_parts:
            h = part.t1 - part.t0
            self._count = self._found_in(part, h, step)
            if self._count:
                if len(step_parts) > 1:  # fractions of the step
                    rows = self._rows[: self._count, 1:]
                    rows[...] = (part.t0 - begin + rows * h) / length
                break
        return self._count

    # --- steps in parts ---

    @property
    def ids(self) -> NDArray[np.int64]:
        """Ids (n,) of the bodies."""
        return self._system.state.ids

    @property
    def marks(self) -> tuple[Any, ...]:
        """The pairs, and which of them are known to touch."""
        return self._pairs, self._touching.copy()

    @marks.setter
    def marks(self, marks: tuple[Any, ...]) -> None:
        self._take(marks[0], marks[1].copy())

    def all_far(self, y0: Floats, y1: Floats, h: float) -> bool:
        """Tell whether a fast test clears all pairs in a step from y0 to y1."""
        if self._many:
            return False
        if self._measured is not self.radii:
            self._measured, self._limits = (
                self.radii,
                np.array([of[self._pairs].sum(axis=0) for of in (self.radii, self.gm)]),
            )
        return bool(all_far(y0, y1, h, self._pairs, self._touching, self._limits))

    def attracts(self, h: float) -> bool:
        """Tell whether a step may feel the attraction of two bodies that touch."""
        if self._strength[0] is not self.radii:
            least = self.radii[self.radii > 0.0].min(initial=np.inf)
            self._strength = self.radii, 2.0 * float(self.gm.max(initial=0.0)) / least**3
        return self._strength[1] * h * h > STRONG

    def suspects(self, whole: Part, step: int, fresh: NDArray[np.bool_]) -> bool:
        """Tell whether pairs that attract each other may touch in a step, or soon after it."""
        h = whole.t1 - whole.t0
        if not self.attracts(h):
            return False
        y0, y1, places, who = self._places(whole, h, step)
        count = suspects(
            y0, y1, h, places, self._touching, of(self.radii, who), of(self.gm, who), self._sources, self.softening2,
            of(fresh, who), *self.evaluated, self._near,
        )  # fmt: skip
        self._calm = not count and not self._near[-1]
        if count:
            self._suspected = self._pairs[:, self._near[:count]]
        return count > 0

    def _places(self, whole: Part, h: float, step: int) -> tuple[Floats, Floats, NDArray[np.int64], Who]:
        """States at both ends of a step, the columns (2, P) of the pairs in these, and the body of each column; None if
        these are all bodies in their order."""
        if self._many:
            self._take_near(overlapping(whole.y0, whole.y1, h, self.radii, self._massive, self.gm, AHEAD * h))
        return whole.y0, whole.y1, self._pairs, None

    def _pairs_at(self, y: Floats, time: float) -> tuple[Floats, NDArray[np.int64], Who]:
        """A state with the suspected pairs, their columns (2, S), and the body of each column; None if
        these are all bodies in their order."""
        return y, np.ascontiguousarray(self._suspected), None

    def room(self, y: Floats, time: float, left: float, fresh: NDArray[np.bool_], motion: Exact | Own) -> float:
        """Longest part of a step from y that ends before suspected pairs touch, or shortly after."""
        there, pairs, who = self._pairs_at(y, time)
        return float(
            room(
                there, left, pairs, of(self.radii, who), of(self.gm, who), self._sources, self.softening2,
                of(fresh, who), motion.ahead, motion.behind, motion.fine,
            )
        )  # fmt: skip

    def soon(self, y: Floats, time: float, h: float, fresh: NDArray[np.bool_]) -> bool:
        """Tell whether suspected pairs touch so soon after y that a step of length h would spoil their velocities."""
        there, pairs, who = self._pairs_at(y, time)
        return bool(
            soon(
                there, h, pairs, of(self.radii, who), of(self.gm, who), self._sources, self.softening2, of(fresh, who),
                *self.evaluated,
            )
        )  # fmt: skip

    def _found_in(self, part: Part, h: float, step: int) -> int:
        """Search a part of a step. Return the number of pairs in contact."""
        if self._many:
            self._take_near(overlapping(part.y0, part.y1, h, self.radii, self._massive))
        return contacts(part.y0, part.y1, h, self._pairs, self.radii, self._approaching, self._touching, self._rows)

    @property
    def watches_all(self) -> bool:
        """Whether every step must be searched: bodies touch, or are so many that each step has other pairs."""
        return self._many or bool(self._touching.any())

    @property
    def limits(self) -> tuple[NDArray[np.int64], Floats, NDArray[np.int64]]:
        """Pairs that can touch, and their distances at contact; see `quiet.Limits`."""
        reaches = self.radii[self._pairs].sum(axis=0)
        can = reaches > 0.0
        return self._pairs[:, can], reaches[can], np.full(int(can.sum()), -1)

    def _take_near(self, near: np.ndarray) -> None:
        """Search these pairs, and forget known contacts of all other pairs."""
        n = len(self._system)
        touching = np.isin(near[0] * n + near[1], self._known[0] * n + self._known[1])
        self._take(np.ascontiguousarray(near), touching)

    def first(self, span: Span) -> Act | None:
        """First contact in the searched span."""
        found: dict[int, Act] = {}  # by row, from the earliest contact on the cubic to the last that may be the first
        for k, row in sorted(enumerate(self._rows[: self._count].tolist()), key=lambda each: each[1][1]):
            best = min((act.time for act in found.values()), default=np.inf)
            if span.t0 + (row[1] - LATE) * span.length > best:
                break
            if (act := self._confirmed(span, *row)) is not None:
                found[k] = act
        return min((found[k] for k in sorted(found)), key=lambda act: act.time, default=None)

    def _confirmed(self, span: Span, pair: float, s: float, a: float, b: float) -> Act | None:
        """Contact on the method's own solution, or None.

        A step of Newton's method from the contact on the cubic curve is exact to rounding if it is short. Other
        contacts, such as grazing ones, are bracketed."""
        i, j, *image = (int(k) for k in self._pairs[:, int(pair)])
        reach, time = self.radii[i] + self.radii[j], span.t0 + s * span.length
        where = [tuple(image)] if image else []
        for _ in range(STEPS if s > a and (span.costly or self._newton) else 0):
            x, v = self._apart(span.inside(time), time, i, j, image)
            if not (inwards := -float(x @ v)) > 0:
                break
            distance = float(np.linalg.norm(x))
            later = (distance - reach) * distance / inwards
            if not span.t0 <= time + later <= span.t1:
                break
            time += later
            if abs(later) <= SHORT * span.length:
                return Act(self.event, time, (i, j), reach, *where)
            if not span.costly:
                break

        def gap(time: float) -> float:
            return float(np.linalg.norm(self._apart(span.inside(time), time, i, j, image)[0])) - reach

        begin, end = span.t0 + a * span.length, span.t0 + b * span.length if b < 1 else span.t1
        time = begin
        if s > a:
            if gap(end) > 0:
                return None
            if gap(begin) > 0:
                time = span.zero(gap, begin, end, 1e-13)
        return Act(self.event, time, (i, j), gap(time) + reach, *where)

    def _apart(self, y: Floats, time: float, i: int, j: int, image: Sequence[int]) -> Floats:
        """Relative position and velocity (2, 3) of two bodies."""
        return y[:2, :, i] - y[:2, :, j]

    def follow(self, system: System) -> None:
        """Watch other bodies; known contacts stay known."""
        known, images = self._system.state.ids[self._known[:2]].T.tolist(), self._known[2:].T.tolist()
        self.begin(system)
        row_of = {int(each): row for row, each in enumerate(system.state.ids)} if known else {}
        for pair, image in zip(known, images, strict=True):
            rows = sorted(row_of.get(each, -1) for each in pair)
            if rows[0] >= 0:
                self.touch(tuple(rows), *([tuple(image)] if image else []))

    def touch(self, bodies: tuple[int, ...], image: Image = HERE) -> None:
        """Mark two bodies as touching, until they separate. In open space there are no images."""
        pair = np.array(bodies, np.int64)[:, None]
        same = (self._pairs == pair).all(axis=0)
        if self._many and not same.any():
            self._take(np.concatenate([self._pairs, pair], axis=1), np.append(self._touching, True))
        else:
            self._touching |= same

    def memory(self) -> Memory:
        """State; for many bodies also the pairs whose contact is known."""
        return super().memory() | ({"touching": self._known.tolist()} if self._many else {})

    def recall(self, memory: Memory) -> None:
        """Restore the state of a memory, for the present bodies."""
        n = len(self._system)
        self.radii = np.zeros(n)
        if not self._many:
            super().recall(memory)
            return
        put_back(self, "radii", memory["radii"])
        known = np.array(memory["touching"], dtype=np.int64).reshape(len(self._pairs), -1)
        if known.size and not (known[:2].min() >= 0 and known[:2].max() < n):
            raise InputError("checkpoint: a known contact is not of two bodies")
        self._take(known, np.ones(known.shape[1], dtype=np.bool_))
