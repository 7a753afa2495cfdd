"""Old public names of a Simulation."""

from __future__ import annotations

from typing import Any
from warnings import warn


class OldNames:
    """Old names of a Simulation's attributes, to be removed after version 0.2."""

    method_state: Any

    @property
    def lattice(self) -> Any:
        """Old name of ``method_state``."""
        _warn_of_lattice()
        return self.method_state

    @lattice.setter
    def lattice(self, value: Any) -> None:
        _warn_of_lattice()
        self.method_state = value


def _warn_of_lattice() -> None:
    warn("Simulation.lattice is deprecated since 0.2; use Simulation.method_state", DeprecationWarning, stacklevel=3)
