"""Messages to a live view of a run: frames, curves and a line of text, a few times a second.

The run's own thread packs them between two calls of compiled code. No further look is taken, so the run keeps its bits.
Frames get a small share of the processor's time, so the run keeps its speed.
"""

from collections.abc import Callable
from threading import Lock
from time import monotonic, process_time, thread_time
from typing import Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.looks.columns import ENERGY_TAKEN, KINETIC, TEMPERATURE, TIME, TOTAL
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import symbol_of
from kickdrift.run.simulation import Simulation
from kickdrift.statistics.drift import energy_error
from kickdrift.text import duration
from kickdrift.view.packing import curve, energy_curve
from kickdrift.view.scene import Scene, phase_of, scene_of, whole_of
from kickdrift.view.stage import Stage

APART = 0.25  # seconds between two frames
SHARE = 0.004  # of the processor's time that frames may take
WAITING = 0.25  # share of the clock that counts as processor's time, for a run in other processes
FEWER = 1000.0  # a run of hours has a frame each time that a thousandth of it has passed

FRAME, TOLD, END = "frame", "told", "end"  # kinds of messages
Send = Callable[[str, dict[str, Any]], None]

# For pages and widgets: of the frames that come while one is unpacked, the last is shown.
NEWEST = """
function newest(show) {
  let busy = false, next = null;
  return async (frame) => {
    next = frame;
    while (next && !busy) {
      const taken = next;
      next = null;
      busy = true;
      try { await show(taken); } finally { busy = false; }
    }
  };
}
"""


class Feed:
    """Follows a Simulation, and sends what a view shows.

    Parameters
    ----------
    sim : Simulation of particles
    send : takes the kind of a message and its content: a chunk of ``Stage.chunk``, or step, text and curves
    listened : whether anyone takes messages now
    """

    def __init__(self, sim: Simulation, send: Send, listened: Callable[[], bool] = lambda: True) -> None:
        whole = whole_of(sim)
        if not isinstance(whole, System):
            raise InputError("live: a Problem has no particles to show")
        self._sim, self._send, self._listened = sim, send, listened
        self._stage = Stage.of(whole)
        self._row, self._record = 0, sim.record  # looks that were sent, of this record
        self._next = self._last = self._began = 0.0  # by the clock
        self._spent = self._owed = 0.0  # processor's time at the last frame, and until the next one
        self._from: tuple[float, int] | None = None  # when the first progress was told, and the step then
        self._settling: tuple[float, int] | None = None  # the same of an equilibration
        self._start = 0
        self._said, self._scene = "before the first step", scene_of(sim)
        self.lock = Lock()  # held while messages are made

    def scene(self) -> Scene:
        """The scene of the last frame, with the curves up to there. Any thread may ask for it, with the lock."""
        return self._scene | {"curves": self._curves(0, self._row), "status": self._said}

    # --- a follower of the run ---

    def begin(self) -> None:
        """Begin with a run."""
        self._began, self._next, self._owed, self._from, self._settling = monotonic(), 0.0, 0.0, None, None
        with self.lock:
            self._said, self._scene = f"step {self._sim.steps_done:,}", scene_of(self._sim)

    def settle(self, sim: Any, done: int, of: int) -> None:
        """Send a frame of the equilibration, whose times and steps end at zero; ``sim`` takes the steps."""
        now = monotonic()
        if self._settling is None or done < self._settling[1]:
            self._settling, self._began = (now, done), now
        if self._due(now):
            first, begun = self._settling
            left = f" · {duration((now - first) * (of - done) / (done - begun))} left" if done > begun else ""
            text = f"equilibrating · step {done:,} of {of:,}{left}"
            self._send_now(now, text, sim, (done - of, (done - of) * (sim.dt or 0.0)))

    def follow(self, done: int, of: int) -> None:
        """Send a frame, if one is due and anyone listens."""
        now = monotonic()
        if self._from is None:
            self._from, self._start = (now, self._sim.steps_done), done
        if self._due(now):
            self._send_now(now, self._pace(done, of, now), self._sim)

    def _due(self, now: float) -> bool:
        """Whether a frame may be sent now, and anyone listens."""
        if now < self._next or not self._listened():
            return False
        return max(process_time() - self._spent, WAITING * (now - self._last)) >= self._owed

    def _send_now(self, now: float, text: str, sim: Simulation, settling: tuple[int, float] | None = None) -> None:
        """Send a frame, unless a page is being made, and note what the frame cost."""
        if not self.lock.acquire(blocking=False):
            return
        before = thread_time()
        try:
            self._tell(text, sim, settling)
        finally:
            self.lock.release()
        took = thread_time() - before
        self._spent, self._owed, self._last = process_time(), took / SHARE, now
        self._next = now + max(APART, (now - self._began) / FEWER)

    def end(self, whole: bool) -> None:
        """Send the last frame."""
        if not self._listened():
            return
        sim = self._sim
        word = "finished" if whole and not sim.stopped else "stopped"
        reason = f": {sim.stopped}" if sim.stopped else ""
        with self.lock:
            self._tell(f"{word} at step {sim.steps_done:,}{reason}", sim)
            self._send(END, {})

    def _pace(self, done: int, of: int, now: float) -> str:
        """Step, steps a second and the time left, as text."""
        assert self._from is not None
        since, first = self._from
        parts = [f"step {self._sim.steps_done:,}"]
        if now - since > 0.2 and self._sim.steps_done > first:
            parts.append(f"{(self._sim.steps_done - first) / (now - since):,.0f} steps/s")
        if now - since > 0.2 and done > self._start:
            parts.append(f"{100 * done / of:.0f} %")
            parts.append(f"{duration((now - since) * (of - done) / (done - self._start))} left")
        return " · ".join(parts)

    def _tell(self, text: str, sim: Simulation, settling: tuple[int, float] | None = None) -> None:
        """Send the present frame, and the looks that were not sent. An equilibration has no looks, and gives the
        step and the time of its frame."""
        run = sim.integration
        state = run.flow.shared_state(run.y, run.time, run.steps_done)  # type: ignore[union-attr]
        x, v, held = phase_of(self._stage, state)
        step, time = settling or (state.steps_done, state.time)
        frame = self._stage.chunk([step], [time], x[None], v[None], [state.box], held=held[None])
        self._said, self._scene = text, self._scene | {"chunks": [frame]}
        self._send(TOLD, {"step": step, "text": text, "curves": [] if settling else self._new_curves()})
        self._send(FRAME, frame)

    def _new_curves(self) -> list[dict[str, Any]]:
        """Curves of the looks that were not sent."""
        record = self._sim.record
        if record is not self._record:  # a new record begins with new energies
            self._record, self._row = record, 0
        row, self._row = self._row, record.looks.count
        return self._curves(row, self._row)

    def _curves(self, first: int, last: int) -> list[dict[str, Any]]:
        """Energy error and temperature of the looks from ``first`` to ``last``."""
        rows = self._record.looks.rows[:last]
        if last <= first:
            return []
        units, times, new = self._sim.system.units, rows[first:, TIME], rows[first:]
        total: Floats = rows[:, TOTAL] + np.nan_to_num(rows[:, ENERGY_TAKEN])
        found = []
        if np.isfinite(total).all():
            kinetic = float(rows[0, KINETIC])
            error = energy_error(total[:1], kinetic)
            found.append(energy_curve(times, total[first:] - total[0], error, kinetic, units))
        if np.isfinite(new[:, TEMPERATURE]).all():
            unit = symbol_of(units.temperature)
            found.append(curve("temperature", "temperature", unit, times, new[:, TEMPERATURE]))
        return found
