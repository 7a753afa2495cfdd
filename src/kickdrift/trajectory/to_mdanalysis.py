"""Frames of a run through MDAnalysis' writers: DCD, XTC, TRR, XYZ and PDB."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.trajectory.export import Frames, Stored
from kickdrift.trajectory.formats import Format
from kickdrift.trajectory.universe import label, mdanalysis

INT32 = 2**31 - 1
XTC_LARGEST = INT32 - 2  # of what XTC's coordinates are in its grid; libxdrfile refuses more
XYZ_DECIMALS = 8
PDB_ATOMS, PDB_MODELS, PDB_EDGE = 99_999, 9_999, 99_999.9995  # what 5, 4 and 9.3 columns hold
PDB_LOWEST, PDB_HIGHEST = -999.9995, 9_999.9995  # what 8.3 columns hold


class Grid(NamedTuple):
    """XTC's: decimals of a position in nm, and how far it may be off in angstrom."""

    decimals: int
    tolerance: float


# GROMACS' own for real units. In nominal ones half of the grid is 5e-5, which leaves as much for the roundings of
# float32, in which libxdrfile computes.
REAL, NOMINAL = Grid(3, 1e-2), Grid(5, 1e-4)


def write(frames: Frames, path: Path, format: Format, progress: Callable[[int, int], None]) -> list[str]:
    """Write the frames; returns what had to be given up."""
    MDAnalysis = mdanalysis(format.suffix)
    kind = format.suffix[1:].upper()
    _check_numbers(frames, kind)
    options, notes = _options(frames, kind)
    universe = MDAnalysis.Universe.empty(len(frames.run.ids), trajectory=True, velocities=bool(format.velocities))
    label(universe, frames.run)
    if kind == "XYZ":
        universe.atoms.names = ["_".join(name.split()) for name in universe.atoms.names]
    gone = False
    with _writer(MDAnalysis.Writer(str(path), len(frames.run.ids), format=kind, **options)) as writer:
        for done, frame in enumerate(frames, 1):
            gone |= _check(frames, frame, kind)
            _set(universe, frames, frame)
            writer.remark = f"step {frame.step} time {frame.time!r}"  # XYZ's comment line; the others know none
            if kind == "PDB" and done > 1 and frames.edges is not None:
                writer.CRYST1(universe.dimensions)  # MDAnalysis' reader finds one for each frame or none
            writer.write(universe.atoms)
            progress(done, len(frames))
    _read_back(frames, path, kind)
    return [*notes, *(["bodies that were removed are NaN from then on"] if gone else [])]


