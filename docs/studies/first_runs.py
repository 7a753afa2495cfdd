"""Time of the very first run of a new pair law, and of the first run of a second method.

Each run has its own process and shares one copy of the package, in which nothing is compiled. First lj-1000 runs with
velocity-verlet, which compiles its loop and its force. Then a new pair law runs with the same method. Then other
methods run the system whose force is compiled. The script times the making of the Simulation and ten steps, in
processor time.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import process_time

from kickdrift_validation.claim import Claim, at_most, show, where
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
    """Print the seconds of a first run."""
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
    """Seconds of a run in its own process, with the packages and the law on this PYTHONPATH."""
    command = [sys.executable, "-P", __file__, "--child", method]
    command += ["--law"] * law
    environment = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    return float(done.stdout)


def claims() -> Iterator[Claim]:
    """Yield each first run as soon as it is known."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = os.pathsep.join([copied(folder, None), str(folder)])
        (folder / "laws.py").write_text(LAWS, encoding="utf-8")
        print(f"  the first run of all, {FIRST} with lj-1000: {seconds(path, FIRST):.1f} s", flush=True)
        took = seconds(path, FIRST, law=True)
        yield at_most(f"seconds of the first run of a new pair law, with {FIRST} compiled", took, LAW, "processor time")
        again = seconds(path, FIRST, law=True)
        print(f"  the same once more: {again:.2f} s", flush=True)
        found = {}
        for method in METHODS:
            found[method] = seconds(path, method)
            print(f"  the first run with {method}: {found[method]:.1f} s", flush=True)
        slowest = max(found, key=lambda method: found[method])
        text = f"seconds of the first run with a second method, the slowest of {len(METHODS)}: {slowest}"
        yield at_most(text, found[slowest], METHOD, "processor time")


def main() -> int:
    """Measure and print. The exit status is 1 where a bound is missed."""
    print(where("numpy"), flush=True)
    return show(list(claims()))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        child(sys.argv[2], "--law" in sys.argv[3:])
    else:
        sys.exit(main())
