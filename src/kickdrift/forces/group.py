"""Group of a force, for integrators with several time steps."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, kw_only=True)
class Grouped:
    """Base class of forces that a word of flows can kick apart from others.

    Attributes
    ----------
    group : int
        0 for fast forces, 1 for slower ones, and so on. Methods with multiple time steps, such as ``respa``, evaluate
        a higher group less often. Other methods ignore groups.
    """

    group: int = field(default=0, repr=False)
