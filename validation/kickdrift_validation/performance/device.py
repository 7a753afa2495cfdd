"""Checks and timings of ``--engine cuda`` on a graphics processor, in one JSON.

Usage: python -m kickdrift_validation.performance.device OUT.json [SECTION ...]

Every section stands alone: its error becomes a line of the JSON, and the next section runs. The file is written after
each. Forces are compared with sums by SciPy's tree of neighbours and by NumPy, which are not kickdrift's code. Times
are those between two events of the device, or of the wall around steps that end with a copy from the device.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

import kickdrift as kd
from kickdrift.engines.cuda.device import check_device, processors
from kickdrift.engines.cuda.forces import PairForces
from kickdrift.engines.cuda.steps import CudaSession
from kickdrift.engines.job import Job
from kickdrift.integrators import INTEGRATORS
from kickdrift.integrators.asked import settled
from kickdrift.model.run_defaults import RunDefaults
from kickdrift.model.starts.builders import lattice, maxwell_boltzmann

DENSITY, TEMPERATURE, CUTOFF, DT = 0.8442, 1.44, 2.5, 0.005
PARTICLES = (10_648, 97_336, 1_000_000, 10_077_696)
BODIES = (10_000, 100_000, 1_000_000)
TUNED = (0.16, 0.2, 0.24, 0.3, 0.36)  # skins
MELTING = 200  # steps before a timing
SECONDS = 1.5  # of a timing, about
SOFTENING = 0.01


@kd.pair_law
class Morse(NamedTuple):
    """A law as a user writes it: U = D ((1 - exp(-w (r - l)))^2 - 1)."""

    depth: float = 1.0
    width: float = 6.0
    length: float = 1.1

    dimensions = {"depth": "energy", "length": "length"}  # noqa: RUF012

    def law(p, r2):
        r = math.sqrt(r2)
        e = math.exp(-p.width * (r - p.length))
        return p.depth * (e * e - 2.0 * e), 2.0 * p.depth * p.width * (e * e - e) / r


def liquid(n: int, force: Any = None, jitter: float = 0.05) -> kd.System:
    """About n particles near a simple cubic lattice, in a periodic box."""
    x, edges = lattice("sc", round(n ** (1 / 3)) ** 3, DENSITY)
    x += np.random.default_rng(1).uniform(-jitter, jitter, x.shape)
    v = maxwell_boltzmann(np.ones(len(x)), TEMPERATURE, 1.0, seed=1)
    return kd.System(x, v, box=np.array(edges), forces=[force or kd.LennardJones(cutoff=CUTOFF)])


def cluster(n: int) -> kd.System:
    """Bodies of a Gaussian cluster of total mass 1."""
    rng = np.random.default_rng(2)
    x, v = rng.normal(size=(2, n, 3))
    masses = rng.uniform(0.5, 1.5, n) / n
    return kd.System(x, 0.5 * v, masses, forces=[kd.Gravity(G=1.0, softening=SOFTENING)], units="nbody")


def session(system: kd.System, precision: str, dt: float, begun: bool = True) -> CudaSession:
    """Velocity Verlet on the device, at the state of the system if ``begun``."""
    method = INTEGRATORS["velocity-verlet"]
    options = settled(method, {"dt": dt, "precision": precision}, RunDefaults())
    made = CudaSession(Job(system, method, method.name, options))
    if begun:
        made.reset(system.state.phase, 0.0)
    return made


def tree_sums(system: kd.System) -> tuple[np.ndarray, float, float]:
    """Accelerations (3, n), energy and virial by SciPy's tree of neighbours; masses are one."""
    from scipy.spatial import cKDTree

    force, edges = system.forces[0], np.diag(system.box.matrix)
    x = np.mod(system.state.positions, edges)
    i, j = cKDTree(x, boxsize=edges).query_pairs(force.cutoff, output_type="ndarray").T
    d = x[i] - x[j]
    d -= edges * np.round(d / edges)
    r2 = np.einsum("nk,nk->n", d, d)
    law = force.pair_law("A", "A")
    if isinstance(force, kd.LennardJones):
        inverse6 = r2**-3
        energy, g = 4.0 * (inverse6 - 1.0) * inverse6, 24.0 * (2.0 * inverse6 - 1.0) * inverse6 / r2
    else:
        e = np.exp(-law.width * (np.sqrt(r2) - law.length))
        energy, g = law.depth * (e * e - 2 * e), 2 * law.depth * law.width * (e * e - e) / np.sqrt(r2)
    energy -= law.law(force.cutoff**2)[0]
    pulls = g[:, None] * d
    a = np.array([np.bincount(i, pulls[:, k], len(x)) - np.bincount(j, pulls[:, k], len(x)) for k in range(3)])
    return a, float(energy.sum()), float((g * r2).sum())


