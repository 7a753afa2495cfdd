"""Films of runs: a liquid as spheres in its box, planets with trails and names. Pictures are written one by one."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift.disk.kinds import FILM
from kickdrift.disk.outputs import checked_target, written_whole
from kickdrift.display.showing import following
from kickdrift.errors import InputError, RunError
from kickdrift.model.checks.values import number
from kickdrift.model.state import Floats
from kickdrift.plots.filmed import Bodies, Particles, has_trails
from kickdrift.plots.scene import Camera
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

    Particles are spheres, inside the box where it is periodic; bonds join smaller ones. A film of at most 30 bodies
    under gravity has their trails and names. It is seen from their barycentre, and z is the direction of their angular
    momentum. MP4 and WebM need ffmpeg, which the extra ``movie`` installs.

    Parameters
    ----------
    path : a run's file
    output : the new file; it is written whole or not at all
    azimuth, elevation : where the camera stands, in degrees about z and above the x-y plane
    turn : angle in degrees by which the camera turns about z during the film
    zoom : magnification
    colour : "species", "molecule", "speed", "body", or one of matplotlib's colours for all; default "body" with trails,
        "species" for a mixture, "molecule" for chains of one species and "speed" for the rest
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


MARK = "kickdrift"  # comment in every film
CODECS = {
    ".mp4": ("mp4", "-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-movflags", "+faststart"),
    ".webm": ("webm", "-c:v", "libvpx-vp9", "-crf", "30", "-b:v", "0", "-cpu-used", "5"),
}  # fmt: skip
GIF = ".gif"
MISSING = "films in .mp4 and .webm need ffmpeg: pip install 'kickdrift[movie]' brings ffmpeg, and .gif needs nothing"


def ffmpeg() -> str | None:
    """Path of ffmpeg: that of the package imageio-ffmpeg, else one on the path, else None."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        return shutil.which("ffmpeg")


def program() -> str:
    """Path of ffmpeg; see `ffmpeg`. Raises InputError without any."""
    if (found := ffmpeg()) is None:
        raise InputError(MISSING)
    return found


def write(path: Path, pictures: Iterator[Floats], size: tuple[int, int], fps: float) -> None:
    """Write pictures (height, width, 4) of bytes as a film; the suffix names the format."""
    if path.suffix.lower() == GIF:
        _write_gif(path, pictures, fps)
    else:
        _write_by_ffmpeg(path, pictures, size, fps)


def _write_gif(path: Path, pictures: Iterator[Floats], fps: float) -> None:
    """A GIF that repeats for ever. Its frames last whole hundredths of a second."""
    from PIL import Image

    def images() -> Iterator[Image.Image]:
        for each in pictures:
            yield Image.fromarray(np.ascontiguousarray(each[..., :3])).quantize(128, Image.Quantize.FASTOCTREE)

    found = images()
    first = next(found)
    with path.open("wb") as file:  # Pillow would leave the file open where a signal ends the program
        first.save(
            file, format="GIF", save_all=True, append_images=found, duration=max(round(100 / fps), 2) * 10, loop=0,
            comment=MARK.encode(),
        )  # fmt: skip


def _write_by_ffmpeg(path: Path, pictures: Iterator[Floats], size: tuple[int, int], fps: float) -> None:
    form, *codec = CODECS[path.suffix.lower()]
    command = [
        program(), "-hide_banner", "-loglevel", "error", "-nostdin", "-y", "-f", "rawvideo", "-pix_fmt", "rgba",
        "-s", f"{size[0]}x{size[1]}", "-r", f"{fps:g}", "-i", "pipe:0", *codec,
        "-pix_fmt", "yuv420p", "-metadata", f"comment={MARK}", "-f", form, str(path),
    ]  # fmt: skip
    with tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=errors)
        assert process.stdin is not None
        try:
            for each in pictures:
                process.stdin.write(np.ascontiguousarray(each).data)
            process.stdin.close()
        except BrokenPipeError:  # ffmpeg has ended, and says why
            pass
        except BaseException:
            process.kill()
            raise
        finally:
            process.wait()
        if process.returncode:
            errors.seek(0)
            said = errors.read().decode(errors="replace").strip().splitlines()
            raise RunError(f"{path.name}: ffmpeg failed: {said[-1] if said else process.returncode}")
