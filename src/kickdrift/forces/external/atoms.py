"""A calculator at work: its Atoms share the memory of the positions, and its own memory is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from ase import Atoms
from ase.calculators.calculator import all_changes

from kickdrift.errors import InputError
from kickdrift.forces.external.python import in_voigt
from kickdrift.forces.external.renewed import RenewedHost
from kickdrift.forces.external.turns import Question, asked
from kickdrift.forces.seam.named import takes_batches
from kickdrift.model.state import Floats
from kickdrift.model.subject import Subject
from kickdrift.model.units.file_units import Scale
from kickdrift.text import shown

MOVED = ["positions"]


class CalculatorHost(RenewedHost):
    """Atoms whose positions compiled code writes, and the calculator that takes these atoms."""

    def __init__(self, calculator: Any, atoms: Any, stress: bool, units: Scale, *given: Any, **more: Any) -> None:
        super().__init__(calculator, *given, **more)
        self._calculator, self._atoms, self._stress, self._scale = calculator, atoms, stress, units
        self._open = not atoms.pbc.any()
        atoms.arrays["positions"] = self.parts.positions  # no copy: this memory is the atoms'
        self._properties = ["energy", "forces", *(["stress"] if stress else [])]

    def follow_box(self) -> None:
        """See RenewedHost."""
        before = self.box
        if self.box_now is not before:
            self._atoms.cell[...] = self.box.matrix / self._scale.length

    def calculate(self, anew: bool) -> None:
        """See RenewedHost."""
        calculator, atoms = self._calculator, self._atoms
        if anew:
            reset = getattr(calculator, "reset", None)
            if reset is not None:
                reset()
        calculator.results = {}
        calculator.atoms = atoms  # as ASE's own get_property sets it, without a copy
        calculator.calculate(atoms, self._properties, all_changes if anew else MOVED)
        self._store(calculator.results)

    def _store(self, results: Any) -> None:
        """Store a calculator's results."""
        for wanted in self._properties:
            if wanted not in results:
                raise InputError(f"returned no {wanted}")
        energy = results.get("free_energy", results["energy"])  # whose slope the forces are, for smeared electrons
        virial = float(np.vdot(self.parts.positions, results["forces"])) * self._scale.energy if self._open else np.nan
        along: Any = np.nan
        if self._stress:
            stress = results["stress"]
            six = np.asarray(stress if np.shape(stress) == (6,) else in_voigt(np.asarray(stress)), dtype=float)
            volume = self.box.volume / self._scale.length**3
            virial = -float(six[0] + six[1] + six[2]) * volume * self._scale.energy
            along = -six * volume * self._scale.energy
        self.put(results["forces"], float(energy) * self._scale.energy, virial, along)


class BatchHost(CalculatorHost):
    """Atoms of a calculator that takes several Atoms at once, and keeps no memory between calls."""

    def answer(self, time: float, aside: bool) -> None:
        """See Host."""
        self.follow_box()
        key = (id(self._calculator), tuple(self._properties))
        self._store(asked(Question(key, self._together, self._atoms)))

    def _together(self, atoms: list[Any]) -> list[Any]:
        """Results of all Atoms in one call."""
        results = self._calculator.calculate_batch(atoms, self._properties)
        if not isinstance(results, list | tuple) or len(results) != len(atoms):
            what = f"{len(results)} results" if isinstance(results, list | tuple) else shown(results)
            raise InputError(f"calculate_batch returned {what} for {len(atoms)} Atoms, expected a list of as many")
        if wrong := [each for each in results if not isinstance(each, Mapping)]:
            raise InputError(f"calculate_batch returned a list with {shown(wrong[0])}, expected tables of results")
        return list(results)


def calculator_host(
    calculator: Any, label: str, elements: dict[str, str], system: Subject, reach: float, stress: bool
) -> CalculatorHost:
    """The host of a calculator for a System's particles.

    Parameters
    ----------
    elements : chemical elements by species
    reach : distance in angstrom from where the calculator last began anew
    stress : whether to calculate the stress
    """
    scale, state = Scale.of(system.units), system.state
    atoms = Atoms(
        [elements[system.species[k]] for k in system.species_index],
        positions=state.positions / scale.length,
        masses=state.masses / scale.mass,
        cell=system.box.matrix / scale.length,
        pbc=system.box.periodic_axes,
    )
    factors: Floats = scale.force / system.coherent_masses
    together = takes_batches(calculator)  # such a calculator has no memory, and so no reference
    return (BatchHost if together else CalculatorHost)(
        calculator, atoms, stress, scale, label, factors, system.box,
        scale=1.0 / scale.length, reach=np.inf if together else reach, sees_velocities=False, pairs=np.nan,
    )  # fmt: skip
