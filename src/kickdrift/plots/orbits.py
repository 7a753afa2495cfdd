"""Figure of an N-body run: orbits in the plane and in space, to scale; elements against time; energy error."""

from typing import Any

import numpy as np

from kickdrift.analysis.orbits.orbits import gravity_of, paths
from kickdrift.errors import InputError
from kickdrift.model.orbits import Orbits, Paths, orbits_of
from kickdrift.model.starts.elements import TAU, Elements, states
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.plots import drawing as draw
from kickdrift.plots.drawing import Axes, Figure
from kickdrift.plots.runs import _draw_error, energy_taken
from kickdrift.trajectory.read import reader

FRAMES = 4000  # most frames of a run
FEW = 12  # most bodies with a line, a colour and a name each; more are drawn as points
COARSE = 0.35  # largest angle between frames, in radians, for a path drawn as a line
TURNS = 8  # ellipses drawn for a body, spread over the run
INNER = 8.0  # ratio of distances across the widest gap from which the inner bodies get their own panel
CROWD = 0.97  # share of many bodies inside the panel
CLOSE = 0.8  # share of a few bodies' places, without a dominant one, inside the close-up
# Seven colours of Okabe & Ito and five muted ones of Paul Tol, distinguishable for colour-blind readers.
BODY_COLOURS = (*draw.COLOURS, "#882255", "#44AA99", "#999933", "#332288", "#AA4499")


def orbits_in(run: reader.Run) -> bool:
    """Tell whether an open file has bodies under gravity and frames to draw."""
    return gravity_of(run) is not None and len(run) > 0 and len(run.ids) > 1


def orbits_figure(run: reader.Run) -> Figure:
    """Orbits of the bodies of an open file.

    The plane is perpendicular to the total angular momentum, seen from the side where the bodies turn counterclockwise.
    It is x-y if they do not turn. Positions are relative to the barycentre. A body whose frames are too far apart for a
    path is drawn by its ellipses, faint, with the last one strong. A body that was absorbed or removed is drawn up to
    its end.
    """
    found = paths(run, FRAMES)
    if len(run.ids) < 2:
        raise InputError(f"{run.path}: one body; orbits need two or more")
    energies, taken = run.energies if len(run.sample_times) else None, energy_taken(run)
    units, title = run.units, draw.title_of(run, "bodies")
    axes = found.invariable_axes()
    flat = np.allclose(axes, np.eye(3), rtol=0, atol=1e-12)
    found = found._replace(positions=found.positions @ axes.T, velocities=found.velocities @ axes.T)
    orbits = orbits_of(found) if found.central is not None else None
    lines = _lines(found, orbits)
    views = _views(found, lines)
    few = len(found.masses) <= FEW
    rows = 2 if orbits is not None or energies is not None else 1
    figure = draw.new_figure(
        15.0 if len(views) == 2 or (orbits is not None and few) else 12.0, 9.6 if rows == 2 else 5.8
    )
    parts: Any = figure.subfigures(2, 1, height_ratios=(1.55, 1.0)) if rows == 2 else (figure, None)
    upper, lower = parts
    views[0] = (f"In the {'x-y' if flat else 'invariable'} plane", *views[0][1:])
    columns = len(views) + 1
    for column, view in enumerate(views):
        _draw_plane(draw.new_axes(upper, (1, columns, column + 1)), found, lines, units, view)
    _draw_space(upper, (1, columns, columns), found, lines, units, views[0])
    if few:
        handles, labels = upper.axes[0].get_legend_handles_labels()
        upper.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 10), frameon=False, fontsize=9)
    if lower is not None:
        places = 3 if orbits is not None and len(orbits.names) <= FEW else 2 if orbits is not None else 0
        many = places + (energies is not None)
        if orbits is not None:
            _draw_elements(lower, many, orbits, units)
        if energies is not None:
            _draw_error(energies, taken, draw.new_axes(lower, (1, many, many)), units)
    figure.suptitle(title, fontsize=12, color=draw.INK)
    return figure


