"""Input of the observables: the frames of a run's file, or arrays, in pieces that fit into memory."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kickdrift.errors import InputError
from kickdrift.model.box.box import Box
from kickdrift.model.freedom import whole_motion
from kickdrift.model.state import Floats
from kickdrift.model.units.unit_systems import UnitSystem
from kickdrift.trajectory.layout.run_parts import RunFile
from kickdrift.trajectory.read import reader
from kickdrift.trajectory.read.frames import Frames

PIECE_BYTES = 64 * 2**20  # positions or velocities in memory at once
Quantity = Literal["positions", "velocities"]
Source = Frames | str | os.PathLike[str] | ArrayLike
Boxes = Box | Sequence[float] | Sequence[Box] | None


def travelled(positions: Floats, boxes: Sequence[Box]) -> Floats:
    """Positions (f, k, 3) that grow by what the particles move inside their boxes, from the first frame's positions on.

    A barostat scales every position x = w + n L with the box L, where w lies inside the box and n counts the edges. So
    a particle far from the origin moves with each change of the box, and more the further it has come. Its mean squared
    displacement then has no meaning. The scheme here keeps the view from inside the box, the toroidal view (von Bülow,
    Bullerjahn & Hummer 2020, J. Chem. Phys. 153, 021101, doi:10.1063/5.0008316):

    u' = u + (w' - w) + (n' - n) L',

    with the primed values of the next frame. The paper finds n' - n from the nearest image. Files of kickdrift hold n,
    so a particle may move further than half a box between two frames.
    """
    found = np.empty_like(positions)
    found[0] = positions[0]
    inside, crossed = _split(positions[0], boxes[0])
    for k in range(1, len(positions)):
        now, count = _split(positions[k], boxes[k])
        found[k] = found[k - 1] + (now - inside) + boxes[k].cartesian(count - crossed)
        inside, crossed = now, count
    return found


def _split(positions: Floats, box: Box) -> tuple[Floats, Floats]:
    """Positions (k, 3) inside the box, and the whole numbers (k, 3) of edges that lead there; 0 along open axes."""
    inside = box.wrap(positions)
    return inside, np.rint(box.fractional(positions - inside)) * box.periodic_axes


@dataclass(frozen=True)
class Vectors:
    """Positions or velocities over time.

    Attributes
    ----------
    what : "positions" or "velocities"
    source : the open run, or an array (frames, n, 3)
    chosen : numbers of the frames in the source
    times : (frames,) float64; None for an array without times
    boxes : (frames,) Box of each frame; the same object wherever the box is the same
    masses : (n,)
    species : (n,) names
    """

    what: Quantity
    source: RunFile | Floats
    chosen: NDArray[np.int64]
    times: Floats | None
    boxes: Sequence[Box]
    masses: Floats
    species: NDArray[np.str_]

    def __len__(self) -> int:
        return len(self.chosen)

    @property
    def particles(self) -> int:
        return len(self.masses)

    @property
    def dimensions(self) -> int:
        """Number of dimensions: 3, or 2 for a run in two dimensions."""
        return int(self.source.system_record.get("dimensions", 3)) if isinstance(self.source, reader.Run) else 3

    @property
    def units(self) -> UnitSystem | None:
        """The run's unit system; None for an array."""
        return self.source.units if isinstance(self.source, reader.Run) else None

    @property
    def box(self) -> Box:
        """Box of the first frame. All frames have its periodic axes."""
        return self.boxes[0]

    @property
    def box_varies(self) -> bool:
        """Whether frames have different boxes."""
        return any(box is not self.boxes[0] for box in self.boxes)

    def pieces(self) -> Iterator[Floats]:
        """Yield unwrapped vectors (k, n, 3) of consecutive frames, piece by piece."""
        size = max(1, PIECE_BYTES // (24 * self.particles))
        for start in range(0, len(self), size):
            yield self._read(start, start + size, slice(None))

    def each(self) -> Iterator[Floats]:
        """Yield vectors (n, 3), frame by frame."""
        for piece in self.pieces():
            yield from piece

    def paths(self) -> Iterator[tuple[slice, Floats]]:
        """Yield groups of particles as slices, with their unwrapped vectors (frames, k, 3) over all frames.

        Positions in a box that changes are those of `travelled`, which do not scale with the box."""
        size = max(1, PIECE_BYTES // (24 * len(self)))
        changes = self.what == "positions" and self.box_varies
        for start in range(0, self.particles, size):
            some = slice(start, min(start + size, self.particles))
            found = self._read(0, len(self), some)
            yield some, travelled(found, self.boxes) if changes else found

    def centre_of_mass(self) -> Floats:
        """Centre of mass of all particles, or its velocity, (frames, 3)."""
        weights = self.masses / self.masses.sum()
        if self.what == "positions" and self.box_varies:
            parts = [np.einsum("n,fnk->fk", weights[some], path) for some, path in self.paths()]
            return np.sum(parts, axis=0)
        return np.concatenate([np.einsum("n,fnk->fk", weights, piece) for piece in self.pieces()])

    def spacing(self) -> float:
        """Time between frames. Raises InputError if it is not constant."""
        if self.times is None:
            raise InputError("times: needed for arrays, one for each frame")
        if len(self) < 2:
            raise InputError(f"{len(self)} frame: correlations in time need two or more frames")
        gaps = np.diff(self.times)
        step = float(gaps.mean())
        wrong = np.flatnonzero(~(np.abs(gaps - gaps[0]) <= 1e-6 * abs(gaps[0])))
        if wrong.size or step <= 0:
            k = int(wrong[0]) if wrong.size else 0
            raise InputError(
                f"frames are not evenly spaced in time: {gaps[k]:.6g} after frame {self.chosen[k]}, {gaps[0]:.6g} "
                "after the first; choose an even slice, run[start:stop:step]"
            )
        return step

    def _read(self, start: int, stop: int, particles: slice) -> Floats:
        rows = self.chosen[start:stop]
        if isinstance(self.source, np.ndarray):
            found: Floats = self.source[rows, particles]
        else:
            step = int(rows[1] - rows[0]) if len(rows) > 1 else 1
            found = self.source.vectors(self.what, slice(int(rows[0]), int(rows[-1]) + 1, step), particles)
        if not np.isfinite(found).all():
            frame, particle = np.argwhere(~np.isfinite(found))[0][:2]
            raise InputError(
                f"{self.what}: particle {particle + (particles.start or 0)} of frame {rows[frame]} is not finite "
                "(removed in the run?)"
            )
        return found


def relative(velocities: Any, positions: Any, masses: Floats, apart: int) -> Iterator[Floats]:
    """Pieces (k, n, 3) of velocities without the motion of the whole; pieces of positions are for ``TURN`` alone."""
    for piece, places in zip(velocities, positions, strict=False):
        found = piece.copy()
        for frame, x in zip(found, places, strict=True):
            motion = whole_motion(masses, x.T, frame.T, apart)
            frame -= 0.0 if motion is None else motion.T
        yield found


def vectors_of(
    source: Source,
    what: Quantity,
    *,
    times: ArrayLike | None = None,
    box: Boxes = None,
    masses: ArrayLike | None = None,
    species: Sequence[str] | None = None,
) -> Vectors:
    """Vectors of a run (open or by its path), of some of its frames (``run[100::10]``), or of an array.

    An array has shape (frames, n, 3) or (n, 3), and further arguments: times, box, masses (default equal), species
    (default one, "A"). A run has these itself. If a whole run's frames are uneven, frames off the run's cadence are
    left out; the end of a run adds such a frame.
    """
    if isinstance(source, str | os.PathLike):
        source = reader.open(source)  # closed after its last use
    if isinstance(source, Frames):
        if any(given is not None for given in (times, box, masses, species)):
            raise InputError("times, box, masses, species: only for arrays; a run has its own")
        run, chosen = source.run, np.array(source.rows, dtype=np.int64)
        if source.rows.step < 0:
            raise InputError("frames: expected a slice of the run with a positive step")
        if source is run and len(chosen) > 3 and np.ptp(np.diff(run.steps)) > 0:
            on_grid = run.steps % run.every == 0 if run.every else np.ones(len(run), bool)
            if np.count_nonzero(on_grid) > 2:
                chosen = chosen[on_grid]
        names = np.array(run.species)[run.species_index]
        boxes = run.boxes_of(range(len(run)))
        found = Vectors(what, run, chosen, run.times[chosen], [boxes[k] for k in chosen], run.masses, names)
    else:
        found = _of_array(np.asarray(source, dtype=float), what, times, box, masses, species)
    if not len(found):
        raise InputError(f"{what}: the choice of frames is empty")
    return found


def _of_array(
    array: Floats,
    what: Quantity,
    times: ArrayLike | None,
    box: Boxes,
    masses: ArrayLike | None,
    species: Sequence[str] | None,
) -> Vectors:
    array = array[np.newaxis] if array.ndim == 2 else array
    if array.ndim != 3 or array.shape[2] != 3 or array.shape[1] < 1:
        raise InputError(f"{what}: expected shape (frames, n, 3) with n >= 1, got {array.shape}")
    chosen = np.arange(len(array))
    n = array.shape[1]
    clock = None if times is None else np.asarray(times, dtype=float)
    if clock is not None and clock.shape != array.shape[:1]:
        raise InputError(f"times: expected {len(array)}, one for each frame, got shape {clock.shape}")
    m = np.ones(n) if masses is None else np.asarray(masses, dtype=float)
    if m.shape != (n,):
        raise InputError(f"masses: expected {n}, one for each particle, got shape {m.shape}")
    names = np.full(n, "A") if species is None else np.array([str(name) for name in species])
    if names.shape != (n,):
        raise InputError(f"species: expected {n}, one for each particle, got {len(names)}")
    return Vectors(what, array, chosen, clock, _boxes_of(box, len(array)), m, names)


def _boxes_of(given: Boxes, frames: int) -> list[Box]:
    """Box of each frame of an array, from one box for all frames or a list with a Box for each."""
    if not (isinstance(given, list | tuple) and given and all(isinstance(each, Box) for each in given)):
        return [Box.of(given)] * frames  # type: ignore[arg-type]
    if len(given) != frames or any(each.periodic_axes != given[0].periodic_axes for each in given):
        raise InputError(f"box: expected one Box, or {frames}, one for each frame, all periodic along the same axes")
    return list(given)
