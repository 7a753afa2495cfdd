"""Do films hold what they should?

Films of ten seconds of a liquid and of planets, as MP4, WebM and GIF, are read back by ffmpeg and by Pillow. They must
have the right number of pictures, the right size, and no blank picture. In a film of one particle, the disc must be
where the frames say: perspective is computed here once more.
"""

import math
import re
import subprocess
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import imageio_ffmpeg
import numpy as np

import kickdrift as kd
from kickdrift.plots.movie import Film
from kickdrift_validation.claim import Claim, claim, main, under

FPS, SECONDS, SIZE = 25, 10, (640, 480)
PICTURES = FPS * SECONDS
AWAY = 4.0  # the camera's distance, in half heights of the picture


def read_back(path: Path, size: tuple[int, int]) -> np.ndarray:
    """Pictures (k, height, width, 3) of a film, decoded by ffmpeg, none of them repeated or left out."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-i", str(path), "-fps_mode", "passthrough"]
    raw = subprocess.run([*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 3)


def said_size(path: Path) -> tuple[int, int] | None:
    """Width and height of the film by ffmpeg's description of the file."""
    text = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-i", str(path)], capture_output=True, text=True
    ).stderr
    found = re.search(r"Video: .*?, (\d+)x(\d+)[, ]", text)
    return None if found is None else (int(found[1]), int(found[2]))


def read_gif(path: Path) -> np.ndarray:
    """Pictures (k, height, width, 3) of a GIF, decoded by Pillow."""
    from PIL import Image, ImageSequence

    with Image.open(path) as film:
        return np.array([np.asarray(each.convert("RGB")) for each in ImageSequence.Iterator(film)])


def checked(what: str, found: Film, pictures: np.ndarray, size: tuple[int, ...] | None) -> Iterator[Claim]:
    reader = "Pillow" if found.path.suffix == ".gif" else "ffmpeg"
    yield claim(f"{what}: pictures", len(pictures), f"{PICTURES}", len(pictures) == PICTURES == found.frames, reader)
    yield claim(f"{what}: size", f"{size[0]}x{size[1]}" if size else "none", "640x480", size == SIZE, reader)
    spread = float(pictures.reshape(len(pictures), -1).std(axis=1).min())
    yield claim(f"{what}: least standard deviation of a picture, of 255", spread, "over 8", spread > 8, reader)
    apart = np.array([np.abs(a.astype(np.int16) - b).max() for a, b in pairwise(pictures)])
    moved = float(np.mean(apart > 20))
    yield claim(f"{what}: share of pictures that differ from the one before", moved, "over 0.95", moved > 0.95, reader)


def one_particle(folder: Path) -> Claim:
    """The disc of a lone particle beside its place by perspective."""
    system = kd.System([[0.0, 0.0, 0.0]], [[0.6, 0.25, 0.4]], units="lj")
    sim = kd.Simulation(system, "leapfrog", dt=0.05)
    sim.run(40, every=2, output=folder / "one.h5md")
    film = kd.movie(
        folder / "one.h5md", folder / "one.mp4", size=SIZE, colour="#ff0000", azimuth=-90.0, elevation=90.0, dark=False
    )
    pictures = read_back(film.path, SIZE).astype(float)
    with kd.open(folder / "one.h5md") as run:
        x = np.array([frame.positions[0] for frame in run])
    middle = np.median(x[np.unique(np.linspace(0, len(x) - 1, 12).astype(int))], axis=0)
    far = np.linalg.norm(x[np.unique(np.linspace(0, len(x) - 1, 12).astype(int))] - middle, axis=1)
    reach = 1.15 * float(np.quantile(far, 0.95))
    worst = 0.0
    for picture, place in zip(pictures, x - middle, strict=True):
        red = picture[..., 0] - picture[..., 1:].max(axis=2)
        rows, columns = np.nonzero(red > 60)
        near = AWAY * reach / (AWAY * reach - place[2]) / reach * SIZE[1] / 2
        expected = SIZE[0] / 2 + place[0] * near, SIZE[1] / 2 - place[1] * near
        middle_of_disc = (columns.min() + columns.max()) / 2 + 0.5, (rows.min() + rows.max()) / 2 + 0.5
        inside = min(columns.min(), rows.min()) > 0 and columns.max() < SIZE[0] - 1 and rows.max() < SIZE[1] - 1
        if inside:
            worst = max(worst, math.dist(expected, middle_of_disc))
    text = "one particle: largest distance of its disc from its place, in pixels"
    return under(text, worst, 2.5, "perspective, computed apart")


def claims(long: bool = False) -> Iterator[Claim]:
    """All claims; the long set has WebM of the liquid too."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sim = kd.Simulation(kd.load("lj-1000"), dt=0.005)
        sim.run(500, every=2, output=folder / "liquid.h5md")
        planets = kd.Simulation(kd.load("outer-solar-system"))
        planets.run(3000, every=12, output=folder / "planets.h5md")
        for what in ("liquid", "planets"):
            for suffix in (".mp4", ".webm", ".gif"):
                if suffix == ".webm" and not long and what == "liquid":
                    continue  # a minute of VP9
                film = kd.movie(
                    folder / f"{what}.h5md", folder / f"{what}{suffix}", duration=SECONDS, fps=FPS, size=SIZE,
                    turn=90.0, elevation=40.0,
                )  # fmt: skip
                gif = suffix == ".gif"
                pictures = read_gif(film.path) if gif else read_back(film.path, SIZE)
                size = pictures.shape[2:0:-1] if gif else said_size(film.path)
                yield from checked(f"{what}{suffix}", film, pictures, size)
        yield one_particle(folder)


if __name__ == "__main__":
    main(claims, __doc__)
