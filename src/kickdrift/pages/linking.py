"""The linker of WebAssembly, which only people who make pages need."""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from kickdrift.errors import InputError

NAMES = ("wasm-ld", *(f"wasm-ld-{version}" for version in range(25, 13, -1)))
MISSING = "page: needs the linker wasm-ld; install Debian's package lld, or: pip install ziglang"
BASE = 2**20  # where a page's own memory begins; the stack and constants of compiled code lie before
STACK = 2**18  # bytes
PAGE = 2**16  # bytes of a page of WebAssembly's memory


def linker() -> list[str]:
    """The command of the linker. Raises InputError that says what to install if there is none."""
    for name in NAMES:
        if found := shutil.which(name):
            return [found]
    if find_spec("ziglang"):
        return [sys.executable, "-m", "ziglang", "wasm-ld"]
    raise InputError(MISSING)


def linked(code: bytes, exports: Sequence[str], memory: int) -> bytes:
    """Module of WebAssembly of an object file. It exports its table of functions, its memory, and these names.

    ``memory`` is the size of a page's own memory. Functions that the code lacks, such as sines, become imports."""
    size = -(-(BASE + memory) // PAGE) * PAGE
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "page.o"), Path(folder, "page.wasm")
        source.write_bytes(code)
        command = [
            *linker(), "--no-entry", "--allow-undefined", "--export-table", "--strip-all", "--gc-sections", "-O2",
            "--stack-first", "-z", f"stack-size={STACK}", f"--initial-memory={size}", "--export=__heap_base",
            *(f"--export={name}" for name in exports), str(source), "-o", str(target),
        ]  # fmt: skip
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode:
            raise InputError(f"page: {command[0]} failed: {' '.join(done.stderr.split())[:300]}")
        return target.read_bytes()
