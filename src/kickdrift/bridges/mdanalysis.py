"""A System of an MDAnalysis Universe: what a frame holds, in any unit system; the forces are the user's."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from MDAnalysis import Universe
from MDAnalysis.exceptions import NoDataError
from MDAnalysis.lib.mdamath import triclinic_vectors

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.molecules.listed import KINDS
from kickdrift.model.molecules.topology import Topology
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.file_units import FileUnits, Scale, elementary_charge
from kickdrift.model.units.unit_systems import UnitSystem, unit_system


def system_of(universe: Any, forces: Iterable[Any], units: str | UnitSystem, factors: Any = None) -> System:
    """Return the System of the present frame; see `System.from_mdanalysis`."""
    if not isinstance(universe, Universe):
        raise InputError(f"universe: expected MDAnalysis.Universe, got {type(universe).__name__}")
    known = units if isinstance(units, UnitSystem) else unit_system(units)
    file, frame = FileUnits.of(known), universe.trajectory.ts
    box, turn = _box(frame, file)
    masses = _column(universe, "masses")
    if masses is None:
        raise InputError(
            "universe: has no masses; universe.guess_TopologyAttrs(to_guess=['types', 'masses']) makes some"
        )
    charges = _column(universe, "charges")
    v = np.array(frame.velocities, dtype=float) / file.velocity @ turn.T if frame.has_velocities else None
    listed = any(len(getattr(universe, kind, ())) for kind in KINDS)
    return System(
        np.array(frame.positions, dtype=float) / file.length @ turn.T, v, masses * Scale.of(known).mass, box,
        forces, known, _species(universe), "universe",
        topology=Topology.from_mdanalysis(universe, factors=factors) if listed else None,
        charges=None if charges is None or not charges.any() else charges * elementary_charge(known),
    )  # fmt: skip


def _column(universe: Any, name: str) -> Floats | None:
    """An attribute of all atoms (n,); None without it."""
    try:
        return np.array(getattr(universe.atoms, name), dtype=float)
    except (NoDataError, AttributeError):
        return None


def _species(universe: Any) -> list[str]:
    """Elements of the atoms if all are known, else their types, else their names."""
    for name in ("elements", "types", "names"):
        try:
            found = [str(each) for each in getattr(universe.atoms, name)]
        except (NoDataError, AttributeError):
            continue
        if all(found):
            return found
    return ["X"] * len(universe.atoms)


def _box(frame: Any, file: FileUnits) -> tuple[Box | None, Floats]:
    """The frame's box, and the rotation (3, 3) into its axes."""
    if frame.dimensions is None or not frame.dimensions[:3].all():
        return None, np.eye(3)
    vectors = triclinic_vectors(np.array(frame.dimensions, dtype=float), dtype=np.float64)
    return Box.from_vectors(vectors / file.length)
