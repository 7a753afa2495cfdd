"""Pair forces from tables of energies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.law import check_law
from kickdrift.forces.pairs.ends import End
from kickdrift.forces.pairs.law import PairForce
from kickdrift.forces.seam.arguments import number
from kickdrift.forces.seam.named import register_force
from kickdrift.forces.tables.curve import curve_through
from kickdrift.forces.tables.given import Tables
from kickdrift.forces.tables.lines import PairTable, pair_table
from kickdrift.forces.tables.reading import Columns, checked
from kickdrift.model.checks.arguments import checked_arguments
from kickdrift.model.checks.values import whole_number
from kickdrift.model.nearness import any_nearer, pairs_nearer
from kickdrift.text import shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject

POINTS = 4000  # of a table of a law
START = 0.2  # of the cutoff, where such a table begins


@checked_arguments
@dataclass(frozen=True, repr=False)
class Tabulated(Tables, PairForce):
    """A pair force from a table of U(r), and perhaps of the force -U'(r): any law, of coarse-graining for example.

    The energy runs through the table's points, twice continuously differentiable; the force is exactly its slope. The
    table's force gives the slopes at its points, and is checked against the energies. Nearer than the table's first
    distance there is no law: a system that begins there is refused, and a run that comes there stops. ``species`` and
    ``pairs`` may have tables of their own. The default cutoff is the table's end.
    """

    Parameters: ClassVar[Any] = PairTable
    name: ClassVar[str] = "tabulated"
    dimensions: ClassVar[dict[str, str]] = {
        "length_unit": "length", "energy_unit": "energy", "cutoff": "length", "switch_start": "length"
    }  # fmt: skip

    def __post_init__(self) -> None:
        if self.tail:
            raise InputError(f"{self.name}: tail: a table says nothing beyond its end")
        self.keep_files("species", "pairs")
        super().__post_init__()

    def __str__(self) -> str:
        return repr(self)

    def law_of_columns(self, where: str, columns: Columns, given: Mapping[str, Any]) -> Any:
        """See Tables."""
        length, energy = (given.get(key) or 1.0 for key in ("length_unit", "energy_unit"))
        checked(where, columns.x, columns.energy, columns.force, "r", length)
        if not columns.x[0] > 0:
            raise InputError(f"{where}: begins at r = {columns.x[0]:g}; the first distance must be above zero")
        force = None if columns.force is None else columns.force * (energy / length)
        return pair_table(curve_through(columns.x * length, columns.energy * energy, force))

    def _tables_given(self) -> list[tuple[str, Mapping[str, Any]]]:
        given = super()._tables_given()
        return given[1:] if self.pairs and not given[0][0] and self._empty else given

    @property
    def _empty(self) -> bool:
        return self.file is None and self.table is None

    def _check_given(self, where: str, law: Any, end: End) -> None:
        if end.cutoff > law.reach * (1.0 + 1e-12):
            raise InputError(f"{self.name}: cutoff{where} is {end.cutoff:g}, and its table ends at {law.reach:g}")
        check_law(f"{self.name}{where}", law, end.cutoff)

    def pair_law(self, a: str, b: str) -> Any:
        """Parameters of the law between species a and b."""
        if self._given(a, b) is None and not self.species and self._empty:
            raise InputError(f"{self.name}: pair {a}-{b} has no table")
        return super().pair_law(a, b)

    def shortest(self) -> float:
        """Zero: the tables say themselves how near particles may be."""
        return 0.0

    def check(self, system: Subject) -> None:
        """Refuse a system that this force does not support, and a pair nearer than its table begins."""
        super().check(system)
        for _, given in self._tables_given():
            self.check_units(system, self.given_with(given))
        kinds = combinations_with_replacement(sorted(system.species), 2)
        starts = {pair: float(self.pair_law(*pair).start) for pair in kinds}
        if (near := self._too_near(system, starts)) is not None:
            raise InputError(f"{self.name}: {near}")

    def _too_near(self, system: Subject, starts: Mapping[tuple[str, str], float]) -> str | None:
        """Words for the first pair that is nearer than its table begins; None if there is none."""
        x, limit = np.asarray(system.state.wrapped()), max(starts.values())
        if not any_nearer(x, system.box, limit):
            return None
        i, j = pairs_nearer(x, system.box, limit).T
        scale = np.ones(len(i)) if system.topology is None else system.topology.factor_of(i, j)
        apart = np.linalg.norm(system.box.minimum_image(x[i] - x[j]), axis=1)
        for k in np.flatnonzero(scale > 0):
            a, b = sorted(system.species[system.species_index[each]] for each in (i[k], j[k]))
            if apart[k] < starts[a, b]:
                return (
                    f"particles {i[k]} and {j[k]} are {apart[k]:.6g} apart, and the table of {a}-{b} begins at "
                    f"{starts[a, b]:.6g}"
                )
        return None

    def bind(self, system: Subject, threads: int = 1, mixed: bool = False) -> Any:
        """See PairForce. Mixed precision is refused."""
        if mixed:
            raise InputError(f"{self.name}: takes no mixed precision: float32 cannot hold the addresses of a table")
        return super().bind(system, threads)

    @classmethod
    def of(cls, law: PairForce, start: float | None = None, points: int = POINTS) -> Tabulated:
        """A table of another pair force, with its cutoff and truncation, for each of its pairs of species.

        Parameters
        ----------
        law : pair force, such as ``kd.LennardJones(cutoff=2.5)`` or one of your own
        start : first distance; default a fifth of the cutoff
        points : number of rows, evenly in r
        """
        if not isinstance(law, PairForce):
            raise InputError(f"Tabulated.of: law: expected a pair force, got {shown(law)}")
        count = whole_number("points", points, 5)
        if law.tail:
            raise InputError("Tabulated.of: law: tail: a table says nothing beyond its end")

        def rows(a: str, b: str) -> tuple[tuple[float, ...], ...]:
            found, cutoff = law.pair_law(a, b), law.pair_end(a, b).cutoff
            begin = START * cutoff if start is None else number("Tabulated.of", "start", start)
            if not 0 < begin < cutoff:
                raise InputError(f"Tabulated.of: start must lie between 0 and cutoff {cutoff:g}, got {shown(start)}")
            r = np.linspace(begin, cutoff, count)
            both = np.array([found.law(each * each) for each in r.tolist()], dtype=float)
            return tuple(zip(r.tolist(), both[:, 0].tolist(), (both[:, 1] * r).tolist(), strict=True))

        names = sorted({*(law.species or ()), *(name for pair in law.pairs or () for name in pair)})
        whole: dict[str, Any] = {"cutoff": law.cutoff, "truncation": law.truncation, "switch_start": law.switch_start}
        if not names:
            return cls(table=rows("", ""), **whole)
        pairs = {}
        for a, b in combinations_with_replacement(names, 2):
            end = law.pair_end(a, b)._asdict()
            pairs[a, b] = {"table": rows(a, b), **{key: value for key, value in end.items() if value is not None}}
        return cls(pairs=pairs, **whole)


register_force(Tabulated, overwrite=True)
