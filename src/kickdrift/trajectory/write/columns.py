"""User columns in a run's file: their description, and the check that a continued run has the same columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from kickdrift.errors import InputError

if TYPE_CHECKING:
    from kickdrift.trajectory.read.recorded import Recorded

Described = tuple[tuple[int, ...], str]  # shape and unit of a column


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
    """The unit of each column."""
    return {name: unit for name, (_, unit) in (columns or {}).items()}
