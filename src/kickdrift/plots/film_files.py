"""Files of films: MP4 and WebM through ffmpeg, GIF through Pillow. Pictures come one by one, so any length fits."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from kickdrift.errors import InputError, RunError
from kickdrift.model.state import Floats

MARK = "kickdrift"  # comment in every film
CODECS = {
    ".mp4": ("mp4", "-c:v", "libx264", "-preset", "veryfast", "-crf", "20", "-movflags", "+faststart"),
    ".webm": ("webm", "-c:v", "libvpx-vp9", "-crf", "30", "-b:v", "0", "-cpu-used", "5"),
}  # fmt: skip
GIF = ".gif"
MISSING = "films in .mp4 and .webm need ffmpeg: pip install 'kickdrift[movie]' brings ffmpeg, and .gif needs nothing"


def program() -> str:
    """Path of ffmpeg: that of the package imageio-ffmpeg, else one on the path. Raises InputError without any."""
    try:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        found = shutil.which("ffmpeg")
    if found is None:
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
