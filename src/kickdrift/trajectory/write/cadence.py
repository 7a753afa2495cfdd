"""Times at which a run's checkpoints are taken."""

from __future__ import annotations

import time
from collections.abc import Callable

from kickdrift.trajectory.layout.checkpoints import Checkpoint, Stored, Table, encoded
from kickdrift.trajectory.layout.points import same

SHARE = 0.25  # largest share of checkpoints in the bytes written; the first and the last of a run are always taken
SECONDS = 60.0  # longest time between two checkpoints


class Cadence:
    """Takes checkpoints of a run as it is written.

    Attributes
    ----------
    written : int
        Bytes of rows since the last checkpoint.
    """

    def __init__(self, checkpoint: Callable[[], Checkpoint] | None) -> None:
        self._checkpoint = checkpoint
        self._at, self.written, self._size = time.monotonic(), 0, 0

    def take(self) -> Stored | None:
        """Return a checkpoint of the present, or None if the run has no checkpoints."""
        if self._checkpoint is None:
            return None
        found = self._checkpoint()
        stored = Stored(int(found["step"]), float(found["time"]), encoded(found))
        self._at, self.written, self._size = time.monotonic(), 0, stored.size
        return stored

    def due(self, table: Table, last: tuple[int, float] | None, final: bool, anew: bool) -> Stored | None:
        """Return a checkpoint of the ``last`` sample if one is due and not stored yet, else None. With ``anew``, ignore
        that the file already has a checkpoint of this step: the run's state was replaced."""
        if last is None or (not anew and table.rows and same((int(table.steps[-1]), float(table.times[-1])), *last)):
            return None
        if final or SHARE * self.written >= self._size or time.monotonic() - self._at >= SECONDS:
            return self.take()
        return None
