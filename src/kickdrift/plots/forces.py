"""Figure of the tests of a force."""

from __future__ import annotations

from typing import TYPE_CHECKING

from kickdrift.errors import InputError
from kickdrift.plots.runs import COLOURS, INK, new_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kickdrift.analysis.certify.certificate import ForceChecks

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
    figure = new_figure(11.2, 7.0 if len(drawn) > 2 else 4.0)
    rows = (len(drawn) + 1) // 2
    for place, name in enumerate(drawn, 1):
        x, y = checks.curves[name]
        across, up, logarithmic = PANELS[name]
        axes = new_axes(figure, (rows, min(2, len(drawn)), place))
        marked = "o" if logarithmic else None
        axes.plot(
            x, y - y.mean() if name == "energy of a run" else y, color=COLOURS[place - 1], linewidth=1.4, marker=marked
        )
        if logarithmic:
            axes.set_xscale("log")
            axes.set_yscale("log")
        axes.set_xlabel(across)
        axes.set_ylabel(up)
    failed = ", ".join(row.test for row in checks.failed)
    figure.suptitle(
        f"{checks.system}  ·  {f'failed: {failed}' if failed else 'all tests passed'}", fontsize=12, color=INK
    )
    return figure
