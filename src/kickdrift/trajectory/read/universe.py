"""Names of a run's particles in other programs, and the MDAnalysis Universe of its file."""

from __future__ import annotations

import warnings
from collections.abc import Container
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.molecules.topology import SIZES, Topology
from kickdrift.model.state import Floats
from kickdrift.model.units import constants
from kickdrift.model.units.file_units import FileUnits, elementary_charge
from kickdrift.trajectory.file.opening import open_to_read
from kickdrift.trajectory.layout.edges import EDGES, stored
from kickdrift.trajectory.layout.names import TRAJECTORY

if TYPE_CHECKING:
    from kickdrift.trajectory.layout.run_parts import RunFile

EVEN = 1e-6  # relative to the time between frames; rounding changes times far less
_ATOMIC = {"u": 1.0, "kg": 1 / constants.ATOMIC_MASS}


def mdanalysis(what: str) -> Any:
    """Import MDAnalysis. Raises an InputError that says how to install it."""
    try:
        import MDAnalysis
    except ImportError:
        raise InputError(f"{what} needs MDAnalysis: pip install 'kickdrift[mdanalysis]'") from None
    return MDAnalysis


def universe(run: RunFile) -> Any:
    """MDAnalysis Universe of a run's file: float32, unwrapped, in angstrom and ps.

    Nominal units stay nominal: a sigma counts as an angstrom, a tau as a ps. Atoms have names (the bodies' names, else
    the species), types, masses (in u if units are real) and ids. If every species is an element, they also have
    elements. The trajectory's ``dt`` is the time between frames; if frames are not evenly spaced, a warning says so.
    For a single frame, ``dt`` is the time to the next frame in the run's plan. A removed body is NaN from its removal
    on.
    """
    MDAnalysis = mdanalysis("universe()")
    if not len(run):
        raise InputError(f"{run.path}: holds no frames")
    dt, even = spacing(run, run.times)
    if not even:
        warnings.warn(
            f"{run.path}: frames are not evenly spaced; dt is {dt:g} ps, but each frame has its own time", stacklevel=3
        )
    found = MDAnalysis.Universe(str(run.path), to_guess=(), n_atoms=len(run.ids), dt=dt)
    label(found, run)
    if "images" in run.options.write and run.box.periodic:
        found.trajectory.add_transformations(Unwrapping(run.path))
    return found


class Unwrapping:
    """A transformation for MDAnalysis that unwraps positions that the file stores inside the box."""

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()

    def __call__(self, ts: Any) -> Any:
        with open_to_read(self.path) as file:
            edges, images = file[EDGES][ts.frame], file[TRAJECTORY]["image/value"][ts.frame]
            ts.positions = ts.positions + images @ (edges if edges.ndim == 2 else np.diag(edges))
        return ts


def dimensions(box: Box, factor: float) -> list[float] | None:
    """Three lengths times a factor and three angles in degrees, for MDAnalysis; None if a box is open along an axis."""
    from MDAnalysis.lib.mdamath import triclinic_box

    if not all(box.periodic_axes):
        return None
    edges = stored(box) * factor
    return [*edges, 90.0, 90.0, 90.0] if edges.ndim == 1 else list(triclinic_box(*edges))


def label(universe: Any, run: RunFile) -> None:
    """Give a Universe's atoms the attributes that the file has for its particles."""
    from MDAnalysis.guesser.tables import SYMB2Z

    types = species(run)
    attributes = {"names": list(run.names) or types, "types": types, "masses": atomic_masses(run), "ids": run.ids}
    if run.charges is not None:
        attributes["charges"] = run.charges / elementary_charge(run.units)
    if elements := chemical_symbols(run, SYMB2Z):
        attributes["elements"] = elements
    for attribute, values in attributes.items():
        universe.add_TopologyAttr(attribute, values)
    if (joined := topology_of(run)) is not None:
        for kind in SIZES:
            if len(items := getattr(joined, kind)):
                universe.add_TopologyAttr(kind, [tuple(item) for item in items.tolist()])


def topology_of(run: RunFile) -> Topology | None:
    """Topology of a run's file; None if the file has none."""
    given = run.system_record.get("topology")
    if not isinstance(given, dict):
        return None
    try:
        found = Topology(**given)
        found.check(len(run.ids))
    except InputError as error:
        raise InputError(f"{run.path}: damaged: kickdrift/system/record: {error}") from None
    return found


def species(run: RunFile) -> list[str]:
    """Species of every particle."""
    return [run.species[index] for index in run.species_index]


def chemical_symbols(run: RunFile, known: Container[str]) -> list[str]:
    """Species of every particle if each is a chemical element and units are real, else nothing."""
    return species(run) if not run.nominal_units and all(each in known for each in run.species) else []


def atomic_masses(run: RunFile) -> Floats:
    """Masses (n,) in u; unchanged if the file's unit of mass has no value in u."""
    return run.masses * _ATOMIC.get(run.units.mass, 1.0)


def spacing(run: RunFile, times: Floats) -> tuple[float, bool]:
    """Time between frames at these times, in the file's ps, and whether the frames are evenly spaced.

    If only the last interval is shorter, as at a run's end, the time is that of the others. If frames are otherwise
    uneven, the time is the mean. For a single frame, the run's step and cadence give the time, else it is 1.
    """
    factor = FileUnits.of(run.units).time
    if len(times) < 2:
        dt = run.method.get("dt")
        step = float(dt) if isinstance(dt, float | int) and dt > 0 else None
        return (run.every * step * factor if step else 1.0), True
    gaps = np.diff(times)
    mean = float(gaps.mean())
    if np.all(np.abs(gaps - mean) <= EVEN * mean):
        return mean * factor, True
    if len(gaps) > 1 and gaps[-1] < gaps[0] and np.all(np.abs(gaps[:-1] - gaps[0]) <= EVEN * gaps[0]):
        mean = float(gaps[0])
    return mean * factor, False
