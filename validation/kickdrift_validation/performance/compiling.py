"""What compiling costs: usual commands, each in a process of its own with an empty folder of compiled code.

    kickdrift bench compile

Seconds are CPU seconds of the process. Importing is apart. "functions" are those that numba compiles; "overloads" are
implementations of operators and helpers that it builds on the way. "LLVM" is the time in LLVM's passes and in its
machine code; the rest of the compile time is numba's own, in Python. A contributor's time is that of its own passes,
without the functions that it calls.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from kickdrift.errors import InputError
from kickdrift.text import choices, suggestion

COMBINATIONS = {
    "lj-1000": "run lj-1000 --steps 100",
    "lj-1000-mixed": "run lj-1000 --steps 100 -o precision=mixed",
    "lj-1000-baoab": "run lj-1000 --steps 100 --integrator baoab -o temperature=1 -o friction=1",
    "lj-binary-1000": "run lj-binary-1000 --steps 100",
    "kremer-grest-1000": "run kremer-grest-1000 --steps 100",
    "copper-864": "run copper-864 --steps 100",
    "silicon-512": "run silicon-512 --steps 100",
    "molten-salt": "run molten-salt --steps 100",
    "solar-system": "run solar-system --steps 100",
    "solar-system-radau": "run solar-system --time 1yr --integrator gauss-radau15",
    "solar-system-chaos": "chaos solar-system --time 100yr",
    "plummer-1000": "run plummer-1000 --steps 10",
}
COLUMNS = ("command", "CPU s", "importing", "functions", "overloads", "LLVM", "largest contributors")
LARGEST = 3  # contributors that are named


class Compiled(NamedTuple):
    """The cost of one command from an empty folder of compiled code."""

    name: str
    seconds: float
    importing: float
    functions: int
    overloads: int
    llvm: float
    largest: list[tuple[str, float]]

    @property
    def cells(self) -> list[str]:
        named = ", ".join(f"{name} {seconds:.1f}" for name, seconds in self.largest)
        share = f"{self.llvm:.1f} ({self.llvm / (self.seconds - self.importing):.0%})"
        counts = [f"{self.functions:,}", f"{self.overloads:,}"]
        return [self.name, f"{self.seconds:.1f}", f"{self.importing:.1f}", *counts, share, named]


def chosen(only: Sequence[str]) -> list[str]:
    """Names of combinations to measure; all without a choice."""
    for name in only:
        if name not in COMBINATIONS:
            raise InputError(
                f"bench compile: {name!r} is unknown; known are {choices(COMBINATIONS, name)}"
                f"{suggestion(name, COMBINATIONS)}"
            )
    return list(only or COMBINATIONS)


def measure(name: str) -> Compiled:
    """Run a combination in another process, and return what compiling has cost there."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", __name__, folder, *COMBINATIONS[name].split()]
        found = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
        if found.returncode:
            raise InputError(f"bench compile: {name}: {found.stderr.strip().splitlines()[-1]}")
        counts = json.loads((Path(folder) / "counts.json").read_text())
    return Compiled(name=name, **counts)


# --- in the other process ---


class Clock:
    """CPU time in calls of some functions: all of it, and each call's own without the calls inside it."""

    def __init__(self) -> None:
        self.own: Counter[str] = Counter()
        self.calls: Counter[str] = Counter()
        self._inside = [0.0]

    def wrap(self, owner: Any, method: str, name_of: Callable[..., str]) -> None:
        """Time a method of a class."""
        called = getattr(owner, method)

        def timed(*args: Any, **kwargs: Any) -> Any:
            begun, name = time.process_time(), name_of(*args)
            self._inside.append(0.0)
            try:
                return called(*args, **kwargs)
            finally:
                whole = time.process_time() - begun
                self.own[name] += whole - self._inside.pop()
                self._inside[-1] += whole
                self.calls[name] += 1

        setattr(owner, method, timed)


def count(folder: str, arguments: list[str]) -> None:
    """Run a command of kickdrift with compiled code in ``folder``, and write there what compiling has cost."""
    from kickdrift.jit.cache import folders

    folders._candidates = lambda: iter([Path(folder)])
    from numba.core.codegen import CPUCodeLibrary, JITCodeLibrary
    from numba.core.compiler import CompilerBase
    from numba.core.typing.templates import _OverloadFunctionTemplate

    import kickdrift.cli.main as program

    importing = time.process_time()
    functions, llvm, built = Clock(), Clock(), Clock()
    functions.wrap(CompilerBase, "_compile_core", lambda self: self.state.func_id.func_qualname)
    built.wrap(_OverloadFunctionTemplate, "_build_impl", lambda *_: "built")
    for owner, method in (
        (CPUCodeLibrary, "_optimize_functions"),
        (CPUCodeLibrary, "_optimize_final_module"),
        (JITCodeLibrary, "_finalize_specific"),
    ):
        llvm.wrap(owner, method, lambda *_: "llvm")
    sys.argv = ["kickdrift", *arguments, "--quiet"]
    status: Any = 0
    try:
        program.main()
    except SystemExit as end:
        status = end.code
    seconds = time.process_time()
    found = {
        "seconds": seconds, "importing": importing, "functions": functions.calls.total(),
        "overloads": built.calls.total(), "llvm": sum(llvm.own.values()), "largest": functions.own.most_common(LARGEST),
    }  # fmt: skip
    (Path(folder) / "counts.json").write_text(json.dumps(found))
    sys.exit(status)


if __name__ == "__main__":
    count(sys.argv[1], sys.argv[2:])
