"""A run's file as people see it: its lines, its figures, and tables with units for pandas and xarray."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.disk.outputs import plain
from kickdrift.display.card import Spark
from kickdrift.display.showing import Lines, Shown, above
from kickdrift.errors import InputError
from kickdrift.looks.columns import parts
from kickdrift.looks.report_lines import energy_spark
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.trajectory.layout.run_parts import RunFile


AXES = ("x", "y", "z")


def data_frame(run: RunFile, steps: NDArray[np.int64], times: Floats, observables: Mapping[str, Floats]) -> Any:
    """A pandas DataFrame with a row for each time. An observable with several numbers has a column for each."""
    pandas = library("pandas", "to_pandas()")
    columns: dict[str, NDArray] = {"step": steps, "time": times}
    units = {"step": "", "time": run.units.unit("time")}
    for name, values in observables.items():
        labels = parts(name, values.shape[1:])
        for label, column in zip(labels, values.reshape(len(values), len(labels)).T, strict=True):
            columns[label], units[label] = column, run.unit_of(name)
    table = pandas.DataFrame(columns)
    table.attrs["units"] = units
    return table


def dataset(
    run: RunFile,
    frames: Any,
    observables: Mapping[str, tuple[str, Floats]],
    samples: Mapping[str, NDArray] | None = None,
) -> Any:
    """An xarray Dataset of frames and observables. Each observable names its dimension; the coordinates are of the
    samples."""
    xarray = library("xarray", "to_xarray()")
    unit = run.units.unit
    per_particle = ("frame", "particle", "axis")
    data: dict[str, Any] = {
        "positions": (per_particle, frames.positions, {"units": unit("length")}),
        "velocities": (per_particle, frames.velocities, {"units": unit("velocity")}),
        "masses": ("particle", run.masses, {"units": unit("mass")}),
        "species": ("particle", np.array(run.species)[run.species_index]),
    }
    if run.names:
        data["names"] = ("particle", np.array(run.names))
    if run.box_varies:  # edge vectors as rows
        edges = np.array([box.matrix for box in frames.boxes])
        data["box"] = (("frame", "edge", "axis"), edges, {"units": unit("length")})
    for name, (dimension, values) in observables.items():
        others = ("axis" if size == len(AXES) else f"{name}_{k}" for k, size in enumerate(values.shape[1:]))
        if values.ndim > 2:  # a tensor has axes of its own
            others = (f"{name}_{k}" for k in range(values.ndim - 1))
        data[name] = ((dimension, *others), values, {"units": run.unit_of(name)})
    clock = {"units": unit("time")}
    coordinates: dict[str, Any] = {
        "step": ("frame", frames.steps),
        "time": ("frame", frames.times, clock),
        "particle": run.ids,
        "axis": list(AXES),
    }
    for name, row in (samples or {}).items():
        coordinates[name] = ("sample", row, clock if name.endswith("time") else {})
    attributes = {
        "path": str(run.path),
        "run_id": run.run_id,
        "unit_system": run.units.name,
        "integrator": str(run.method.get("integrator", "")),
        "box": np.ravel(run.box.shape or ()).tolist(),  # at the start: lengths, or the edge vectors in turn
    }
    return xarray.Dataset(data, coordinates, attributes)


def library(name: str, asked: str, install: str = "") -> Any:
    """A library that kickdrift can do without; an InputError says what needs it."""
    try:
        return import_module(name)
    except ImportError:
        needs = install or f"{name}: pip install 'kickdrift[tables]'"
        raise InputError(f"{asked} needs {needs}") from None


class ShownRun(Shown):
    """An open run's file that prints what ``kickdrift info`` prints, and draws what ``kickdrift plot`` draws."""

    def _lines(self) -> Lines:
        return above("run lines")(self)

    def _spark(self: Any) -> Spark | None:
        seen = self.whole_samples().observables
        if not {"total_energy", "kinetic_energy"} <= seen.keys() or not len(seen["kinetic_energy"]):
            return None
        return energy_spark(seen["total_energy"] + seen.get("energy_taken", 0.0), seen["kinetic_energy"][0])

    def as_json(self) -> dict[str, Any]:
        """Content of the file in numbers and texts, as ``kickdrift info --json`` writes it."""
        return plain(above("run content")(self))

    def view(
        self, *, frames: int | None = None, colour: str | None = None, size: float = 1.0, height: int | None = None
    ) -> Any:
        """Show the frames in a picture that turns: a widget in a notebook, else an object with ``save(path)``.

        ``height`` is in pixels; ``colour`` and ``size`` are those of `kickdrift view`.
        ``frames`` is the most of them. See docs/live.md."""
        return above("view")(self, frames=frames, colour=colour, size=size, height=height)

    def plot(self, kind: str | None = None, *, column: str | None = None) -> Any:
        """Draw the run; a matplotlib Figure.

        Parameters
        ----------
        kind : "orbits", "energies", "rdf", "msd", "vacf" or "structure-factor"; default orbits under gravity, else
            energies with their error, the temperature and g(r)
        column : a column of the samples, drawn against time instead

        Raises
        ------
        InputError
            For an unknown name, and a run without what the figure shows.
        """
        return above("run figure")(self, kind, column)


class ShownProblemRun(Shown):
    """The run of a Problem, open, that prints what ``kickdrift info`` prints, and draws what ``kickdrift plot``
    draws."""

    def _lines(self) -> Lines:
        return above("problem lines")(self)

    def _spark(self: Any) -> Spark | None:
        y, energies = self.y, self.energies
        if energies is not None:
            return energy_spark(energies, 0.0)
        return Spark(y[:, 0].tolist(), "y0") if len(y) > 1 else None

    def plot(self, *, column: str | None = None) -> Any:
        """Draw y against time, the phase portrait and the energy error, or one ``column``; a matplotlib Figure.

        Raises InputError for an unknown column, and for a run without samples."""
        return above("problem figure")(self, column)
