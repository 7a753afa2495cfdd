"""The log of events: entries that the run has reached, and entries that wait."""

from __future__ import annotations

from typing import Any, Protocol

from kickdrift.errors import InputError
from kickdrift.looks.record import Record
from kickdrift.model.events import is_row
from kickdrift.run.watch.watches import Row


class Recorded(Protocol):
    """An object with a record; see `run.advance.Integration`."""

    record: Record


class Log:
    """Entries for the record of a run.

    The current time of an adaptive run may lie inside a step, but events are searched in the whole step. A later event
    waits until the run reaches its time."""

    def __init__(self, run: Recorded) -> None:
        self._run = run
        self._waiting: list[tuple[float, Row]] = []

    def add(self, row: Row) -> None:
        """Write an entry into the record."""
        self._run.record.events.append(row)

    def wait(self, found: list[tuple[float, Row]]) -> None:
        """Hold back entries, each until the run reaches its time."""
        self._waiting += sorted(found, key=lambda pair: pair[0])

    def tell(self, until: float) -> None:
        """Write the waiting entries up to the time ``until``."""
        late = []
        for due, row in self._waiting:
            if due <= until:
                self.add(row)
            else:
                late.append((due, row))
        self._waiting = late

    def forget(self) -> None:
        """Drop the waiting entries."""
        self._waiting = []

    @property
    def waiting_rows(self) -> list[Row]:
        """Return the waiting entries."""
        return [row for _, row in self._waiting]

    def memory(self) -> list[list[Any]]:
        """Return the waiting entries by value, for a checkpoint."""
        return [[due, row] for due, row in self._waiting]

    def recall(self, memory: Any) -> None:
        """Restore the waiting entries from ``memory``; an InputError if these are not entries."""
        self._waiting = [(due, row) for due, row in memory]
        if not all(isinstance(due, int | float) and is_row(row) for due, row in self._waiting):
            raise InputError("checkpoint: its waiting events are invalid")
