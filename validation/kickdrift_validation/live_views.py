"""Runs that are watched: the speed and the bits that they keep, what MDAnalysis reads, and views in a browser.

Another process reads the page of a run. What the page costs is the processor time of the frames and of the threads that
serve them; the rest of the run's time is the speed that it keeps. With --long, runs with a page and without take turns
as well, and the fastest turns are compared. Such ratios need a machine with nothing else to do.
MDAnalysis reads a run by IMDv3 in a process of its own, and has to find the frames of the run's file. With --long,
Chromium opens the live page, and a notebook in JupyterLab whose widget follows a run.
"""

import os
import secrets
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from time import perf_counter, process_time, sleep, thread_time
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.view.live import Feed
from kickdrift.view.server import Server
from kickdrift_validation.browsers import CHROMIUM, NEEDS, colours_of, opened
from kickdrift_validation.claim import Claim, claim, main, not_run

KEPT = 0.98  # of the speed
SECONDS, TURNS, LONG_TURNS = 2.0, 3, 10
SYSTEMS = ("lj-1000", "solar-system")
COLOURS = 50  # on a picture that is not blank
READ_PAGE = """
import http.client, sys
there = http.client.HTTPConnection("127.0.0.1", int(sys.argv[1]))
there.request("GET", f"/events?token={sys.argv[2]}")
answer = there.getresponse()
print(answer.status, flush=True)
print(answer.read().count(b"event: frame"), flush=True)
"""
READ_IMD = """
import sys, time, warnings
warnings.simplefilter("ignore")
import MDAnalysis, numpy as np
universe = MDAnalysis.Universe.empty(int(sys.argv[1]))
for _ in range(1200):
    try:
        universe.load_new(f"imd://localhost:{sys.argv[2]}")
        break
    except ConnectionError:  # the run is being compiled
        time.sleep(0.05)
found = [(ts.time, ts.positions.copy(), ts.velocities.copy(), ts.forces.copy()) for ts in universe.trajectory]
names = "times", "positions", "velocities", "forces"
np.savez(sys.argv[3], **dict(zip(names, map(np.array, zip(*found)))))
"""
NOTEBOOK = """
import kickdrift as kd
sim = kd.Simulation(kd.load("lj-1000"))
sim.view(height=400)
---
sim.run(20000, every=100)
"""


class Turn(NamedTuple):
    """Seconds of a run by the processor and by the clock, the Simulation, the number of frames that a page got, and the
    processor's seconds that the page took."""

    processor: float
    clock: float
    sim: kd.Simulation
    frames: int = 0
    cost: float = 0.0


def turn(name: str, steps: int, watched: bool) -> Turn:
    """A run with or without a live page."""
    sim = kd.Simulation(kd.load(name))
    sim.run(2)
    if not watched:
        return Turn(*timed(sim, steps), sim)
    server = Server(sim)
    sim.followers.append(server.feed)
    given = [sys.executable, "-c", READ_PAGE, str(server.port), server.token]
    with subprocess.Popen(given, stdout=subprocess.PIPE, text=True) as page:
        assert page.stdout
        assert page.stdout.readline().strip() == "200"
        spent, before = accounted(server.feed), thread_time()
        took = timed(sim, steps)
        served = took[0] - (thread_time() - before)  # by the other threads
        server.close()
        return Turn(*took, sim, int(page.stdout.readline()), served + sum(spent))


def accounted(feed: Feed) -> list[float]:
    """The processor's seconds of each call of the feed, which fill this list from now on."""
    found: list[float] = []

    def measured(act: Callable[..., None]) -> Callable[..., None]:
        def call(*given: Any) -> None:
            before = thread_time()
            act(*given)
            found.append(thread_time() - before)

        return call

    for name in ("begin", "follow", "end"):
        setattr(feed, name, measured(getattr(feed, name)))
    return found


def timed(sim: kd.Simulation, steps: int) -> tuple[float, float]:
    """Seconds of a run by the processor and by the clock."""
    began = process_time(), perf_counter()
    sim.run(steps)
    return process_time() - began[0], perf_counter() - began[1]


