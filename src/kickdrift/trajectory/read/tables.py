"""Tables of a run's file with units: a pandas DataFrame or an xarray Dataset."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.looks.columns import parts
from kickdrift.model.state import Floats

if TYPE_CHECKING:
    from kickdrift.trajectory.layout.run_parts import RunHeader, Series

AXES = ("x", "y", "z")


def data_frame(run: RunHeader, steps: NDArray[np.int64], times: Floats, observables: Mapping[str, Floats]) -> Any:
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
    run: RunHeader,
    frames: Series,
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
