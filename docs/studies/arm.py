"""Does kickdrift run on ARM (aarch64), and to the numbers of this machine? A processor of that kind is emulated.

    python -m docs.studies.arm FOLDER [--only TEXT …] [--processor generic] [--page docs/machines.md]

FOLDER takes all that is fetched and made, about 1 GB, and is used again: the emulator (qemu's user mode), Debian's
Python for arm64 with the libraries that it needs, the wheels of kickdrift's dependencies in the versions that run here,
and kickdrift's own wheel, made from this checkout. This works on Debian 12 for x86-64, with apt, dpkg and pip as they
are set up there, and without root's rights: nothing is installed, and no setting of the system changes.
The first time took 17 minutes on a busy machine of two cores, the second 5: the compiled code is kept.

There .ci/smoke.py runs, then each kind of run of arm_kinds.py, in a process of its own. A kind checks what holds to the
last bit on any processor: two threads give what one gives, a resumed file what the whole run gives. Runs that blow up
must say so. Energies and positions are compared with those of this machine. They cannot be the same bits: processors
fuse products with sums and divide in different ways, and a run makes small differences grow. How far they grow is
measured: the kind runs here once more, compiled for older processors. ARM agrees if it is at most ten times as far from
this machine's numbers as those are, or ten times sqrt(steps) rounding units where that is more. A distance is the
largest over all numbers, divided by the largest number. Exit status 1 if a kind disagrees or ends in an error.

An emulated processor shows the machine code that ARM gets, and what the code computes. It does not show ARM's speed. It
does not show mistakes in the order in which threads see each other's writes either: x86-64 keeps to a stricter order.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from datetime import date
from importlib.metadata import version
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

from docs.studies.arm_kinds import KINDS
from kickdrift.analysis.compare.bench import processor
from kickdrift_validation import processors
from kickdrift_validation.docs_tables import put, table
from kickdrift_validation.folders import checkout

RUNS = Path(__file__).with_name("arm_kinds.py")
PACKAGES = ("python3", "libstdc++6", "libgomp1")  # for arm64: Python, and what the wheels load
EPS = float(np.finfo(np.float64).eps)
FEATURES = "NUMBA_CPU_FEATURES"  # what LLVM may use beside, or instead of, what a processor of that name has
THREADS = {"NUMBA_NUM_THREADS": "2"}
TIMES = 10  # as far as the older processors are
LIMIT = 3600.0  # seconds of a kind, most of them for compiling
BEGIN, END = "<!-- docs.studies.arm --page writes from here -->", "<!-- to here -->"


class Failure(Exception):
    """A process ended with an error: what it said last."""


class Machine(NamedTuple):
    """What errors call it, how Python starts there, and with which settings."""

    name: str
    python: tuple[str, ...]
    settings: Mapping[str, str]

    def output(self, *arguments: str | Path) -> str:
        """What a script prints; a Failure if it ends with an error or takes longer than LIMIT."""
        try:
            return output(*self.python, *arguments, settings={**THREADS, **self.settings}, limit=LIMIT)
        except Failure as failure:
            raise Failure(f"{self.name}: {failure}") from None

    def found(self, kind: str) -> dict[str, Any]:
        """What a kind of run gave, and the seconds that it took."""
        began = perf_counter()
        lines = self.output(RUNS, kind).splitlines()
        return json.loads(lines[-1]) | {"seconds": perf_counter() - began}


HERE = Machine("this machine", (sys.executable,), {})
OLDER = tuple(  # the same with code for processors that round otherwise
    HERE._replace(name=name, settings=processors.settings(name)) for name in processors.FEATURES
)


def output(
    *command: str | Path,
    folder: Path | None = None,
    settings: Mapping[str, str] | None = None,
    limit: float | None = None,
) -> str:
    """What a command prints; a Failure with the end of its messages where it goes wrong."""
    environment = os.environ | dict(settings or {})
    try:
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=limit)
    except FileNotFoundError:
        raise Failure(f"there is no program {command[0]!r}") from None
    except subprocess.TimeoutExpired:
        raise Failure(f"not done in {limit:g} s") from None
    if done.returncode:
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"exit status {done.returncode}"
        last = "\n".join((done.stderr or done.stdout).strip().splitlines()[-12:])
        raise Failure(f"{how}: {last}")
    return done.stdout


def fetched(folder: Path, architecture: str, *command: str) -> None:
    """Put packages into ``folder`` with apt. It gets a state of its own, in which nothing is installed."""
    for name in ("lists/partial", "cache/archives/partial"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "status").touch()
    settings = {
        "APT::Architecture": architecture,
        "APT::Architectures": architecture,
        "APT::Install-Recommends": "false",
        "APT::Sandbox::User": "",  # downloads as whoever runs this
        "Dir::State::lists": f"{folder}/lists",
        "Dir::State::status": f"{folder}/status",
        "Dir::State::extended_states": f"{folder}/extended_states",
        "Dir::Cache": f"{folder}/cache",
        "Dir::Log": f"{folder}",
        "Debug::NoLocking": "true",
    }
    options = [f"-o{key}={value}" for key, value in settings.items()]
    output("apt-get", *options, "-qq", "update", folder=folder)
    output("apt-get", *options, "-qq", *command, folder=folder)


def unpacked(packages: Sequence[Path], place: Path) -> None:
    """The files of Debian packages below ``place``, which is there once all are."""
    half = place.with_name(f"{place.name}.part")
    shutil.rmtree(half, ignore_errors=True)
    for package in packages:
        output("dpkg-deb", "--extract", package, half)
    half.rename(place)


def emulator(folder: Path) -> str:
    """The path of qemu for aarch64: this machine's own, or fetched."""
    own = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    if own:
        return own
    place = folder / "qemu"
    if not place.is_dir():
        architecture = output("dpkg", "--print-architecture").strip()
        packages = folder / "packages" / architecture
        fetched(packages, architecture, "download", "qemu-user-static")
        unpacked(list(packages.glob("*.deb")), place)
    return str(place / "usr" / "bin" / "qemu-aarch64-static")


