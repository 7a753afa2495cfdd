"""Parameters of laws: one value for all particles, or values for each particle, each species or each pair of them.

A parameter's *kind* says what one value is, and over what it may vary. A force keeps what the user gave, as numbers,
tuples and mappings. ``bind`` spreads the values over the particles of a System.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, get_type_hints

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.central import central_body
from kickdrift.forces.laws.law import Form, check_class
from kickdrift.forces.seam.arguments import Vector, is_one, number
from kickdrift.forces.seam.group import Grouped
from kickdrift.model.state import Floats
from kickdrift.text import clean, shown

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


Numbers = float | Sequence[float] | dict[str, float]
Vectors = Vector | Sequence[Vector] | dict[str, Vector]
Pairs = float | Sequence[Sequence[float]] | dict[str, dict[str, float]]


class Kind(NamedTuple):
    """What one value of a parameter is: a number, or three of them.

    Attributes
    ----------
    length : numbers in a value, 1 or 3
    over : 0 for one value, 1 for a value of each particle or species, 2 for each pair
    whole : whether the number is whole
    either : whether one number may stand for three equal ones
    """

    length: int = 1
    over: int = 0
    whole: bool = False
    either: bool = False

    @property
    def hint(self) -> Any:
        """Type of the parameter in a system file."""
        if self.length == 3:
            vectors: Any = Vectors if self.over else Vector
            return float | vectors if self.either else vectors
        return (int if self.whole else float, Numbers, Pairs)[self.over]


def kinds_of(cls: Any, form: Form, over: Callable[[str], int]) -> dict[str, Kind]:
    """Kinds of a law's parameters, from their annotations; ``over`` says how often each may vary.

    Parameters of a class with ``bound`` may have other annotations; they have no kind.

    Raises
    ------
    InputError
        For an annotation other than float, int, tuple[float, float, float] or the first or the last.
    """
    check_class(cls, form.decorator, form.arguments)
    hints, found = hints_of(cls, form), {}
    known = {float: Kind(1), int: Kind(1, whole=True), Vector: Kind(3), float | Vector: Kind(3, either=True)}
    for key in cls._fields:
        if hints.get(key) in known:
            found[key] = known[hints[key]]._replace(over=over(key))
        elif not hasattr(cls, "bound"):
            raise InputError(
                f"{cls.__name__}: {key} must be annotated as float, int or tuple[float, float, float], "
                f"got {shown(hints.get(key))}"
            )
    return found


def hints_of(cls: Any, form: Form) -> dict[str, Any]:
    """Types of a law's parameters, as annotated."""
    try:
        return get_type_hints(cls)
    except (NameError, TypeError) as error:
        raise InputError(f"{cls.__name__}: {form.decorator}: the annotations cannot be read: {error}") from None


# --- checks when the force is made ---


def given(name: str, key: str, value: Any, kind: Kind) -> Any:
    """Return a parameter as numbers, tuples of them and dicts. An InputError names the key and the place."""
    if isinstance(value, Mapping) and kind.over:
        inner = kind._replace(over=kind.over - 1)
        return {str(species): given(name, f"{key}[{shown(species)}]", one, inner) for species, one in value.items()}
    if is_one(value) and (kind.length == 1 or kind.either):
        if kind.whole:
            return _whole(name, key, value)
        return number(name, key, value)
    if kind.over and not _is_value(value, kind):
        return _several(name, key, value, kind)
    return number(name, key, value) if kind.length == 1 else _vector(name, key, value)


def _is_value(value: Any, kind: Kind) -> bool:
    """Tell whether this is one vector, not one for each particle."""
    return kind.length == 3 and (is_one(value) or isinstance(value, str) or all(map(is_one, value)))


def _several(name: str, key: str, value: Any, kind: Kind) -> tuple[Any, ...]:
    if isinstance(value, str):
        raise InputError(f"{name}: {key}: expected numbers, got {shown(value)}")
    inner = kind._replace(over=kind.over - 1)
    return tuple(given(name, f"{key}[{i}]", each, inner) for i, each in enumerate(value))


def _whole(name: str, key: str, value: Any) -> int:
    found = number(name, key, value)
    if not found.is_integer():
        raise InputError(f"{name}: {key}: expected a whole number, got {shown(value)}")
    return int(found)


def _vector(name: str, key: str, value: Any) -> Vector:
    values = [] if is_one(value) or isinstance(value, str) else list(value)
    if len(values) != 3:
        raise InputError(f"{name}: {key}: expected three numbers, got {shown(value)}")
    x, y, z = (number(name, key, each) for each in values)
    return x, y, z


# --- values for the particles of a System ---


