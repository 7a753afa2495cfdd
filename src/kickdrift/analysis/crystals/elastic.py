"""Elastic constants of a crystal from stress under finite strain, at rest and with all internal motion relaxed.

The stress of a strained crystal is the slope of its energy along a further strain, over the volume, by central
differences of order 4. So any force has a stress here, also a user's own or a calculator. All strains act on the box
and the particles alike, and the particles then move to their minimum of energy.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kickdrift.display.showing import Lines, Shown, Table
from kickdrift.errors import InputError, RunError
from kickdrift.forces.bound.forces import BoundForces
from kickdrift.model.box.box import Box
from kickdrift.model.checks.values import positive
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.quantities import quantity
from kickdrift.run.minimization import minimum
from kickdrift.text import measured

AXES = ("xx", "yy", "zz", "yz", "xz", "xy")  # Voigt's order
PLACES = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
PROBE = 2.5e-4  # further strains along which the energy has its slope
STEPS = 20_000  # most steps of a relaxation
RELAXED = 1e-6  # of the largest force right after a strain
REST = 1e-12  # of energy over length: a force that is rounding
LARGEST = 0.05  # strain


@dataclass(frozen=True, repr=False)
class ElasticConstants(Shown):
    """Result of `elastic_constants`, in the system's unit of pressure.

    Attributes
    ----------
    matrix : (6, 6) slopes of the stress by the strain, in Voigt's order xx, yy, zz, yz, xz, xy
    error : (6, 6) their errors: a third of the change from the strain to half of it, and half of what two sides of the
        diagonal differ by
    stress : (6,) of the crystal without strain, negative under pressure
    strain : largest strain
    volume : of the box
    unit : symbol of the unit of pressure
    gigapascal : 1 GPa in this unit; None in reduced units
    """

    matrix: Floats
    error: Floats
    stress: Floats
    strain: float
    volume: float
    unit: str
    gigapascal: float | None = field(default=None)

    @property
    def pressure(self) -> float:
        """Pressure without strain."""
        return -float(self.stress[:3].mean())

    @property
    def bulk(self) -> float:
        """Bulk modulus, by Voigt's average."""
        return float(self.matrix[:3, :3].mean())

    @property
    def shear(self) -> float:
        """Shear modulus, by Voigt's average."""
        c = self.matrix
        return float((np.trace(c[:3, :3]) - c[0, 1] - c[0, 2] - c[1, 2] + 3.0 * np.trace(c[3:, 3:])) / 15.0)

    @property
    def cubic(self) -> tuple[float, float, float]:
        """C11, C12 and C44 of a cubic crystal along the axes: means over the entries that are then equal."""
        c = self.matrix
        off = c[:3, :3][~np.eye(3, dtype=bool)]
        return float(np.trace(c[:3, :3]) / 3), float(off.mean()), float(np.trace(c[3:, 3:]) / 3)

    def as_json(self) -> dict[str, Any]:
        """The numbers as one JSON object."""
        arrays = {key: getattr(self, key).tolist() for key in ("matrix", "error", "stress")}
        return arrays | {key: getattr(self, key) for key in ("strain", "volume", "unit", "bulk", "shear", "pressure")}

    @property
    def _shown(self) -> tuple[float, str]:
        """The pressure in which people read the numbers, and its symbol."""
        return (1.0, self.unit) if self.gigapascal is None else (self.gigapascal, "GPa")

    def _lines(self) -> Lines:
        scale, unit = self._shown
        values = {"bulk modulus": self.bulk, "shear modulus": self.shear, "pressure": self.pressure}
        found = [(name, measured(f"{value / scale:.6g}", unit)) for name, value in values.items()]
        most = measured(f"{self.error.max() / scale:.1g}", unit)
        return [*found, ("strain", f"±{self.strain:g} and half of it"), ("errors", f"at most {most}")]

    def _tables(self) -> list[Table]:
        scale, unit = self._shown
        digits = max(0, 5 - int(np.ceil(np.log10(np.abs(self.matrix).max() / scale))))
        rows = [[AXES[i], *(f"{value / scale + 0.0:.{digits}f}" for value in self.matrix[i])] for i in range(6)]
        return [(measured("elastic constants,", unit).strip(), ["", *AXES], rows)]


