"""A Simulation of rebound as plain data, and the program that reads a snapshot of an archive in a process of its own.

rebound's C code ends the process on many damaged archives, so `rebound` runs this file apart, with limits of
time and memory, and takes numbers and text. This module imports nothing of kickdrift, so that the process starts fast.
"""

import contextlib
import json
import os
import sys
import warnings
from ctypes import addressof, sizeof, string_at
from typing import Any, NamedTuple

COLUMNS = ("x", "y", "z", "vx", "vy", "vz", "m", "r")
FUNCTIONS = ("additional_forces", "pre_timestep_modifications", "post_timestep_modifications")
OPTIONS = {  # of each integrator that kickdrift has too
    "leapfrog": ("order",),
    "ias15": ("epsilon", "adaptive_mode", "min_dt"),
    "whfast": ("coordinates", "kernel", "corrector", "corrector2"),
    "trace": ("peri_crit_eta", "peri_mode", "r_crit_hill"),
    "saba": ("type",),
}
CHOICES = ("adaptive_mode", "coordinates", "kernel", "peri_mode", "type")  # options that are words
MEMORY_BYTES, MEMORY_SHARE = 2**28, 8  # of the process that reads: this, and this many times the file's size
CPU_SECONDS, CPU_RATE = 4, 10**7  # of its work: this, and the file's size at so many bytes a second


class Snapshot(NamedTuple):
    """What a Simulation of rebound says about its bodies, forces and method. ``own_switch`` tells whether a user's
    function decides where encounters or passages begin."""

    t: float
    G: float
    softening: float
    OMEGA: float
    OMEGAZ: float
    dt: float
    exit_max_distance: float
    exit_min_distance: float
    N: int
    N_var: int
    N_active: int
    N_odes: int
    is_synchronized: bool
    own_switch: bool
    boundary: str
    collision: str
    gravity: str
    integrator: str
    functions: list[str]
    options: dict[str, int | float | str]
    units: tuple[str | None, str | None, str | None]
    names: list[str | None]


def described(sim: Any) -> tuple[Snapshot, bytes]:
    """Return a Simulation's settings, and the `COLUMNS` of its bodies, one after the other, as bytes of doubles."""
    method = str(sim.integrator)
    options = {key: _option(key, getattr(sim.integrator, key)) for key in OPTIONS.get(method, ())}
    named = [p.name for p in sim.particles]
    snapshot = Snapshot(
        sim.t, sim.G, sim.softening, sim.OMEGA, sim.OMEGAZ, sim.dt, sim.exit_max_distance, sim.exit_min_distance,
        sim.N, sim.N_var, sim.N_active, sim._N_odes, bool(sim.is_synchronized), _own_switch(sim.integrator, method),
        str(sim.boundary), str(sim.collision), str(sim.gravity), method,
        [key for key in FUNCTIONS if getattr(sim, f"_{key}", None)], options,
        (sim.units["length"], sim.units["time"], sim.units["mass"]), named if any(named) else [],
    )  # fmt: skip
    return snapshot, _table(sim)


def _option(key: str, value: Any) -> int | float | str:
    """An option without rebound's own type. rebound gives a choice that it does not know as a number."""
    return str(value) if key in CHOICES else int(value) if isinstance(value, int) else float(value)


def _own_switch(own: Any, method: str) -> bool:
    for key in ("S", "S_peri") if method == "trace" else ():
        with contextlib.suppress(TypeError):  # rebound cannot read a pointer that was never set
            if getattr(own, key):
                return True
    return False


def _table(sim: Any) -> bytes:
    if not sim.N:
        return b""
    first = next(iter(sim.particles))  # an index would import NumPy
    kind, size = type(first), sizeof(first)
    numbers = memoryview(string_at(addressof(first), sim.N * size)).cast("d")
    return b"".join(numbers[getattr(kind, key).offset // 8 :: size // 8].tobytes() for key in COLUMNS)


# --- the program ---


def main() -> None:
    """Answer on standard output: a line of JSON, then the table. Arguments: path, snapshot, further folders of code."""
    answer = os.dup(1)
    for said in (1, 2):  # rebound prints errors
        os.dup2(os.open(os.devnull, os.O_WRONLY), said)
    path, snapshot, folders = json.loads(sys.argv[1])
    sys.path += folders
    table = b""
    try:
        import rebound

        _limit(os.stat(path).st_size)
        told, table = _read(rebound, path, snapshot)
    except Exception as error:
        told = {"error": _cause(error)}
    with os.fdopen(answer, "wb") as file:
        file.write(json.dumps(told).encode() + b"\n" + table)


def _cause(error: Exception) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "a name in it is not text"
    return str(error) if isinstance(error, RuntimeError) else f"{type(error).__name__}: {error}".rstrip(": ")


def _read(rebound: Any, path: str, snapshot: int | None) -> tuple[dict[str, Any], bytes]:
    """Count the snapshots, and describe one of them if asked."""
    found, table = None, b""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        # rebound takes names in ASCII alone; other files are read whole
        with open(path, "rb") as file:
            archive = rebound.Simulationarchive(path if path.isascii() else file.read())
        count = len(archive)
        if snapshot is not None and -count <= snapshot < count:
            sim = archive[snapshot]
            if not sim.is_synchronized:
                sim.synchronize()
            found, table = described(sim)
    texts = sorted({str(each.message) for each in said})
    return {"snapshots": count, "said": texts, "snapshot": found and found._asdict()}, table


def _limit(size: int) -> None:
    """Limit this process for a file of that size, where the system can: memory, work, and no file may grow."""
    try:
        import resource
    except ImportError:  # on Windows
        return
    limits = {
        "RLIMIT_CORE": 0,
        "RLIMIT_FSIZE": 0,
        "RLIMIT_CPU": CPU_SECONDS + size // CPU_RATE,
        "RLIMIT_AS": _used() + MEMORY_BYTES + MEMORY_SHARE * size,
    }
    for name, most in limits.items():
        with contextlib.suppress(AttributeError, OSError, ValueError):  # systems differ
            kind = getattr(resource, name)
            given = [each for each in resource.getrlimit(kind) if each != resource.RLIM_INFINITY]
            most = min([most, *given])
            resource.setrlimit(kind, (most, min([most + 1, *given])))  # the second's work ends with another signal


def _used() -> int:
    """Address space of this process in bytes, with Python and rebound; 1 GiB where the system does not say."""
    try:
        with open("/proc/self/statm", "rb") as file:
            return int(file.read().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return 2**30


if __name__ == "__main__":
    main()
