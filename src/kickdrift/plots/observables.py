"""Figures of a run's observables, each with its standard errors below."""

from collections.abc import Callable
from itertools import combinations_with_replacement
from typing import NamedTuple
from warnings import warn

import numpy as np

from kickdrift.analysis.observables.motion import (
    MeanSquaredDisplacement,
    mean_squared_displacement,
    velocity_autocorrelation,
)
from kickdrift.analysis.observables.structure import radial_distribution, structure_factor
from kickdrift.errors import InputError
from kickdrift.model.state import Floats
from kickdrift.plots import drawing as draw
from kickdrift.plots.drawing import Axes, Figure
from kickdrift.text import measured
from kickdrift.trajectory.read import reader

WORK = 2e8  # n^2 times the frames averaged for g(r) and S(k): a few seconds
FEWEST_FRAMES = 10  # least number of frames, if the run has them
FEW_POINTS = 20  # most points of a line that is drawn with markers
FEWEST_POINTS = 5  # fewer points show no curve
FAINT = 0.02  # fraction of a velocity's square: smaller correlations look like zero
MOST_SPECIES = 3  # most species with a line each, or a line for each pair; else all particles are taken together


class Curve(NamedTuple):
    """Values with standard errors, infinite if unknown."""

    label: str
    x: Floats
    y: Floats
    error: Floats


def observable_figure(run: reader.Run, kind: str) -> Figure:
    """ "rdf", "msd", "vacf" or "structure-factor" of an open file.

    If there are few species, each species or pair has its own line. Bands and bars are standard errors by block
    averages, and a panel below shows the errors alone. A run that is too short has no errors. g(r) and S(k) are
    averages over frames spread evenly over the run without the first, as many as take a few seconds.
    """
    measure, paint = KINDS[kind]
    if not len(run):
        raise InputError(f"{run.path}: no frame to draw")
    curves = measure(run)
    figure = draw.new_figure(7.2, 6.0)
    axes = draw.new_axes(figure, (4, 1, (1, 3)))
    paint(axes, curves, run)
    _draw_errors(figure, axes, curves)
    if kind in ("msd", "vacf") and len(curves[0].x) < FEWEST_POINTS:
        points = f"{len(curves[0].x)} point" + "s" * (len(curves[0].x) != 1)
        warn(f"{kind}: the curve has {points}; write frames more often, or run longer", stacklevel=3)
    if any(curve.label for curve in curves):
        axes.legend(loc="best", fontsize=9, frameon=True, framealpha=0.9, edgecolor=draw.GRID)
    figure.suptitle(draw.title_of(run), fontsize=11, color=draw.INK)
    return figure


# -- curves


def _rdf(run: reader.Run) -> list[Curve]:
    kinds = run.species if 1 < len(run.species) <= MOST_SPECIES else ()
    pairs: list[tuple[str, str] | None] = [*combinations_with_replacement(kinds, 2)] or [None]
    counts = np.bincount(run.species_index)
    curves = []
    for pair in pairs:
        if pair and pair[0] == pair[1] and counts[run.species.index(pair[0])] < 2:
            continue
        found = radial_distribution(run[_spread(run)], pair=pair)
        curves.append(Curve("–".join(pair or ()), found.r, found.g, found.error))
    return curves


def _structure_factor(run: reader.Run) -> list[Curve]:
    found = structure_factor(run[_spread(run)])
    return [Curve("", found.k, found.s, found.error)]


def _displacements(run: reader.Run) -> list[Curve]:
    found = ((name, mean_squared_displacement(run, of=name)) for name in _each_species(run))
    return [Curve(_with_diffusion(name, m, run), m.times[1:], m.values[1:], m.error[1:]) for name, m in found]


def _with_diffusion(name: str | None, found: MeanSquaredDisplacement, run: reader.Run) -> str:
    """Label of a curve: its species and its diffusion coefficient, with the window of the slope."""
    if len(found.times) < 3:
        return name or ""
    d = found.diffusion()
    unit = measured("", draw.printed(f"{run.units.length}^2/{run.units.time}"))
    value = f"{d.value:.3g} ± {d.error:.1g}{unit}" if np.isfinite(d.error) else f"{d.value:.3g}{unit}, error unknown"
    window = f"slope from {d.window[0]:.3g} to {d.window[1]:.3g}"
    return f"{name + ': ' if name else ''}D = {value} ({window})"


def _velocities(run: reader.Run) -> list[Curve]:
    found = ((name, velocity_autocorrelation(run, of=name)) for name in _each_species(run))
    curves = [Curve(name or "", c.times, c.normalised, c.error / abs(c.values[0])) for name, c in found]
    # Twice the visible range.
    shown = min(2 * max(int(np.flatnonzero(abs(curve.y) > FAINT)[-1]) for curve in curves) + 2, len(curves[0].x))
    return [Curve(c.label, c.x[:shown], c.y[:shown], c.error[:shown]) for c in curves]


