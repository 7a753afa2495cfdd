"""Figures of results: work against precision, tests of forces, and secular motion."""

from __future__ import annotations

import math
import os
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.errors import InputError
from kickdrift.model.units.quantities import FAMILIAR
from kickdrift.plots import drawing as draw
from kickdrift.plots.drawing import Axes, Figure
from kickdrift.plots.orbits import BODY_COLOURS
from kickdrift.text import measured

if TYPE_CHECKING:
    from kickdrift.analysis.certify.certificate import ForceChecks
    from kickdrift.analysis.compare.comparison import Comparison
    from kickdrift.analysis.compare.sampling import SamplingComparison
    from kickdrift.analysis.orbits.section import Section
    from kickdrift.analysis.orbits.secular_report import OrbitReport

MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def plot_comparison(
    comparison: Comparison | SamplingComparison, output: str | os.PathLike[str], *, overwrite: bool = False
) -> Path:
    """Draw the error of each method against force evaluations and against seconds, or sampling errors against the step.
    Return the figure's path.

    Methods use all colours first and then all markers. Below the grey line the reference itself is not accurate.
    """
    target = draw.checked_target(output, overwrite)
    return draw.save_figure(comparison.plot(), target)


def comparison_figure(comparison: Comparison) -> Figure:
    """The figure of ``plot_comparison``."""
    drawn = {
        name: rows
        for name in comparison.methods
        if (rows := [row for row in comparison.of(name) if row.error and row.seconds > 0])
    }
    if not drawn:
        raise InputError("compare: every run failed; there is nothing to draw")
    figure = draw.new_figure(11.2, 5.6)
    left = None
    for place, (key, label) in enumerate((("evaluations", "force evaluations"), ("seconds", "seconds")), start=1):
        axes = draw.new_axes(figure, (1, 2, place), sharey=left)
        left = left or axes
        for index, (name, rows) in enumerate(drawn.items()):
            colour = draw.COLOURS[index % len(draw.COLOURS)]
            marker = MARKERS[(index + index // len(draw.COLOURS)) % len(MARKERS)]
            style = "-" if index < len(draw.COLOURS) else "--"
            axes.plot(
                [getattr(row, key) for row in rows], [row.error or 0.0 for row in rows], color=colour, marker=marker,
                linestyle=style, markersize=4, linewidth=1.4, label=name,
            )  # fmt: skip
        axes.axhspan(axes.get_ylim()[0], comparison.reference_error, color="#BBBBBB", alpha=0.35, linewidth=0)
        axes.set(
            xscale="log",
            yscale="log",
            xlabel=label,
            title="Work in force evaluations" if key == "evaluations" else "Work in time",
        )
    assert left is not None
    errors = [row.error for rows in drawn.values() for row in rows if row.error]
    left.set_ylim(0.3 * min(errors), 3.0 * min(max(errors), 1.0))
    left.set_ylabel(
        "relative energy error (RMS)" if comparison.measure == "energy" else "largest relative error of the positions"
    )
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    unit = measured("", draw.printed(comparison.time_unit))
    figure.suptitle(
        f"{comparison.system}  ·  {comparison.length:.4g}{unit}  ·  {comparison.reference}", fontsize=12, color=draw.INK
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
    scale, pressure_unit = FAMILIAR.get(comparison.pressure_unit, (1.0, comparison.pressure_unit))
    units = {"pressure": (scale, pressure_unit)}
    figure = draw.new_figure(4.2 * len(kinds) + 1.0, 4.6)
    for place, (key, label) in enumerate(kinds, start=1):
        axes = draw.new_axes(figure, (1, len(kinds), place))
        axes.axhline(0.0, color="#BBBBBB", linewidth=1.0)
        scale, unit = units.get(key, (1.0, comparison.energy_unit))
        for index, name in enumerate(comparison.methods):
            rows = [row for row in good if row.method == name]
            axes.errorbar(
                [row.dt for row in rows], [scale * getattr(row, key) for row in rows],
                [2.0 * scale * getattr(row, f"{key}_error") for row in rows],
                color=draw.COLOURS[index % len(draw.COLOURS)],
                marker=MARKERS[index % len(MARKERS)], markersize=4, linewidth=1.4, capsize=2,
                label=comparison.label(name),
            )  # fmt: skip
        axes.set_xlabel(f"dt ({draw.printed(comparison.time_unit)})" if comparison.time_unit else "dt")
        axes.set_title(f"Error of the mean of {label}{f' ({draw.printed(unit)})' if unit else ''}")
    axes = figure.axes[0]
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=6, fontsize=8, frameon=False)
    figure.suptitle(f"{comparison.system}  ·  errors of means with two standard errors", fontsize=12, color=draw.INK)
    return figure


PANELS = {  # axis labels of each curve, and whether both axes are logarithmic
    "energy": ("displacement of one particle", "energy", False),
    "force": ("displacement of one particle", "force along the line", False),
    "error of the force": ("step of the differences, in nearest distances", "largest relative error", True),
    "energy of a run": ("time", "energy of a run, less its mean", False),
}


def force_figure(checks: ForceChecks) -> Figure:
    """Draw energy and force along a line, the error of the force over the step of the differences, and the energy of a
    run. Raises InputError if no test made a curve."""
    drawn = [name for name in PANELS if name in checks.curves and checks.curves[name].size]
    if not drawn:
        raise InputError(f"{checks.system}: no test of its forces made a curve; there is nothing to draw")
    figure = draw.new_figure(11.2, 7.0 if len(drawn) > 2 else 4.0)
    rows = (len(drawn) + 1) // 2
    for place, name in enumerate(drawn, 1):
        x, y = checks.curves[name]
        across, up, logarithmic = PANELS[name]
        axes = draw.new_axes(figure, (rows, min(2, len(drawn)), place))
        marked = "o" if logarithmic else None
        axes.plot(
            x,
            y - y.mean() if name == "energy of a run" else y,
            color=draw.COLOURS[place - 1],
            linewidth=1.4,
            marker=marked,
        )
        if logarithmic:
            axes.set(xscale="log", yscale="log")
        axes.set(xlabel=across, ylabel=up)
    failed = ", ".join(row.test for row in checks.failed)
    figure.suptitle(
        f"{checks.system}  ·  {f'failed: {failed}' if failed else 'all tests passed'}", fontsize=12, color=draw.INK
    )
    return figure


FEW = 12  # most bodies with a line each
ANGLES = 4  # most angles that are drawn
WIDE = 1.6  # range of the spectra over the fastest proper frequency
KINDS = (("z", "g", "Pericentres", "e cos ϖ", "e sin ϖ"), ("zeta", "s", "Nodes", "sin(i/2) cos Ω", "sin(i/2) sin Ω"))


def section_figure(section: Section) -> Figure:
    """Draw the second value of a Poincaré section over the first, a point for each crossing."""
    if len(section.names) < 2:
        raise InputError("plot: a section in a picture has two coordinates, and this one has one")
    figure = draw.new_figure(6.0, 5.4)
    axes = draw.new_axes(figure, (1, 1, 1))
    axes.plot(section.values[:, 0], section.values[:, 1], ".", markersize=2)
    axes.set_xlabel(section.names[0])
    axes.set_ylabel(section.names[1])
    return figure


def orbit_report_figure(report: OrbitReport) -> Figure:
    """Draw pericentres and nodes in the complex plane, their spectra with the proper frequencies as dashed lines, and
    angles that librate against time."""
    angles = report.resonances[:ANGLES]
    figure = draw.new_figure(12.0, 12.4 if angles else 8.6)
    parts: Any = figure.subfigures(2, 1, height_ratios=(2.2, 1.0)) if angles else (figure, None)
    upper, lower = parts
    for column, (series, kind, title, across, up) in enumerate(KINDS):
        values = getattr(report, series)[:, :FEW]
        axes = draw.new_axes(upper, (2, 2, column + 1))
        thin = slice(None, None, -(-len(values) // draw.MAX_POINTS))
        for k, body in enumerate(report.bodies[:FEW]):
            path = values[thin, k]
            axes.plot(path.real, path.imag, color=_colour(k), linewidth=0.6, alpha=0.8, label=body.name)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set(title=title, xlabel=across, ylabel=up)
        _draw_spectra(draw.new_axes(upper, (2, 2, column + 3)), report, values, kind)
    handles, labels = upper.axes[0].get_legend_handles_labels()
    upper.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 10), frameon=False, fontsize=9)
    if lower is not None:
        axes = draw.new_axes(lower, (1, 1, 1))
        thin = slice(None, None, -(-len(report.times) // draw.MAX_POINTS))
        for k, (one, angle) in enumerate(zip(angles, report.angles[: len(angles)], strict=True)):
            shown = np.degrees(angle[thin] % (2.0 * math.pi))
            axes.plot(report.times[thin], shown, ".", markersize=2.0, color=_colour(k), label=one.angle)
        axes.set(
            ylim=(0, 360),
            yticks=[0, 90, 180, 270, 360],
            title="Angles that librate",
            ylabel="degrees",
            xlabel=draw.with_unit("time", report.units.time),
        )
        axes.legend(loc="upper right", fontsize=8)
    figure.suptitle(f"{report.path.stem}  ·  {len(report.bodies)} orbits", fontsize=12, color=draw.INK)
    return figure


def _draw_spectra(axes: Axes, report: OrbitReport, values: Any, kind: str) -> None:
    """Spectra under a Hann window, with a dashed line at each proper frequency."""
    scale, unit = report.rate
    n = len(values)
    step = float(report.times[-1] - report.times[0]) / (n - 1)
    window = np.hanning(n)
    sizes = np.abs(np.fft.fft(values * (window / window.sum())[:, None], axis=0))
    at = 2.0 * math.pi * np.fft.fftfreq(n, step)
    known = [getattr(body, kind) for body in report.bodies[:FEW]]
    reach = WIDE * max([abs(w) for w in known if math.isfinite(w)] or [abs(at).max()])
    order = np.argsort(at)
    order = order[np.abs(at[order]) <= max(reach, 8.0 * report.resolution)]
    for k, w in enumerate(known):
        axes.plot(at[order] * scale, sizes[order, k], color=_colour(k), linewidth=0.8)
        if math.isfinite(w):
            axes.axvline(w * scale, color=_colour(k), linewidth=0.7, linestyle=(0, (4, 3)), alpha=0.7)
    axes.set_yscale("log")
    low, high = sizes[order].min(), sizes[order].max()
    if high > 0:
        axes.set_ylim(max(low, 1e-7 * high), 2.0 * high)
    axes.set(xlabel=f"frequency ({unit}); dashed: {kind}", ylabel="amplitude")


def _colour(k: int) -> str:
    return BODY_COLOURS[k % len(BODY_COLOURS)]
