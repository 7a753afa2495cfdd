"""Figure of a modified Hamiltonian: flat where H oscillates."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from kickdrift.analysis.shadow import ShadowRun
from kickdrift.plots.runs import COLOURS, checked_target, new_axes, new_figure, save_figure


def plot_shadow(
    run: ShadowRun, runs: Sequence[ShadowRun], output: str | os.PathLike[str], *, overwrite: bool = False
) -> Path:
    """Draw H and its modifications against time for one run, and their oscillations against the step for several runs.

    Return the figure's path."""
    target = checked_target(output, overwrite)
    names = {0: "H", 2: "H + dt² H$_2$", 4: "H + dt² H$_2$ + dt⁴ H$_4$"}
    figure = new_figure(11.2, 4.8)
    left, right = new_axes(figure, (1, 2, 1)), new_axes(figure, (1, 2, 2))
    for (order, name), colour in zip(names.items(), (COLOURS[1], COLOURS[5], COLOURS[0]), strict=True):
        left.plot(run.times, run.values[order], color=colour, linewidth=1.4, label=name)
        steps = [each.dt for each in runs]
        right.plot(
            steps, [each.oscillation(order) for each in runs], color=colour, marker="o", markersize=4, label=name
        )
    left.set_xlabel("time")
    left.set_ylabel("difference from the start")
    left.set_title(f"Velocity Verlet, dt = {run.dt:g}")
    left.legend(loc="best", fontsize=8, frameon=True, framealpha=0.9)
    right.set_xscale("log")
    right.set_yscale("log")
    right.set_xlabel("dt")
    right.xaxis.set_minor_formatter("")
    right.set_ylabel("oscillation")
    right.set_title("Slopes 2, 4 and 6")
    return save_figure(figure, target)
