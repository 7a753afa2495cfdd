"""What a System can tell of itself without a run: energy, pressure and the force on each particle."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from kickdrift.display.showing import above

if TYPE_CHECKING:
    from kickdrift.model.state import Floats


class MeasuredSystem:
    """Energy, pressure and forces of a System where its particles are now. They need no integrator and no step."""

    def energy(self, threads: int = 1) -> Any:
        """Kinetic, potential and total energy, in the system's units: ``system.energy().potential``.

        Raises
        ------
        RunError
            If the forces or the energy are not finite.
        """
        return above("sample of a System")(self, threads).energies

    def pressure(self, threads: int = 1) -> float:
        """Pressure, in the system's energy unit per volume (per area in two dimensions); nan in open space, for
        forces without a virial and where bodies collide."""
        found: float = above("sample of a System")(self, threads).pressure
        return found

    def net_forces(self, threads: int = 1) -> Floats:
        """Sum of all forces on each particle, (n, 3), also on fixed ones; ``forces`` are the forces themselves."""
        found: Floats = above("forces on a System")(self, threads)
        return found
