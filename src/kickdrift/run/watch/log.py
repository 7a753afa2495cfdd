"""The log of events: entries up to the present, and entries that wait for their time."""

from __future__ import annotations

from typing import Any, Protocol

from kickdrift.errors import InputError
from kickdrift.looks.record import Record
from kickdrift.model.event_log import Row, is_row


class Recorded(Protocol):
    """Integration with a record; see `run.advance.Integration`."""

    record: Record


class Log:
    """Entries for the record of a run.

    The present of an adaptive run may lie inside a step, but the search covers whole steps. A later event waits until
    the present reaches it.
    """

    def __init__(self, run: Recorded) -> None:
        self._run = run
        self._waiting: list[tuple[float, Row]] = []

    def add(self, row: Row) -> None:
        """Write an entry into the record."""
        self._run.record.events.append(row)

    def wait(self, found: list[tuple[float, Row]]) -> None:
        """Keep entries until the present reaches their times."""
        self._waiting += sorted(found, key=lambda pair: pair[0])

    def tell(self, until: float) -> None:
        """Write the entries up to this time."""
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
        """Waiting entries."""
        return [row for _, row in self._waiting]

    def memory(self) -> list[list[Any]]:
        """Waiting entries with their times."""
        return [[due, row] for due, row in self._waiting]

    def recall(self, memory: Any) -> None:
        """Restore waiting entries. Raises InputError for anything else."""
        self._waiting = [(due, row) for due, row in memory]
        if not all(isinstance(due, int | float) and is_row(row) for due, row in self._waiting):
            raise InputError("checkpoint: its waiting events are invalid")
