"""Scenes: plain descriptions of what a view shows, from a run's file, a System or a Simulation.

A scene is made of texts, numbers and lists, so it fits into JSON. ``src/viewer/README.md`` lists its keys.
"""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kickdrift.display.showing import stage
from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.patch import patch_of
from kickdrift.model.problem import Problem
from kickdrift.model.state import Floats
from kickdrift.model.system import System
from kickdrift.model.units.unit_systems import UnitSystem, symbol_of
from kickdrift.run.simulation import Simulation
from kickdrift.systemfile.files import is_shipped
from kickdrift.systemfile.reading import load
from kickdrift.text import choices, counted, measured, shown, suggestion
from kickdrift.trajectory.export.formats import BLOCK_BYTES
from kickdrift.trajectory.file.opening import BEING_WRITTEN
from kickdrift.trajectory.overview import overview_of
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.reader import masses_held
from kickdrift.view.packing import curves_of
from kickdrift.view.stage import Stage

FRAMES = 501  # most frames of a view, spread evenly: the start and 500 more
FRAMES_OF_FEW = 2001  # the same for a few bodies, whose trails need them
MOST_PLACES = 5_000_000  # particles times frames of a view
MOST_EVENTS = 500

Scene = dict[str, Any]


def scene_of(
    given: reader.Run | System | Simulation | str | os.PathLike[str],
    frames: int | None = None,
    colour: str | None = None,
    size: float = 1.0,
) -> Scene:
    """Scene of a run's file, a System, a Simulation as it stands, or the path or name of a file.

    Parameters
    ----------
    given : Run, System, Simulation, or a path or the name of a shipped system
    frames : most frames, spread evenly; default 501, and 2001 for a few bodies under gravity
    colour : what colours the particles first: "species" or "body", "speed", "kinetic energy", "charge", or one of the
        run's own columns with a number for each particle
    size : factor of the spheres' sizes

    Raises
    ------
    InputError
        For a file that is no run and no system of particles, and for an unknown colour.
    """
    if frames is not None and frames < 1:
        raise InputError(f"frames: expected 1 or more, got {frames}")
    if not 0.0 < size < np.inf:
        raise InputError(f"size: expected a positive number, got {size}")
    if isinstance(given, str | os.PathLike):
        found = scene_of_file(given, frames)
    elif isinstance(given, reader.Run):
        found = scene_of_run(given, frames)
    elif isinstance(given, Simulation | System):
        found = scene_of_system(given)
    else:
        raise InputError(f"view: expected a run, a System or a Simulation, got {type(given).__name__}")
    names = [each["name"] for each in found["colours"]]
    if colour is not None and colour not in names:
        raise InputError(
            f"colour: expected one of {choices(names, colour)}, got {shown(colour)}{suggestion(colour, names)}"
        )
    return found | {"colour": colour or found["colour"], "size": float(size)}


def scene_of_file(path: str | os.PathLike[str], frames: int | None = None) -> Scene:
    """Scene of a run's file, or of the start of a system file or shipped system."""
    text = os.fspath(path)
    if text.endswith((".toml", ".py")) or (is_shipped(text) and not os.path.lexists(text)):
        system = load(text)
        if isinstance(system, Problem):
            raise InputError(f"{text}: is a Problem, which has no particles to show; kickdrift plot draws Problems")
        return scene_of_system(system)
    if not os.path.lexists(text) and not Path(text).suffix:
        load(text)  # says which shipped system may be meant
    with _opened(path) as (run, growing):
        return scene_of_run(run, frames, growing)


def scene_of_system(given: System | Simulation) -> Scene:
    """Scene of one moment: the start of a System, or a Simulation as it stands."""
    if isinstance(given, Simulation):
        system, state = whole_of(given), given.state
    else:
        system, state = given, getattr(given, "state", None)
    if not isinstance(system, System):
        raise InputError("view: a Problem has no particles to show; its plot() draws it")
    stage = Stage.of(system)
    x, v, held = phase_of(stage, state)
    chunk = stage.chunk([state.steps_done], [state.time], x[None], v[None], [state.box], held=held[None])
    if isinstance(given, Simulation):
        caption = _caption({"integrator": given.integrator, "dt": given.dt}, system.units)
        return stage.scene([chunk], x, v, notes=stage.notes(), caption=caption)
    return stage.scene([chunk], x, v, notes=[*stage.notes(), "Shows the start: a system has no frames."])


