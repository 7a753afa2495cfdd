"""How long the first run ever of a new pair law takes, and that of a second method.

    python -m kickdrift_validation.performance.first_runs

Each run is a process of its own, of one copy of the package, in which nothing is compiled. First comes lj-1000 with
velocity-verlet, which compiles its loop and its force. Then a pair law that nobody has compiled runs with the same
method; then other methods run the system whose force is compiled. What is timed is making the Simulation and ten steps,
in processor time.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import process_time

from kickdrift_validation.claim import Claim, claim, show, where
from kickdrift_validation.faults import copied

LAW, METHOD = 5.0, 10.0  # bounds, seconds
FIRST = "velocity-verlet"
METHODS = ("leapfrog", "yoshida4", "rk4", "dormand-prince45", "gauss-radau15", "gauss-legendre4", "hermite4")
LAWS = """
from typing import NamedTuple
import kickdrift as kd

@kd.pair_law
class SixTwelve(NamedTuple):
    epsilon: float = 1.0
    sigma: float = 1.0
    dimensions = {"epsilon": "energy", "sigma": "length"}

    def law(p, r2):
        s2 = p.sigma**2 / r2
        s6 = s2 * s2 * s2
        return 4 * p.epsilon * s6 * (s6 - 1), 24 * p.epsilon * s6 * (2 * s6 - 1) / r2
"""


def child(method: str, law: bool) -> None:
    """Print the seconds that a first run takes."""
    import kickdrift as kd

    system = kd.load("plummer-1000" if method == "hermite4" else "lj-1000")
    if law:
        from laws import SixTwelve  # type: ignore[import-not-found]

        x, v = system.state.positions, system.state.velocities
        system = kd.System(x, v, box=system.box, forces=[SixTwelve(cutoff=2.5, truncation="shift")])
    began = process_time()
    sim = kd.Simulation(system, method, **({} if method == "gauss-radau15" else {"dt": 0.001}))
    sim.run(10)
    print(process_time() - began)


def seconds(path: str, method: str, law: bool = False) -> float:
    """The seconds of a run in a process of its own, with the packages and the law on that PYTHONPATH."""
    command = [sys.executable, "-P", "-m", "kickdrift_validation.performance.first_runs", "--child", method]
    command += ["--law"] * law
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return float(done.stdout)


def claims() -> Iterator[Claim]:
    """Each first run, as soon as it is known."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = os.pathsep.join([copied(folder, None), str(folder)])
        (folder / "laws.py").write_text(LAWS, encoding="utf-8")
        print(f"  the first run of all, {FIRST} with lj-1000: {seconds(path, FIRST):.1f} s", flush=True)
        took = seconds(path, FIRST, law=True)
        text = f"seconds of the first run of a new pair law, with {FIRST} compiled"
        yield claim(text, took, f"at most {LAW:g}", took <= LAW, "processor time")
        again = seconds(path, FIRST, law=True)
        print(f"  the same once more: {again:.2f} s", flush=True)
        found = {}
        for method in METHODS:
            found[method] = seconds(path, method)
            print(f"  the first run with {method}: {found[method]:.1f} s", flush=True)
        slowest = max(found, key=lambda method: found[method])
        text = f"seconds of the first run with a second method, the slowest of {len(METHODS)}: {slowest}"
        yield claim(text, found[slowest], f"at most {METHOD:g}", found[slowest] <= METHOD, "processor time")


def main() -> int:
    """Measure, print; the exit status, 1 where a bound is missed."""
    print(where("numpy"), flush=True)
    return show(list(claims()))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], "--law" in sys.argv[3:])
    else:
        sys.exit(main())