def gravity_sums(system: kd.System) -> np.ndarray:
    x, m = system.state.positions, system.state.masses
    a = np.zeros((3, len(x)))
    for k in range(0, len(x), 256):
        d = x[None] - x[k : k + 256, None]
        a[:, k : k + 256] = np.einsum("inx,in->xi", d, m / (np.einsum("inx,inx->in", d, d) + SOFTENING**2) ** 1.5)
    return a


def error(found: np.ndarray, expected: np.ndarray) -> dict[str, float]:
    """Differences of vectors (3, n): largest over the largest vector, and root mean squares over each other."""
    difference = found - expected
    size = np.sqrt((expected**2).sum(0))
    return {
        "largest_over_largest": float(np.sqrt((difference**2).sum(0)).max() / size.max()),
        "rms_over_rms": float(np.sqrt((difference**2).sum() / (expected**2).sum())),
    }


def step_forces(made: CudaSession) -> np.ndarray:
    """Accelerations that steps use."""
    made.forces.evaluate(made.particles)
    return made.particles.in_order(made.particles.a)


def timed(made: CudaSession, work: Callable[[], Any], repeats: int = 10, rounds: int = 5) -> float:
    """Median seconds of work of the device, in graphs of several repeats."""
    key, stream, found = object(), made.launches.stream, []
    many = partial(_repeated, work, repeats)
    for _ in range(3):
        made.launches.repeat(key, many)
    for _ in range(rounds):
        begin, end = cuda.event(), cuda.event()
        begin.record(stream)
        made.launches.repeat(key, many)
        end.record(stream)
        end.synchronize()
        found.append(begin.elapsed_time(end) / 1e3 / repeats)
    return float(np.median(found))


def _repeated(work: Callable[[], Any], repeats: int) -> None:
    for _ in range(repeats):
        work()


def steps_a_second(made: CudaSession, warm: int | None = None) -> dict[str, float]:
    """Steps a second of the wall; the numbers of steps, of lists and of blocks that were taken back."""
    made.advance(warm or MELTING, np.inf)
    begin = time.perf_counter()
    made.advance(100 if warm is None else 5, np.inf)
    each = (time.perf_counter() - begin) / (100 if warm is None else 5)
    count, lists, returns = max(10, min(50_000, int(SECONDS / each))), made.lists, made.returns
    begin = time.perf_counter()
    made.advance(count, np.inf)
    taken = time.perf_counter() - begin
    lists, returns = made.lists - lists, made.returns - returns
    return {"steps_per_s": count / taken, "steps": count, "lists": lists, "returns": returns}


def other_list(system: kd.System, precision: str, skin: float, lanes: int) -> CudaSession:
    """A session with a list of another skin, and other threads for each particle."""
    made = session(system, precision, DT, begun=False)
    made.forces = PairForces(system, made.launches, precision == "mixed", skin, lanes)
    made.reset(system.state.phase, 0.0)
    return made


# --- sections ---


def environment() -> dict[str, Any]:
    from importlib.metadata import version

    check_device()
    device = cuda.get_current_device()
    free, total = cuda.current_context().get_memory_info()
    found = {
        "device": str(device.name), "compute_capability": list(device.compute_capability), "free": free, "total": total,
        "multiprocessors": processors(), "python": sys.version,
        **{name: version(name) for name in ("numba", "numba-cuda", "numpy", "cuda-bindings")},
    }  # fmt: skip
    try:
        query = ["nvidia-smi", "--query-gpu=name,driver_version,clocks.max.sm,clocks.sm", "--format=csv,noheader"]
        found["nvidia_smi"] = subprocess.run(query, capture_output=True, text=True).stdout.strip()
    except OSError:
        pass
    here, there = (cuda.device_array(2**28, np.float64) for _ in range(2))
    begin, end = cuda.event(), cuda.event()
    there.copy_to_device(here)
    begin.record()
    for _ in range(10):
        there.copy_to_device(here)
    end.record()
    end.synchronize()
    found["copy_bytes_per_s"] = 20 * here.nbytes / (begin.elapsed_time(end) / 1e3)
    return found


