"""Where cases run: the run files that they damage, the inputs that command lines find, and what lies outside."""

import hashlib
import os
import shutil
import stat
from pathlib import Path
from typing import Any

import h5py
import numpy as np

MARK = "KEEP-OUT-7391"  # in every file outside: no case may print it
MARK_NUMBER = 739173917391.0
LIQUID = """
units = "lj"
particles = { lattice = "sc", count = 125, density = 0.8, mass = 1.0, species = "A" }
velocities = { temperature = 1.0, seed = 1 }
box = { periodic = true }
force = [{ type = "lennard-jones", epsilon = 1.0, sigma = 1.0, cutoff = 2.2, truncation = "shift" }]
run = { integrator = "velocity-verlet", dt = 0.005, steps = 20, every = 4 }
"""
BODIES = """
units = "nbody"
particles = { masses = [1.0, 0.5, 0.2], positions = [[0.0, 0, 0], [1, 0, 0], [0, 3, 0]] }
velocities = { values = [[0.0, 0, 0], [0, 1.2, 0], [0.6, 0, 0]] }
force = [{ type = "gravity" }]
run = { integrator = "leapfrog", dt = 0.01, steps = 40, every = 4 }
"""
MEASURE = "def f(sim):\n    return {'x': float(sim.state.positions.sum())}\n"
LONG_STEPS, LONG_EVERY = 1600, 20  # of the runs that are killed
ENSEMBLE = (
    "ensemble", "s.toml", "--vary", "dt=0.001:0.002:6", "--steps", "20000", "--every", "1000", "--workers", "1",
    "--output", "t.parquet", "--quiet",
)  # fmt: skip
MEMBERS = ("members.h5", "members.parquet")  # tables of an ensemble
JOURNAL = "t.parquet.journal"
WHOLE = {"bodies": "bodies.h5md", "liquid": "liquid.h5md", "unfinished": "bodies.h5md"}  # and the file of the whole run


def make_bases(folder: Path) -> None:
    """Write the run files that cases damage, one of them as a kill leaves it."""
    import kickdrift as kd

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "lj.toml").write_text(LIQUID, encoding="utf-8")
    (folder / "s.toml").write_text(BODIES, encoding="utf-8")
    bodies, liquid = kd.load(folder / "s.toml"), kd.load(folder / "lj.toml")
    often = kd.FileOptions(flush=1e-9)
    kd.Simulation(bodies).run(40, every=4, output=folder / "bodies.h5md", file=often)
    file = kd.FileOptions(flush=1e-9, write=("images", "forces"), compress=True)
    kd.Simulation(liquid).run(20, every=4, output=folder / "liquid.h5md", file=file)
    left_at(bodies, folder / "unfinished.h5md", 40, 4, 28)
    make_long(bodies, folder)
    shutil.copy(folder / "bodies.h5md", folder / "old.h5md")
    (folder / "old.json").write_text("{}\n")
    (folder / "old.png").write_bytes(b"\x89PNG\r\n\x1a\n")
    make_tables(folder)
    (folder / "measure.py").write_text(MEASURE)
    (folder / "broken.toml").write_text("[run\n")
    (folder / "text.txt").write_text("a text of mine\n")
    shutil.copy(folder / "text.txt", folder / "text.h5md")
    (folder / "empty").write_text("")


def make_tables(folder: Path) -> None:
    """Write tables as of an ensemble of 20 members."""
    from kickdrift.ensemble import table

    rows: list[dict[str, Any]] = [
        {"member": k, "seed": 7 * k, "dt": 0.001 * k, "status": "done", "error": "", "energy": k / 3 - 1.5,
         "momentum": [0.1 * k, 0.2, 0.3], "closed": k % 2 == 0, "verdict": "bounded", "integrator": "rk4",
         "stopped": "", "warnings": ""} for k in range(20)
    ]  # fmt: skip
    provenance = {"identity": {"system": "s"}, "system": "s", "seed": 0, "members": 20, "replicas": 1, "draws": {},
                  "grids": {"dt": [0.001 * k for k in range(20)]}}  # fmt: skip
    for name in MEMBERS:
        table.write(table.frame(rows, provenance), folder / name)


def left_at(system: Any, path: Path, steps: int, every: int, last: int) -> None:
    """Write the file of a run that ends at step ``last`` as by a kill."""
    import kickdrift as kd

    if not (child := os.fork()):

        def end(state: Any) -> None:
            if state.steps_done >= last:
                os._exit(0)

        kd.Simulation(system).run(steps, every=every, output=path, file=kd.FileOptions(flush=1e-9), observe=end)
        os._exit(1)
    assert os.waitpid(child, 0)[1] == 0


def make_long(bodies: Any, folder: Path) -> None:
    """Write the runs that kills are compared with, one whole and one that was left half-way."""
    import kickdrift as kd

    often = kd.FileOptions(flush=1e-9)
    kd.Simulation(bodies).run(LONG_STEPS, every=LONG_EVERY, output=folder / "long.h5md", file=often)
    left_at(bodies, folder / "half.h5md", LONG_STEPS, LONG_EVERY, LONG_STEPS // 2)


def make_outside(folder: Path) -> None:
    """Files that no case may read or write, but by a link that it finds."""
    folder.mkdir(parents=True)
    (folder / "secret.txt").write_text(f"{MARK}\n")
    np.full(300, MARK_NUMBER).tofile(folder / "secret.bin")
    with h5py.File(folder / "secret.h5", "w") as file:
        file.attrs["name"] = MARK
        file["text"] = MARK
        file["numbers"] = np.full((11, 3, 3), MARK_NUMBER)
        file["step"] = np.arange(11) * 4
        file.create_dataset("grows", data=np.full((11, 3, 3), MARK_NUMBER), maxshape=(None, 3, 3))


def furnish(work: Path, base: Path) -> None:
    """Put the usual inputs in the folder, and what is no plain file."""
    for path in base.iterdir():
        if path.name not in ("long.h5md", "half.h5md"):
            shutil.copy(path, work / path.name)
    (work / "folder").mkdir()
    os.mkfifo(work / "pipe")
    os.symlink("loop", work / "loop")
    os.symlink("s.toml", work / "link.toml")


def touched(folder: Path) -> tuple[tuple[str, int, int], ...]:
    """What tells quickly whether anybody wrote to a folder of plain files."""
    found = sorted(folder.iterdir()) if folder.is_dir() else ()
    return tuple((each.name, each.stat().st_mtime_ns, each.stat().st_size) for each in found)


def prints(folder: Path) -> dict[str, tuple[object, ...]]:
    """What each file of a folder is, its mode, and the hash of its content."""
    found: dict[str, tuple[object, ...]] = {}
    for path in sorted(folder.rglob("*")):
        mode = path.lstat().st_mode
        if stat.S_ISREG(mode):
            content: object = hashlib.sha1(path.read_bytes()).hexdigest()
        elif stat.S_ISLNK(mode):
            content = os.readlink(path)
        else:
            content = None
        found[str(path.relative_to(folder))] = (mode, content)
    return found


def changes(before: dict[str, tuple[object, ...]], after: dict[str, tuple[object, ...]]) -> tuple[set[str], set[str]]:
    """Names of files that were changed or lost, and of new ones."""
    return {name for name in before if after.get(name) != before[name]}, set(after) - set(before)