def whole_of(sim: Simulation) -> System | Problem:
    """The system of a Simulation, with rows for bodies that left and for those that collisions may add."""
    events = getattr(sim.integration, "events", None)
    return events.roster.filed if events else sim.system


def phase_of(stage: Stage, state: Any) -> tuple[Floats, Floats, Floats]:
    """Positions and velocities (k, 3) and masses (k,) of the shown rows; bodies that are gone have nan and mass 0."""
    rows = len(stage.masses)
    x, v, m = np.full((rows, 3), np.nan), np.full((rows, 3), np.nan), np.zeros(rows)
    known = stage.system.state.ids
    if np.array_equal(known, state.ids):
        found = np.arange(len(known))
    else:
        row_of = {each: k for k, each in enumerate(known.tolist())}
        found = np.array([row_of.get(each, -1) for each in state.ids.tolist()], dtype=int)
    there = found >= 0
    place = found[there]
    x[place], v[place], m[place] = state.positions[there], state.velocities[there], state.masses[there]
    if stage.gravity is not None and len(place):
        x -= m[place] @ x[place] / m.sum()
        v -= m[place] @ v[place] / m.sum()
    if (patch := patch_of(stage.system)) is not None:
        x, v = patch.folded(x, v, state.time)
    return x[stage.rows], v[stage.rows], m[stage.rows]


