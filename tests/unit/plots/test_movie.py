"""Films: their pictures are as many and as large as asked and not blank; what cannot be filmed is one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

import kickdrift as kd
from kickdrift.plots import movie
from kickdrift.plots.filmed import Bodies, Particles
from kickdrift.plots.scene import Camera, view
from tests.run_files import FRAMES, make_system, write

SIZE = (96, 64)


def decoded(path, size) -> np.ndarray:
    """Pictures (k, height, width, 3) of a film, read back by ffmpeg."""
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="ffmpeg of the extra movie")
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-loglevel", "error", "-i", path, "-fps_mode", "passthrough"]
    raw = subprocess.run([*command, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"], capture_output=True, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(-1, size[1], size[0], 3)


@pytest.fixture
def liquid(tmp_path):
    path = tmp_path / "liquid.h5md"
    write(path, make_system("lj"))
    return path


@pytest.fixture(scope="module")
def planets(tmp_path_factory):
    path = tmp_path_factory.mktemp("planets") / "planets.h5md"
    kd.Simulation(kd.load("two-body"), "leapfrog").run(200, every=20, output=path)
    return path


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_film_has_a_picture_for_each_frame(suffix, liquid):
    pytest.importorskip("imageio_ffmpeg", reason="ffmpeg of the extra movie")
    done: list[tuple[int, int]] = []
    found = kd.movie(liquid, liquid.with_suffix(suffix), size=SIZE, turn=40, progress=lambda *k: done.append(k))
    pictures = decoded(found.path, SIZE)
    assert len(pictures) == found.frames == FRAMES
    assert done == [(k, FRAMES) for k in range(1, FRAMES + 1)]
    assert pictures.std(axis=(1, 2, 3)).min() > 10
    assert all(np.abs(a.astype(int) - b).mean() > 0.5 for a, b in pairwise(pictures))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_film_that_is_ended_leaves_nothing(name, liquid, request):
    number = getattr(signal, name)
    before = signal.signal(number, signal.SIG_DFL)  # nohup ignores SIGHUP
    request.addfinalizer(lambda: signal.signal(number, before))
    with pytest.raises(SystemExit) as ended:
        kd.movie(liquid, liquid.with_suffix(".gif"), size=SIZE, progress=lambda *k: os.kill(os.getpid(), number))
    assert ended.value.code == 128 + number
    assert list(liquid.parent.iterdir()) == [liquid]
    assert signal.getsignal(number) == signal.SIG_DFL


def test_a_gif_needs_no_ffmpeg_and_shows_the_nearest_frames(planets, monkeypatch, tmp_path):
    monkeypatch.setattr(movie, "program", lambda: pytest.fail("a GIF needs no ffmpeg"))
    found = kd.movie(planets, tmp_path / "p.gif", size=SIZE, duration=0.6, fps=10)
    with Image.open(found.path) as film:
        assert (film.n_frames, film.size) == (6, SIZE)
        first = np.asarray(film.convert("RGB"))
        film.seek(5)
        last = np.asarray(film.convert("RGB"))
    assert first.std() > 5
    assert np.any(first != last)
    assert tuple(first[2, 2]) < (40, 40, 40)  # planets are shown before a dark sky


@pytest.mark.parametrize(
    ("output", "given", "line"),
    [
        ("f.avi", {}, "f.avi: the name of a film must end in .mp4, .webm, .gif, not '.avi'"),
        ("f.gif", {"fps": 0}, "fps: expected a number from 1 to 100, got 0"),
        ("f.gif", {"every": 2, "duration": 1}, "give every or duration, not both"),
        ("f.gif", {"size": (97, 64)}, "size: expected two even numbers of pixels from 64 to 4096"),
        ("f.gif", {"colour": "speeed"}, "colour: expected species, molecule, speed, body or a colour such as #0072B2"),
        ("f.gif", {"zoom": -1}, "zoom: expected a positive number, got -1"),
        ("f.gif", {"elevation": 100}, "elevation: expected an angle from -90 to 90 degrees, got 100"),
    ],
)  # fmt: skip
def test_what_cannot_be_asked_is_one_line(output, given, line, planets, tmp_path):
    with pytest.raises(kd.InputError) as error:
        kd.movie(planets, tmp_path / output, **given)
    assert line in str(error.value).replace(f"{tmp_path}/", "")
    assert not list(tmp_path.iterdir())


def test_a_missing_ffmpeg_says_what_to_install(liquid, monkeypatch, kickdrift):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setattr(movie.shutil, "which", lambda name: None)
    code, out, err = kickdrift("movie", liquid, liquid.with_suffix(".mp4"))
    assert (code, out) == (2, "")
    assert err == f"kickdrift: {movie.MISSING}\n"
    assert "pip install 'kickdrift[movie]'" in err


def test_an_existing_file_stays_unless_told(liquid, kickdrift):
    target = liquid.with_suffix(".gif")
    assert kickdrift("movie", liquid, target, "--size", "64x64", "--every", 2)[:2] == (
        0, f"{target}: 3 pictures of 64 x 64 pixels, 0.12 s\n",
    )  # fmt: skip
    first = target.read_bytes()
    code, _, err = kickdrift("movie", liquid, target)
    assert (code, target.read_bytes()) == (2, first)
    assert "exists already" in err
    assert kickdrift("movie", liquid, target, "--size", "64x64", "--overwrite", "--colour", "tomato")[0] == 0
    assert target.read_bytes() != first
    target.write_bytes(b"GIF89a of someone else")
    assert kickdrift("movie", liquid, target, "--overwrite")[0] == 2
    assert target.read_bytes() == b"GIF89a of someone else"


def test_a_file_without_frames_has_nothing_to_show(tmp_path, kickdrift):
    path = tmp_path / "empty.h5md"
    write(path, make_system("lj"), of=[])
    code, _, err = kickdrift("movie", path, tmp_path / "empty.gif")
    assert code == 2
    assert err.endswith("empty.h5md: holds no frames, so there is nothing to show\n")


def test_the_run_of_an_ode_is_refused(tmp_path, kickdrift):
    kd.Simulation(kd.load("ode-harmonic"), "rk4", dt=0.1).run(5, output=tmp_path / "ode.h5")
    code, _, err = kickdrift("movie", tmp_path / "ode.h5", tmp_path / "ode.gif")
    assert code == 2
    assert "is the run of an ODE" in err


def test_a_film_of_planets_shows_the_ellipse_of_each_body(planets):
    """A two-body orbit keeps its ellipse: all positions of the run lie on the ellipse of each frame."""
    with kd.open(planets) as run:
        bodies = Bodies(run, [0, 5, 10], SIZE, Camera(), None, None)
    for k, row in enumerate(bodies.rows):
        middle, long, short = bodies.ellipses[k, 1]
        centre = bodies.x[row, 1] + middle
        off = bodies.x[:, 1] - centre
        at = np.stack([off @ long / (long @ long), off @ short / (short @ short)])
        np.testing.assert_allclose(np.hypot(*at), 1.0, atol=2e-3)  # leapfrog's error at the step of the run
        assert bodies.scene.reach > np.linalg.norm(centre) + np.linalg.norm(long)
    assert np.isnan(bodies.ellipses[:, 0]).all()


def test_chains_have_bonds_within_the_box_and_one_colour_each(tmp_path):
    """Two chains of three along x in a cube of 6; the second one leaves the box between its beads 4 and 5."""
    x = [[1, 1, 1], [2, 1, 1], [3, 1, 1], [4, 4, 4], [5, 4, 4], [6.5, 4, 4]]
    melt = kd.System(x, box=[6.0] * 3, forces=[kd.HarmonicBond(10.0, 1.0)], topology=kd.Topology.chains(2, 3))
    kd.Simulation(melt, "velocity-verlet", dt=0.001).run(1, output=tmp_path / "melt.h5md")
    with kd.open(tmp_path / "melt.h5md") as run:
        film = Particles(run, [0], SIZE, Camera(), None, None)
        assert film.colouring == "molecule"
        frame = run[0]
        places, radii, colours = film._with_bonds(frame.wrapped(), film.colours, frame.box)
    assert len(np.unique(colours[:6], axis=0)) == 2
    assert np.array_equal(colours[:3], np.tile(colours[0], (3, 1)))
    sticks, per_bond = places[6:], (len(places) - 6) // 3  # three bonds of four: one crosses a face
    assert len(sticks) == 3 * per_bond > 0
    assert sticks[:, 0].max() < 5.0
    assert (radii[6:] < radii[:6].min()).all()
    assert kd.movie(tmp_path / "melt.h5md", tmp_path / "melt.gif", size=SIZE, colour="molecule").frames == 2


def test_the_camera_sees_what_is_nearer_larger():
    """From above, x and y are the picture's axes; a point towards the camera is larger, one behind it is not seen."""
    axes = Camera(azimuth=-90.0, elevation=90.0).at(0.0)
    seen = view(np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 2.0], [0, 0, 9.0]]), axes, reach=2.0, zoom=1.0)
    np.testing.assert_allclose(seen.xy[:2], [[0.5, 0.0], [0.0, 0.5]], atol=1e-12)
    assert seen.scale[2] == pytest.approx(0.5 * 4 / 3)
    assert np.isnan(seen.scale[3])
    turned = Camera(azimuth=-90.0, elevation=0.0, turn=90.0).at(1.0)
    np.testing.assert_allclose(turned[2], [1.0, 0.0, 0.0], atol=1e-12)


def test_too_many_particles_are_thinned_and_the_film_says_so(liquid, monkeypatch):
    from kickdrift.plots import filmed

    monkeypatch.setattr(filmed, "MOST", 5)
    found = kd.movie(liquid, liquid.with_suffix(".gif"), size=SIZE, every=4)
    assert found.notes == ("the film shows 5 of 12 particles, evenly chosen",)


def test_a_body_that_merges_is_filmed_up_to_its_end(tmp_path):
    """Names are shown as text: a dollar sign begins no formula."""
    pair = kd.System(
        [[-1, 0, 0], [1, 0.1, 0]], [[1, 0, 0], [-1, 0, 0]], masses=[2.0, 1.0], radii=0.3, names=["$A", "<b>$"],
        forces=[kd.Gravity(G=1e-3)], units="nbody", events=[kd.Collision()],
    )  # fmt: skip
    kd.Simulation(pair, "leapfrog", dt=0.05).run(40, every=4, output=tmp_path / "pair.h5md")
    assert kd.movie(tmp_path / "pair.h5md", tmp_path / "pair.gif", size=SIZE).frames == 11
