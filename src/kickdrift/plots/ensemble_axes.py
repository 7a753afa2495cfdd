"""Axes, colours and labels of the figures of an ensemble."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kickdrift.ensemble.rows import DONE
from kickdrift.ensemble.table import PROVENANCE
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.plots import runs
from kickdrift.plots.runs import INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

# MEGNO tends to 2 for regular motion (Cincotta & Simo 2000, doi:10.1051/aas:2000108); colours end at the second number.
REGULAR, CHAOTIC = 2.0, 4.0
WIDE = 100.0  # smallest ratio of the largest to the smallest positive value for a logarithmic axis
NO_VALUE = "#BDBDBD"  # colour of a missing value

# Dimensions of columns, and of the keys of a system file by their last part.
COLUMNS = {
    "dt": "time", "time": "time", "temperature": "temperature", "pressure": "pressure", "lyapunov": "rate",
    "energy_drift": "rate",
}  # fmt: skip
KEYS = {
    "dt": "time", "time": "time", "temperature": "temperature", "mass": "mass", "a": "length", "q": "length",
    "radius": "length", "P": "time", "T": "time", "inc": "angle", "Omega": "angle", "omega": "angle", "f": "angle",
    "M": "angle", "E": "angle",
}  # fmt: skip
NAMES = {"megno": "MEGNO", "lyapunov": "largest Lyapunov exponent"}


class GridScale(NamedTuple):
    """Axis along the values of a grid: their places, the edges between them, and their names if they are not
    numbers."""

    places: Any
    edges: Any
    order: Any  # order of the grid's values along the axis
    log: bool
    names: list[str]


def grid_scale(values: Sequence[Any]) -> GridScale:
    """Axis of numbers, in the logarithm if that is more even; other values are placed one by one."""
    numbers = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if not numbers or len(set(values)) < len(values):
        places = np.arange(len(values), dtype=float)
        names = [f"{value:g}" if isinstance(value, float) else str(value) for value in values]
        return GridScale(places, np.append(places - 0.5, len(values) - 0.5), np.arange(len(values)), False, names)
    order = np.argsort(np.array(values, dtype=float))
    places = np.array(values, dtype=float)[order]
    log = bool(len(places) > 2 and places[0] > 0 and _unevenness(np.log(places)) < 0.5 * _unevenness(places))
    even = np.log(places) if log else places
    middle = (even[1:] + even[:-1]) / 2
    edges = np.concatenate([[2 * even[0] - middle[0]], middle, [2 * even[-1] - middle[-1]]])
    return GridScale(places, np.exp(edges) if log else edges, order, log, [])


def _unevenness(places: Any) -> float:
    """Standard deviation of the gaps over their mean; rounding of even gaps counts as zero."""
    gaps = np.diff(places)
    found = float(gaps.std() / gaps.mean())
    return found if found > 1e-6 else 0.0


def set_grid_axis(axes: Axes, which: str, scale: GridScale, table: DataFrame, key: str) -> None:
    """Label one axis, x or y."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    axes.set(**{f"{which}label": key if scale.names else key_label(table, key)})
    if scale.names:
        axis.set_ticks(scale.places, scale.names)
        axes.set(**{f"{which}lim": (scale.edges[0], scale.edges[-1])})
        if which == "x" and sum(map(len, scale.names)) > 60:
            axes.tick_params("x", rotation=30)
            for text in axes.get_xticklabels():
                text.set_horizontalalignment("right")
    elif scale.log:
        axes.set(**{f"{which}scale": "log"})


def member_values(table: DataFrame, name: str) -> Any:
    """Numbers of a column; NaN for members that are not done."""
    return np.where(table["status"] == DONE, table[name].to_numpy(dtype=float), np.nan)


def spans_decades(values: Any) -> bool:
    """Tell whether values need a logarithmic scale."""
    known = values[np.isfinite(values)]
    return bool(len(known) and known.min() > 0 and known.max() > WIDE * known.min())


def colour_scale(name: str, values: Any) -> dict[str, Any]:
    """Colour map and scale. MEGNO's has regular motion in its middle, and is the same in all figures."""
    from matplotlib.colors import LogNorm

    if name == "megno":
        return {"cmap": "RdYlBu_r", "vmin": 2.0 * REGULAR - CHAOTIC, "vmax": CHAOTIC}
    return {"cmap": "viridis", "norm": LogNorm() if spans_decades(values) else None}


def draw_colour_bar(figure: Figure, axes: Axes, drawn: Any, values: Any, label: str) -> None:
    """Draw the colour bar, with a tip if values lie beyond its end."""
    low, high = drawn.get_clim()
    below, above = np.nanmin(values) < low, np.nanmax(values) > high
    extend = {(False, False): "neither", (True, False): "min", (False, True): "max"}.get((below, above), "both")
    bar = figure.colorbar(drawn, ax=axes, extend=extend, pad=0.02)
    bar.set_label(label)
    bar.outline.set_visible(False)
    bar.ax.tick_params(colors=INK, labelsize=9)


def set_value_axis(axes: Axes, table: DataFrame, name: str) -> None:
    """Set the y axis of a column."""
    if name == "megno":
        axes.axhline(REGULAR, color=INK, linewidth=0.9, linestyle=(0, (4, 3)), label="regular motion: 2")
    if spans_decades(member_values(table, name)):
        axes.set_yscale("log")
    axes.set_ylabel(column_label(table, name))


def set_random_axis(axes: Axes, which: str, table: DataFrame, key: str) -> None:
    """Set the axis of a random key."""
    log = table.attrs[PROVENANCE]["draws"][key][0] == "log-uniform"
    axes.set(**{f"{which}label": key_label(table, key), f"{which}scale": "log" if log else "linear"})


def mark_missing(axes: Axes, places: Any) -> None:
    """Draw crosses along the x axis for missing values."""
    if len(places):
        axes.plot(
            places, np.full(len(places), 0.025), "x", color="#888888", markersize=5, label="no value",
            transform=axes.get_xaxis_transform(),
        )  # fmt: skip


def column_label(table: DataFrame, name: str) -> str:
    """Label of a column, with its unit."""
    return with_unit(table, NAMES.get(name, name.replace("_", " ")), COLUMNS.get(name))


def key_label(table: DataFrame, key: str) -> str:
    """Label of a key, with its unit if it belongs to a system file or to [run]."""
    last = key.rpartition(".")[2]
    return with_unit(table, key, KEYS.get(last) if "." in key or last in ("dt", "time") else None)


def with_unit(table: DataFrame, name: str, dimension: str | None) -> str:
    """Name with the unit of its dimension, if the system's units have names."""
    units = UNIT_SYSTEMS.get(table.attrs[PROVENANCE].get("units", ""))
    if dimension is None or units is None:
        return name
    return runs.with_unit(name, units.unit(dimension))