def _check_numbers(frames: Frames, kind: str) -> None:
    """Of PDB, whose columns have an end."""
    if kind != "PDB":
        return
    path, n = frames.run.path, len(frames.run.ids)
    if n > PDB_ATOMS:
        raise InputError(f"{path}: has {n:,} particles, and a .pdb has columns for {PDB_ATOMS:,}; .dcd has no limit")
    if len(frames) > PDB_MODELS:
        fewer = -(-len(frames) // PDB_MODELS) * frames.indices.step
        raise InputError(
            f"{path}: {len(frames):,} frames, and a .pdb numbers {PDB_MODELS:,}; --step {fewer} takes fewer"
        )
    if frames.edges is not None and frames.edges.max() >= PDB_EDGE:
        raise InputError(f"{path}: the box has an edge of {frames.edges.max():g}, and a .pdb has columns up to 99,999")


def _options(frames: Frames, kind: str) -> tuple[dict[str, Any], list[str]]:
    """What the writer is told, and what that gives up."""
    run, indices = frames.run, frames.indices
    if kind == "XTC":
        return {"precision": _grid(frames).decimals}, _steps_note(frames)
    if kind == "XYZ":
        return {"precision": XYZ_DECIMALS}, []
    if kind == "PDB":
        return {"multiframe": True, "bonds": None}, []
    if kind == "TRR":
        return {}, _steps_note(frames)
    # DCD has the step of the first frame, the steps between frames and the length of one.
    first = float(run.times[indices[0]]) * frames.units.time / frames.dt
    steps = np.diff(run.steps[np.asarray(indices)])
    every = int(steps[0]) if len(steps) and steps[0] > 0 and np.all(steps == steps[0]) else 1
    start = round(first * every)
    notes = [] if frames.even else ["DCD has one time step: the mean of these frames, which are not evenly spaced"]
    if not 0 <= start <= INT32 or every > INT32 or abs(start / every - first) > 1e-6 * max(1.0, first):
        start = 0
        notes.append("DCD starts at a whole step: its times are those since the first frame")
    return {"dt": frames.dt, "nsavc": every, "istart": start, "remarks": f"kickdrift: {run.path.name}"}, notes


def _steps_note(frames: Frames) -> list[str]:
    too_long = frames.run.steps[frames.indices[-1]] > INT32
    return ["steps are beyond 32 bits: the frames' numbers stand instead"] if too_long else []


def _grid(frames: Frames) -> Grid:
    return NOMINAL if frames.units.nominal else REAL


def _set(universe: Any, frames: Frames, frame: Stored) -> None:
    """Make the frame the universe's only one."""
    ts = universe.trajectory.ts
    ts.frame, ts.time = frame.number, frame.time
    if frames.run.steps[frames.indices[-1]] <= INT32:
        ts.data["step"] = frame.step
    ts.dimensions = None if frames.edges is None else [*frames.edges, 90, 90, 90]
    ts.positions = frame.positions
    if ts.has_velocities:
        ts.velocities = frame.velocities


def _check(frames: Frames, frame: Stored, kind: str) -> bool:
    """Whether bodies are gone; an InputError where the format cannot hold this frame."""
    x = frame.positions
    gone = ~np.isfinite(x).all(axis=1)
    if kind not in ("PDB", "XTC"):
        return bool(gone.any())
    suffix = f".{kind.lower()}"
    if gone.any():
        raise InputError(
            f"{frames.who(frame, int(gone.argmax()))} was removed, and {suffix} must have a place for it; "
            f"--stop {frame.number} ends before, and .extxyz leaves it out"
        )
    if kind == "PDB":
        beyond = (x <= PDB_LOWEST) | (x >= PDB_HIGHEST)
        limit = "the columns of .pdb, -999.999 to 9999.999"
    else:
        scaled = x * 10.0 ** (_grid(frames).decimals - 1)
        size = np.abs(scaled)  # and libxdrfile packs differences from the lowest
        beyond = (size >= XTC_LARGEST) | ((np.ptp(scaled, axis=0) >= XTC_LARGEST) & (size == size.max(axis=0)))
        limit = "the 32-bit integers of .xtc"
    if beyond.any():
        particle, axis = np.unravel_index(int(beyond.argmax()), beyond.shape)
        raise _cannot(frames, frame, int(particle), f"{'xyz'[axis]} = {x[particle, axis]:.6g} is beyond {limit}")
    return False


def _cannot(frames: Frames, frame: Stored, particle: int, why: str) -> InputError:
    inside = frames.unwrapped and frames.edges is not None
    advice = "without --unwrapped it lies inside the box" if inside else "export to .trr or .dcd"
    return InputError(f"{frames.who(frame, particle)}: {why}; {advice}")


def _read_back(frames: Frames, path: Path, kind: str) -> None:
    """Make sure that the binary formats are complete, and that XTC's positions are near enough."""
    from MDAnalysis.lib.formats import libdcd, libmdaxdr

    if kind not in ("DCD", "TRR", "XTC"):
        return
    with {"DCD": libdcd.DCDFile, "TRR": libmdaxdr.TRRFile, "XTC": libmdaxdr.XTCFile}[kind](str(path)) as file:
        if kind != "XTC":
            whole = len(file) == len(frames)
        else:
            tolerance, count = _grid(frames).tolerance, 0
            for frame, found in zip(frames, file, strict=False):
                count += 1
                off = np.abs(found.x.astype(float) * 10 - frame.positions).max(axis=1)
                worst = int(off.argmax())
                if off[worst] > tolerance:
                    why = f"is off by {off[worst]:.2g} in .xtc, more than {tolerance:g}"
                    raise _cannot(frames, frame, worst, why)
            whole = count == len(frames)
    if not whole:
        raise RunError("the export did not come out whole; is the disk full?")


@contextmanager
def _writer(writer: Any) -> Iterator[Any]:
    """A writer that is closed at the end, once, and without its warnings of a missing box and of columns unknown."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with writer:
                yield writer
        except OSError:
            writer.close = lambda: None  # it would be called again, with the same error, when the object goes
            raise
