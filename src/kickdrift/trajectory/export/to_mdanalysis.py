"""Frames of a run through MDAnalysis' writers: DCD, XTC, TRR, XYZ and PDB, each with what the format can hold."""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kickdrift.errors import InputError, RunError
from kickdrift.model.units.file_units import FileUnits
from kickdrift.trajectory.export.formats import REMOVED_NAN, Chosen, Format, Placed
from kickdrift.trajectory.read.universe import dimensions, label, mdanalysis, spacing, topology_of

INT32 = 2**31 - 1


def write(chosen: Chosen, path: Path, format: Format, progress: Callable[[int, int], None]) -> list[str]:
    """Write the frames and return notes about what was lost."""
    MDAnalysis = mdanalysis(format.suffix)
    target = _TARGETS[format.suffix](chosen, format)
    n = len(chosen.run.ids)
    universe = MDAnalysis.Universe.empty(n, trajectory=True, velocities=bool(format.velocities))
    label(universe, chosen.run)
    target.rename(universe.atoms)
    kind = format.suffix[1:].upper()
    with _closing(MDAnalysis.Writer(str(path), n, format=kind, **target.options)) as writer:
        for done, frame in enumerate(chosen, 1):
            stored = target.stored(frame)
            target.check(stored)
            target.set(universe, stored)
            target.announce(writer, stored, done)
            writer.write(universe.atoms)
            progress(done, len(chosen))
    if not target.whole(path):
        raise RunError("the export is incomplete; is the disk full, or the size of files limited?")
    return target.notes


class Target:
    """A format: the options of its writer, its limits and its losses.

    Attributes
    ----------
    options : for MDAnalysis' writer
    notes : what this run loses in the format
    cell : bool
        Whether frames have a box. These formats cannot hold a box that is open along an axis.
    """

    def __init__(self, chosen: Chosen, format: Format) -> None:
        run = chosen.run
        self.chosen, self.format, self.run = chosen, format, run
        self.units = FileUnits.of(run.units)
        self.cell = all(run.box.periodic_axes)
        self.options: dict[str, Any] = {}
        self.notes: list[str] = []
        if self.units.nominal:
            self.notes.append(f"{run.units.length} and {run.units.time} stand as angstrom and ps")
        if format.box and run.box.periodic and not self.cell:
            whole = run.box.described(run.units.symbol("length"))
            self.notes.append(f"frames have no box, since {format.suffix} has none like {whole}")

    def rename(self, atoms: Any) -> None:
        """Give the atoms names that the format can hold."""

    def stored(self, frame: Placed) -> Placed:
        """Convert the frame to angstrom and ps."""
        units = self.units
        x, v = frame.positions * units.length, frame.velocities * units.velocity
        return frame._replace(time=frame.time * units.time, positions=x, velocities=v)

    def check(self, frame: Placed) -> None:
        """Raise InputError if the format cannot hold the frame."""
        gone = ~np.isfinite(frame.positions).all(axis=1)
        if not gone.any():
            return
        if not self.format.removed:
            raise InputError(
                f"{self.chosen.who(frame, int(gone.argmax()))} was removed, but {self.format.suffix} needs its "
                f"position; --stop {frame.number} ends before the removal, and .extxyz leaves the body out"
            )
        note = f"bodies that were removed are kept {REMOVED_NAN}"
        if note not in self.notes:
            self.notes.append(note)

    def set(self, universe: Any, frame: Placed) -> None:
        """Make the frame the only frame of the universe."""
        ts = universe.trajectory.ts
        ts.frame, ts.time, ts.data["step"] = frame.number, frame.time, frame.step
        ts.dimensions = self.dimensions(frame)
        ts.positions = frame.positions
        if ts.has_velocities:
            ts.velocities = frame.velocities

    def dimensions(self, frame: Placed) -> list[float] | None:
        """Box of the frame: lengths in angstrom, angles in degrees."""
        return dimensions(frame.box, self.units.length)

    def announce(self, writer: Any, frame: Placed, done: int) -> None:
        """Write what comes before the frame."""

    def whole(self, path: Path) -> bool:
        """Tell whether the file holds all frames."""
        return True

    def cannot(self, frame: Placed, particle: int, why: str) -> InputError:
        inside = self.chosen.unwrapped and self.run.box.periodic
        advice = "without --unwrapped it lies inside the box" if inside else "export to .trr or .dcd"
        return InputError(f"{self.chosen.who(frame, particle)}: {why}; {advice}")


class Xyz(Target):
    """XYZ, with step and time in the comment line."""

    def __init__(self, chosen: Chosen, format: Format) -> None:
        super().__init__(chosen, format)
        self.options = {"precision": 8}

    def rename(self, atoms: Any) -> None:
        atoms.names = ["_".join(name.split()) for name in atoms.names]

    def announce(self, writer: Any, frame: Placed, done: int) -> None:
        writer.remark = f"step {frame.step} time {frame.time!r}"


