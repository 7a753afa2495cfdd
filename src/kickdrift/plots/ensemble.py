"""Figures of an ensemble: a map over two keys, a curve over one, points over random keys, or a histogram."""

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.ensemble import summary
from kickdrift.ensemble.ensemble import Ensemble
from kickdrift.ensemble.rows import DONE, DataFrame
from kickdrift.ensemble.table import PROVENANCE
from kickdrift.errors import InputError
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS
from kickdrift.plots import drawing
from kickdrift.plots.drawing import COLOURS, INK, Axes, Figure, checked_target, new_axes, new_figure, save_figure
from kickdrift.systemfile.files import prefixed
from kickdrift.text import counted, with_error

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
    return _with_unit(table, NAMES.get(name, name.replace("_", " ")), COLUMNS.get(name))


def key_label(table: DataFrame, key: str) -> str:
    """Label of a key, with its unit if it belongs to a system file or to [run]."""
    last = key.rpartition(".")[2]
    return _with_unit(table, key, KEYS.get(last) if "." in key or last in ("dt", "time") else None)


def _with_unit(table: DataFrame, name: str, dimension: str | None) -> str:
    """Name with the unit of its dimension, if the system's units have names."""
    units = UNIT_SYSTEMS.get(table.attrs[PROVENANCE].get("units", ""))
    if dimension is None or units is None:
        return name
    return drawing.with_unit(name, units.unit(dimension))


MOST_LABELS = 8  # most values along a map's axis that are all labelled


