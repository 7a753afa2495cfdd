"""Common parts of all many-body forces: checks, binding, and parameters that are numbers for each triple of species."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from os import PathLike
from typing import TYPE_CHECKING, Any, ClassVar

from kickdrift.errors import InputError
from kickdrift.forces.many_body.entries import checked_entries, elements_of, entry_of, likest, read_entries
from kickdrift.forces.seam.group import Grouped, ListedForce, refuse_massless
from kickdrift.model.checks.values import path_text
from kickdrift.text import choices, shown, suggestion

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


class ManyBodyForce(ListedForce, Grouped):
    """A force whose energy depends on the neighbourhood of each particle; its numbers are in eV and angstroms."""

    name: ClassVar[str]
    elements: Mapping[str, str] | None

    @property
    def stands_for(self) -> str:  # type: ignore[override]
        """What the force is a model of: itself."""
        return self.name

    @property
    def cutoff(self) -> float:
        """Largest distance of particles that interact, in angstroms."""
        raise NotImplementedError

    @property
    def known(self) -> tuple[str, ...]:
        """Names that the parameters use."""
        raise NotImplementedError

    @property
    def source(self) -> str:
        """The source of the parameters, for messages."""
        raise NotImplementedError

    def law(self, species: tuple[str, ...]) -> Any:
        """Return the law's parts for compiled code: parameters of these species, as yet without workspace."""
        raise NotImplementedError

    def named(self, species: Iterable[str]) -> tuple[str, ...]:
        """Names of these species in the parameters. Raises an InputError that names a species without any."""
        names = tuple((self.elements or {}).get(each, each) for each in species)
        for each, name in zip(species, names, strict=True):
            if name not in self.known:
                called = "" if name == each else f", called {name!r},"
                raise InputError(
                    f"{self.name}: species {each!r}{called} has no parameters in {self.source}, which has "
                    f"{', '.join(self.known)}"
                )
        return names

    def check_elements(self) -> None:
        """Refuse ``elements`` that are no names, or that the parameters lack."""
        if self.elements is None:
            return
        texts = isinstance(self.elements, Mapping) and [*self.elements, *self.elements.values()]
        if not texts or not all(isinstance(each, str) for each in texts):
            raise InputError(
                f"{self.name}: elements: expected names by species, such as {{'Si': 'Si(D)'}}, got "
                f"{shown(self.elements)}"
            )
        object.__setattr__(self, "elements", dict(self.elements))
        self.named(self.elements)

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support."""
        if system.units.name != "metal":
            raise InputError(
                f"{self.name}: its parameters are in eV and angstroms, which needs units 'metal', not "
                f"{system.units.name!r}"
            )
        if system.dimensions != 3:
            raise InputError(f"{self.name}: works in three dimensions, and the system has {system.dimensions}")
        self.named(system.species)
        if strange := [each for each in self.elements or () if each not in system.species]:
            raise InputError(
                f"{self.name}: elements: no particle is of species {choices(map(repr, strange))}"
                f"{suggestion(strange[0], system.species)} (species: {choices(system.species)})"
            )
        if system.topology is not None and len(system.topology.scaled.pairs):
            raise InputError(f"{self.name}: acts on all particles; a topology can leave out or scale only pair forces")
        system.box.check_cutoff(self.name, self.cutoff, system.units)
        refuse_massless(self.name, system)

    def bind(self, system: Subject, threads: int = 1, mixed: bool = False) -> Any:
        """Bind this force to a System, with its list of neighbours. ``mixed`` is its precision."""
        from kickdrift.forces.many_body.binding import bind

        return bind(self, system, threads, mixed)


class TabledForce(ManyBodyForce):
    """A many-body force with ``entries``, a table of numbers for each triple of species; the first is at the centre.

    The numbers of a file become the entries, so a run keeps them and needs the file no more."""

    forms: ClassVar[Mapping[str, tuple[str, ...]]]  # keys of entries by the suffix of their files, in their order
    default: ClassVar[Mapping[str, Any]]
    default_name: ClassVar[str]

    entries: Mapping[str, Mapping[str, float]] | str | PathLike[str] | None
    file: str | None

    def _settle(self) -> None:
        """Bring the file or the default into the entries. A path in their place is the file."""
        if isinstance(self.entries, str | PathLike):
            if self.file is not None:
                raise InputError(f"{self.name}: give one file, not {shown(self.entries)} and {shown(self.file)}")
            object.__setattr__(self, "file", path_text(f"{self.name}: file", self.entries))
            object.__setattr__(self, "entries", None)
        if self.file is not None and self.entries is not None:
            raise InputError(f"{self.name}: give entries or a file, not both")
        given: Any = self.entries
        if self.file is not None:
            given = read_entries(self.name, self.file, self.forms)
        elif given is None:
            given = self.default
        object.__setattr__(self, "_source", self.file or ("entries" if self.entries is not None else "the default"))
        object.__setattr__(self, "_form", likest(self.forms, given))
        object.__setattr__(self, "entries", checked_entries(self.name, given, self.keys))
        object.__setattr__(self, "file", None)
        for triple, numbers in self.table.items():
            _, second, third = triple.split("-")
            if second == third:  # other entries leave numbers of pairs unused
                self.check_pair(f"{self.name}: {triple}", numbers)
        self.check_elements()

    @property
    def form(self) -> str:
        """The form of the entries, as the suffix of their files."""
        found: str = self._form  # type: ignore[attr-defined]
        return found

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys of an entry, in the order of files."""
        return self.forms[self.form]

    @property
    def table(self) -> Mapping[str, Mapping[str, float]]:
        """The entries."""
        assert isinstance(self.entries, Mapping)
        return self.entries

    def __repr__(self) -> str:
        """The default set by its name; else the entries."""
        elements = "" if self.elements is None else f", elements={dict(self.elements)!r}"
        if self.table == checked_entries(self.name, self.default, self.keys):
            return f"{type(self).__name__}({self.default_name}{elements})"
        return f"{type(self).__name__}(entries={dict(self.table)!r}{elements})"

    @property
    def known(self) -> tuple[str, ...]:
        """Names that the entries use."""
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
