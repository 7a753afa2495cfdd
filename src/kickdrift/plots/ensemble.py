"""Figures of an ensemble: a map over two keys, a curve over one, points over random keys, or a histogram."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.ensemble import summary
from kickdrift.ensemble.ensemble import Ensemble
from kickdrift.ensemble.rows import DONE
from kickdrift.ensemble.table import PROVENANCE
from kickdrift.errors import InputError
from kickdrift.plots.ensemble_axes import (
    NO_VALUE,
    colour_scale,
    column_label,
    draw_colour_bar,
    grid_scale,
    mark_missing,
    member_values,
    set_grid_axis,
    set_random_axis,
    set_value_axis,
    spans_decades,
)
from kickdrift.plots.runs import COLOURS, INK, checked_target, new_axes, new_figure, save_figure
from kickdrift.systemfile.files import prefixed
from kickdrift.text import counted, with_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame

MOST_LABELS = 8  # most values along a map's axis that are all labelled


def plot_ensemble(
    path: str | os.PathLike[str], output: str | os.PathLike[str], column: str | None = None, *, overwrite: bool = False
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
    return save_figure(figure, target)


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
    axes.set_xlabel(column_label(table, name))
    axes.set_ylabel("members")
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
