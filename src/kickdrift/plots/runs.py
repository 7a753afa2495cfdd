"""Figures of a run, of one of its columns, and of a benchmark."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kickdrift.analysis.observables.structure import radial_distribution
from kickdrift.errors import InputError
from kickdrift.looks.columns import parts
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UNIT_SYSTEMS, UnitSystem
from kickdrift.plots import drawing as draw
from kickdrift.plots.drawing import Axes, Figure
from kickdrift.statistics.drift import energy_error
from kickdrift.text import choices, measured, shown, suggestion
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.info import Room, room_of

if TYPE_CHECKING:
    from kickdrift.run.report.report import Report

RDF_FRAMES = 20  # most frames, spread evenly over the run
RDF_NEIGHBOURS = 400  # g(r) reaches to this many neighbours, or to half the box
RDF_PARTICLES = 20_000  # particles over all frames, about a second of work; more particles use fewer frames
WINDOWS = 50  # parts of a benchmark's run for the RMS error


def write_figure(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    overwrite: bool,
    made: Callable[[reader.Run], Figure],
    numbers: str | os.PathLike[str] | None = None,
) -> Path:
    """Write the figure that ``made`` returns of a run's file, and on request its numbers. Return the figure's path."""
    target = draw.checked_target(output, overwrite, path)
    with reader.open(path) as run:
        figure = made(run)
    return draw.save_figure(figure, target, numbers, overwrite)


def run_figure(run: reader.Run) -> Figure:
    """Energies, energy error, temperature and radial distribution function of an open file.

    The error is (E(t) - E(0)) / |E(0)|, or relative to the kinetic energy at the start if |E(0)| is under a tenth of
    it. As in the report, E(t) includes the energy that collisions and removed bodies took out.
    """
    if not len(run.sample_times):
        raise InputError(f"{run.path}: no sample to draw")
    energies, temperature = run.energies, run.observables.get("temperature")
    rdf = _rdf(run) if len(run.ids) > 1 and len(run) else None
    panels = [partial(_draw_energies, energies), partial(_draw_error, energies, energy_taken(run))]
    panels += [partial(_draw_temperature, energies.time, temperature)] if temperature is not None else []
    if room := room_of(run):
        panels += [partial(_draw_room, room), partial(_draw_edges, room, run.box.periodic_axes)]
    panels += [partial(_draw_rdf, *rdf)] if rdf is not None else []
    return panelled(panels, run.units, draw.title_of(run))


def report_figure(report: Report) -> Figure:
    """Energies, energy error and temperature of a run, from the samples that its report holds."""
    units, series = report.about.units, report.about.series
    if not np.isfinite(series.total).all():
        raise InputError(f"{report.system}: has no energy to draw; give the Problem an energy function")
    total, kinetic = series.total - series.taken, np.nan_to_num(series.kinetics) + 0.0 * series.total
    energies = reader.EnergySeries(series.times, kinetic, total - kinetic, total)
    panels = [partial(_draw_error, energies, series.taken)]
    panels = [partial(_draw_energies, energies), *panels] if units else panels
    panels += [partial(_draw_temperature, series.times, series.temperatures)] if series.temperatures is not None else []
    units = units or UNIT_SYSTEMS["nbody"]
    step = [] if report.dt is None else [measured(f"dt = {report.dt:g}", draw.printed(units.time))]
    return panelled(panels, units, "  ·  ".join([report.system, report.integrator, *step]))


def panelled(panels: Sequence[Callable[[Axes, UnitSystem], None]], units: UnitSystem, title: str) -> Figure:
    """A figure of panels in two columns; the last one of an odd number is as wide as both."""
    rows = math.ceil(len(panels) / 2)
    figure = draw.new_figure(10.0, 3.5 * rows if rows > 1 else 3.8)
    for index, panel in enumerate(panels):
        last_alone = index == len(panels) - 1 and len(panels) % 2
        panel(draw.new_axes(figure, (rows, 2, (index + 1, index + 2)) if last_alone else (rows, 2, index + 1)), units)
    figure.suptitle(title, fontsize=12, color=draw.INK)
    return figure


def plot_benchmark(
    rows: Sequence[Mapping[str, Any]], output: str | os.PathLike[str], *, overwrite: bool = False, time_unit: str = "τ"
) -> Path:
    """Draw the relative energy error of each method against time, a panel for each table. Return the figure's path.

    Faint: every sample; strong: the root mean square over each fiftieth of the run.

    A row has ``method``, ``dt``, ``table``, ``times`` (k,), ``relative_error`` (k,) and, optionally, ``verdict``.
    Values that are not finite, as after a blow-up, are left out.
    """
    target = draw.checked_target(output, overwrite)
    if not rows:
        raise InputError("plot_benchmark: there is nothing to draw")
    tables = list(dict.fromkeys(str(row["table"]) for row in rows))
    methods = list(dict.fromkeys(str(row["method"]) for row in rows))
    figure = draw.new_figure(5.6 * len(tables), 5.2)
    first: Axes | None = None
    for index, table in enumerate(tables):
        axes = draw.new_axes(figure, (1, len(tables), index + 1), sharey=first)
        first = first or axes
        for row in rows:
            if str(row["table"]) == table:
                _draw_method(axes, row, draw.COLOURS[methods.index(str(row["method"])) % len(draw.COLOURS)])
        axes.set(yscale="log", title=table[:1].upper() + table[1:], xlabel=f"time ({time_unit})")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, fontsize=8, frameon=False)
    if first is not None:
        first.set_ylabel("relative energy error |ΔE / E$_0$|")
    return draw.save_figure(figure, target)


# -- panels of a run


def energy_taken(run: reader.Run) -> Floats | float:
    """Energy that events had taken out of a run at each sample, or 0."""
    return run.observables.get("energy_taken", 0.0)


def _draw_energies(energies: reader.EnergySeries, axes: Axes, units: UnitSystem) -> None:
    names = ("kinetic", "potential", "total")
    for name, values, colour in zip(names, energies[1:], (draw.COLOURS[1], draw.COLOURS[0], draw.INK), strict=True):
        axes.plot(*draw.thin(energies.time, values), label=name, color=colour, linewidth=1.2)
    axes.set(title="Energy", ylabel=draw.with_unit("energy", units.energy))
    draw.time_axis(axes, units)
    draw.legend(axes)


def _draw_error(energies: reader.EnergySeries, taken: Floats | float, axes: Axes, units: UnitSystem) -> None:
    total, kinetic = energies.total + taken, float(energies.kinetic[0])
    found = energy_error(total, kinetic)
    by_total = found.relative_to == "initial energy"
    error = (total - total[0]) / found.scale(kinetic)
    power = math.floor(math.log10(np.max(np.abs(error)))) if np.any(error) else 0
    axes.axhline(0.0, color=draw.GRID, linewidth=1.2)
    axes.plot(*draw.thin(energies.time, error / 10.0**power), color=draw.COLOURS[0], linewidth=0.9)
    rms = float(np.sqrt(np.mean(error**2)))
    axes.set_title(f"Relative energy error (RMS {rms:.2g})")
    ratio = "(E − E$_0$) / |E$_0$|" if by_total else "(E − E$_0$) / K$_0$"
    axes.set_ylabel(f"{ratio}   [$10^{{{power}}}$]" if power else ratio)
    draw.time_axis(axes, units)


def _draw_temperature(times: Floats, temperature: Floats, axes: Axes, units: UnitSystem) -> None:
    axes.plot(*draw.thin(times, temperature), color=draw.COLOURS[1], linewidth=0.9)
    mean = float(np.mean(temperature))
    axes.axhline(mean, color=draw.INK, linewidth=0.9, linestyle=(0, (4, 3)))
    axes.set(
        title=f"Temperature (mean {measured(f'{mean:.4g}', draw.printed(units.temperature))})",
        ylabel=draw.with_unit("temperature", units.temperature),
    )
    draw.time_axis(axes, units)


def _draw_room(room: Room, axes: Axes, units: UnitSystem) -> None:
    axes.plot(*draw.thin(room.times, room.density), color=draw.COLOURS[3], linewidth=0.9)
    mean = float(np.mean(room.density))
    axes.axhline(mean, color=draw.INK, linewidth=0.9, linestyle=(0, (4, 3)))
    axes.set(
        title=f"Density (mean {mean:.4g}, mean volume {float(np.mean(room.volume)):.5g})", ylabel="particles per volume"
    )
    draw.time_axis(axes, units)


def _draw_edges(room: Room, periodic: tuple[bool, ...], axes: Axes, units: UnitSystem) -> None:
    alike = all(np.allclose(room.lengths[:, k], room.lengths[:, 0], rtol=1e-12) for k in range(3))
    for k in [0] if alike else np.flatnonzero(periodic):
        name = "x, y and z" if alike else "xyz"[k]
        axes.plot(*draw.thin(room.times, room.lengths[:, k]), label=name, color=draw.COLOURS[int(k)], linewidth=0.9)
    axes.set(title="Edges of the box", ylabel=draw.with_unit("length", units.length))
    draw.legend(axes)
    draw.time_axis(axes, units)


def _draw_rdf(r: Floats, g: Floats, frames: int, axes: Axes, units: UnitSystem) -> None:
    axes.axhline(1.0, color=draw.GRID, linewidth=1.2)
    axes.plot(r, g, color=draw.COLOURS[2], linewidth=1.3)
    axes.set(
        title=f"Radial distribution function ({frames} frame{'s' if frames > 1 else ''})",
        xlabel=draw.with_unit("r", units.length),
        ylabel="g(r)",
        xlim=(0.0, r[-1]),
        ylim=(0.0, None),
    )


def _draw_method(axes: Axes, row: Mapping[str, Any], colour: str) -> None:
    times, errors = np.asarray(row["times"], dtype=float), np.abs(np.asarray(row["relative_error"], dtype=float))
    drawn = np.isfinite(errors) & (errors > 0)  # zero, as at the start, cannot be drawn on a logarithmic axis
    label = f"{row['method']}, dt = {row['dt']:g}"
    if row.get("verdict"):
        label += f": {row['verdict']}"
    axes.plot(*draw.thin(times[drawn], errors[drawn]), color=colour, linewidth=0.6, alpha=0.25)
    parts = [part for part in np.array_split(np.flatnonzero(drawn), WINDOWS) if len(part)]
    strong = [(times[part].mean(), math.sqrt(np.mean(errors[part] ** 2))) for part in parts]
    axes.plot(*np.array(strong).reshape(-1, 2).T, color=colour, linewidth=1.8, zorder=3, label=label)


def _rdf(run: reader.Run) -> tuple[Floats, Floats, int] | None:
    """r, g(r) and the number of frames; None if particles move along an open axis of the box."""
    n, plane = len(run.ids), run.system_record.get("dimensions") == 2
    size = run.box.area if plane else run.box.volume
    if not math.isfinite(size):
        return None
    count = max(1, min(RDF_FRAMES, len(run), RDF_PARTICLES // n))
    # The frames nearest the end of each of `count` equal parts, without the start, which often is a lattice.
    chosen = np.unique(np.linspace(0, len(run) - 1, count + 1).round().astype(int)[1:])
    frames = [run[int(index)] for index in chosen]
    positions, boxes = np.array([frame.positions for frame in frames]), [frame.box for frame in frames]
    around = RDF_NEIGHBOURS * size / n
    reach = (around / math.pi) ** (1 / 2) if plane else (around * 3 / (4 * math.pi)) ** (1 / 3)
    half = min(float(box.heights.min()) for box in boxes) / 2
    found = radial_distribution(positions, boxes, r_max=min(reach, half))
    return found.r, found.g, len(chosen)


MOST_LINES = 9  # a tensor's


def column_figure(run: reader.Run, name: str) -> Figure:
    """A column of a run's samples, kickdrift's own or a user's, against time.

    Each number of a vector or tensor is a line; of more than nine numbers the first nine are drawn."""
    observables = run.observables
    if name == "density" and name not in observables and "volume" in observables:
        observables = {**observables, name: len(run.ids) / observables["volume"]}
    if name not in observables:
        known = choices(observables, name) or "none, for it has no sample"
        raise InputError(f"{run.path}: column {shown(name)}: its columns are {known}{suggestion(name, observables)}")
    times, values = run.sample_times, observables[name]
    unit = run.unit_of(name) if name in run.observables else f"{run.units.length}^-3" if run.units.length else ""
    units, title = run.units, draw.title_of(run)
    figure = draw.new_figure(7.2, 4.2)
    axes = draw.new_axes(figure, (1, 1, 1))
    labels = parts(name, values.shape[1:])
    lines = values.reshape(len(values), len(labels)).T
    for k, (label, line) in enumerate(zip(labels[:MOST_LINES], lines, strict=False)):
        finite = np.isfinite(line)
        axes.plot(
            *draw.thin(times[finite], line[finite]),
            label=label,
            color=draw.COLOURS[k % len(draw.COLOURS)],
            linewidth=1.2,
        )
    axes.set(title=name.replace("_", " "), ylabel=draw.with_unit(name.replace("_", " "), unit))
    draw.time_axis(axes, units)
    if len(labels) > 1:
        draw.legend(axes)
    figure.suptitle(title, fontsize=11, color=draw.INK)
    return figure
