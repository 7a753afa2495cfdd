"""The log of events: what the present has come to, and what waits for it."""

from __future__ import annotations

from typing import Any, Protocol

from kickdrift.errors import InputError
from kickdrift.looks.record import Record
from kickdrift.model.event_log import is_row
from kickdrift.run.watch.watches import Row


class Recorded(Protocol):
    """What has a record; see `run.advance.Integration`."""

    record: Record


class Log:
    """Entries for the record of a run.

    The present of an adaptive run may lie inside a step that was searched as a whole. An event beyond the present waits
    until the present has come there."""

    def __init__(self, run: Recorded) -> None:
        self._run = run
        self._waiting: list[tuple[float, Row]] = []

    def add(self, row: Row) -> None:
        """Write an entry into the record."""
        self._run.record.events.append(row)

    def wait(self, found: list[tuple[float, Row]]) -> None:
        """Let entries wait, each until the present has come to its time."""
        self._waiting += sorted(found, key=lambda pair: pair[0])

    def tell(self, until: float) -> None:
        """Write the entries whose time is up."""
        late = []
        for due, row in self._waiting:
            if due <= until:
                self.add(row)
            else:
                late.append((due, row))
        self._waiting = late

    def forget(self) -> None:
        """Drop what waits."""
        self._waiting = []

    @property
    def waiting_rows(self) -> list[Row]:
        """The entries that wait."""
        return [row for _, row in self._waiting]

    def memory(self) -> list[list[Any]]:
        """What waits, by value."""
        return [[due, row] for due, row in self._waiting]

    def recall(self, memory: Any) -> None:
        """Wait for what this memory has; an InputError where it has something else."""
        self._waiting = [(due, row) for due, row in memory]
        if not all(isinstance(due, int | float) and is_row(row) for due, row in self._waiting):
            raise InputError("checkpoint: what its events wait for are none")