def pair_forces() -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, n, force in (("lennard-jones", 97_336, None), ("morse", 10_648, Morse(cutoff=2.5))):
        system = liquid(n, force)
        made = session(system, "double", DT / 2)
        made.advance(MELTING, np.inf)
        system = system.at(made.phase(), 0.0)
        a, energy, virial = tree_sums(system)
        for precision in ("double", "mixed"):
            begin = time.perf_counter()
            made = session(system, precision, DT)
            made.advance(2, np.inf)
            first = time.perf_counter() - begin
            made.reset(system.state.phase, 0.0)
            own = error(step_forces(made), a)
            measured = made.measure(0.0)
            own |= {f"measured_{key}": value for key, value in error(measured.accelerations, a).items()}
            own["energy"] = abs(measured.potential / energy - 1)
            own["virial"] = abs(measured.virial / virial - 1)
            own["momentum"] = float(np.abs(step_forces(made).sum(1)).max())
            own["seconds_to_first_steps"] = first
            found[f"{name} {precision} {len(system)}"] = own
    return found


def gravity_forces() -> dict[str, Any]:
    system = cluster(BODIES[0])
    a = gravity_sums(system)
    found = {}
    for precision in ("double", "mixed"):
        made = session(system, precision, 1e-3)
        found[precision] = error(step_forces(made), a)
        measured = made.measure(0.0)
        found[precision]["momentum"] = float(np.abs(measured.accelerations @ system.state.masses).max())
    return found


def beside_the_processor() -> dict[str, Any]:
    """Largest differences from the native engine after 50 steps: mixtures and baths."""
    found = {}
    laws = {"species": {"A": {}, "B": {"sigma": 0.88, "epsilon": 0.5}}, "pairs": {("A", "B"): {"epsilon": 1.5}}}
    mixture = liquid(10_648, kd.LennardJones(cutoff=CUTOFF, **laws)).remade(species=["A", "A", "B", "A"] * 2_662)
    bath = {"temperature": 1.2, "seed": 3}
    for name, system, method, options in (
        ("mixture", mixture, "velocity-verlet", {}),
        ("mixture, mixed", mixture, "velocity-verlet", {"precision": "mixed"}),
        ("baoab", liquid(10_648), "baoab", bath | {"friction": 2.0}),
        ("andersen", liquid(10_648), "andersen", bath | {"collision_rate": 2.0}),
        ("csvr", liquid(10_648), "csvr", bath | {"tau": 0.1}),
        ("nose-hoover", liquid(10_648), "nose-hoover", {"temperature": 1.2, "tau": 0.1}),
    ):
        ours, theirs = (kd.Simulation(system, method, DT / 5, engine=each, **options) for each in ("native", "cuda"))
        forces, native = theirs.forces(), ours.forces()
        own = error(forces.T, native.T)
        heats = [sim.run(50, every=50).heat or 0.0 for sim in (ours, theirs)]
        apart = theirs.state.phase - ours.state.phase
        own |= {"positions": float(np.abs(apart[0]).max()), "velocities": float(np.abs(apart[1]).max())}
        found[name] = own | {"heat": heats[0], "difference_of_heat": heats[1] - heats[0]}
    return found


def same_bits() -> dict[str, Any]:
    found = {}
    for precision in ("mixed", "double"):
        system, ends = liquid(97_336), []
        for skin, lanes, cuts in ((0.3, 8, (300,)), (0.3, 8, (300,)), (0.12, 4, (100, 7, 193))):
            made = other_list(system, precision, skin, lanes)
            for cut in cuts:
                made.advance(cut, np.inf)
                made.measure(0.0)
            ends.append(made.phase().tobytes())
        found[precision] = {"twice": ends[0] == ends[1], "cut, other skin and lanes": ends[0] == ends[2]}
    return found