def _lines(found: Paths, orbits: Orbits | None) -> list[list[Floats]]:
    """The (k, 3) lines to draw for each of a few bodies, with the last one at the end; many bodies have none.

    A line is the body's path. If its frames are too far apart, the lines are its ellipses at TURNS times, about the
    centre of mass of the bodies inside its orbit.
    """
    n = len(found.masses)
    if n > FEW:
        return []
    if orbits is None or found.central is None:
        return [[found.positions[:, i]] for i in range(n)]
    order = [found.central, *(i for i in range(n) if i != found.central)]
    within = np.cumsum(found.masses[order])
    lines: list[list[Floats]] = [[] for _ in range(n)]
    for k, i in enumerate(order[1:]):
        path = found.positions[:, i]
        if not _coarse(orbits, k):
            lines[i] = [path]
            continue
        part = 1.0 - found.masses[i] / within[k + 1]
        there = np.flatnonzero(np.isfinite(path[:, 0]))
        for frame in np.unique(there[np.linspace(0, len(there) - 1, TURNS).round().astype(int)]):
            at = Elements(*(element[frame, k] for element in orbits.elements))
            turn = _ellipse(at, orbits.mu[frame, k])
            lines[i].append(path[frame] + part * (turn - turn[0]))
            if n == 2:
                lines[found.central].append(found.positions[frame, found.central] - (1.0 - part) * (turn - turn[0]))
    if not lines[found.central]:
        lines[found.central] = (
            [] if any(_coarse(orbits, k) for k in range(n - 1)) else [found.positions[:, found.central]]
        )
    return lines


def _coarse(orbits: Orbits, k: int) -> bool:
    """Tell whether a body is on ellipses and turns by more than COARSE between frames at its pericentre."""
    found = orbits.elements
    there = np.isfinite(found.e[:, k])
    e = found.e[there, k]
    if len(orbits.times) < 2 or np.any(e >= 1):
        return len(orbits.times) < 2 and not np.any(e >= 1)
    fastest = np.sqrt(orbits.mu[there, k] * (1.0 + e) / found.q[there, k] ** 3)
    return bool(np.max(fastest, initial=0.0) * np.median(np.diff(orbits.times)) > COARSE)


def _ellipse(at: Elements, mu: float) -> Floats:
    """Points (k, 3) of an ellipse, once around from the body, in even steps of the eccentric anomaly."""
    around = float(at.E) + np.linspace(0, TAU, 361)
    return states(mu, q=at.q, e=at.e, inc=at.inc, Omega=at.Omega, omega=at.omega, E=around)[0]


def _views(found: Paths, lines: list[list[Floats]]) -> list[tuple[str, Floats, float]]:
    """Panels of the plane: title, centre (3,), half the width. The second is a close-up if distances differ much."""
    far = np.linalg.norm(found.positions, axis=2)
    origin = np.zeros(3)
    if not lines:
        return [("", origin, 1.1 * float(np.nanquantile(far[-1], CROWD)))]
    drawn = np.concatenate([*(line for body in lines for line in body), found.positions[-1]])
    low, high = np.nanmin(drawn, axis=0), np.nanmax(drawn, axis=0)
    reach = 0.54 * float((high - low).max())
    whole = ("", (low + high) / 2, reach)
    if found.central is None:
        near = 1.1 * float(np.nanquantile(far, CLOSE))
        return [whole, ("Close up", origin, near)] if reach > 0.5 * INNER * near else [whole]
    sizes = np.sort(np.delete(np.nanmax(far, axis=0), found.central))
    if len(sizes) < 3 or sizes[-1] < INNER * sizes[0]:
        return [whole]
    near = 1.12 * float(sizes[int(np.argmax(sizes[1:] / sizes[:-1]))])
    return [whole, ("Inner bodies", origin, near)] if sizes[-1] > 0.5 * INNER * near else [whole]


def _draw_plane(
    axes: Axes, found: Paths, lines: list[list[Floats]], units: UnitSystem, view: tuple[str, Floats, float]
) -> None:
    title, centre, reach = view
    x = found.positions[-1]
    for i, body in enumerate(lines):
        colour = _colour(found, i)
        for line in body:
            axes.plot(line[:, 0], line[:, 1], color=colour, linewidth=0.9, alpha=0.85 if line is body[-1] else 0.25)
        marker, size = ("*", 9.0) if i == found.central else ("o", 5.0)
        axes.plot(x[i, 0], x[i, 1], marker, color=colour, markersize=size, label=found.names[i], zorder=4)
    if not lines:
        axes.plot(x[:, 0], x[:, 1], ".", color=draw.COLOURS[0], markersize=2.2, alpha=0.7)
        if found.central is not None:
            axes.plot(*x[found.central, :2], "*", color=draw.COLOURS[5], markersize=10)
    axes.set(
        xlim=(centre[0] - reach, centre[0] + reach),
        ylim=(centre[1] - reach, centre[1] + reach),
        aspect="equal",
        title=title if lines else f"{title}, at the end",
        xlabel=draw.with_unit("x", units.length),
        ylabel=draw.with_unit("y", units.length),
    )


