"""The figure that suits a run, and the stability of methods: what ``kickdrift plot`` and Python draw."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path

from kickdrift.errors import InputError
from kickdrift.integrators.asked import Integrator
from kickdrift.plots import observables
from kickdrift.plots.clusters import run_cluster_figure
from kickdrift.plots.drawing import Figure
from kickdrift.plots.orbits import orbits_figure, orbits_in
from kickdrift.plots.runs import column_figure, run_figure, write_figure
from kickdrift.plots.stability import stability_figure
from kickdrift.text import shown, suggestion
from kickdrift.trajectory.read import reader

KINDS: dict[str, Callable[[reader.Run], Figure]] = {
    "orbits": orbits_figure,
    "energies": run_figure,
    "cluster": run_cluster_figure,
    **{kind: partial(observables.observable_figure, kind=kind) for kind in observables.KINDS},
}


def figure_of(run: reader.Run, kind: str | None = None, column: str | None = None) -> Figure:
    """The figure of a run: of a kind, of a column, or by default orbits under gravity and else energies."""
    if kind is not None and column is not None:
        raise InputError("plot: give kind or column, not both")
    if column is not None:
        return column_figure(run, column)
    if kind is None:
        kind = "orbits" if orbits_in(run) else "energies"
    if kind not in KINDS:
        raise InputError(f"kind: expected one of {', '.join(KINDS)}, got {shown(kind)}{suggestion(kind, KINDS)}")
    return KINDS[kind](run)


def plot_file(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    kind: str | None = None,
    column: str | None = None,
    *,
    numbers: str | os.PathLike[str] | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw a run's file as ``figure_of`` does, and on request write the figure's numbers. Return the figure's path."""
    return write_figure(path, output, overwrite, partial(figure_of, kind=kind, column=column), numbers)


def stability(*integrators: str | Integrator) -> Figure:
    """Draw how long a step may be: the stability regions of methods; a matplotlib Figure.

    For one-step methods: the regions |R(z)| <= 1, z = lambda dt, of y' = lambda y, and where they end on the real and
    the imaginary axis. For splittings: half the trace of an oscillator's propagation matrix against omega dt, and the
    longest stable step. ``kd.integrator(name).stability`` has these limits as numbers.

    Parameters
    ----------
    integrators : names, or values of ``kickdrift.integrator``

    Raises
    ------
    InputError
        For an unknown name, and for a method without a stability function, such as one with several steps.
    """
    return stability_figure(integrators)
