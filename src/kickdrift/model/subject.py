"""What forces see of a System."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import NDArray

from kickdrift.model.box import Box
from kickdrift.model.state import Floats, State
from kickdrift.model.units import UnitSystem


class Subject(Protocol):
    """Particles that forces act on; see ``System``."""

    @property
    def name(self) -> str: ...

    @property
    def state(self) -> State: ...

    @property
    def box(self) -> Box: ...

    @property
    def units(self) -> UnitSystem: ...

    @property
    def forces(self) -> tuple[Any, ...]: ...

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def species(self) -> tuple[str, ...]: ...

    @property
    def species_index(self) -> NDArray[Any]: ...

    @property
    def coherent_masses(self) -> Floats: ...

    def __len__(self) -> int: ...

    def body(self, i: int) -> str:
        """Name of a particle for people."""
