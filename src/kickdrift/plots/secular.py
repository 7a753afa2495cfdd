"""Figure of an orbit report: paths of z and zeta, their spectra, and angles that librate."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.plots.orbits import BODY_COLOURS
from kickdrift.plots.runs import INK, MAX_POINTS, new_axes, new_figure, with_unit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kickdrift.analysis.orbits.secular_report import OrbitReport

FEW = 12  # most bodies with a line each
ANGLES = 4  # most angles that are drawn
WIDE = 1.6  # range of the spectra over the fastest proper frequency
KINDS = (("z", "g", "Pericentres", "e cos ϖ", "e sin ϖ"), ("zeta", "s", "Nodes", "sin(i/2) cos Ω", "sin(i/2) sin Ω"))


def orbit_report_figure(report: OrbitReport) -> Figure:
    """Draw pericentres and nodes in the complex plane, their spectra with the proper frequencies as dashed lines, and
    angles that librate against time."""
    angles = report.resonances[:ANGLES]
    figure = new_figure(12.0, 12.4 if angles else 8.6)
    parts: Any = figure.subfigures(2, 1, height_ratios=(2.2, 1.0)) if angles else (figure, None)
    upper, lower = parts
    for column, (series, kind, title, across, up) in enumerate(KINDS):
        values = getattr(report, series)[:, :FEW]
        axes = new_axes(upper, (2, 2, column + 1))
        thin = slice(None, None, -(-len(values) // MAX_POINTS))
        for k, body in enumerate(report.bodies[:FEW]):
            path = values[thin, k]
            axes.plot(path.real, path.imag, color=_colour(k), linewidth=0.6, alpha=0.8, label=body.name)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_title(title)
        axes.set_xlabel(across)
        axes.set_ylabel(up)
        _draw_spectra(new_axes(upper, (2, 2, column + 3)), report, values, kind)
    handles, labels = upper.axes[0].get_legend_handles_labels()
    upper.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 10), frameon=False, fontsize=9)
    if lower is not None:
        axes = new_axes(lower, (1, 1, 1))
        thin = slice(None, None, -(-len(report.times) // MAX_POINTS))
        for k, (one, angle) in enumerate(zip(angles, report.angles[: len(angles)], strict=True)):
            shown = np.degrees(angle[thin] % (2.0 * math.pi))
            axes.plot(report.times[thin], shown, ".", markersize=2.0, color=_colour(k), label=one.angle)
        axes.set_ylim(0, 360)
        axes.set_yticks([0, 90, 180, 270, 360])
        axes.set_title("Angles that librate")
        axes.set_ylabel("degrees")
        axes.set_xlabel(with_unit("time", report.units.time))
        axes.legend(loc="upper right", fontsize=8)
    figure.suptitle(f"{report.path.stem}  ·  {len(report.bodies)} orbits", fontsize=12, color=INK)
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
    axes.set_xlabel(f"frequency ({unit}); dashed: {kind}")
    axes.set_ylabel("amplitude")


def _colour(k: int) -> str:
    return BODY_COLOURS[k % len(BODY_COLOURS)]
