"""Speed of LAMMPS alone and through the engine: in one process, in two, and in two on two machines.

    python -m docs.studies.scaling_engine [--turns 5] [--seconds 0.5]

Two network namespaces stand for the machines: they share no address and reach each other by a virtual cable. This
needs root and the command ip; without them the row is left out. Prints JSON.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from kickdrift.engines import ENGINES
from kickdrift_validation.folders import checkout
from kickdrift_validation.performance.liquids import Lammps, liquid
from kickdrift_validation.performance.turns import Native, Runner, ratio_of, turns

SIDE, MELT = 22, 500
LIMIT = 120.0  # seconds for the process that measures
WAY = '#!/bin/sh\n[ "$1" = -x ] && shift\nshift\nexec {} sh -c "$*"\n'  # like ssh: -x, a machine's name, a command


def way_there(folder: Path, before: str = "") -> Path:
    """Write a program that takes ssh's place for mpiexec, and runs the command after ``before``. Return its path."""
    way = folder / "way"
    way.write_text(WAY.format(before))
    way.chmod(0o700)
    return way


@contextmanager
def two_namespaces(folder: Path, there: int = 1) -> Iterator[tuple[list[str], dict[str, str]]]:
    """Two network namespaces with a cable between them, and a file ``hosts`` in the folder.

    Yields the words before a command that is to run in the first, and variables of its environment. ``there`` is the
    number of processes in the second."""
    names = [f"kd{os.getpid()}{letter}" for letter in "ab"]

    def ip(*words: str, check: bool = True) -> None:
        subprocess.run(["ip", *words], check=check)

    try:
        for name in names:
            ip("netns", "add", name)
        ip("link", "add", names[0], "netns", names[0], "type", "veth", "peer", "name", names[1], "netns", names[1])
        for k, name in enumerate(names):
            ip("-n", name, "addr", "add", f"10.99.0.{k + 1}/24", "dev", name)
            ip("-n", name, "link", "set", "lo", "up")
            ip("-n", name, "link", "set", name, "up")
        (folder / "hosts").write_text(f"10.99.0.1:1\n10.99.0.2:{there}\n")
        way = way_there(folder, f"ip netns exec {names[1]}")
        yield ["ip", "netns", "exec", names[0]], {"HYDRA_LAUNCHER_EXEC": str(way)}
    finally:
        for name in names:
            ip("netns", "delete", name, check=False)


def rows(count: int, seconds: float, hosts: Path | None) -> list[dict[str, Any]]:
    """Speeds in turns; each over LAMMPS alone in one process."""
    start = liquid(SIDE**3, MELT)
    names = ["alone, 1 process", "engine, 1 process", "engine, 2 processes"]
    runners: list[Runner] = [Lammps(start, style="opt")]
    options: list[dict[str, Any]] = [{}, {"processes": 2}]
    if hosts:
        names.append("engine, processes of the hosts file")
        options.append({"hosts": hosts})
    try:
        for each in options:
            runners.append(Native(start.simulation(engine="lammps", **each)))
        speeds = turns(runners, seconds, count)
    finally:
        for runner in runners:
            session: Any = runner.sim.integration.stepper if isinstance(runner, Native) else None
            getattr(session, "_session", runner).close()
    return [
        {"name": name, "speed": float(np.median(speeds[:, k])), "ratio": ratio_of(speeds[:, k], speeds[:, 0])._asdict()}
        for k, name in enumerate(names)
    ]


def measured(count: int = 5, seconds: float = 0.5) -> dict[str, Any]:
    """Rows from a process of its own, in a network namespace if that works, and what is left out."""
    found: dict[str, Any] = {"particles": SIDE**3, "rows": [], "left_out": []}
    if ENGINES["lammps"].version is None:
        return found | {"left_out": [f"LAMMPS: {ENGINES['lammps'].install}"]}
    words = [sys.executable, "-m", "docs.studies.scaling_engine", "--turns", str(count)]
    words += ["--seconds", str(seconds)]
    if os.geteuid() == 0 and shutil.which("ip"):
        with tempfile.TemporaryDirectory(prefix="kickdrift-") as name:
            try:
                with two_namespaces(Path(name)) as (before, more):
                    made = printed([*before, *words, "--hosts", f"{name}/hosts"], more)
                made[-1]["name"] = "engine, 2 processes on two network namespaces"
                return found | {"rows": made}
            except (OSError, subprocess.SubprocessError) as error:
                found["left_out"].append(f"two network namespaces: {' '.join(str(error).split())[-200:]}")
    else:
        found["left_out"].append("two network namespaces: they need root and the command ip")
    try:
        return found | {"rows": printed(words, {})}
    except subprocess.SubprocessError as error:
        return found | {"left_out": [*found["left_out"], f"LAMMPS: {' '.join(str(error).split())[-200:]}"]}


def printed(words: list[str], more: dict[str, str]) -> Any:
    """What a command prints as JSON."""
    environment = {**os.environ, **more}
    done = subprocess.run(words, cwd=checkout(), env=environment, stdout=subprocess.PIPE, check=True, timeout=LIMIT)
    return json.loads(done.stdout)


def main() -> int:
    """Measure in this process, and print the rows."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--turns", type=int, default=5, help="of each")
    parser.add_argument("--seconds", type=float, default=0.5, help="length of a turn")
    parser.add_argument("--hosts", type=Path, metavar="FILE", help="also run over the machines in this file")
    given = parser.parse_args()
    print(json.dumps(rows(given.turns, given.seconds, given.hosts)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
