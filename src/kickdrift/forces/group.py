"""What every force says of itself: its group, for integrators with several time steps, and what it stands for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from kickdrift.model.subject import Subject


@dataclass(frozen=True, kw_only=True)
class Grouped:
    """Base class of forces that a word of flows can kick apart from others.

    Attributes
    ----------
    group : int
        0 for fast forces, 1 for slower ones, and so on. Methods with multiple time steps, such as ``respa``, evaluate
        a higher group less often. Other methods ignore groups.
    stands_for : str
        What the force is a model of, such as "gravity"; "" if it may stand beside any other force. See
        ``model.doubles``.
    """

    group: int = field(default=0, repr=False)

    stands_for: ClassVar[str] = ""

    def acting_on(self, system: Subject) -> dict[Any, str] | None:
        """Where the force acts, with a text for each place; None if it acts everywhere."""
        return None
