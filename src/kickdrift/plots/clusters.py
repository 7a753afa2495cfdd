"""Figure of a star cluster over time: Lagrangian radii and core, core density, bound mass, and energy of binaries."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kickdrift.analysis.clusters.report import ClusterReport, cluster_report
from kickdrift.plots import drawing as draw
from kickdrift.plots.drawing import Axes, Figure

if TYPE_CHECKING:
    from kickdrift.trajectory.read import reader

FRAMES = 400  # most frames of a run


def run_cluster_figure(run: reader.Run) -> Figure:
    """Draw the cluster of an open file, at frames that are spread evenly over the run."""
    return cluster_figure(cluster_report(run[:: max(1, -(-len(run) // FRAMES))]))


def cluster_figure(report: ClusterReport) -> Figure:
    """Draw a cluster's radii, core density, bound mass and energy of binaries against time."""
    figure, times = draw.new_figure(11.2, 7.6), report.times
    units = report.units
    axes = draw.new_axes(figure, (2, 2, (1, 3)))
    for k, share in enumerate(report.fractions):
        colour = draw.COLOURS[k % len(draw.COLOURS)]
        _line(axes, times, report.series("lagrangian_radii")[:, k], f"{100 * share:g} %", colour)
    _line(axes, times, report.series("core_radius"), "core", draw.INK, "--")
    _line(axes, times, report.series("tidal_radius"), "tidal radius", draw.INK, ":")
    axes.set(yscale="log", title="Lagrangian radii and core", ylabel=draw.with_unit("radius", units.length))
    draw.few_labels(axes)
    draw.legend(axes)
    density = draw.new_axes(figure, (2, 2, 2))
    _line(density, times, report.series("core_density"), "", draw.COLOURS[0])
    unit = f"{units.mass}/{units.length}^3" if units.symbol("length") else ""
    density.set(yscale="log", title="Core density", ylabel=draw.with_unit("mass density", unit))
    draw.few_labels(density)
    share = draw.new_axes(figure, (2, 2, 4))
    _line(share, times, report.series("bound_mass") / report.series("bound_mass")[0], "bound mass", draw.COLOURS[2])
    hardest = report.series("hardest")
    if (hardest >= 1.0).any():
        _line(share, times, hardest / 100.0, "hardest pair (100 kT)", draw.COLOURS[1])
    share.set_title("Bound mass, and the hardest pair")
    share.set_ylim(0.0, None)
    draw.legend(share)
    for each in figure.axes:
        draw.time_axis(each, units)
    figure.suptitle(f"{report.name}  ·  {report.states[0].stars:,} stars", fontsize=12, color=draw.INK)
    return figure


def _line(axes: Axes, x: draw.Floats, y: draw.Floats, label: str, colour: str, style: str = "-") -> None:
    """Draw a line, or nothing where no value is known."""
    if np.isfinite(y).any():
        marker = "o" if len(x) <= 20 else ""
        axes.plot(x, y, style, color=colour, linewidth=1.2, label=label, marker=marker, markersize=3.0)
