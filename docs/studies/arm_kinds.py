"""Short runs of every kind that matters, each in a process of its own: arm.py compares two machines by them.

    python -m docs.studies.arm_kinds KIND

The last line of output is JSON: what the run gave, and what it ran with.
"""

from __future__ import annotations

import json
import math
import platform
import sys
import tempfile
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import kickdrift as kd
from kickdrift.batch.batch import Batch
from kickdrift.jit.compile import features, processor

VERSIONS = ("kickdrift", "numpy", "numba", "llvmlite", "scipy", "h5py")


TREE = kd.GravityTree(softening=0.01)


class Found(NamedTuple):
    """What a run gave: total energies at its looks, positions (or y) at its end, and after how many steps."""

    energies: list[float]
    positions: list[float]
    steps: int


@kd.pair_law
class Morse(NamedTuple):
    """A law of the user's own."""

    depth: float = 1.0
    width: float = 6.0
    bond: float = 1.1

    def law(p, r2):
        r = math.sqrt(r2)
        e = math.exp(-p.width * (r - p.bond))
        return p.depth * (e * e - 2 * e), 2 * p.depth * p.width * (e * e - e) / r


def found(sim: Any) -> Found:
    """What a Simulation has recorded."""
    state = sim.state
    positions = state.y if isinstance(sim.system, kd.Problem) else state.positions
    energies = sim.record.series().total
    return Found(energies[np.isfinite(energies)].tolist(), positions.ravel().tolist(), sim.steps_done)


def moved(system: Any, method: str, steps: int, **options: Any) -> Found:
    sim = kd.Simulation(system, method, **options)
    sim.run(steps, every=5)
    return found(sim)


def reached(system: Any, method: str, time: float, **options: Any) -> Found:
    """By steps that the method chooses."""
    sim = kd.Simulation(system, method, **options)
    sim.run(until=time, interval=time / 4)
    return found(sim)


def on_threads(system: Any, steps: int, **options: Any) -> Found:
    """Velocity Verlet on one thread and on two."""
    one, two = (moved(system, "velocity-verlet", steps, dt=0.002, threads=count, **options) for count in (1, 2))
    if one != two:
        raise AssertionError("two threads give other bits than one")
    return one


def stars(force: Any) -> Any:
    """The stars of plummer-1000, to nine digits: the last ones of NumPy's cube roots, by which they are drawn, differ
    from processor to processor."""
    state = kd.load("plummer-1000").state
    x, v = np.round(state.positions, 9), np.round(state.velocities, 9)
    return kd.System(x, v, state.masses, forces=[force], units="nbody")


def own_law() -> Found:
    """A liquid with the law above."""
    state = kd.load("lj-1000").state
    forces = [Morse(cutoff=2.5, truncation="force-shift")]
    return moved(
        kd.System(state.positions, state.velocities, box=state.box, forces=forces), "velocity-verlet", 20, dt=0.002
    )


def resumed() -> Found:
    """A run that goes on from its file, and the same run in one."""
    whole = kd.Simulation(kd.load("lj-1000"), "velocity-verlet", dt=0.002)
    whole.run(20, every=5)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.h5md"
        kd.Simulation(kd.load("lj-1000"), "velocity-verlet", dt=0.002).run(10, every=5, output=path)
        sim = kd.resume(path)
        sim.run(10)
        with kd.open(path) as run:
            if not np.array_equal(run[-1].positions, sim.state.positions):
                raise AssertionError("the file's last frame is not the state")
    if found(sim) != found(whole):
        raise AssertionError("the resumed run gives other bits than the whole one")
    return found(whole)


def side_by_side() -> Found:
    """Eight systems of three bodies in a processor's registers, a lane each, with steps of different lengths."""
    batch = Batch([kd.load("figure-eight")] * 8, "leapfrog", [1e-3 * (1 + k / 10) for k in range(8)])
    batch.run(200, every=20)
    energies = [batch.record(i).series().total for i in range(len(batch))]
    return Found(np.ravel(energies).tolist(), batch.phase[:, 0].ravel().tolist(), 200)


def blown_up() -> Found:
    """Runs whose steps are far too long: each ends in kickdrift's own error, and no number comes of them."""
    for system, method, dt in (
        (kd.load("lj-1000"), "velocity-verlet", 1.0),
        (kd.load("lj-1000"), "velocity-verlet", 1e300),
        (stars(TREE), "leapfrog-dkd", 1e307),
    ):
        try:
            kd.Simulation(system, method, dt=dt).run(100, every=5)
        except kd.RunError:
            continue
        raise AssertionError(f"a step of {dt:g} does not blow up")
    return Found([], [], 0)


def van_der_pol(t, y):
    return [y[1], (1 - y[0] ** 2) * y[1] - y[0]]


KINDS: dict[str, Callable[[], Found]] = {
    "Lennard-Jones, 1000, on 1 and 2 threads": lambda: on_threads(kd.load("lj-1000"), 50),
    "the same in mixed precision": lambda: on_threads(kd.load("lj-1000"), 50, precision="mixed"),
    "binary mixture, 1000": lambda: on_threads(kd.load("lj-binary-1000"), 20),
    "user's pair law, 1000": own_law,
    "written to a file, resumed": resumed,
    "Sun and Jupiter, leapfrog": lambda: moved(kd.load("sun-jupiter"), "leapfrog", 500, dt=0.02),
    "1000 stars, leapfrog-dkd": lambda: moved(stars(kd.Gravity()), "leapfrog-dkd", 20, dt=0.01),
    "1000 stars, tree": lambda: moved(stars(TREE), "leapfrog-dkd", 20, dt=0.01),
    "blow-ups, told as such": blown_up,
    "planets, wisdom-holman": lambda: moved(kd.load("solar-system"), "wisdom-holman", 200, dt=0.01),
    "planets, gauss-radau15": lambda: reached(kd.load("solar-system"), "gauss-radau15", 1.0),
    "3 bodies, dormand-prince45": lambda: reached(kd.load("figure-eight"), "dormand-prince45", 2.0, rtol=1e-9),
    "8 × 3 bodies side by side": side_by_side,
    "van der Pol's equation": lambda: reached(kd.Problem(van_der_pol, [2.0, 0.0]), "dormand-prince45", 10.0, rtol=1e-8),
}


def machine() -> dict[str, Any]:
    return {
        "machine": platform.machine(),
        "processor": processor(),
        "features": features(),
        "versions": {
            "Python": platform.python_version(),
            "glibc": platform.libc_ver()[1],
            **{name: version(name) for name in VERSIONS},
        },
    }


if __name__ == "__main__":
    print(json.dumps(KINDS[sys.argv[1]]()._asdict() | machine()))