def elastic_constants(system: System, strain: float = 1e-3, threads: int = 1) -> ElasticConstants:
    """Elastic constants of a crystal at rest: the slopes of the Cauchy stress by the strain.

    The crystal is strained by ± ``strain`` and by half of it, along each of the six components in turn, and relaxed.
    Under pressure these are Birch's coefficients, which say how the strained crystal pushes back (Wallace 1972; Barron
    & Klein 1965, doi:10.1088/0370-1328/85/3/313). A shear strain is the change of the angle.

    Parameters
    ----------
    system : a crystal near a minimum of its energy, in a box that is periodic along all axes, in three dimensions
    strain : largest strain, at most 0.05

    Raises
    ------
    InputError
        For an open box, two dimensions, and forces that change the total momentum.
    RunError
        If a strained crystal does not relax.
    """
    most = check_crystal(system, strain)
    start = relaxed(system.remade(velocities=np.zeros((len(system), 3)), events=()), threads)
    slopes = np.zeros((2, 6, 6))  # of half the strain and of the whole
    for k in range(6):
        for which, size in enumerate((0.5 * most, most)):
            low, high = (_strained_stress(start, k, sign * size, threads) for sign in (-1, 1))
            slopes[which, :, k] = (high - low) / (2.0 * size)
    found = (4.0 * slopes[0] - slopes[1]) / 3.0
    error = np.abs(slopes[0] - slopes[1]) / 3.0 + 0.5 * np.abs(found - found.T)
    try:
        gigapascal = quantity("1 GPa", "pressure", system.units)
    except InputError:
        gigapascal = None
    return ElasticConstants(
        found, error, stress_of(start, threads), most, start.volume, system.units.symbol("pressure"), gigapascal
    )


def check_crystal(system: System, strain: float) -> float:
    """Refuse a System without elastic constants, and a strain that is too large; return the strain."""
    if not isinstance(system, System):
        raise InputError("elastic_constants: expected a System of particles")
    if system.dimensions != 3 or not all(system.box.periodic_axes):
        raise InputError("elastic_constants: needs a box that is periodic along all three axes")
    if system.held_by:
        raise InputError(f"elastic_constants: relaxes particles freely, so it would break the {system.held_by}")
    if outside := system.acting("external"):
        raise InputError(f"elastic_constants: force {outside[0]!r} acts from outside, so the crystal has no stress")
    most = positive("elastic_constants: strain", strain)
    if most > LARGEST:
        raise InputError(f"elastic_constants: strain must be at most {LARGEST:g}, got {most:g}")
    return most


def _strained_stress(system: System, component: int, size: float, threads: int) -> Floats:
    """Stress (6,) of the System under a strain, along the axes before the strain."""
    made, rotation = strained(system, component, size)
    stress, tensor = stress_of(relaxed(made, threads), threads), np.zeros((3, 3))
    for value, (i, j) in zip(stress, PLACES, strict=True):
        tensor[i, j] = tensor[j, i] = value
    tensor = rotation.T @ tensor @ rotation
    return np.array([tensor[place] for place in PLACES])


def strained(system: System, component: int, size: float) -> tuple[System, Floats]:
    """The System with box and particles under a strain along a component in Voigt's order, turned into the axes of its
    box; and the rotation (3, 3)."""
    i, j = PLACES[component]
    change = np.eye(3)
    change[i, j] += size if i == j else 0.5 * size
    change[j, i] += 0.0 if i == j else 0.5 * size
    box, rotation = Box.from_vectors(system.box.matrix @ change.T)
    return system.remade(positions=system.state.positions @ change.T @ rotation.T, box=box), rotation


def stress_of(system: System, threads: int) -> Floats:
    """Stress (6,) of a System in Voigt's order."""
    energies = [
        [_energy(strained(system, k, step * PROBE)[0], threads) for step in (-2, -1, 1, 2)] for k in range(len(PLACES))
    ]
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * PROBE)
    found: Floats = np.array(energies) @ weights / system.volume
    return found


def _energy(system: System, threads: int) -> float:
    measured = BoundForces(system, threads).measure(system.state.time, system.state.phase)
    if measured is None:
        raise RunError("elastic_constants: the forces of the strained crystal are not finite")
    return measured.potential


def relaxed(system: System, threads: int) -> System:
    """The System at the minimum of its energy in its box."""
    measured = BoundForces(system, threads).measure(system.state.time, system.state.phase)
    if measured is None:
        raise RunError("elastic_constants: the forces of the strained crystal are not finite")
    largest = float(np.abs(measured.accelerations * system.coherent_masses).max())
    rounding = REST * abs(measured.potential) / system.volume ** (1 / 3)
    if largest <= rounding:
        return system
    found = minimum(system, threads, force=max(RELAXED * largest, rounding), steps=STEPS)
    if not found.converged:
        raise RunError(f"elastic_constants: the strained crystal does not relax: {found.trouble}")
    return found.system
