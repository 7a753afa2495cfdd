"""What all figures share: colours, labels with units, axes and files. No pyplot, so that nothing outside changes."""

from __future__ import annotations

import csv
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kickdrift.disk import outputs
from kickdrift.disk.kinds import FIGURE, NUMBERS
from kickdrift.errors import InputError
from kickdrift.jit.cache import folders
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem, symbol_of
from kickdrift.text import measured
from kickdrift.trajectory.read import reader

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
else:  # the first figure loads matplotlib
    Axes = Figure = object

MAX_POINTS = 4000  # most points of a line, about twice the dots across a panel; more only make the file large

# Okabe & Ito's colours for colour-blind readers, without yellow, which is hardly visible on white.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#555555")
INK, GRID = "#333333", "#E4E4E4"


def title_of(run: reader.Run, what: str = "particles") -> str:
    parts = [str(run.system_record.get("name") or run.path.stem), f"{len(run.ids):,} {what}"]
    if run.method.get("integrator"):
        parts.append(str(run.method["integrator"]))
    if isinstance(run.method.get("dt"), (int, float)):
        parts.append(measured(f"dt = {run.method['dt']:g}", printed(run.units.time)))
    return "  ·  ".join(parts)


def printed(unit: str) -> str:
    """Name of a unit in a figure; "" for a unit without a name, such as those of nbody."""
    return symbol_of(unit).replace("angstrom", "Å").replace("k_B", "k$_B$").replace("^2", "²").replace("^3", "³")


def with_unit(name: str, unit: str) -> str:
    """Label with its unit, if the unit has a name."""
    return f"{name} ({text})" if (text := printed(unit)) else name


def time_axis(axes: Axes, units: UnitSystem) -> None:
    axes.set_xlabel(with_unit("time", units.time))


def thin(x: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Line with at most MAX_POINTS points that keeps the smallest and largest y of every stretch."""
    if len(x) <= MAX_POINTS:
        return x, y
    starts = np.linspace(0, len(x), MAX_POINTS // 2 + 1).astype(int)
    kept = [
        start + index
        for start, stop in pairwise(starts)
        for index in sorted({int(np.argmin(y[start:stop])), int(np.argmax(y[start:stop]))})
    ]
    return x[kept], y[kept]


def checked_target(output: str | os.PathLike[str], overwrite: bool, *inputs: str | os.PathLike[str]) -> Path:
    """Checked path of a figure, which must not be one of the ``inputs``."""
    return outputs.checked_target(output, FIGURE, overwrite, inputs)


@contextmanager
def own_matplotlib_folder() -> Iterator[None]:
    """Let matplotlib, if first loaded here, keep its font list in kickdrift's cache, not in the user's home."""
    own = folders.folder()
    if "matplotlib" in sys.modules or "MPLCONFIGDIR" in os.environ or own is None:
        yield
        return
    place = own / "matplotlib"
    folders.make_private(place)
    os.environ["MPLCONFIGDIR"] = str(place)
    try:
        yield
    finally:
        os.environ.pop("MPLCONFIGDIR", None)  # matplotlib has read it by now, and child processes should not inherit it


@cache
def _figure_class() -> type[Figure]:
    """A Figure that a notebook shows without pyplot; matplotlib is loaded now."""
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def _repr_png_(self) -> bytes:
            content = BytesIO()
            self.savefig(content, format="png")
            return content.getvalue()

    return NotebookFigure


def legend(axes: Axes) -> None:
    """Name the lines where they cover least."""
    axes.legend(loc="best", fontsize=8, frameon=True, framealpha=0.9, edgecolor=GRID)


def new_figure(width: float, height: float) -> Figure:
    with own_matplotlib_folder():
        import matplotlib.font_manager  # noqa: F401 (reads or builds its list on import)
        from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _figure_class()(figsize=(width, height), dpi=120, facecolor="white", layout="constrained")
    figure.get_layout_engine().set(w_pad=0.12, h_pad=0.12)  # type: ignore[union-attr, call-arg]
    FigureCanvasAgg(figure)
    return figure


def new_axes(figure: Figure, place: tuple[int, int, int | tuple[int, int]], sharey: Axes | None = None) -> Axes:
    axes = figure.add_subplot(*place, sharey=sharey)
    axes.set_facecolor("white")
    axes.grid(True, color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.tick_params(colors=INK, labelsize=9)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return axes


def few_labels(axes: Axes) -> None:
    """Name at most 1, 2 and 5 of each decade of logarithmic axes, so that labels do not touch."""
    from matplotlib.ticker import LogLocator

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))


def save_figure(
    figure: Figure, target: Path, numbers: str | os.PathLike[str] | None = None, overwrite: bool = False
) -> Path:
    """Write a figure, whole or not at all, and on request its ``numbers``. Return the figure's path."""
    if numbers is not None:
        save_numbers(figure, numbers, overwrite)
    with outputs.written_whole(target, FIGURE, overwrite=True) as part:
        figure.savefig(part)
    return target


def save_numbers(figure: Figure, target: str | os.PathLike[str], overwrite: bool) -> None:
    """Write the points of a figure's lines as a table, whole or not at all: panel, line, x and y. A long line has the
    points that are drawn, see ``thin``."""
    checked = outputs.checked_target(target, NUMBERS, overwrite, ())
    drawn = [
        [line for line in axes.get_lines() if line.get_transform() == axes.transData and np.size(line.get_xdata())]
        for axes in figure.axes
    ]
    if not any(drawn):  # rules are no lines, and entries of a legend have no points
        raise InputError(f"{target}: this figure has areas and no lines, so it has no points to write")
    with outputs.written_whole(checked, NUMBERS, overwrite=overwrite) as part, part.open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("panel", "line", "x", "y"))
        for axes, lines in zip(figure.axes, drawn, strict=True):
            for number, line in enumerate(lines, 1):
                name = str(line.get_label())
                places = zip(np.asarray(line.get_xdata(), float), np.asarray(line.get_ydata(), float), strict=True)
                for x, y in places:
                    own = str(number) if name.startswith("_") else name
                    rows.writerow((axes.get_title() or axes.get_ylabel(), own, repr(float(x)), repr(float(y))))