def values_of(name: str, key: str, value: Any, kind: Kind, system: Subject) -> Any:
    """Values of a parameter for a System: one value where all particles share one, else an array (n,), (n, 3) or
    (n, n). Raises an InputError that names the key and the particle or species without a value."""
    if isinstance(value, float | int):
        return (value,) * kind.length if kind.length == 3 else value
    if not kind.over:
        return value
    if kind.length == 3 and not isinstance(value, Mapping) and is_one(value[0]):
        return value
    if isinstance(value, Mapping):
        return _by_species(name, key, value, kind, system)
    rows = _rows(name, key, value, system)
    if kind.over == 2:
        rows = [_rows(name, f"{key}[{i}]", row, system) for i, row in enumerate(rows)]
    return np.array(rows)


def _rows(name: str, key: str, value: Sequence[Any], system: Subject) -> list[Any]:
    """Values of the particles that the system has now, by id."""
    ids, count = system.state.ids, len(value)
    most = max(len(system), int(ids.max()) + 1)
    if count < most:
        raise InputError(f"{name}: {key}: {count} values for {most} particles; particle {count} has none")
    if count > most and most == len(system):
        raise InputError(f"{name}: {key}: {count} values for {most} particles; there is no particle {most}")
    return [value[i] for i in ids]


def _by_species(name: str, key: str, value: Mapping[str, Any], kind: Kind, system: Subject) -> Floats:
    for k, species in enumerate(system.species):
        if species not in value:
            first = int(np.flatnonzero(system.species_index == k)[0])
            known = ", ".join(value) or "none"
            raise InputError(f"{name}: {key}: particle {first} has species {species!r}, which has no value ({known})")
    if kind.over == 1:
        return np.array([value[species] for species in system.species])[system.species_index]
    table = [[_pair(name, key, value, a, b) for b in system.species] for a in system.species]
    return np.array(table)[np.ix_(system.species_index, system.species_index)]


def _pair(name: str, key: str, value: Mapping[str, Mapping[str, float]], a: str, b: str) -> float:
    """Value of a pair of species, given under either of them."""
    for one, other in ((a, b), (b, a)):
        if other in value[one]:
            return value[one][other]
    raise InputError(f"{name}: {key}: the pair {a}-{b} has no value")


@dataclass(frozen=True, kw_only=True)
class LawForce(Grouped):
    """A force with the parameters of a law.

    Attributes
    ----------
    group : int
        See ``Grouped``.
    velocity_dependent, time_dependent, works : bool
        What the law's class says; see ``field_law``.
    """

    velocity_dependent: ClassVar[bool] = False
    time_dependent: ClassVar[bool] = False
    works: ClassVar[bool] = False

    Parameters: ClassVar[Any]  # the law's NamedTuple class
    kinds: ClassVar[dict[str, Kind]]
    name: ClassVar[str]
    dimensions: ClassVar[dict[str, str]]

    def __post_init__(self) -> None:
        for key, kind in self.kinds.items():
            object.__setattr__(self, key, given(self.name, key, getattr(self, key), kind))
        self._ask("check")

    @property
    def joins(self) -> bool:
        """Whether a parameter lists particles one by one; such particles may neither merge nor leave."""
        return any(self._listed(key, kind) for key, kind in self.kinds.items())

    def _listed(self, key: str, kind: Kind) -> bool:
        """Whether a parameter has a value for each particle."""
        value = getattr(self, key)
        return kind.over > 0 and isinstance(value, tuple) and not (kind.length == 3 and is_one(value[0]))

    @property
    def law(self) -> Any:
        """The parameters as the user gave them."""
        return self.Parameters(*(getattr(self, key) for key in self.Parameters._fields))

    def values(self, system: Subject) -> dict[str, Any]:
        """The parameters for this system's particles: one value, or an array of a value for each."""
        return {key: values_of(self.name, key, getattr(self, key), kind, system) for key, kind in self.kinds.items()}

    def check(self, system: Subject) -> None:
        """Refuse a system that the law's class refuses."""
        self._ask("check_system", system)

    def acting_on(self, system: Subject) -> dict[Any, str] | None:
        """Where the force acts: the bodies to which the parameter that the law names in ``acts_by`` gives a share, or
        the one that ``central`` names; else everywhere."""
        if key := getattr(self.Parameters, "acts_by", ""):
            share = np.broadcast_to(self.values(system)[key], len(system))
            return {int(i): f"the bulge of {system.body(int(i))}" for i in np.flatnonzero(share)}
        if not hasattr(self, "central"):
            return None
        central = central_body(self.name, self.central, system)
        return {central: system.body(central)}

    def with_law(self, law: Any) -> Any:
        """The same force with these parameters, which are not checked."""
        made = copy(self)
        for key, value in law._asdict().items():
            object.__setattr__(made, key, value)
        return made

    def _ask(self, hook: str, *arguments: Any) -> None:
        """Call a check of the law's class, if there is one."""
        if function := getattr(self.Parameters, hook, None):
            try:
                function(self.law, *arguments)
            except InputError as error:
                text = str(error)
                raise error if text.startswith(f"{self.name}: ") else InputError(f"{self.name}: {text}") from None
            except (ArithmeticError, TypeError, ValueError) as error:
                raise InputError(f"{self.name}: {clean(' '.join(str(error).split()), 200)}") from None
