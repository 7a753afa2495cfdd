"""Figure of the longest stable step: regions in the complex plane, and splittings on the oscillator."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from kickdrift.errors import InputError
from kickdrift.integrators.asked import Integrator, method_of
from kickdrift.integrators.method import Method
from kickdrift.integrators.splitting.method import Splitting
from kickdrift.integrators.step_choice import stability
from kickdrift.plots.drawing import COLOURS, GRID, INK, Axes, Figure, checked_target, new_axes, new_figure, save_figure

POINTS = 600  # grid points along each axis of the complex plane; a curve has a quarter of this
STYLES = ("-", "--", ":", "-.")  # line styles; the next one starts after all colours
UNBOUNDED = 8.0  # extent of the figure without any bound
TRACE = 1.8  # extent of the figure for half a trace


def plot_stability(
    names: Sequence[str],
    output: str | os.PathLike[str],
    *,
    numbers: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw the stability regions of the named methods. Return the figure's path.

    For one-step methods: the regions |R(z)| <= 1, z = lambda dt, of y' = lambda y. For splittings: half the trace of
    an oscillator's propagation matrix against omega dt. Computed from the coefficients: see
    ``integrators.step_choice.stability``.
    """
    target = checked_target(output, overwrite)
    return save_figure(stability_figure(names), target, numbers, overwrite)


def stability_figure(names: Sequence[str | Integrator]) -> Figure:
    """The figure of ``plot_stability``."""
    methods = list(dict.fromkeys(map(method_of, names)))
    if not methods:
        raise InputError("stability: there is nothing to draw; name an integrator")
    if culprit := next((method.name for method in methods if method.overdamped), None):
        raise InputError(f"stability: {culprit} moves without inertia, and has no curve of oscillations")
    curves = [method for method in methods if isinstance(method, Splitting)]
    regions = [method for method in methods if not isinstance(method, Splitting)]
    functions = [stability.stability_function(method) for method in regions]
    panels = bool(regions) + bool(curves)
    figure = new_figure(6.2 * panels, 5.4 + 0.2 * max(len(regions), len(curves)))
    if regions:
        _draw_regions(new_axes(figure, (1, panels, 1)), regions, functions)
    if curves:
        _draw_half_traces(new_axes(figure, (1, panels, panels)), curves)
    for axes in figure.axes:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), fontsize=8, frameon=False)
    return figure


def number(bound: float) -> str:
    """A bound as printed."""
    return f"{bound:.4f}" if math.isfinite(bound) else "∞"


def _style(index: int) -> tuple[str, str]:
    return COLOURS[index % len(COLOURS)], STYLES[index // len(COLOURS) % len(STYLES)]


def _draw_regions(axes: Axes, regions: Sequence[Method], functions: Sequence[stability.StabilityFunction]) -> None:
    left, right, top = _extent(functions)
    real, imaginary = np.linspace(left, right, POINTS), np.linspace(-top, top, POINTS)
    z = real + 1j * imaginary[:, None]
    axes.axhline(0.0, color=INK, linewidth=0.7)
    axes.axvline(0.0, color=INK, linewidth=0.7)
    for index, (method, r) in enumerate(zip(regions, functions, strict=True)):
        colour, style = _style(index)
        # Across the edge the logarithm changes evenly, unlike |R|; NaN at a pole would leave a hole.
        size = np.log(np.clip(np.abs(r(z)), 1e-30, 1e30))
        axes.contourf(real, imaginary, size, levels=[-100.0, 0.0], colors=[colour], alpha=0.08)
        axes.contour(real, imaginary, size, levels=[0.0], colors=[colour], linestyles=[style], linewidths=1.5)
        along = number(stability.real_interval(r)), number(stability.imaginary_interval(r))
        label = f"{method.name}: real {along[0]}, imaginary {along[1]}"
        axes.plot([], [], color=colour, linestyle=style, linewidth=1.5, label=label)
    axes.set(aspect="equal", title="Regions of stability: |R(z)| ≤ 1", xlabel="Re λ dt", ylabel="Im λ dt")


def _extent(functions: Sequence[stability.StabilityFunction]) -> tuple[float, float, float]:
    """Rectangle around the bounded parts of the regions: left, right, and equally far up and down."""
    reach = [x for x in map(stability.real_interval, functions) if math.isfinite(x)]
    width = 2.0 * max(reach, default=UNBOUNDED / 2)
    line = np.linspace(-width, width, POINTS // 2)
    z = line + 1j * line[:, None]
    inside = [np.abs(r(z)) <= 1.0 for r in functions if math.isfinite(stability.real_interval(r))]
    found = z[np.any(inside, axis=0)] if inside else z
    margin = 0.08 * width
    return (
        float(found.real.min()) - margin,
        max(float(found.real.max()), 0.0) + 2.0 * margin,
        float(found.imag.max()) + margin,
    )


def _draw_half_traces(axes: Axes, curves: Sequence[Splitting]) -> None:
    intervals = [stability.stability_interval(method) for method in curves]
    step = np.linspace(0.0, 1.2 * max(intervals), 4 * POINTS)
    for bound in (-1.0, 1.0):
        axes.axhline(bound, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
    for index, (method, interval) in enumerate(zip(curves, intervals, strict=True)):
        colour, style = _style(index)
        half = stability.half_trace(method)(step**2)
        drawn = np.where(np.abs(half) <= 2.0 * TRACE, half, np.nan)
        label = f"{method.name}: ω dt ≤ {number(interval)}"
        axes.plot(step, drawn, color=colour, linestyle=style, linewidth=1.5, label=label)
        axes.axvline(interval, color=colour, linewidth=0.8, linestyle=":")
    axes.plot(step, np.cos(step), color=GRID, linewidth=3.5, zorder=0.5, label="exact: cos ω dt")
    axes.set(
        xlim=(0.0, float(step[-1])),
        ylim=(-TRACE, TRACE),
        title="Oscillator: |trace| ≤ 2",
        xlabel="ω dt",
        ylabel="trace of the propagation matrix / 2",
    )