class Pdb(Target):
    """PDB, with columns of 5 digits for atoms, 4 for frames, 8.3 for coordinates and 9.3 for the box."""

    ATOMS, MODELS, EDGE = 99_999, 9_999, 99_999.9995
    LOWEST, HIGHEST = -999.9995, 9_999.9995

    def __init__(self, chosen: Chosen, format: Format) -> None:
        super().__init__(chosen, format)
        self.options = {"multiframe": True, "bonds": None if topology_of(self.run) is None else "conect"}
        path, n = self.run.path, len(self.run.ids)
        if n > self.ATOMS:
            raise InputError(f"{path}: has {n:,} particles; .pdb holds at most {self.ATOMS:,}, .dcd any number")
        if len(chosen) > self.MODELS:
            every = -(-len(chosen) // self.MODELS) * chosen.every
            raise InputError(f"{path}: {len(chosen):,} frames; .pdb holds at most {self.MODELS:,}; try --step {every}")
        kinds = {id(box): box for box in chosen.frames.boxes}.values()
        edge = max(max((dimensions(box, self.units.length) or [0.0])[:3]) for box in kinds)
        if edge >= self.EDGE:
            raise InputError(f"{path}: the box has an edge of {edge:g}; .pdb holds at most 99999.999")

    def check(self, frame: Placed) -> None:
        super().check(frame)
        x = frame.positions.astype("f4")  # as MDAnalysis sees them, with the limits of float32
        _within(self, frame, (x <= np.float32(self.LOWEST)) | (x > np.float32(self.HIGHEST)), "columns of .pdb")

    def announce(self, writer: Any, frame: Placed, done: int) -> None:
        if done > 1 and self.cell:
            writer.CRYST1(self.dimensions(frame))  # MDAnalysis' reader expects one in each frame


class Dcd(Target):
    """DCD, with one step of the first frame, one spacing of steps and one spacing of times for the whole file."""

    def __init__(self, chosen: Chosen, format: Format) -> None:
        super().__init__(chosen, format)
        steps, times = chosen.frames.steps, chosen.frames.times
        dt, even = spacing(self.run, times)
        gaps = np.diff(steps)
        every = int(gaps[0]) if len(gaps) and gaps[0] > 0 and np.all(gaps == gaps[0]) else 1
        first = float(times[0]) * self.units.time / dt  # counted in frames
        start = round(first * every)
        if not even:
            self.notes.append("DCD has one time step, and these frames are not evenly spaced")
        if not 0 <= start <= INT32 or every > INT32 or abs(start / every - first) > 1e-6 * max(1.0, first):
            start, every = 0, min(every, INT32)
            self.notes.append("DCD starts at a whole step: its times are those since the first frame")
        self.options = {"dt": dt, "nsavc": every, "istart": start, "remarks": f"kickdrift: {self.run.path.name}"}

    def whole(self, path: Path) -> bool:
        from MDAnalysis.lib.formats.libdcd import DCDFile

        with DCDFile(str(path)) as file:
            return len(file) == len(self.chosen)


class Trr(Target):
    """TRR, with steps of 32 bits."""

    def __init__(self, chosen: Chosen, format: Format) -> None:
        super().__init__(chosen, format)
        self._steps_fit = int(chosen.frames.steps[-1]) <= INT32
        if not self._steps_fit:
            self.notes.append("steps are beyond 32 bits: the frames' numbers stand instead")

    def stored(self, frame: Placed) -> Placed:
        found = super().stored(frame)
        return found if self._steps_fit else found._replace(step=frame.number)

    def whole(self, path: Path) -> bool:
        from MDAnalysis.lib.formats.libmdaxdr import TRRFile

        with TRRFile(str(path)) as file:
            return len(file) == len(self.chosen)


class Grid(NamedTuple):
    """Decimals of a position in nm in XTC, and the largest error in angstrom."""

    decimals: int
    tolerance: float


class Xtc(Trr):
    """XTC, with positions as whole numbers of 32 bits, which libxdrfile computes in float32."""

    # GROMACS' own choice for real units. In nominal units half of the grid is 5e-5; float32 may add as much.
    REAL, NOMINAL = Grid(3, 1e-2), Grid(5, 1e-4)
    LARGEST = INT32 - 2  # limit of libxdrfile

    def __init__(self, chosen: Chosen, format: Format) -> None:
        super().__init__(chosen, format)
        self.grid = self.NOMINAL if self.units.nominal else self.REAL
        self.options = {"precision": self.grid.decimals}

    def check(self, frame: Placed) -> None:
        super().check(frame)
        scaled = frame.positions * 10.0 ** (self.grid.decimals - 1)
        size = np.abs(scaled)
        apart = np.ptp(scaled, axis=0) >= self.LARGEST  # libxdrfile stores differences from the lowest
        _within(self, frame, (size >= self.LARGEST) | (apart & (size == size.max(axis=0))), "32-bit integers of .xtc")

    def whole(self, path: Path) -> bool:
        """Raise InputError if a stored position is too far from the true position."""
        from MDAnalysis.lib.formats.libmdaxdr import XTCFile

        read = 0
        with XTCFile(str(path)) as file:
            for frame, found in zip(self.chosen, file, strict=False):
                stored = self.stored(frame)
                off = np.abs(found.x.astype(float) * 10 - stored.positions).max(axis=1)
                worst = int(off.argmax())
                if off[worst] > self.grid.tolerance:
                    why = f"is off by {off[worst]:.2g} in .xtc, more than {self.grid.tolerance:g}"
                    raise self.cannot(frame, worst, why)
                read += 1
        return read == len(self.chosen)


_TARGETS: dict[str, type[Target]] = {".dcd": Dcd, ".xtc": Xtc, ".trr": Trr, ".xyz": Xyz, ".pdb": Pdb}


def _within(target: Target, frame: Placed, beyond: NDArray[np.bool_], limit: str) -> None:
    """Raise an InputError that names the first coordinate beyond a limit, if any."""
    if beyond.any():
        particle, axis = np.unravel_index(int(beyond.argmax()), beyond.shape)
        value = frame.positions[particle, axis]
        raise target.cannot(frame, int(particle), f"{'xyz'[axis]} = {value:.8g} is beyond the {limit}")


@contextmanager
def _closing(writer: Any) -> Iterator[Any]:
    """Close the writer once at the end, and silence its warnings of a missing box and unknown columns."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with writer:
                yield writer
        except OSError:
            writer.close = lambda: None  # a second call at the object's deletion would raise the same error
            raise
