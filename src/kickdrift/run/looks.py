"""Looks at a run in progress: rows of its record, taken one by one or in series by compiled code."""

from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import RunError
from kickdrift.forces.seam.kernel import OK
from kickdrift.integrators.stepping.chosen_steps import ChosenSteps
from kickdrift.integrators.stepping.stepper import STOPPED
from kickdrift.integrators.stepping.stepping import Regular
from kickdrift.jit.cache.notices import compiling_for
from kickdrift.looks.columns import COLUMNS, PRESSURE, TIME, VIRIAL
from kickdrift.looks.looking import Looking
from kickdrift.looks.observers import NOTHING, Taken
from kickdrift.looks.record import BOTH, LOOKS, STEPPING
from kickdrift.model.state import Floats
from kickdrift.run.advance import CHUNK_SECONDS, Integration
from kickdrift.run.plan.plan import Plan
from kickdrift.run.report.warnings import begins_badly
from kickdrift.run.watchers.file import File
from kickdrift.run.watchers.stability import Stability

MOST = 4096  # most looks in one series
WAIT = -1  # status of a look, unlike those of forces: no other look before the file has got these
BLOCK_BYTES = 2**20  # most memory of the looks that wait for a file


class Sampler:
    """Samples a run into its record, and stores its last good state."""

    def __init__(self, run: Integration, stability: Stability) -> None:
        self._run, self._stability = run, stability
        self._compiled = False

    def look(self, again: bool = True) -> None:
        """Sample the current state; without ``again``, do nothing if the last look was here.

        Raises RunError if forces or energy are not finite."""
        run = self._run
        record, flow, y, safe = run.record, run.flow, run.y, run.safe
        looks, step, time = record.looks, run.steps_done, run.time
        new = again or not looks.at(step, time)
        if (heat := run.heat) is not None:
            record.work = getattr(run.stepper, "work", 0.0)
            record.taken = Taken(-heat - record.work, 0.0, 0.0)
        if run.method.bounces:
            record.taken = run.stepper.taken  # type: ignore[union-attr]
        if not new:
            if record.taken is not NOTHING:
                looks.retake(record.taken)
            safe.y[...], safe.box = y, run.box
        else:
            try:
                seen = flow.look(looks, y, time, step, safe.y, run.fresh) == OK
            except RunError:  # another program has ended
                seen = False
            if not seen:
                run.fail(inside_step=False, stopped=run.foreign and bool(run.stepper.trouble))
            elif run.method.bounces:
                self._press(looks.rows[looks.count])
        if not record.begun:
            flow.begin(record, y)
            record.warnings += begins_badly(run.system, y)
        safe.time, safe.step, safe.box = time, step, run.box
        if new:
            looks.keep(step, record.taken)

    def _press(self, row: Floats) -> None:
        """Add the pressure of the hits since the look before to a row, which has the pressure of the motion alone. The
        first look has no hits before it."""
        run, hits = self._run, self._run.stepper.hits  # type: ignore[union-attr]
        time, virial = run.record.hits or (hits.time, hits.virial)
        run.record.hits = [hits.time, hits.virial]
        row[VIRIAL] = (hits.virial - virial) / (hits.time - time) if hits.time > time else 0.0
        row[PRESSURE] += row[VIRIAL] / (run.system.dimensions * run.system.volume)  # type: ignore[union-attr]

    # --- in series ---

    def alone(self, plan: Plan, chunk: int) -> int:
        """Return how many looks, in about ``chunk`` steps, compiled code may take in series for the record alone.

        The number is 0 if a series is impossible or does not pay."""
        run = self._run
        stepper: Any = run.stepper
        if not self._plain:
            return 0
        if isinstance(stepper, Regular) and plan.every:
            done = stepper.steps_done
            found = (
                0 if done % plan.every else min(chunk // plan.every, (plan.whole_steps_end - done) // plan.every, MOST)
            )
            return found if found > 1 else 0
        if not plan.interval or plan.exact or self._stability.watches or self._looking() is None:
            return 0
        return 0 if run.time + plan.interval >= plan.end_time else MOST

    @property
    def _plain(self) -> bool:
        """Whether the next steps and looks are like all later ones."""
        run = self._run
        steady = getattr(run.stepper, "steady", False)
        return run.at is None and run.record.taken is NOTHING and not run.method.bath and steady

    def block(self, plan: Plan) -> int:
        """Return how many looks of a run with fixed steps may follow one another before a file gets them.

        The number is 0 if each look must be alone."""
        run, stepper = self._run, self._run.stepper
        if not (self._plain and isinstance(stepper, Regular) and plan.every) or run.foreign or run.box_varies:
            return 0
        if stepper.steps_done % plan.every or run.chunk < plan.every:
            return 0
        return min((plan.whole_steps_end - stepper.steps_done) // plan.every, BLOCK_BYTES // run.safe.y.nbytes)

    def _looking(self) -> Looking | None:
        """Return the Looking for looks that compiled code takes between steps; None if it cannot."""
        flow, stepper = self._run.flow, self._run.stepper
        if isinstance(stepper, Regular):
            return flow.looking(stepper.ends_fresh) if stepper.compiled_steps else None
        if isinstance(stepper, ChosenSteps) and not flow.clocked:
            return flow.looking(False) if stepper.compiled_steps else None
        return None

    def prepare(self, plan: Plan) -> None:
        """Compile the code for a series of looks; this time does not count as the run's."""
        if self._compiled:
            return
        began = perf_counter()
        looking, stepper, rows = self._looking(), self._run.stepper, np.zeros((1, COLUMNS))
        last = self._run.safe.y
        with compiling_for(self._run.purpose):
            if looking and isinstance(stepper, Regular) and plan.every:
                stepper.looked(0, 1, looking, last, rows, 0)
            elif looking and isinstance(stepper, ChosenSteps) and plan.interval:
                stepper.looked(plan, 0, looking, last, rows, 1)
        self._compiled = True
        self._run.record.compile_seconds += perf_counter() - began

    def series(self, plan: Plan, count: int) -> None:
        """Run through ``count`` looks for the record alone; with steps of varying length, through about ``chunk``
        steps."""
        run, began = self._run, perf_counter()
        stepper, looks_before = run.stepper, run.record.spent.get(LOOKS, 0.0)
        before, counts = stepper.steps_done, stepper.counts
        run.moving.forget_errors()
        status, refused = self._taken(plan, count)
        run.record.steps += stepper.steps_done - before
        run.record.count(stepper.counts - counts)
        if status != OK:
            run.fail(inside_step=not refused, stopped=status == STOPPED and not refused)
        run.at = plan.present(stepper.time, np.inf) if run.method.chooses_steps else None
        elapsed = perf_counter() - began
        run.pace(stepper.steps_done - before, elapsed)
        apart = run.record.spent.get(LOOKS, 0.0) - looks_before  # of looks between calls of compiled code
        run.record.spend(BOTH if self._looking() else STEPPING, elapsed - apart)

    def series_for(self, file: File, plan: Plan, count: int) -> None:
        """Run through at most ``count`` looks, for as long as compiled code may run, and write them to a file."""
        run, began = self._run, perf_counter()
        looks, safe, looks_before = run.record.looks, run.safe, run.record.spent.get(LOOKS, 0.0)
        stepper: Any = run.stepper
        row, before, counts = looks.count, stepper.steps_done, stepper.counts
        phases = np.empty((count, *safe.y.shape))
        run.moving.forget_errors()
        status, refused = self._one_by_one(stepper, count, plan.every, phases, began + file.patience(CHUNK_SECONDS))
        run.record.steps += stepper.steps_done - before
        run.record.count(stepper.counts - counts)
        ended = perf_counter()
        run.record.spend(STEPPING, ended - began - (run.record.spent.get(LOOKS, 0.0) - looks_before))
        with run.record.spending(file.part):
            file.series(row, phases[: looks.count - row], whole=status == OK)
        if status != OK:
            run.fail(inside_step=not refused, stopped=status == STOPPED and not refused)

    def _taken(self, plan: Plan, count: int) -> tuple[int, bool]:
        """Take steps and looks until one fails; return a status and whether a look failed."""
        run, looking = self._run, self._looking()
        stepper = run.stepper
        if isinstance(stepper, ChosenSteps):
            assert looking
            looks = run.record.looks
            row = looks.free(count)
            status, steps, refused = stepper.looked(
                plan, run.chunk, looking, run.safe.y, looks.rows[: row + count], row
            )
            self._seen(row, steps)
            return status, refused
        assert isinstance(stepper, Regular)
        shown = min(count, self._stability.shown) if looking else count  # looks to show one by one
        if looking and count > shown:
            status, refused = self._by_compiled_code(looking, stepper, count - shown, plan.every)
            if status != OK:
                return status, refused
        return self._one_by_one(stepper, min(count, shown), plan.every)

    def _by_compiled_code(self, looking: Looking, stepper: Regular, count: int, every: int) -> tuple[int, bool]:
        looks, first = self._run.record.looks, stepper.steps_done
        row = looks.free(count)
        status, taken, refused = stepper.looked(count, every, looking, self._run.safe.y, looks.rows, row)
        self._seen(row, first + every * np.arange(1, taken + 1))
        return status, refused

    def _seen(self, row: int, steps: NDArray[np.int64]) -> None:
        """Count the rows that compiled code has filled, from ``row`` on."""
        if len(steps):
            looks, safe = self._run.record.looks, self._run.safe
            safe.step, safe.time = int(steps[-1]), float(looks.rows[row + len(steps) - 1, TIME])
            looks.keep_next(steps)

    def _one_by_one(
        self, stepper: Regular, count: int, every: int, phases: Floats | None = None, end: float = np.inf
    ) -> tuple[int, bool]:
        """Take looks until one fails or the clock passes ``end``. Return a status and whether a look failed. Looks
        store their positions and velocities in ``phases``, if given."""
        flow, looks, safe, refused = self._run.flow, self._run.record.looks, self._run.safe, False
        first = looks.count

        def look() -> int:
            nonlocal refused
            began, step, time = perf_counter(), stepper.steps_done, stepper.time
            last = safe.y if phases is None else phases[looks.count - first]
            if (status := flow.look(looks, stepper.y, time, step, last, stepper.fresh)) != OK:
                refused = True
                return status
            safe.time, safe.step = time, step
            if self._stability.watches:
                self._stability.keep(time, last)
            looks.keep_next([step])
            now = perf_counter()
            self._run.record.spend(LOOKS, now - began)
            return OK if now < end else WAIT

        status = stepper.series(count, every, look)
        if phases is not None and looks.count > first:
            safe.y[...] = phases[looks.count - first - 1]
        return OK if status == WAIT else status, refused