def scene_of_run(run: reader.Run, frames: int | None = None, growing: bool = False) -> Scene:
    """Scene of an open file. A run without frames shows its start."""
    stage = Stage.of(run.system(), run.masses, run.names, run.species_index)
    notes = stage.notes()
    if growing or not run.closed:
        why = "goes on" if growing else "did not finish"
        notes.append(f"The run {why}: the view shows the {counted(len(run), 'frame')} written so far.")
    more = _told(run)
    happened = len(run.whole_events())
    if happened > MOST_EVENTS:
        notes.append(f"Shows the first {MOST_EVENTS} of {happened:,} events.")
    if not len(run):
        found = scene_of_system(run.system())
        return found | more | {"notes": [*notes, "The run has no frames: the view shows its start."]}
    shown = len(stage.masses[stage.rows])
    most = frames or (FRAMES_OF_FEW if stage.few else FRAMES)
    kept = min(len(run), max(1, min(most, MOST_PLACES // shown)))
    chosen = np.linspace(0, len(run) - 1, kept).round().astype(int)
    if kept < len(run):
        notes.append(f"Shows {kept:,} of {len(run):,} frames, spread evenly.")
    columns = {name: unit for name, (shape, unit) in run.columns.items() if shape == (len(run.ids),)}
    try:
        x, v, values, boxes = _read(run, chosen, stage.rows, columns)
    except InputError:
        lost = run.damaged_frames(chosen)
        if not lost:
            raise
        notes.append(f"Leaves out what is damaged: {choices(f'frame {k}' for k in lost)}.")
        chosen = chosen[~np.isin(chosen, lost)]
        if not len(chosen):
            found = scene_of_system(run.system())
            return found | more | {"notes": [*notes, "No frame is whole: the view shows the start."]}
        x, v, values, boxes = _read(run, chosen, stage.rows, columns)
    held = np.broadcast_to(stage.masses[stage.rows], x.shape[:2])
    if stage.gravity is not None and stage.stride == 1:
        held = masses_held(run, chosen, x, v)
        for y in (x, v):
            y -= np.einsum("kn,knj->kj", held, np.nan_to_num(y))[:, None] / held.sum(axis=1)[:, None, None]
    if (patch := patch_of(stage.system)) is not None:
        x, v = patch.folded(x, v, run.all_times[chosen])
    chunk = stage.chunk(run.all_steps[chosen], run.all_times[chosen], x, v, boxes, values, held)
    more["columns"] = [{"name": name, "label": name, "unit": symbol_of(unit)} for name, unit in columns.items()]
    found = stage.scene([chunk], x[0], v[0], notes=notes, **more)
    if stage.few:
        far = np.linalg.norm(x - np.array(found["centre"]), axis=2)
        found["reach"] = max(found["reach"], float(np.nanquantile(far, 0.8)))
    return found


def _of(chosen: NDArray[np.int64], read: Callable[[slice], Any]) -> list[Any]:
    """What is read of the chosen frames: all at once, or each apart where a frame between them is damaged."""
    first = int(chosen[0])
    try:
        found = read(slice(first, int(chosen[-1]) + 1))
    except InputError:
        return [read(slice(k, k + 1))[0] for k in chosen.tolist()]
    return [found[k - first] for k in chosen.tolist()]


def _read(
    run: reader.Run, chosen: NDArray[np.int64], rows: slice, columns: Iterable[str]
) -> tuple[Floats, Floats, dict[str, Floats], list[Box]]:
    """Positions, velocities and columns (f, k, …) of the shown rows at the chosen frames, and the boxes."""
    x, v = (_vectors(run, what, chosen, rows) for what in ("positions", "velocities"))
    values = {name: np.array(_of(chosen, partial(_column, run, name)))[:, rows] for name in columns}
    return x, v, values, _of(chosen, lambda part: run.boxes_of(range(part.start, part.stop)))


def _column(run: reader.Run, name: str, frames: slice) -> Floats:
    """A column (f, n) at some frames."""
    return run.framed(frames)[name]


def _vectors(run: reader.Run, what: str, chosen: NDArray[np.int64], rows: slice) -> Floats:
    """Positions or velocities (f, k, 3) of the shown rows at the chosen frames, read in blocks."""
    most = max(1, BLOCK_BYTES // (24 * len(run.ids)))  # frames of a block
    starts = np.flatnonzero(np.diff(chosen // most, prepend=-1))
    found, done, move = [], 0, stage(f"reading {what}")
    for part in np.split(chosen, starts[1:]):
        found.append(np.array(_of(part, lambda frames: run.vectors(what, frames, rows))))
        done += len(part)
        move(done, len(chosen))
    return np.concatenate(found)


def _told(run: reader.Run) -> dict[str, Any]:
    """Curves, verdict and events of a run."""
    samples = run.whole_samples()
    own = {name: unit for name, (shape, unit) in run.columns.items() if shape == ()}
    events = run.whole_events()
    return {
        "curves": curves_of(samples.times, samples.observables, run.units, own),
        "caption": _caption(run.method, run.units),
        "verdict": [list(line) for line in overview_of(run)],
        "events": [
            {"time": each["time"], "text": " and ".join([each["kind"].replace("-", " "), *each["bodies"]][:1])
             + (": " + " and ".join(each["bodies"]) if each["bodies"] else "")}
            for each in events[:MOST_EVENTS]
        ],
    }  # fmt: skip


def _caption(method: Mapping[str, Any], units: UnitSystem) -> list[str]:
    """Method and step of a run."""
    name, dt = method.get("integrator"), method.get("dt")
    step = measured(f"dt = {dt:g}", symbol_of(units.time)) if isinstance(dt, int | float) else ""
    return [text for text in (str(name or ""), step) if text]


@contextmanager
def _opened(path: str | os.PathLike[str]) -> Iterator[tuple[reader.Run, bool]]:
    """A run's file, and whether a run is writing to it; then the file is a copy of this moment."""
    try:
        run = reader.open(path)
    except InputError as error:
        if BEING_WRITTEN not in str(error):
            raise
    else:
        with run:
            yield run, False
        return
    with tempfile.TemporaryDirectory(prefix="kickdrift-") as folder:
        copy = Path(folder) / Path(path).name
        shutil.copyfile(path, copy)
        with reader.open(copy) as run:
            yield run, True
