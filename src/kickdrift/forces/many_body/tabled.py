"""Many-body forces whose parameters are numbers for each triple of species."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.many_body.base import ManyBodyForce
from kickdrift.forces.many_body.entries import checked_entries, elements_of, entry_of, read_entries

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


class TabledForce(ManyBodyForce):
    """A many-body force with ``entries``, a table of numbers for each triple of species; the first is at the centre.

    The numbers of a file become the entries, so a run keeps them and needs the file no more."""

    keys: ClassVar[tuple[str, ...]]
    suffix: ClassVar[str]  # of files
    default: ClassVar[Mapping[str, Any]]

    entries: Mapping[str, Mapping[str, float]] | None
    file: str | None

    def _settle(self) -> None:
        """Bring the file or the default into the entries."""
        if self.file is not None and self.entries is not None:
            raise InputError(f"{self.name}: give entries or a file, not both")
        given: Any = self.entries
        if self.file is not None:
            given = read_entries(self.name, self.file, self.suffix, self.keys)
        elif given is None:
            given = self.default
        object.__setattr__(self, "_source", self.file or ("entries" if self.entries is not None else "the default"))
        object.__setattr__(self, "entries", checked_entries(self.name, given, self.keys))
        object.__setattr__(self, "file", None)
        for triple, numbers in self.table.items():
            _, second, third = triple.split("-")
            if second == third:  # other entries leave numbers of pairs unused
                self.check_pair(f"{self.name}: {triple}", numbers)

    @property
    def table(self) -> Mapping[str, Mapping[str, float]]:
        """The entries."""
        assert self.entries is not None
        return self.entries

    @property
    def elements(self) -> tuple[str, ...]:
        """Species with parameters."""
        return elements_of(self.table)

    @property
    def source(self) -> str:
        """The source of the parameters, for messages."""
        found: str = self._source  # type: ignore[attr-defined]
        return found

    def entry(self, *triple: str) -> Mapping[str, float]:
        """Numbers of three species. Raises InputError without them."""
        found: Mapping[str, float] = entry_of(self.name, self.source, self.table, *triple)
        return found

    def check_pair(self, where: str, numbers: Mapping[str, float]) -> None:
        """Refuse numbers of a pair that make no sense; ``where`` begins the message."""
        raise NotImplementedError

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support."""
        super().check(system)
        self.law(system.species)
