"""Figure of work against precision."""

from __future__ import annotations

import os
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.plots.runs import COLOURS, INK, checked_target, new_axes, new_figure, printed, save_figure
from kickdrift.text import measured

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kickdrift.analysis.compare.comparison import Comparison
    from kickdrift.analysis.compare.sampling import SamplingComparison

MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def plot_comparison(
    comparison: Comparison | SamplingComparison, output: str | os.PathLike[str], *, overwrite: bool = False
) -> Path:
    """Draw the error of each method against force evaluations and against seconds, or sampling errors against the step.
    Return the figure's path.

    Methods use all colours first and then all markers. Below the grey line the reference itself is not accurate.
    """
    target = checked_target(output, overwrite)
    return save_figure(comparison.plot(), target)


def comparison_figure(comparison: Comparison) -> Figure:
    """The figure of ``plot_comparison``."""
    drawn = {
        name: rows
        for name in comparison.methods
        if (rows := [row for row in comparison.of(name) if row.error and row.seconds > 0])
    }
    if not drawn:
        raise InputError("compare: every run failed; there is nothing to draw")
    figure = new_figure(11.2, 5.6)
    left = None
    for place, (key, label) in enumerate((("evaluations", "force evaluations"), ("seconds", "seconds")), start=1):
        axes = new_axes(figure, (1, 2, place), sharey=left)
        left = left or axes
        for index, (name, rows) in enumerate(drawn.items()):
            colour = COLOURS[index % len(COLOURS)]
            marker = MARKERS[(index + index // len(COLOURS)) % len(MARKERS)]
            style = "-" if index < len(COLOURS) else "--"
            axes.plot(
                [getattr(row, key) for row in rows], [row.error or 0.0 for row in rows], color=colour, marker=marker,
                linestyle=style, markersize=4, linewidth=1.4, label=name,
            )  # fmt: skip
        axes.axhspan(axes.get_ylim()[0], comparison.reference_error, color="#BBBBBB", alpha=0.35, linewidth=0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel(label)
        axes.set_title("Work in force evaluations" if key == "evaluations" else "Work in time")
    assert left is not None
    errors = [row.error for rows in drawn.values() for row in rows if row.error]
    left.set_ylim(0.3 * min(errors), 3.0 * min(max(errors), 1.0))
    left.set_ylabel(
        "relative energy error (RMS)" if comparison.measure == "energy" else "largest relative error of the positions"
    )
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    unit = measured("", printed(comparison.time_unit))
    figure.suptitle(
        f"{comparison.system}  ·  {comparison.length:.4g}{unit}  ·  {comparison.reference}", fontsize=12, color=INK
    )
    return figure


def sampling_figure(comparison: SamplingComparison) -> Figure:
    """The figure of sampling errors: of the mean energies and of the pressure, against the step."""
    kinds = [("potential", "U / N"), ("kinetic", "K / N"), ("pressure", "pressure")]
    good = [row for row in comparison.rows if not row.failure]
    if not good:
        raise InputError("compare: every run failed; there is nothing to draw")
    if not any(isfinite(row.pressure) for row in good):
        kinds.pop()
    units = {"pressure": comparison.pressure_unit}
    figure = new_figure(4.2 * len(kinds) + 1.0, 4.6)
    for place, (key, label) in enumerate(kinds, start=1):
        axes = new_axes(figure, (1, len(kinds), place))
        axes.axhline(0.0, color="#BBBBBB", linewidth=1.0)
        for index, name in enumerate(comparison.methods):
            rows = [row for row in good if row.method == name]
            axes.errorbar(
                [row.dt for row in rows], [getattr(row, key) for row in rows],
                [2.0 * getattr(row, f"{key}_error") for row in rows], color=COLOURS[index % len(COLOURS)],
                marker=MARKERS[index % len(MARKERS)], markersize=4, linewidth=1.4, capsize=2,
                label=comparison.label(name),
            )  # fmt: skip
        axes.set_xlabel(f"dt ({printed(comparison.time_unit)})" if comparison.time_unit else "dt")
        unit = units.get(key, comparison.energy_unit)
        axes.set_title(f"Error of the mean of {label}{f' ({printed(unit)})' if unit else ''}")
    axes = figure.axes[0]
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    figure.suptitle(f"{comparison.system}  ·  errors of means with two standard errors", fontsize=12, color=INK)
    return figure
