"""Films of runs: a liquid as spheres in its box, planets with trails and names."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.disk.kinds import FILM
from kickdrift.disk.outputs import checked_target, written_whole
from kickdrift.display.showing import following
from kickdrift.errors import InputError
from kickdrift.model.checks.values import number
from kickdrift.model.state import Floats
from kickdrift.plots.camera import Camera
from kickdrift.plots.film_files import CODECS, program, write
from kickdrift.plots.filmed import Bodies, Particles, has_trails
from kickdrift.text import shown
from kickdrift.trajectory.opened import is_problem
from kickdrift.trajectory.read import reader

LONGEST = 20.0  # seconds of a film that shows each frame of the run once
SIZES = (64, 4096)  # least and most pixels of an edge


class Film(NamedTuple):
    """A film that was written.

    ``frames`` are its pictures of ``size`` (width, height) in pixels, ``fps`` of them a second. ``notes`` say what the
    film leaves out.
    """

    path: Path
    frames: int
    size: tuple[int, int]
    fps: float
    notes: tuple[str, ...] = ()


def movie(
    path: str | os.PathLike[str],
    output: str | os.PathLike[str],
    *,
    azimuth: float = 30.0,
    elevation: float = 25.0,
    turn: float = 0.0,
    zoom: float = 1.0,
    colour: str | None = None,
    fps: float = 25.0,
    duration: float | None = None,
    every: int | None = None,
    size: tuple[int, int] = (960, 720),
    dark: bool | None = None,
    overwrite: bool = False,
    progress: bool | Callable[[int, int], Any] | None = None,
) -> Film:
    """Make a film of a run; the suffix of ``output`` names the format: .mp4, .webm or .gif.

    Particles are spheres, inside the box where it is periodic. A film of at most 30 bodies under gravity has their
    trails and names. It is seen from their barycentre, and z is the direction of their angular momentum. MP4 and WebM
    need ffmpeg, which the extra ``movie`` installs.

    Parameters
    ----------
    path : a run's file
    output : the new file; it is written whole or not at all
    azimuth, elevation : where the camera stands, in degrees about z and above the x-y plane
    turn : angle in degrees by which the camera turns about z during the film
    zoom : magnification
    colour : "species", "speed", "body", or one of matplotlib's colours for all; default "body" with trails, "species"
        for a mixture and "speed" for the rest
    fps : pictures a second
    duration : seconds of the film, whose pictures then show the nearest frames in time; default each frame of the run
        once, and at most 20 seconds
    every : show only every so many frames of the run, each once
    size : width and height in pixels, both even
    dark : whether the background is dark; default for bodies with trails
    overwrite : replace a file of that name
    progress : True shows a bar; a function is called with the pictures done and their number

    Returns
    -------
    A `Film`.

    Raises
    ------
    InputError
        For a file without frames, an unknown ending, an existing file, a missing ffmpeg, or an option that is not
        allowed. Then nothing is written.
    """
    camera = Camera(azimuth, elevation, turn, zoom).checked()
    size = _checked_size(size)
    if not 1.0 <= number(fps) <= 100.0:
        raise InputError(f"fps: expected a number from 1 to 100, got {shown(fps)}")
    target = checked_target(output, FILM, overwrite, [path])
    if is_problem(path):
        raise InputError(f"{path}: is the run of an ODE; a film shows particles, and plot draws this file")
    if target.suffix.lower() in CODECS:
        program()
    with reader.open(path) as run:
        if not len(run):
            raise InputError(f"{run.path}: holds no frames, so there is nothing to show")
        rows = _rows(run, fps, duration, every)
        show = (Bodies if has_trails(run) else Particles)(run, rows, size, camera, colour, dark)
        with following(progress, "drawing") as told, written_whole(target, FILM, overwrite=overwrite) as part:
            write(part, _told(show.pictures(), len(rows), told), size, fps)
    return Film(target, len(rows), size, float(fps), tuple(show.notes))


def _told(pictures: Iterator[Floats], of: int, told: Callable[..., Any] | None) -> Iterator[Floats]:
    for done, each in enumerate(pictures, 1):
        yield each
        if told is not None:
            told(done, of)


def _checked_size(size: Any) -> tuple[int, int]:
    low, high = SIZES
    try:
        found = tuple(int(number(each)) for each in size)
        fine = len(found) == 2 and all(low <= each <= high and each % 2 == 0 for each in found)
    except (TypeError, ValueError, OverflowError):
        fine = False
    if not fine:
        given = "x".join(map(str, size)) if isinstance(size, tuple) else size
        raise InputError(
            f"size: expected two even numbers of pixels from {low} to {high}, such as 960x720, got {shown(given)}"
        )
    return found[0], found[1]


def _rows(run: reader.Run, fps: float, duration: float | None, every: int | None) -> list[int]:
    """Frame of the run for each picture of the film."""
    if duration is not None and every is not None:
        raise InputError("give every or duration, not both")
    if every is not None:
        if not (number(every).is_integer() and every >= 1):
            raise InputError(f"every: expected a whole number, 1 or more, got {shown(every)}")
        return list(range(0, len(run), int(every)))
    if duration is None:
        if len(run) <= LONGEST * fps:
            return list(range(len(run)))
        duration = LONGEST
    if not 0 < number(duration) <= 3600:
        raise InputError(f"duration: expected seconds, more than 0 and at most 3600, got {shown(duration)}")
    times = np.asarray(run.all_times)
    wanted = np.linspace(times[0], times[-1], max(round(duration * fps), 1))
    return [int(np.argmin(np.abs(times - each))) for each in wanted]