def system_root(folder: Path) -> Path:
    """A folder that looks like the root of an arm64 Debian with Python."""
    place = folder / "root"
    if not place.is_dir():
        packages = folder / "packages" / "arm64"
        fetched(packages, "arm64", "install", "--yes", "--download-only", *PACKAGES)
        unpacked(list((packages / "cache" / "archives").glob("*.deb")), place)
    return place


def wheels(folder: Path, python: str) -> tuple[Path, Path]:
    """Folders with kickdrift and with all that it requires, for that version of Python on aarch64."""
    libraries, package, made = folder / f"python{python}", folder / "kickdrift", folder / "wheel"
    pip = (sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check")
    glibc = [f"--platform=manylinux_2_{minor}_aarch64" for minor in range(17, 37)]  # Debian 12 has 2.36
    there = ("--platform=manylinux2014_aarch64", *glibc, "--only-binary=:all:", f"--python-version={python}")
    if not libraries.is_dir():
        named = tomllib.loads((checkout() / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
        names = [*(text.split(">")[0] for text in named), "llvmlite"]
        half = libraries.with_name(f"{libraries.name}.part")
        shutil.rmtree(half, ignore_errors=True)
        output(*pip, "install", "--target", half, *there, *(f"{name}=={version(name)}" for name in names))
        half.rename(libraries)
    shutil.rmtree(made, ignore_errors=True)
    output(*pip, "wheel", "--no-deps", "--wheel-dir", made, checkout())
    code, kept = package / "kickdrift" / "__pycache__" / "jit", folder / "jit"
    if code.is_dir():
        code.rename(kept)  # what was compiled before, which kickdrift uses as far as its sources are the same
    shutil.rmtree(package, ignore_errors=True)
    output(*pip, "install", "--target", package, "--no-deps", *made.glob("*.whl"))
    if kept.is_dir():
        code.parent.mkdir(mode=0o700, exist_ok=True)
        kept.rename(code)
    return package, libraries


def arm(folder: Path, named: str) -> Machine:
    """The emulated machine, whose code is compiled for the processor of that name."""
    folder.mkdir(parents=True, exist_ok=True)
    qemu, root = emulator(folder), system_root(folder)
    (python,) = (path for path in (root / "usr" / "bin").glob("python3.*") if path.name.count(".") == 1)
    package, libraries = wheels(folder, python.name.removeprefix("python"))
    settings = {"PYTHONPATH": f"{package}:{libraries}", "NUMBA_CPU_NAME": named}
    if named != "generic":
        settings[FEATURES] = ""  # all that a processor of that name has, which the emulator does not tell
    return Machine(f"aarch64, {named}", (qemu, "-L", str(root), str(python)), settings)


class Row(NamedTuple):
    """What came of a kind: how far ARM's energies and positions are from here, how far the older processors' are."""

    kind: str
    agrees: bool
    energies: tuple[float, float] | None = None
    positions: tuple[float, float] | None = None
    seconds: float = 0.0
    error: str = ""

    def cells(self) -> list[str]:
        if self.error:
            return [self.kind, "error", "–", "–"]
        pairs = (self.energies, self.positions)
        return [self.kind, "yes" if self.agrees else "no", *(f"{p[0]:.1e} ({p[1]:.1e})" if p else "–" for p in pairs)]


HEADING = ["kind of run", "agrees", "energies apart (older x86-64)", "positions apart (older x86-64)"]


def apart(one: Sequence[float], other: Sequence[float]) -> float:
    """The largest difference, divided by the largest number; infinite where they are not as many, or not finite."""
    a, b = np.array(one), np.array(other)
    if a.shape != b.shape or not (np.isfinite(a).all() and np.isfinite(b).all()):
        return float("inf")
    return float(np.abs(a - b).max() / np.abs(a).max())


def compared(kind: str, there: dict[str, Any], here: dict[str, Any], older: Sequence[dict[str, Any]]) -> Row:
    """ARM's run beside this machine's, by what the older processors' differ."""
    rounding, pairs = EPS * here["steps"] ** 0.5, {}
    for key in ("energies", "positions"):
        if here[key]:
            pairs[key] = (apart(here[key], there[key]), max(apart(here[key], each[key]) for each in older))
    agrees = all(far <= TIMES * max(usual, rounding) for far, usual in pairs.values())
    return Row(kind, agrees, pairs.get("energies"), pairs.get("positions"), there["seconds"])


def described(found: dict[str, Any]) -> str:
    named = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    return f"{found['machine']}, code for {found['processor']}: {named}"


def study(machine: Machine, kinds: Sequence[str]) -> tuple[list[Row], list[str]]:
    """Run the kinds on both machines; the table's rows, and what they ran with."""
    rows, with_what = [], []
    for kind in kinds:
        try:
            here = HERE.found(kind)
            has = {f"+{name}" for name in here["features"]}
            older = [each.found(kind) for each in OLDER if has.issuperset(each.settings[FEATURES].split(","))]
            there = machine.found(kind)
            rows.append(compared(kind, there, here, older))
            with_what = [described(there), f"{described(here)} ({processor()})"]
        except Failure as failure:
            rows.append(Row(kind, False, error=str(failure)))
        print(f"  {' | '.join(rows[-1].cells())} | {rows[-1].seconds:.0f} s {rows[-1].error}", flush=True)
    return rows, with_what


def main() -> int:
    """Set up, run, compare, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="for all that is fetched and made")
    parser.add_argument("--only", nargs="+", metavar="TEXT", help="kinds whose names have that in them")
    parser.add_argument("--processor", default="generic", metavar="NAME", help="to compile for, in LLVM's words")
    parser.add_argument("--page", type=Path, metavar="FILE", help="put the table into that page")
    given = parser.parse_args()
    kinds = [kind for kind in KINDS if given.only is None or any(text in kind for text in given.only)]
    if given.page and len(kinds) < len(KINDS):
        parser.error("--only is a part, and --page wants all")
    if platform.machine() != "x86_64" or sys.platform != "linux":
        parser.error("the emulated machine is compared with x86-64 under Linux; elsewhere run .ci/smoke.py as it is")
    try:
        machine = arm(given.folder.resolve(), given.processor)
        print(output(machine.python[0], "--version").splitlines()[0], flush=True)
        smoke = machine.output(checkout() / ".ci" / "smoke.py") if given.only is None else ""
    except Failure as failure:
        print(f"arm.py: {failure}", file=sys.stderr)
        return 1
    print(smoke, end="", flush=True)
    rows, with_what = study(machine, kinds)
    text = table(HEADING, [row.cells() for row in rows])
    emulated = output(machine.python[0], "--version").splitlines()[0]
    said = "\n".join(f"* {line}" for line in [f"{date.today():%Y-%m-%d}, {emulated}", *with_what])
    print(f"\n{text}\n\n{said}")
    if given.page:
        put(given.page, BEGIN, END, f"{text}\n\n{said}")
    return int(not all(row.agrees for row in rows))


if __name__ == "__main__":
    sys.exit(main())