def enough_steps(name: str) -> int:
    """Number of steps that take the processor a turn's time."""
    sim, steps = kd.Simulation(kd.load(name)), 1000
    sim.run(2)
    while (took := timed(sim, steps)[0]) < SECONDS / 4:
        steps *= 2
    return int(SECONDS * steps / took)


def speeds(long: bool) -> Iterator[Claim]:
    """Speed and bits with a live page."""
    for name in SYSTEMS:
        steps = enough_steps(name)
        pairs = []
        for k in range(LONG_TURNS if long else TURNS):
            first = turn(name, steps, watched=k % 2 == 0)
            second = turn(name, steps, watched=k % 2 == 1)
            pairs.append((second, first) if k % 2 == 0 else (first, second))
        frames = sum(watched.frames for _, watched in pairs)
        kept = 1.0 - sum(live.cost for _, live in pairs) / sum(live.processor for _, live in pairs)
        text = f"{name}: part of the processor's time that a run with a live page keeps, {frames} frames"
        yield claim(text, kept, f">= {KEPT}", kept >= KEPT, "the same run")
        for what in ("processor", "clock") if long else ():
            alone, watched = (min(getattr(pair[i], what) for pair in pairs) for i in (0, 1))
            text = f"{name}: speed by the {what} with a live page over speed without, {frames} frames"
            yield claim(text, alone / watched, f">= {KEPT}", alone >= KEPT * watched, "the same run")
        plain, live = pairs[-1]
        same = np.array_equal(plain.sim.state.phase, live.sim.state.phase) and frames > len(pairs)
        yield claim(f"{name}: the bits after {steps:,} steps with a live page", same, "the same", same, "the same run")


