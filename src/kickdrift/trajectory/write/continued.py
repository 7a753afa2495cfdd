"""Checks before a run's file is continued."""

from __future__ import annotations

from collections.abc import Mapping

from kickdrift.errors import InputError
from kickdrift.trajectory.layout.options import FileOptions
from kickdrift.trajectory.layout.points import behind, same
from kickdrift.trajectory.read.recorded import Recorded
from kickdrift.trajectory.write.columns import Described, check_columns


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
