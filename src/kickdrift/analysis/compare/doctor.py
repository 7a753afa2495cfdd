"""State of an installation: versions, processor, lanes, threads, compiled code, and what is missing."""

from __future__ import annotations

import os
import platform
import re
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

from kickdrift.analysis.compare.bench import processor
from kickdrift.display.showing import Lines, Shown, Table
from kickdrift.model.checks.limits import cores
from kickdrift.text import counted

ABSENT = "not installed"
_REQUIREMENT = re.compile(r"""^([\w.-]+).*?(?:extra == ['"]([\w-]+)['"])?$""")
LEFT_OUT = ("test", "docs", "validation")  # extras for developers


@dataclass(frozen=True, repr=False)
class Installation(Shown):
    """Facts about this installation, which ``kickdrift doctor`` prints.

    Attributes
    ----------
    machine : keys and texts about Python, processor, threads and compiled code
    packages : rows of package, version and what needs it; the version is "not installed" for a missing one
    problems : one line for each thing that needs attention
    """

    machine: tuple[tuple[str, str], ...]
    packages: tuple[tuple[str, str, str], ...]
    problems: tuple[str, ...]
    _lines_first = True

    def as_json(self) -> dict[str, Any]:
        """The installation as one JSON object."""
        rows = [dict(zip(("package", "version", "needed by"), row, strict=True)) for row in self.packages]
        return {**dict(self.machine), "packages": rows, "problems": list(self.problems)}

    def _lines(self) -> Lines:
        found = [("problem", line) for line in self.problems] or [("problems", "none")]
        return [*self.machine, *found]

    def _tables(self) -> list[Table]:
        return [(None, ["package", "version", "needed by"], [list(row) for row in self.packages])]


def doctor() -> Installation:
    """Describe this installation: an `Installation`, which prints as lines and a table.

    The machine's part holds versions, the processor, the lanes of compiled code, threads, and the folder of compiled
    code. Extras that are not installed are listed with the line that installs them, and are no problem."""
    packages = _packages()
    problems = [
        f"{name} is {ABSENT}: pip install {name}"
        for name, found, by in packages
        if by == "kickdrift" and found == ABSENT
    ]
    machine, more = _machine()
    return Installation(tuple(machine), tuple(packages), (*problems, *more))


def _machine() -> tuple[Lines, list[str]]:
    from numba.core import config

    from kickdrift.forces.bound.forces import most_threads
    from kickdrift.jit.cache.folders import CODE, folder

    place, problems = folder(), []
    threads, here = most_threads(), cores()
    lines = [
        ("kickdrift", version("kickdrift")),
        ("python", f"{platform.python_version()}, {platform.system()} {platform.machine()}"),
        ("processor", processor()),
        ("lanes", _lanes()),
        ("threads", f"{threads} of {counted(here, 'core')}"),
    ]
    if threads > here:
        problems.append(f"numba may start {threads} threads on {counted(here, 'core')}: set NUMBA_NUM_THREADS={here}")
    if place is None:
        lines.append(("compiled code", "kept nowhere"))
        problems.append(
            "no folder is writable and private: every run compiles anew; set XDG_CACHE_HOME to such a folder"
        )
    else:
        files = [entry.stat().st_size for entry in os.scandir(place / CODE)] if (place / CODE).is_dir() else []
        lines.append(
            ("compiled code", f"{counted(len(files), 'file', ',')}, {sum(files) / 2**20:.0f} MiB, in {place / CODE}")
        )
    if config.DISABLE_JIT:
        problems.append("NUMBA_DISABLE_JIT is set: nothing is compiled, and runs are hundreds of times slower")
    return lines, problems


def _lanes() -> str:
    """SIMD instructions of compiled code."""
    from llvmlite import binding

    features = dict(binding.get_host_cpu_features())
    known = {
        "avx512f": "AVX-512, 8 numbers",
        "avx2": "AVX2, 4 numbers",
        "sse2": "SSE2, 2 numbers",
        "neon": "NEON, 2 numbers",
    }
    name = os.environ.get("NUMBA_CPU_NAME")
    found = next((text for feature, text in known.items() if features.get(feature)), "none known")
    return f"{found} at once" + (f"; NUMBA_CPU_NAME={name} may choose others" if name else "")


def _packages() -> list[tuple[str, str, str]]:
    """Package, version and what needs it, for each requirement of kickdrift."""
    found: dict[str, tuple[str, str, str]] = {}
    for line in requires("kickdrift") or []:
        match = _REQUIREMENT.match(line.strip())
        if match is None or match[1] == "kickdrift" or match[2] in LEFT_OUT:
            continue
        name, extra = match[1], match[2]
        by = "kickdrift" if extra is None else f"pip install 'kickdrift[{extra}]'"
        found.setdefault(name, (name, _version(name), by))
    return list(found.values())


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ABSENT
