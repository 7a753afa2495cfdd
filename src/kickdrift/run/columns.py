"""Columns that the user defines: checks, and their values at each look."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from math import prod
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.forces.beside.columns import further
from kickdrift.looks.columns import Column, parts
from kickdrift.looks.molecules import molecule_columns
from kickdrift.looks.observers import SAMPLE_BYTES
from kickdrift.looks.record import OBSERVING
from kickdrift.looks.tensor import NAMES, TENSOR
from kickdrift.model.checks.limits import NEVER, check_room
from kickdrift.model.state import Floats
from kickdrift.model.units.quantities import unit_named
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.run.plan.plan import Plan
from kickdrift.run.watcher import Watcher
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.run.advance import Integration


def checked_columns(given: Any, units: UnitSystem | None, own: Sequence[Column] = ()) -> dict[Column, str]:
    """Return the columns that a run writes, each with its unit as text; a Problem has no ``units``.

    ``own`` are kickdrift's own columns of this run, and ``given`` the user's."""
    if isinstance(given, Column) or not isinstance(given, Iterable):
        raise InputError(f"run: columns must be a list of kd.Column, got {shown(given)}")
    found: dict[Column, str] = {}
    labels: dict[str, str] = {}
    for column in (*own, *given):
        if not isinstance(column, Column):
            raise InputError(f"run: columns must be a list of kd.Column; it holds {shown(column)}")
        for label in {column.name, *parts(column.name, column.shape)}:
            if label in labels:
                twice = "there are two of that name" if labels[label] == column.name else "another one has that name"
                raise InputError(f"column {column.name!r}: {label!r} is taken: {twice}")
            labels[label] = column.name
        found[column] = unit_named(column.unit, units, f"column {column.name!r}: unit")
    return found


def check_columns_fit(columns: Iterable[Column], plan: Plan) -> None:
    """Refuse more numbers than fit into memory, if the number of looks is known."""
    numbers = sum(prod(column.shape) for column in columns)
    if plan.every and plan.end_step < NEVER:
        looks = (plan.end_step - plan.begin_step) / plan.every
    else:
        looks = abs(plan.end_time - plan.begin_time) / plan.interval if plan.interval else 0.0
    if numbers and np.isfinite(looks):
        check_room("run", looks, "samples with their columns", SAMPLE_BYTES + 100 + 8 * numbers, "look less often")


def with_body_columns(columns: Any, run: Integration) -> Any:
    """The user's columns, and the masses and radii of bodies that collisions may change, spins and unknowns,
    temperatures of molecules with constraints, and the components of the pressure in a box that changes its shape."""
    own = run.events.roster.columns() if run.events else []
    live = getattr(run.flow, "live", None)
    if live is not None and live.free:
        own.append(Column(TENSOR, "pressure", (len(NAMES),), _pressure_tensor))
    own += molecule_columns(run.system, run.method.drags)
    for force, kind in further(run.system):
        for name, unit, shape, value in kind.listed(force, run.system):
            own.append(Column(name, unit, shape, partial(_of_state, kind.key, value)))
    return [*columns, *own] if own and isinstance(columns, Iterable) else columns


def _of_state(key: str, value: Callable[[Floats], Any], sim: Any) -> Any:
    return value(getattr(sim.state, key))


def _pressure_tensor(sim: Any) -> Floats:
    run = sim.integration
    found: Floats = run.flow.pressure_tensor(run.y, run.time, run.method.drags)
    return found


class ColumnWatcher(Watcher):
    """Evaluates the user's columns at each look.

    Parameters
    ----------
    columns : each column with its unit as text
    run : the Integration to sample
    sim : argument of the columns' functions
    """

    part = OBSERVING

    def __init__(self, columns: Mapping[Column, str], run: Integration, sim: Any) -> None:
        self.columns, self._run, self._sim = columns, run, sim
        self._first: dict[str, Any] | None = None

    @property
    def described(self) -> dict[str, tuple[tuple[int, ...], str]]:
        """Shape and unit of each column, by name."""
        return {column.name: (column.shape, unit) for column, unit in self.columns.items()}

    def begin(self) -> None:
        """Evaluate the columns for the first look, before a file is touched."""
        self._first = self._values(InputError)

    def look(self) -> None:
        """Store the columns' values at the current time."""
        values, self._first = self._first, None
        self._run.record.looks.note(self._values(RunError) if values is None else values)

    def _values(self, kind: Callable[[str], Exception]) -> dict[str, Any]:
        where = f"step {self._run.steps_done} (t = {self._run.time:.9g})"
        return {column.name: _value(column, self._sim, where, kind) for column in self.columns}


def _value(column: Column, sim: Any, where: str, kind: Callable[[str], Exception]) -> float | Floats:
    """Return the checked value of a column's function; an error of type ``kind`` names the column."""
    begin = f"column {column.name!r}: {where}: "
    try:
        given = column.function(sim)
    except Exception as error:  # whatever a user's function raises
        raise kind(" ".join(f"{begin}raised {type(error).__name__}: {error}".split())) from error
    try:
        found = np.asarray(given)
    except Exception:  # rows of different lengths, or an object that numpy cannot convert
        found = np.asarray(None)
    if found.dtype.kind not in "biuf":
        raise kind(f"{begin}returned {shown(given)}; expected a number or an array of numbers")
    if found.shape != column.shape:
        raise kind(f"{begin}returned an array of shape {found.shape}; expected {column.shape}")
    return np.array(found, dtype=float) if column.shape else float(found)