def _draw_space(figure: Any, place: tuple[int, int, int], found: Paths, lines: list[list[Floats]],
                units: UnitSystem, view: tuple[str, Floats, float]) -> None:  # fmt: skip
    axes: Any = figure.add_subplot(*place, projection="3d")
    _, centre, reach = view
    x = found.positions[-1]
    for i, body in enumerate(lines):
        for line in body:
            axes.plot(*line.T, color=_colour(found, i), linewidth=0.8, alpha=0.8 if line is body[-1] else 0.2)
        marker, size = ("*", 8.0) if i == found.central else ("o", 4.0)
        axes.plot(*x[i, :, None], marker, color=_colour(found, i), markersize=size)
    if not lines:
        shown = x[np.all(np.abs(x - centre) <= reach, axis=1)]
        axes.plot(*shown.T, ".", color=draw.COLOURS[0], markersize=1.8, alpha=0.6)
    seen = np.concatenate([line for body in lines for line in body]) if lines else shown
    height = min(reach, max(1.1 * float(np.nanmax(np.abs(seen[:, 2] - centre[2]))), 0.3 * reach))
    axes.set(
        xlim=(centre[0] - reach, centre[0] + reach),
        ylim=(centre[1] - reach, centre[1] + reach),
        zlim=(centre[2] - height, centre[2] + height),
    )
    axes.set_box_aspect((1, 1, height / reach), zoom=0.92)
    axes.view_init(elev=28, azim=-60)
    axes.set_title("In space")
    axes.tick_params(colors=draw.INK, labelsize=7)
    for axis, name in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_pane_color("white")
        axis.set_major_locator(_few_ticks(5 if name != "z" or height > 0.6 * reach else 3))
        axis._axinfo["grid"]["color"] = draw.GRID
        axis.set_label_text(draw.with_unit(name, units.length), fontsize=8)


def _few_ticks(count: int) -> Any:
    from matplotlib.ticker import MaxNLocator

    return MaxNLocator(count)


def _draw_elements(figure: Figure | Any, columns: int, orbits: Orbits, units: UnitSystem) -> None:
    """Draw elements against time for a few bodies, or at the end against the semi-major axis for many."""
    found = orbits.elements
    inc = np.degrees(found.inc)
    if len(orbits.names) >= FEW:
        for column, (values, label) in enumerate(((found.e, "eccentricity"), (inc, "inclination (degrees)"))):
            axes = draw.new_axes(figure, (1, columns, column + 1))
            bound = found.a[-1] > 0
            for frame, colour, when in ((0, draw.COLOURS[6], "start"), (-1, draw.COLOURS[0], "end")):
                axes.plot(found.a[frame][bound], values[frame][bound], ".", color=colour, markersize=2.5, alpha=0.6,
                          label=when)  # fmt: skip
            axes.set(xlabel=draw.with_unit("semi-major axis", units.length), ylabel=label)
            draw.legend(axes)
        return
    panels = (
        (found.a, draw.with_unit("semi-major axis", units.length)),
        (found.e, "eccentricity"),
        (inc, "inclination (degrees)"),
    )
    for column, (values, label) in enumerate(panels):
        axes = draw.new_axes(figure, (1, columns, column + 1))
        for k in range(len(orbits.names)):
            fine = np.isfinite(values[:, k])
            axes.plot(*draw.thin(orbits.times[fine], values[fine, k]), color=BODY_COLOURS[k % len(BODY_COLOURS)],
                      linewidth=0.9)  # fmt: skip
        axes.set_title(label[:1].upper() + label[1:])
        draw.time_axis(axes, units)
        known = values[np.isfinite(values)]
        if column == 0 and np.all(known > 0) and np.ptp(known) > (INNER - 1.0) * known.min():
            axes.set_yscale("log")


def _colour(found: Paths, i: int) -> str:
    """Colour of a body: the central one has its own, the others share the colours of their elements' lines."""
    if i == found.central:
        return draw.INK
    k = i if found.central is None or i < found.central else i - 1
    return BODY_COLOURS[k % len(BODY_COLOURS)]