def plot_ensemble(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    column: str | None = None,
    *,
    numbers: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw a column of an ensemble's table against the varied keys. Return the figure's path.

    Two keys on grids give a map. One gives a curve of the mean over the members at each value, with its standard error.
    One or two random keys give points, and anything else a histogram. The default column is the most informative one.
    The title counts members that failed or that have no number there, and the figure marks their places.
    """
    target = checked_target(output, overwrite, path)
    table = Ensemble.read(path)
    with prefixed(f"{path}: "):
        figure = ensemble_figure(table, column)
    return save_figure(figure, target, numbers, overwrite)


def ensemble_figure(table: DataFrame, column: str | None = None) -> Figure:
    """The figure of ``plot_ensemble``, of a table."""
    grids, drawn = summary.grids(table), summary.drawn(table)
    if len(grids) > 2:
        raise InputError(
            f"{len(grids)} keys vary on grids, {', '.join(grids)}, but a figure shows two: "
            f"give each of the others one value, as in --vary {grids[-1]}=VALUE"
        )
    name = summary.chosen(table, column)
    shape = (7.4, 5.6) if len(grids) == 2 or (not grids and len(drawn) == 2) else (7.4, 4.8)
    figure = new_figure(*shape)
    axes = new_axes(figure, (1, 1, 1))
    if len(grids) == 2:
        _draw_map(figure, axes, table, name)
    elif grids:
        _draw_curve(axes, table, name)
    elif len(drawn) == 1:
        _draw_points(axes, table, name)
    elif len(drawn) == 2:
        _draw_coloured_points(figure, axes, table, name)
    else:
        _draw_histogram(axes, table, name)
    if axes.get_legend_handles_labels()[1]:
        figure.legend(loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    figure.suptitle(_title(table, name), fontsize=12, color=INK)
    return figure


def _draw_map(figure: Figure, axes: Axes, table: DataFrame, name: str) -> None:
    from matplotlib.ticker import NullLocator

    keys = summary.grids(table)
    grids = [table.attrs[PROVENANCE]["grids"][key] for key in keys]
    x, y = map(grid_scale, grids)
    points = summary.by_point(table, name)
    values = np.full((len(grids[0]), len(grids[1])), np.nan)
    values.flat[points.index.to_numpy()] = points["mean"]  # a key of one value does not change a point's number
    values = values[np.ix_(x.order, y.order)].T
    axes.grid(False)
    if not np.isfinite(values).all():
        axes.fill_between(
            [x.edges[0], x.edges[-1]], y.edges[0], y.edges[-1],
            facecolor=NO_VALUE, hatch="////", edgecolor="white", linewidth=0.0, label="no value",
        )  # fmt: skip
    mesh = axes.pcolormesh(
        x.edges, y.edges, np.ma.masked_invalid(values), rasterized=True, **colour_scale(name, values)
    )
    draw_colour_bar(figure, axes, mesh, values, column_label(table, name))
    for which, scale, key in (("x", x, keys[0]), ("y", y, keys[1])):
        set_grid_axis(axes, which, scale, table, key)
        axes.set(**{f"{which}lim": (scale.edges[0], scale.edges[-1])})
        if len(scale.places) <= MOST_LABELS and not scale.names:
            axis = axes.xaxis if which == "x" else axes.yaxis
            axis.set_ticks(scale.places, [f"{place:.4g}" for place in scale.places])
            axis.set_minor_locator(NullLocator())


def _draw_curve(axes: Axes, table: DataFrame, name: str) -> None:
    (key,) = summary.grids(table)
    scale = grid_scale(table.attrs[PROVENANCE]["grids"][key])
    points = summary.by_point(table, name)
    points = points.reindex(scale.order)
    known = np.isfinite(points["mean"].to_numpy(dtype=float))
    mean, error = points["mean"].to_numpy(dtype=float), points["error"].to_numpy(dtype=float)
    sets = int(np.nanmax(points["members"])) > 1
    if sets:
        done = table[table["status"] == DONE]
        place = np.argsort(scale.order)[done["member"] % len(scale.order)]
        axes.plot(
            scale.places[place], done[name], "o", color=COLOURS[4], markersize=3, alpha=0.5, markeredgewidth=0,
            label="members", rasterized=True,
        )  # fmt: skip
    axes.errorbar(
        scale.places[known], mean[known], yerr=np.nan_to_num(error[known]) if sets else None,
        fmt="o" if scale.names else "o-", color=COLOURS[0], linewidth=1.3, markersize=4.5, capsize=3, elinewidth=1.1,
        label="mean ± standard error" if sets else None,
    )  # fmt: skip
    set_grid_axis(axes, "x", scale, table, key)
    set_value_axis(axes, table, name)
    mark_missing(axes, scale.places[~known])


def _draw_points(axes: Axes, table: DataFrame, name: str) -> None:
    (key,) = summary.drawn(table)
    x, values = table[key].to_numpy(dtype=float), member_values(table, name)
    known = np.isfinite(values)
    axes.plot(x[known], values[known], "o", color=COLOURS[0], markersize=4, alpha=0.6, markeredgewidth=0)
    set_random_axis(axes, "x", table, key)
    set_value_axis(axes, table, name)
    mark_missing(axes, x[~known])


def _draw_coloured_points(figure: Figure, axes: Axes, table: DataFrame, name: str) -> None:
    keys = summary.drawn(table)
    (x, y), values = (table[key].to_numpy(dtype=float) for key in keys), member_values(table, name)
    known = np.isfinite(values)
    dots = axes.scatter(
        x[known], y[known], c=values[known], s=24, edgecolors="#888888", linewidths=0.4, **colour_scale(name, values)
    )
    if not known.all():
        axes.plot(x[~known], y[~known], "x", color="#888888", markersize=5, label="no value")
    draw_colour_bar(figure, axes, dots, values, column_label(table, name))
    for which, key in zip("xy", keys, strict=True):
        set_random_axis(axes, which, table, key)


def _draw_histogram(axes: Axes, table: DataFrame, name: str) -> None:
    from matplotlib.ticker import MaxNLocator

    values = member_values(table, name)
    values = values[np.isfinite(values)]
    found = summary.moments(table[table["status"] == DONE][name])
    log = spans_decades(values)
    shown = np.log10(values) if log else values
    count = math.ceil(2.0 * len(values) ** (1 / 3))  # Rice's rule
    flat = float(np.ptp(shown)) <= 1e-12 * float(np.abs(shown).max())
    reach = float(np.abs(shown).max()) * 0.05 or 1.0
    edges = np.linspace(shown.min() - reach * flat, shown.max() + reach * flat, 2 if flat else count + 1)
    axes.hist(values, bins=list(10.0**edges if log else edges), color=COLOURS[4], edgecolor="white", linewidth=0.8)
    text = f"mean {with_error(found['mean'], found['error'])}"
    if found["error"] > 0:
        text += " (standard error)"
        ends = found["mean"] - found["error"], found["mean"] + found["error"]
        axes.axvspan(*ends, color=COLOURS[1], alpha=0.25, linewidth=0)
    axes.axvline(found["mean"], color=COLOURS[1], linewidth=1.6, label=text)
    if log:
        axes.set_xscale("log")
    axes.set(xlabel=column_label(table, name), ylabel="members")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(False, axis="x")


def _title(table: DataFrame, name: str) -> str:
    """Title: the system, the number of members, and the number without a value."""
    came_from = table.attrs[PROVENANCE]
    counts = {str(status): int(count) for status, count in table["status"].value_counts().items() if status != DONE}
    done = table["status"] == DONE
    if blank := int((done & ~np.isfinite(table[name].to_numpy(dtype=float))).sum()):
        counts["with no number"] = blank
    return "  ·  ".join(
        [
            str(came_from["system"]),
            ", ".join([counted(len(table), "member"), *(f"{count:,} {what}" for what, count in counts.items())]),
        ]
    )