def pair_times() -> dict[str, Any]:
    found: dict[str, Any] = {}
    for n in PARTICLES[:3]:
        system = liquid(n)
        for precision in ("mixed", "double"):
            made = session(system, precision, DT)
            own: dict[str, Any] = steps_a_second(made)
            p, forces = made.particles, made.forces
            assert isinstance(forces, PairForces)
            own["forces_s"] = timed(made, partial(forces.evaluate, p))
            own["move_s"] = timed(made, partial(made.moved, 0.0, 0.0, 0.0))
            own["keep_s"] = timed(made, p.keep)
            own["list_s"] = timed(made, partial(forces.listed, p), 3)
            own["search_s"] = timed(made, partial(forces.search, p), 3)
            forces.prepare(p)
            own["neighbours"] = float(forces.found.copy_to_host().mean())
            found[f"{precision} {len(system)}"] = own
    return found


def tuning() -> dict[str, Any]:
    """Steps a second and seconds of the forces, for other skins."""
    found: dict[str, Any] = {}
    for n in PARTICLES[:3]:
        system = liquid(n)
        made = session(system, "mixed", DT)
        made.advance(MELTING, np.inf)
        system = system.at(made.phase(), 0.0)
        for skin in TUNED:
            made = other_list(system, "mixed", skin, 0)
            own = steps_a_second(made, 50)
            own["forces_s"] = timed(made, partial(made.forces.evaluate, made.particles))
            found[f"mixed {len(system)} skin {skin}"] = own
    return found


def largest() -> dict[str, Any]:
    system = liquid(PARTICLES[3])
    made = session(system, "mixed", DT)
    return {f"mixed {len(system)}": steps_a_second(made, 60)}


def gravity_times() -> dict[str, Any]:
    found: dict[str, Any] = {}
    for n in BODIES:
        system = cluster(n)
        for precision in ("mixed", "double"):
            made = session(system, precision, 1e-3)
            many = (1, 2) if n > 2e5 else (3, 3)
            seconds = timed(made, partial(made.forces.evaluate, made.particles), *many)
            found[f"{precision} {n}"] = {"forces_s": seconds, "pairs_per_s": n * (n - 1.0) / seconds}
            if n < 2e5:
                found[f"{precision} {n}"] |= steps_a_second(made, 10)
    return found


def conservation() -> dict[str, Any]:
    """A run as a user has it: the energy's verdict over 10^5 steps of 97,336 particles, after a melting."""
    system = liquid(97_336, kd.LennardJones(cutoff=CUTOFF, truncation="switch"))
    sim = kd.Simulation(system, "velocity-verlet", 0.002, engine="cuda", precision="mixed")
    sim.run(2000, every=2000)
    begin = time.perf_counter()
    report = sim.run(100_000, every=1000)
    return {"wall_s": time.perf_counter() - begin, "report": str(report), "json": report.as_json()}


def user() -> dict[str, Any]:
    """The command line from start to file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5md"
        command = [sys.executable, "-m", "kickdrift", "run", "lj-1000", "--engine", "cuda", "--steps", "2000"]
        begin = time.perf_counter()
        done = subprocess.run([*command, "--output", str(path)], capture_output=True, text=True, timeout=120)
        taken = time.perf_counter() - begin
        info = subprocess.run([sys.executable, "-m", "kickdrift", "info", str(path)], capture_output=True, text=True)
    return {"seconds": taken, "status": done.returncode, "out": done.stdout[-3000:], "err": done.stderr[-1500:],
            "info": info.stdout[-1500:]}  # fmt: skip


SECTIONS: tuple[Callable[[], dict[str, Any]], ...] = (
    environment, pair_forces, gravity_forces, beside_the_processor, same_bits, pair_times, gravity_times, conservation,
    user, tuning, largest,
)  # fmt: skip


def main(path: str, *names: str) -> None:
    """Run the sections, all by default, and write their results to a JSON."""
    found: dict[str, Any] = {}
    for section in SECTIONS:
        name = section.__name__
        if names and name not in names:
            continue
        begin = time.perf_counter()
        try:
            own = section()
        except Exception as problem:  # the other sections still run
            own = {"error": f"{type(problem).__name__}: {problem}"[:3000], "trace": traceback.format_exc()[-3000:]}
        found[name] = own | {"section_s": time.perf_counter() - begin}
        Path(path).write_text(json.dumps(found, indent=1, default=str))
        print(name, json.dumps(found[name], default=str)[:2500], flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
