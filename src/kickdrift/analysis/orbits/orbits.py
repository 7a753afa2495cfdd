"""Orbits of a run's bodies: elements over time, and paths for figures."""

import os

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError
from kickdrift.model.orbits import Orbits, Paths, central_row, orbits_of
from kickdrift.model.starts.elements import Elements
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.reader import masses_held


def orbits(
    run: reader.Run | str | os.PathLike[str],
    frame: str = "jacobi",
    plane: str = "file",
    most_frames: int | None = None,
) -> Orbits:
    """Osculating elements of a run's bodies at its frames.

    Parameters
    ----------
    run : a run's file, open or by its path
    frame : origin of the orbits: "heliocentric", "jacobi" (in the order of the file) or "barycentric"
    plane : reference plane of inclinations and nodes: "file", the x-y plane, or "invariable", perpendicular to the
        total angular momentum at the start
    most_frames : most frames to read, spread evenly; default all

    Raises
    ------
    InputError
        For a run without gravity, or without a body of at least half of all mass.
    """
    found = paths(run, most_frames)
    return orbits_of(found, frame, plane)


def orbital_elements(
    run: reader.Run | str | os.PathLike[str],
    frame: str = "jacobi",
    plane: str = "file",
    most_frames: int | None = None,
) -> NDArray[np.void]:
    """Return ``orbits`` as a table: a structured array (frames x bodies,), body by body within a frame.

    Columns are ``time``, ``body`` (a name), the semi-major axis ``a`` and the elements by their names. A body that is
    gone has nan. ``pandas.DataFrame(orbital_elements(run))`` makes a data frame. Parameters and errors are as in
    ``orbits``.
    """
    if not isinstance(run, reader.Run | str | os.PathLike):
        raise InputError("orbital_elements: expected a whole run or its path; set most_frames to use fewer frames")
    found = orbits(run, frame, plane, most_frames)
    width = max(len(name) for name in found.names)
    columns = [("time", "f8"), ("body", f"U{width}"), *((name, "f8") for name in ("a", *Elements._fields))]
    table = np.empty((len(found.times), len(found.names)), dtype=columns)
    table["time"], table["body"] = found.times[:, None], np.array(found.names)
    for name in ("a", *Elements._fields):
        table[name] = getattr(found.elements, name)
    return table.ravel()


def paths(run: reader.Run | str | os.PathLike[str], most_frames: int | None = None) -> Paths:
    """Positions and velocities of a run under gravity, relative to the barycentre of each frame."""
    if not isinstance(run, reader.Run):
        with reader.open(run) as opened:
            return paths(opened, most_frames)
    gravity = gravity_of(run)
    if gravity is None:
        raise InputError(f"{run.path}: no gravity, so no orbits")
    if not len(run):
        raise InputError(f"{run.path}: no frames")
    kept = len(run) if most_frames is None else min(most_frames, len(run))
    chosen = np.unique(np.linspace(0, len(run) - 1, kept).round().astype(int))
    m = run.masses
    if kept == len(run):
        x, v = (np.array(run.vectors(what, slice(None))) for what in ("positions", "velocities"))
    else:
        x = np.array([run[int(k)].positions for k in chosen])
        v = np.array([run[int(k)].velocities for k in chosen])
    names = run.names or tuple(f"particle {i}" for i in run.ids)
    held = masses_held(run, chosen, x, v)
    seen = np.any(np.isfinite(x[:, :, 0]), axis=0)  # collisions may have added fewer bodies than have rows
    if not np.all(seen):
        x, v, m, held = x[:, seen], v[:, seen], m[seen], held[:, seen]
        names = tuple(name for name, ever in zip(names, np.atleast_1d(seen), strict=True) if ever)
    for y in (x, v):
        y -= np.einsum("kn,knj->kj", held, np.nan_to_num(y))[:, None] / held.sum(axis=1)[:, None, None]
    return Paths(run.times[chosen], x, v, m, held, names, gravity, central_row(m))


def gravity_of(run: reader.Run) -> float | None:
    """G of a run's gravity, in the run's units; None without gravity."""
    for force in run.system_record["forces"]:
        if isinstance(force["parameters"], dict) and "G" in force["parameters"]:
            given = force["parameters"]["G"]
            if not (given is None or (isinstance(given, int | float) and abs(given) < np.inf)):
                raise InputError(f"{run.path}: damaged: the gravitational constant in its record is not a number")
            return run.units.gravity if given is None else float(given)
    return None
