"""Base class of the forces that field and body laws make: parameters, traits and the user's own checks."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from kickdrift.errors import InputError
from kickdrift.forces.laws.central import central_body
from kickdrift.forces.laws.parameters import Kind, given, values_of
from kickdrift.forces.seam.arguments import is_one
from kickdrift.forces.seam.group import Grouped
from kickdrift.text import clean

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


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
