"""What all classes of forces share: their group, what they stand for, parameters as text; and a base for lists."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.units.quantities import UnitSystem, has_unit, quantity

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


@dataclass(frozen=True, kw_only=True)
class Grouped:
    """Base class of forces that a word of flows can kick apart from others.

    Parameters may be texts with units, as in ``kd.LennardJones(epsilon="120 K", sigma="3.4 angstrom")``. They become
    numbers when a System takes the force, in the units of that System. Until then, the force is an `InText`.

    Attributes
    ----------
    group : int
        0 for fast forces, 1 for slower ones, and so on. Methods with multiple time steps, such as ``respa``, evaluate
        a higher group less often. Other methods ignore groups.
    stands_for : str
        What the force is a model of, such as "gravity"; "" if it may stand beside any other force. See
        ``model.body_checks``.
    on_sites : bool
        Whether the force may act on virtual sites: it is divided by masses, and depends on nothing else of them.
    """

    group: int = field(default=0, repr=False)

    stands_for: ClassVar[str] = ""
    on_sites: ClassVar[bool] = False

    def half_height(self, system: Subject) -> float:
        """Half the least height that the box must keep for this force."""
        return 0.0

    def fixes_box(self, system: Subject) -> str:
        """Why no barostat can change the box under this force; "" if one can, since the force follows the box and gives
        its virial: see ``forces.bound.forces.in_live_box``."""
        return "it acts on each particle alone, so it has no virial"

    def fixes_shape(self, system: Subject) -> str:
        """Why no barostat can change edges apart under this force; "" if one can."""
        return ""

    def fixes_edges(self, system: Subject) -> str:
        """Why no barostat can change angles between edges under this force; "" if one can."""
        return ""

    def keeps_edges(self, system: Subject) -> str:
        """What the force ties to these edges, so that the box takes no others of the same lattice; "" if nothing."""
        return ""

    def stated_error(self) -> float:
        """Relative root-mean-square error of the forces that the user has asked; 0 for an exact sum."""
        return 0.0

    def acting_on(self, system: Subject) -> dict[Any, str] | None:
        """Where the force acts, with a text for each place; None if it acts everywhere."""
        return None

    def __new__(cls, *args: Any, **given: Any) -> Any:
        """Return an `InText` if a parameter with a dimension is text with a unit."""
        if any(map(_holds_text, (*args, *given.values()))):
            try:
                named = inspect.signature(cls).bind(*args, **given).arguments
            except TypeError:  # ``__init__`` says what is wrong
                named = {}
            dimensions: Mapping[str, str] = getattr(cls, "dimensions", {})
            if any(_in_units(value, dimensions, key, None, "") is not value for key, value in named.items()):
                return InText(cls, named)
        return super().__new__(cls)


@dataclass(frozen=True, eq=False, repr=False)
class InText:
    """A force some of whose parameters are text with units; a System makes the force of it in its own units."""

    of: type
    given: Mapping[str, Any]

    def __repr__(self) -> str:
        return f"{self.of.__name__}({', '.join(f'{key}={value!r}' for key, value in self.given.items())})"

    def in_units(self, units: UnitSystem) -> Any:
        """The force with its parameters as numbers in these units."""
        cls: Any = self.of
        return cls(**{key: _in_units(value, cls.dimensions, key, units, cls.name) for key, value in self.given.items()})

    def check(self, system: Any) -> None:
        """Refuse a use without a System that knows the units."""
        raise InputError(f"{self}: has texts with units; give it to kd.System, which knows its units")


def _holds_text(value: Any) -> bool:
    """Whether the value is text that may have a unit, or holds such text."""
    if isinstance(value, str):
        return has_unit(value)
    values = value.values() if isinstance(value, Mapping) else value if isinstance(value, list | tuple) else ()
    return any(map(_holds_text, values))


def _in_units(value: Any, dimensions: Mapping[str, str], key: str, units: UnitSystem | None, where: str) -> Any:
    """The value of a parameter with its texts as numbers in ``units``; the value itself if it has no such text. Without
    units, texts become zero. Tables of species, pairs and types hold the names of parameters, or values of one."""
    if not _holds_text(value):
        return value
    if isinstance(value, Mapping):
        made = {
            each: _in_units(one, dimensions, each if each in dimensions else key, units, where)
            for each, one in value.items()
        }
        return made if any(made[each] is not one for each, one in value.items()) else value
    if isinstance(value, list | tuple):
        row = [_in_units(one, dimensions, key, units, where) for one in value]
        return type(value)(row) if any(a is not b for a, b in zip(row, value, strict=True)) else value
    if key not in dimensions:
        return value
    return 0.0 if units is None else quantity(value, dimensions[key], units, f"{where}: {key}")


MANY = 4  # rows of a table that a line shows


def brief(force: Any, key: str) -> str:
    """A force as text, in which a table ``key`` of many rows is only their number."""
    table, text = getattr(force, key), repr(force)
    return text if not table or len(table) <= MANY else text.replace(repr(table), f"{{{len(table)} {key}}}")


class ListedForce:
    """A force with a cutoff, whose particles find each other through a list of neighbours.

    ``bind(system, threads, mixed)`` returns a `pairs.kernel.PairKernel`."""

    name: ClassVar[str]
    thermal: ClassVar[bool] = True  # particles act on each other, so that samples have a temperature
    has_pairs: ClassVar[bool] = True  # ``bind`` takes the precision of pairs

    def half_height(self, system: Subject) -> float:
        """See Grouped: the cutoff."""
        cutoff: float | None = self.cutoff  # type: ignore[attr-defined]
        return float(cutoff or 0.0)

    def fixes_box(self, system: Subject) -> str:
        """See Grouped: pairs scale with the box."""
        return ""


def refuse_massless(name: str, system: Subject, what: str = "this force") -> None:
    """Refuse a System with a particle without mass, for a force that accelerates particles by their inverse mass."""
    massless = system.state.masses == 0
    if system.virtual_sites is not None:
        massless[system.virtual_sites.particles] = False
    if massless.any():
        raise InputError(
            f"{name}: particle {np.flatnonzero(massless)[0]} has no mass, and {what} would move it infinitely fast"
        )


def reach_of(system: Any) -> float:
    """Half the least height of the box that the System's forces allow."""
    return max(
        (float(force.half_height(system)) for force in system.forces if hasattr(force, "half_height")), default=0.0
    )
