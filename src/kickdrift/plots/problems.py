"""Figures of a Problem: y against time, the phase portrait and the energy error, of one run or of several methods."""

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import Integrator, method_of, takers_text
from kickdrift.integrators.options import DT
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.plots import drawing as draw
from kickdrift.plots.drawing import Axes, Figure
from kickdrift.run.plan.lengths import steps_to
from kickdrift.run.simulation import Simulation
from kickdrift.run.times import length_of
from kickdrift.text import shown, suggestion
from kickdrift.trajectory import opened

LOOKS = 2000  # of each run that is drawn
MOST_LINES = 6  # of y against time
WIDTH, HEIGHT = 4.2, 3.1  # of a panel
LIMIT = 1e150  # larger numbers of a run that blows up are not drawn


class Solution(NamedTuple):
    """One run of a Problem, to be drawn."""

    label: str
    times: Floats
    y: Floats
    energies: Floats | None
    separable: bool


Panel = Callable[["Axes", Solution], None]


def plot_problem(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    column: str | None = None,
    *,
    numbers: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw a Problem's run from its file or table; with ``column`` that column alone. Return the figure's path."""
    target = draw.checked_target(output, overwrite, path)
    with opened.open(path) as run:
        return draw.save_figure(problem_figure(run, column), target, numbers, overwrite)


def problem_figure(run: Any, column: str | None = None) -> Figure:
    """Draw a Problem's open run: y against time, the phase portrait and the energy error; or one column."""
    if not len(run):
        raise InputError(f"{run.path}: no sample to draw")
    series = run.series()
    found = Solution(_label(run.method), run.times, run.y, run.energies, run.separable)
    if column is not None and column not in series:
        raise InputError(
            f"{run.path}: column {shown(column)}: its columns are {', '.join(series)}{suggestion(column, series)}"
        )
    panels = _panels([found]) if column is None else [_column(column, series[column])]
    return _figure([found], panels, str(run.name or Path(run.path).stem), beside=True)


def plot_methods(
    problem: Problem,
    integrators: Sequence[str | Integrator],
    output: str | os.PathLike[str],
    *,
    time: float | None = None,
    options: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    progress: Callable[[int, int], Any] | None = None,
) -> Path:
    """Draw a Problem's runs with several methods as ``methods_figure`` does. Return the figure's path."""
    target = draw.checked_target(output, overwrite)
    return draw.save_figure(methods_figure(problem, integrators, time=time, options=options, progress=progress), target)


def methods_figure(
    problem: Problem,
    integrators: Sequence[str | Integrator],
    *,
    time: float | None = None,
    options: Mapping[str, Any] | None = None,
    progress: Callable[[int, int], Any] | None = None,
) -> Figure:
    """Run a Problem with each method, and draw the runs side by side.

    Parameters
    ----------
    integrators : names or values; none means the Problem's own
    time : length of the runs; default the Problem's own
    options : dt and others; each method takes those that it has

    Raises
    ------
    InputError
        For arguments that make no sense, and for an option that none of the methods takes. A run that blows up is drawn
        as far as it came.
    """
    sims = _simulations(problem, list(integrators), dict(options or {}))
    lengths = [length_of(sim, problem.name, None, time) for sim in sims]
    found = []
    for done, (sim, length) in enumerate(zip(sims, lengths, strict=True)):
        found.append(_solved(sim, length))
        if progress:
            progress(done + 1, len(sims))
    return _figure(found, _panels(found), problem.name, beside=False)


def _simulations(problem: Problem, integrators: list[str | Integrator], options: dict[str, Any]) -> list[Simulation]:
    if not integrators:
        return [Simulation(problem, **options)]
    taken = {each: [key for key in options if key in (DT.name, *method_of(each).tunable)] for each in integrators}
    for key in options:
        if not any(key in keys for keys in taken.values()):
            raise InputError(f"{key}: {' or '.join(map(str, taken))} does not take it; {takers_text(key)} it")
    return [Simulation(problem, each, **{key: options[key] for key in keys}) for each, keys in taken.items()]


def _solved(sim: Simulation, length: dict[str, Any]) -> Solution:
    """Run, and keep about LOOKS samples; a run that blows up is kept as far as it came."""
    times: list[float] = []
    states: list[Floats] = []

    def keep(sim: Simulation) -> None:
        times.append(sim.time)
        states.append(sim.state.y)

    label = _label({"integrator": sim.integrator, **dict(sim.options)})
    if sim.method.chooses_steps and "until" in length:
        cadence: dict[str, Any] = {"interval": (length["until"] - sim.time) / LOOKS}
    else:
        cadence = {"every": max(1, steps_to(sim, length.get("steps"), length.get("until")) // LOOKS)}
    try:
        sim.run(**length, **cadence, observe=keep)
    except RunError:
        label += f"\nblows up at t = {times[-1]:.4g}" if times else "\nblows up"
    energies = None
    if sim.system.energy is not None:
        energies = np.array([sample.energies.total for sample in sim.record.samples[: len(times)]])
    return Solution(label, np.array(times), np.array(states), energies, sim.system.separable)


def _label(method: Mapping[str, Any]) -> str:
    """Name of the method with its step, or with the tolerance that sets its steps."""
    name = str(method.get("integrator") or "")
    chooses = name in INTEGRATORS and INTEGRATORS[name].chooses_steps
    key = "rtol" if chooses else "dt"
    value = {**method, **method.get("options", {})}.get(key)
    return f"{name}, {key} = {value:g}" if isinstance(value, (int, float)) else name


def _figure(found: Sequence[Solution], panels: Sequence[Panel], title: str, *, beside: bool) -> Figure:
    """Panels of one run ``beside`` one another; or a column for each run, with a row for each kind of panel."""
    rows, columns = (1, len(panels)) if beside else (len(panels), len(found))
    figure = draw.new_figure(max(5.0, WIDTH * columns), HEIGHT * rows + 0.6)
    for row, panel in enumerate(panels):
        first: Axes | None = None
        for place, solution in enumerate(found):
            index = row + 1 if beside else row * columns + place + 1
            shared = first if panel is _draw_error else None
            axes = draw.new_axes(figure, (rows, columns, index), sharey=shared)
            first = first or axes
            panel(axes, solution)
            if row == 0 and not beside:
                axes.set_title(solution.label, fontsize=10)
    labels = [title, found[0].label] if beside and found[0].label else [title]
    figure.suptitle("  ·  ".join(labels), fontsize=12, color=draw.INK)
    return figure


# --- panels ---


def _panels(found: Sequence[Solution]) -> list[Panel]:
    several = found[0].y.shape[1] > 1
    return [
        _draw_series,
        *([_draw_portrait] if several else []),
        *([_draw_error] if found[0].energies is not None else []),
    ]


def _draw_series(axes: Axes, solution: Solution) -> None:
    """y against time; of a separable Problem, the positions."""
    n = solution.y.shape[1]
    shown = min(n // 2 if solution.separable else n, MOST_LINES)
    for k in range(shown):
        times, values = _finite(solution.times, solution.y[:, k])
        axes.plot(*draw.thin(times, values), label=f"y{k}", color=draw.COLOURS[k % len(draw.COLOURS)], linewidth=1.1)
    axes.set(xlabel="time", ylabel="y0" if shown == 1 else "y")
    if shown > 1:
        draw.legend(axes)


def _draw_portrait(axes: Axes, solution: Solution) -> None:
    """The first position and its velocity; of a Problem that is not separable, the first two numbers of y."""
    other = solution.y.shape[1] // 2 if solution.separable else 1
    axes.plot(*_finite(solution.y[:, 0], solution.y[:, other]), color=draw.COLOURS[0], linewidth=0.7)
    axes.plot(*solution.y[:1, [0, other]].T, marker="o", color=draw.INK, markersize=4)
    axes.set(xlabel="y0", ylabel=f"y{other}")


def _draw_error(axes: Axes, solution: Solution) -> None:
    """The energy error, relative where the energy is not zero at the start."""
    assert solution.energies is not None
    first = float(solution.energies[0])
    times, error = _finite(solution.times, np.abs(solution.energies - first) / (abs(first) or 1.0))
    drawn = error > 0  # zero, as at the start, cannot be drawn on a logarithmic axis
    axes.plot(*draw.thin(times[drawn], error[drawn]), color=draw.COLOURS[1], linewidth=0.9)
    axes.set(yscale="log", xlabel="time", ylabel="|E − E$_0$| / |E$_0$|" if first else "|E − E$_0$|")
    if len(times) and not drawn.any():
        axes.set_ylim(1e-17, 1e-15)
        axes.text(0.5, 0.5, "no error", transform=axes.transAxes, ha="center", color=draw.INK)


def _column(name: str, values: Floats) -> Panel:
    """One column of the table against time."""

    def panel(axes: Axes, solution: Solution) -> None:
        axes.plot(*draw.thin(*_finite(solution.times, values)), color=draw.COLOURS[0], linewidth=1.1)
        axes.set(xlabel="time", ylabel=name)

    return panel


def _finite(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """The points that can be drawn."""
    with np.errstate(invalid="ignore"):
        kept = (np.abs(x) < LIMIT) & (np.abs(y) < LIMIT)
    return x[kept], y[kept]
