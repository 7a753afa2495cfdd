"""Figure of one column of a run's samples against time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kickdrift.errors import InputError
from kickdrift.looks.columns import parts
from kickdrift.plots.runs import COLOURS, GRID, INK, _thin, _time_axis, _title, new_axes, new_figure, with_unit
from kickdrift.text import choices, shown, suggestion
from kickdrift.trajectory.read import reader

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_LINES = 9  # a tensor's


def column_figure(run: reader.Run, name: str) -> Figure:
    """A column of a run's samples, kickdrift's own or a user's, against time.

    Each number of a vector or tensor is a line; of more than nine numbers the first nine are drawn."""
    observables = run.observables
    if name not in observables:
        known = choices(observables, name) or "none, for it has no sample"
        raise InputError(f"{run.path}: column {shown(name)}: its columns are {known}{suggestion(name, observables)}")
    times, values, unit = run.sample_times, observables[name], run.unit_of(name)
    units, title = run.units, _title(run)
    figure = new_figure(7.2, 4.2)
    axes = new_axes(figure, (1, 1, 1))
    labels = parts(name, values.shape[1:])
    lines = values.reshape(len(values), len(labels)).T
    for k, (label, line) in enumerate(zip(labels[:MOST_LINES], lines, strict=False)):
        finite = np.isfinite(line)
        axes.plot(*_thin(times[finite], line[finite]), label=label, color=COLOURS[k % len(COLOURS)], linewidth=1.2)
    axes.set_title(name.replace("_", " "))
    axes.set_ylabel(with_unit(name.replace("_", " "), unit))
    _time_axis(axes, units)
    if len(labels) > 1:
        axes.legend(loc="best", fontsize=8, frameon=True, framealpha=0.9, edgecolor=GRID)
    figure.suptitle(title, fontsize=11, color=INK)
    return figure
