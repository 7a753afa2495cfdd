"""A cluster over the frames of a run: tables, figures and JSON; and columns that a run records itself."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from kickdrift.analysis.clusters.cluster import (
    COULOMB,
    FRACTIONS,
    NEIGHBOURS,
    Cluster,
    checked_settings,
    cluster_in,
)
from kickdrift.analysis.clusters.stars import stars_at, stars_of
from kickdrift.analysis.doubts import warning_lines
from kickdrift.display.showing import Lines, Shown, Table, above
from kickdrift.errors import InputError
from kickdrift.looks.columns import Column
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.text import choices, counted, measured
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.frames import Frames
from kickdrift.trajectory.read.info import warnings_of
from kickdrift.trajectory.read.reader import masses_held

ROWS = 12  # most states in a table
# Results of one number, or of one for each fraction, with the dimension of their unit.
UNITS = {
    "lagrangian_radii": "length",
    "half_mass_radius": "length",
    "core_radius": "length",
    "core_density": "density",
    "core_mass": "mass",
    "relaxation_time": "time",
    "anisotropy": "",
    "shell_anisotropy": "",
    "bound_mass": "mass",
    "escapers": "",
    "tidal_radius": "length",
    "binaries": "",
    "binary_energy": "energy",
    "hardest": "",
}
MANY = ("lagrangian_radii", "shell_anisotropy")


@dataclass(frozen=True, eq=False, repr=False)
class ClusterReport(Shown):
    """A cluster over time.

    Attributes
    ----------
    name : of the file or the system
    states : a `Cluster` for each frame
    units : UnitSystem
    warnings : what is wrong with the run, from its file
    """

    name: str
    states: tuple[Cluster, ...] = field(repr=False)
    units: UnitSystem
    warnings: list[str] = field(default_factory=list)

    @property
    def times(self) -> Floats:
        """(f,) times of the frames."""
        return self.series("time")

    @property
    def fractions(self) -> Floats:
        """(k,) shares of the bound mass of the Lagrangian radii."""
        return self.states[0].fractions

    @property
    def relaxed(self) -> Floats:
        """(f,) times since the first frame in half-mass relaxation times of the first frame."""
        return (self.times - self.times[0]) / self.states[0].relaxation_time

    def series(self, name: str) -> Floats:
        """One attribute of `Cluster` over time: (f,), (f, k) for a value of each fraction, (f, 3) for vectors."""
        if name not in Cluster._fields:
            raise InputError(f"cluster: no result {name!r}; expected one of {choices(Cluster._fields, name)}")
        return np.array([getattr(each, name) for each in self.states])

    def as_json(self) -> dict[str, Any]:
        """The report as one JSON object, with a list over the frames for each result; what is not known is null."""
        return {
            "name": self.name,
            "frames": len(self.states),
            "fractions": self.fractions.tolist(),
            **{key: _known(self.series(key).tolist()) for key in Cluster._fields if key != "fractions"},
            "relaxed": _known(self.relaxed.tolist()),
            "units": {key: self.units.symbol(unit) for key, unit in UNITS.items() if unit},
            "warnings": self.warnings,
        }

    def plot(self) -> Any:
        """Draw radii, core density, binaries and bound mass against time; a matplotlib Figure."""
        return above("cluster figure")(self)

    def _tables(self) -> list[Table]:
        shown = [f"{100 * share:g} %" for share in self.fractions]
        columns = ["time", "t / t_rh(0)", *shown, "core", "core density", "β", "bound", "pairs", "hardest (kT)"]
        rows = []
        for k in np.unique(np.linspace(0, len(self.states) - 1, min(ROWS, len(self.states))).round().astype(int)):
            at = self.states[k]
            radii = (f"{each:.3g}" for each in (*at.lagrangian_radii, at.core_radius, at.core_density))
            more = f"{at.anisotropy:.2f}", f"{at.bound_stars:,}", f"{at.binaries}", f"{at.hardest:.3g}"
            rows.append([f"{at.time:.6g}", f"{self.relaxed[k]:.3g}", *radii, *more])
        return [("Lagrangian radii and core", columns, rows)]

    def _lines(self) -> Lines:
        first, last = self.states[0], self.states[-1]
        units = self.units.described(("length", "time"))
        states = counted(len(self.states), "state")
        lines = [("cluster", f"{self.name}: {first.stars:,} stars, {states}; {units}")]
        relaxation = measured(f"{first.relaxation_time:.4g}", self.units.symbol("time"))
        lines.append(("relaxation", f"{relaxation} at the half-mass radius of the first state"))
        if not math.isnan(last.tidal_radius):
            lines.append(
                (
                    "tidal radius",
                    f"{measured(f'{last.tidal_radius:.4g}', self.units.symbol('length'))} in the last state",
                )
            )
        lines.append(("escapers", f"{last.escapers:,} in the last state"))
        if last.binaries:
            energy = measured(f"{last.binary_energy:.4g}", self.units.symbol("energy"))
            lines.append(("binaries", f"{last.binaries} above 1 kT in the last state, energy {energy}"))
        return lines + warning_lines(self.warnings)


def cluster_report(
    source: Any,
    fractions: Sequence[float] = FRACTIONS,
    *,
    neighbours: int = NEIGHBOURS,
    coulomb: float = COULOMB,
    tidal_radius: float | None = None,
) -> ClusterReport:
    """What `cluster` tells for each frame of a run, or for one System.

    Parameters
    ----------
    source : a run, open or by its path, some of its frames, ``run[::10]``, or a System
    fractions, neighbours, coulomb, tidal_radius : see `cluster`

    Raises
    ------
    InputError
        As `cluster`, and for a run without frames.
    """
    settings = checked_settings(fractions, neighbours, coulomb, tidal_radius)
    if isinstance(source, System):
        return ClusterReport(source.name, (cluster_in(stars_of(source, "cluster"), *settings),), source.units)
    if isinstance(source, str | os.PathLike):
        with reader.open(source) as opened:
            return _over(opened, settings)
    if not isinstance(source, Frames):
        raise InputError(f"cluster: expected a run, its path or a System, got {type(source).__name__}")
    return _over(source, settings)


def _over(frames: Frames, settings: Any) -> ClusterReport:
    run: Any = frames.run
    if not len(frames):
        raise InputError(f"{run.path}: no frames")
    system, states = run.system(), []
    for k in frames.rows:
        x, v = (np.array(run.vectors(what, slice(k, k + 1))) for what in ("positions", "velocities"))
        masses = masses_held(run, [k], x, v)[0]
        states.append(cluster_in(stars_at(system, x[0], v[0], masses, float(run.times[k]), "cluster"), *settings))
    return ClusterReport(run.path.name, tuple(states), run.units, warnings_of(run))


def _known(value: Any) -> Any:
    if isinstance(value, list):
        return [_known(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


class _Latest:
    """The cluster of a Simulation at its last look, so that several columns share one computation."""

    def __init__(self, settings: Any) -> None:
        self._settings = settings
        self._at: Any = None
        self._found: Any = None

    def value(self, name: str, sim: Any) -> Any:
        at = (id(sim), sim.time, sim.steps_done)
        if at != self._at:
            self._found = cluster_in(stars_of(sim, "cluster"), *self._settings)
            self._at = at
        return getattr(self._found, name)


def cluster_columns(
    *names: str,
    fractions: Sequence[float] = FRACTIONS,
    neighbours: int = NEIGHBOURS,
    coulomb: float = COULOMB,
    tidal_radius: float | None = None,
) -> list[Column]:
    """Columns with which a run records its cluster at each look: ``sim.run(columns=kd.analysis.cluster_columns())``.

    Parameters
    ----------
    names : results of `cluster`, such as "lagrangian_radii" and "core_radius"; default all but the anisotropy of shells
    fractions, neighbours, coulomb, tidal_radius : see `cluster`

    Raises
    ------
    InputError
        For an unknown name. At the first look, ``run`` refuses a system that is no cluster, as `cluster` does.
    """
    settings = checked_settings(fractions, neighbours, coulomb, tidal_radius)
    chosen = names or tuple(name for name in UNITS if name != "shell_anisotropy")
    for name in chosen:
        if name not in UNITS:
            raise InputError(f"cluster_columns: no result {name!r}; expected one of {choices(UNITS, name)}")
    latest = _Latest(settings)
    shapes = {name: (len(settings[0]),) if name in MANY else () for name in chosen}
    return [Column(name, UNITS[name], shape, partial(latest.value, name)) for name, shape in shapes.items()]
