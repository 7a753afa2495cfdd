"""Checks before a run's file is continued, also of the user's columns, and the times at which checkpoints are taken."""

import time
from collections.abc import Callable, Mapping

from kickdrift.errors import InputError
from kickdrift.trajectory.layout.checkpoints import Checkpoint, Stored, Table, behind, encoded, same
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.read.recorded import Recorded

Described = tuple[tuple[int, ...], str]  # shape and unit of a column
SHARE = 0.25  # largest share of checkpoints in the bytes written; the first and the last of a run are always taken
SECONDS = 60.0  # longest time between two checkpoints


def check_columns(run: Recorded, given: Mapping[str, Described]) -> None:
    """Refuse to continue a file with other columns than its first part has. A file without samples has no columns
    yet."""
    there = run.columns
    if given == there or not run.committed.samples:
        return
    names = ", ".join(there)
    if not given:
        raise InputError(
            f"{run.path}: was begun with columns of the user ({names}), whose functions a file cannot hold; give these "
            f"columns again, kd.resume(file).run(columns=[…]), or give another output"
        )
    if not there:
        raise InputError(f"{run.path}: was begun without columns, got {', '.join(given)}; give another output")
    if set(given) != set(there):
        raise InputError(f"{run.path}: was begun with the columns {names}, got {', '.join(given)}; give the same ones")
    name = next(name for name in there if given[name] != there[name])
    (shape, unit), (other, label) = there[name], given[name]
    raise InputError(
        f"{run.path}: column {name!r} was begun with shape {shape} and unit {unit!r}, got {other} and {label!r}"
    )


def units_of(columns: Mapping[str, Described] | None) -> dict[str, str]:
    return {name: unit for name, (_, unit) in (columns or {}).items()}


def check_continued(
    run: Recorded,
    run_id: str,
    at: tuple[int, float] | None,
    options: FileOptions | None,
    columns: Mapping[str, Described] | None,
) -> None:
    """Raise InputError unless the file of ``run`` can go on ``at`` a step and time, with these options and columns.

    The file must belong to the run ``run_id``. A file with a damaged end must have its last whole sample ``at`` that
    point. Only the option ``flush`` may differ."""
    path = run.path
    if run.run_id != run_id:
        raise InputError(f"{path}: belongs to another run; give another name, or overwrite it")
    run.check_growing()
    if columns is not None:
        check_columns(run, columns)
    last = run.last_point
    if at and last and behind(at, last):
        raise InputError(f"{path}: ends at step {last[0]}; step {at[0]} cannot follow it")
    if run.kept != run.committed and last and not (at and same(last, *at)):
        raise InputError(f"{path}: damaged after step {last[0]}; resume the run from that step")
    for key in ("store", "compress", "write"):
        if options and getattr(options, key) != getattr(run.options, key):
            raise InputError(f"{path}: was begun with {key}={getattr(run.options, key)!r}, which cannot change")


class Cadence:
    """Takes the checkpoints of a run while its file is written.

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