def streamed() -> Iterator[Claim]:
    """What MDAnalysis reads by IMDv3."""
    text, reference = "frames by IMDv3 beside the run's file: largest difference", "MDAnalysis' IMD reader, imdclient"
    if not (find_spec("MDAnalysis") and find_spec("imdclient")):
        yield not_run(text, "<= 1e-6", reference)
        return
    for name in ("lj-1000", "argon-864"):
        with tempfile.TemporaryDirectory() as folder:
            found, path = Path(folder) / "found.npz", Path(folder) / "run.h5md"
            sim, port = kd.Simulation(kd.load(name)), free_port()
            given = [sys.executable, "-c", READ_IMD, str(len(sim.system)), str(port), str(found)]
            forces: list[np.ndarray] = []
            with subprocess.Popen(given) as reader:
                sim.run(
                    200, every=20, output=path, observe=lambda sim, into=forces: into.append(sim.forces()),
                    imd=port, imd_wait=True,
                )  # fmt: skip
                reader.wait(120)
            read = np.load(found)
            with kd.open(path) as run:
                per_mole = 96.48533212331 if run.units.energy == "eV" else 1.0
                pairs = [
                    (read["times"], run.times),
                    (read["positions"], np.array([frame.positions for frame in run])),
                    (read["velocities"], np.array([frame.velocities for frame in run])),
                    (read["forces"], per_mole * np.array(forces)),
                ]
            off = max(float(np.abs(a - b).max() / np.abs(b).max()) for a, b in pairs)
            yield claim(f"{name}: {text}", off, "<= 1e-6 of the largest", off <= 1e-6, reference)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def live_page() -> Iterator[Claim]:
    text = "the live page in Chromium"
    if CHROMIUM is None or not find_spec("playwright"):
        yield not_run(text, "steps rise", "Chromium", NEEDS)
        return
    sim = kd.Simulation(kd.load("lj-1000"))
    sim.run(2)
    server = Server(sim)
    sim.followers.append(server.feed)
    with opened() as page:
        errors, requests = [], []
        page.on("console", lambda said: errors.append(said.text) if said.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(server.address)
        page.wait_for_function("globalThis.view !== undefined")
        steps: list[int] = []
        running = Thread(target=sim.run, args=(20_000,))
        running.start()
        began = perf_counter()
        while perf_counter() - began < 120 and (not steps or steps[-1] < sim.steps_done or running.is_alive()):
            page.wait_for_timeout(100)
            found = int(page.evaluate("document.body.dataset.step ?? -1"))
            if found >= 0 and (not steps or found != steps[-1]):
                steps.append(found)
        running.join()
        yield claim(f"{text}: errors on its console", len(errors), "0", not errors, "Chromium")
        outside = [
            url for url in requests if not url.startswith((f"http://127.0.0.1:{server.port}/", "data:", "blob:"))
        ]
        yield claim(f"{text}: requests beyond the page's server", len(outside), "0", not outside, "Chromium")
        rises = len(steps) >= 3 and steps == sorted(steps) and steps[-1] == sim.steps_done
        shown = f"{len(steps)} counts up to {steps[-1] if steps else 0:,}"
        yield claim(
            f"{text}: step counts while it runs", shown, f"3 or more, up to {sim.steps_done:,}", rises, "the run"
        )
        seen = colours_of(page.screenshot())
        yield claim(f"{text}: colours in its picture", seen, f">= {COLOURS}", seen >= COLOURS, "Chromium")
    server.close()


def notebook() -> Iterator[Claim]:
    """A widget in JupyterLab that follows a run."""
    text = "a widget in JupyterLab"
    missing = [name for name in ("jupyterlab", "anywidget", "playwright", "nbformat") if not find_spec(name)]
    if CHROMIUM is None or missing:
        yield not_run(text, "steps rise", "JupyterLab in Chromium", f"pip install {' '.join(missing)}; {NEEDS}")
        return
    with tempfile.TemporaryDirectory() as folder, jupyterlab(Path(folder)) as address, opened() as page:
        page.goto(address, timeout=120_000)
        page.wait_for_selector(".jp-Notebook .jp-Cell", timeout=120_000)
        page.wait_for_timeout(3000)
        page.click("text=Run >> nth=0")
        page.click("text=Run All Cells")
        steps: list[int] = []
        began = perf_counter()
        while perf_counter() - began < 120 and (not steps or steps[-1] < 20_000):
            found = page.evaluate(
                "[...document.querySelectorAll('[data-step]')].map((each) => Number(each.dataset.step))"
            )
            if found and (not steps or found[0] != steps[-1]):
                steps.append(found[0])
            page.wait_for_timeout(100)
        rises = len(steps) >= 3 and steps == sorted(steps) and steps[-1] == 20_000
        shown = f"{len(steps)} counts up to {steps[-1] if steps else 0:,}"
        yield claim(f"{text}: step counts while the cell runs", shown, "3 or more, up to 20,000", rises, "JupyterLab")
        view = page.locator("[data-step]").first
        view.scroll_into_view_if_needed()
        seen = colours_of(view.screenshot())
        yield claim(f"{text}: colours in its picture", seen, f">= {COLOURS}", seen >= COLOURS, "Chromium")


@contextmanager
def jupyterlab(folder: Path) -> Iterator[str]:
    """A JupyterLab with the notebook; yields the notebook's address."""
    import nbformat

    cells: list[Any] = [nbformat.v4.new_code_cell(each.strip()) for each in NOTEBOOK.split("---")]
    kernel = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=kernel), folder / "live.ipynb")
    port, token = free_port(), secrets.token_hex(16)
    own = {name: str(folder / name.lower()) for name in
           ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR")}  # fmt: skip
    given = [
        sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", f"--port={port}", "--ip=127.0.0.1",
        f"--IdentityProvider.token={token}", f"--ServerApp.root_dir={folder}", "--LabApp.news_url=None",
    ]  # fmt: skip
    with (folder / "log").open("w") as log:
        lab = subprocess.Popen(given, env=os.environ | own, stdout=log, stderr=log)
        try:
            for _ in range(600):
                with socket.socket() as probe:
                    if probe.connect_ex(("127.0.0.1", port)) == 0:
                        break
                sleep(0.1)
            yield f"http://127.0.0.1:{port}/lab/tree/live.ipynb?token={token}"
        finally:
            lab.terminate()
            lab.wait(30)


def claims(long: bool = False) -> Iterator[Claim]:
    yield from speeds(long)
    yield from streamed()
    if long:
        yield from live_page()
        yield from notebook()


if __name__ == "__main__":
    main(claims, __doc__)