def _each_species(run: reader.Run) -> list[str | None]:
    return list(run.species) if 1 < len(run.species) <= MOST_SPECIES else [None]


def _spread(run: reader.Run) -> slice:
    """Frames over the whole run except its start, which often is a lattice."""
    count = max(FEWEST_FRAMES, int(WORK / len(run.ids) ** 2))
    step = -(-len(run) // count)
    return slice(min(max(1, step - 1), len(run) - 1), None, step)


# -- drawing


def _draw_rdf(axes: Axes, curves: list[Curve], run: reader.Run) -> None:
    axes.axhline(1.0, color=draw.GRID, linewidth=1.2)
    _lines(axes, curves)
    _name(axes, "Radial distribution function", draw.with_unit("r", run.units.length), "g(r)")
    axes.set(xlim=(0.0, None), ylim=(0.0, None))


def _draw_structure_factor(axes: Axes, curves: list[Curve], run: reader.Run) -> None:
    axes.axhline(1.0, color=draw.GRID, linewidth=1.2)
    for curve, colour in zip(curves, draw.COLOURS, strict=False):
        axes.plot(curve.x, curve.y, color=colour, linewidth=0.8, alpha=0.5)
        bars = np.where(np.isfinite(curve.error), curve.error, 0.0)
        axes.errorbar(curve.x, curve.y, bars, fmt="o", markersize=3.5, color=colour, elinewidth=1.0, capsize=2.0)
    _name(axes, "Static structure factor", draw.with_unit("k", f"1/{run.units.length}"), "S(k)")
    axes.set(xlim=(0.0, None), ylim=(0.0, None))


def _draw_displacements(axes: Axes, curves: list[Curve], run: reader.Run) -> None:
    _lines(axes, curves)
    axes.set(xscale="log", yscale="log")
    draw.few_labels(axes)
    squared = draw.with_unit("⟨|r(t) − r(0)|²⟩", f"{run.units.length}^2")
    _name(axes, "Mean squared displacement", draw.with_unit("time", run.units.time), squared)


def _draw_velocities(axes: Axes, curves: list[Curve], run: reader.Run) -> None:
    axes.axhline(0.0, color=draw.GRID, linewidth=1.2)
    _lines(axes, curves)
    _name(axes, "Velocity autocorrelation", draw.with_unit("time", run.units.time), "⟨v(t) · v(0)⟩ / ⟨v²⟩")
    axes.set_xlim(0.0, None)


def _lines(axes: Axes, curves: list[Curve]) -> None:
    """Draw lines, each with a band of one standard error to both sides, between the first and the last known error. In
    between, the band goes straight over points without an error."""
    for curve, colour in zip(curves, draw.COLOURS, strict=False):
        known = np.isfinite(curve.error)
        if known.any():
            band = np.interp(curve.x, curve.x[known], curve.error[known], left=np.nan, right=np.nan)
            axes.fill_between(curve.x, curve.y - band, curve.y + band, color=colour, alpha=0.3, lw=0)
        marker = "o" if len(curve.x) <= FEW_POINTS else ""
        axes.plot(curve.x, curve.y, color=colour, linewidth=1.2, label=curve.label, marker=marker, markersize=4.0)


def _draw_errors(figure: Figure, above: Axes, curves: list[Curve]) -> None:
    """Draw the errors alone, which are thinner than a line for a long run."""
    axes = draw.new_axes(figure, (4, 1, 4))
    axes.set(xscale=above.get_xscale(), yscale="log")
    draw.few_labels(axes)
    several = False
    for curve, colour in zip(curves, draw.COLOURS, strict=False):
        drawn = np.isfinite(curve.error) & (curve.error > 0)
        axes.plot(curve.x[drawn], curve.error[drawn], ".", color=colour, markersize=3.0)
        several |= bool(drawn.any())
    if not several:
        axes.set_yticks([], minor=False)
        axes.text(0.5, 0.5, "the run is too short for errors", transform=axes.transAxes, ha="center", va="center")
    axes.set_xlim(above.get_xlim())
    axes.set(xlabel=above.get_xlabel(), ylabel="standard error")
    above.set_xlabel("")


def _name(axes: Axes, title: str, x: str, y: str) -> None:
    axes.set_title(f"{title} (± one standard error)", fontsize=11)
    axes.set(xlabel=x, ylabel=y)


Measure = Callable[[reader.Run], list[Curve]]
KINDS: dict[str, tuple[Measure, Callable[..., None]]] = {
    "rdf": (_rdf, _draw_rdf),
    "msd": (_displacements, _draw_displacements),
    "vacf": (_velocities, _draw_velocities),
    "structure-factor": (_structure_factor, _draw_structure_factor),
}
