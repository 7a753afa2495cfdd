"""Speed of kickdrift beside another build: an earlier commit, or code for another processor.

    python -m docs.studies.against COMMIT [--turns 9] [--only NAME …]
    python -m docs.studies.against --processor haswell

Each build runs in its own process, on the systems of groups.py, from the same numbers. The two take turns (A B A B …).
A ratio is the median over the turns of this build's speed over the other's. Runs on one thread are timed in processor
time. The other commit uses its own groups.py.
"""

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from kickdrift_validation.claim import Claim, claim, show, where
from kickdrift_validation.folders import checkout
from kickdrift_validation.performance.turns import Runner, ratio_of, turns
from kickdrift_validation.processors import FEATURES, settings

CHILD = Path(__file__).with_name("build.py")
TURNS, SECONDS = 9, 0.5


class Case(NamedTuple):
    """One of our contestants in a group, and the share of the other build's speed that it must keep."""

    group: str
    contestant: str = "kickdrift"
    least: float = 0.97

    @property
    def name(self) -> str:
        return self.group + self.contestant.removeprefix("kickdrift").replace(" ", "-")


LOOPS = (
    Case("lj-1000"), Case("lj-1000", "kickdrift mixed"), Case("leapfrog-9"), Case("leapfrog-1000"),
    Case("wisdom-holman-jacobi"), Case("wisdom-holman-heliocentric"), Case("planets"), Case("lj-100000"),
)  # fmt: skip
LIQUIDS = LOOPS[:2]
NARROW, MIXED_GAIN = 0.85, 1.4  # bounds for AVX2: share of the widest vectors' speed; mixed precision over float64


class Build(NamedTuple):
    """A build of kickdrift: its folder, and the environment of its processes."""

    name: str
    top: Path
    environment: dict[str, str]


class Apart(Runner):
    """A case in its own process. The process reads how far to go on, and answers with the distance and the time."""

    def __init__(self, build: Build, case: Case) -> None:
        scripts = build.top / "validation"
        if (scripts / "kickdrift_validation").is_dir():
            groups, folders = "kickdrift_validation.performance.groups", [build.top / "src", scripts]
        else:  # in older commits the scripts were no package
            groups, folders = "groups", [build.top / "src", scripts, scripts / "performance"]
        path = os.pathsep.join([*map(str, folders), os.environ.get("PYTHONPATH", "")])
        command = [sys.executable, "-P", str(CHILD), groups, case.group, case.contestant]
        environment = {**os.environ, **build.environment, "PYTHONPATH": path}
        self.process = subprocess.Popen(
            command, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        self.least = float(self._answer()[0])

    def _answer(self) -> Any:
        assert self.process.stdout
        line = self.process.stdout.readline()
        if not line:
            raise RuntimeError(f"a process ended with status {self.process.wait()}")
        return json.loads(line)

    def timed(self, amount: float) -> float:
        assert self.process.stdin
        print(amount, file=self.process.stdin, flush=True)
        done, seconds = self._answer()
        return done / seconds

    def close(self) -> None:
        assert self.process.stdin
        self.process.stdin.close()
        self.process.wait()


def unpacked(commit: str, folder: Path) -> Path:
    """Unpack all timed files of a commit into the folder."""
    packed = subprocess.run(
        ["git", "-C", str(checkout()), "archive", commit, "src", "systems", "validation"],
        capture_output=True,
        check=False,
    )
    if packed.returncode:
        raise SystemExit(f"against.py: {packed.stderr.decode().strip()}")
    with tarfile.open(fileobj=io.BytesIO(packed.stdout)) as archive:
        archive.extractall(folder, filter="data")
    return folder


def speeds(case: Case, builds: tuple[Build, Build], count: int) -> np.ndarray:
    """Return the amounts a second of both builds, (count, 2)."""
    with ExitStack() as stack:
        runners = []
        for build in builds:
            runners.append(Apart(build, case))
            stack.callback(runners[-1].close)
        return turns(runners, SECONDS, count)


def claims(cases: tuple[Case, ...], builds: tuple[Build, Build], count: int) -> Iterator[Claim]:
    """Yield a claim on the ratio of speeds of each case, as soon as the case is measured."""
    ours, other = builds
    for case in cases:
        found = speeds(case, builds, count)
        ratio = ratio_of(found[:, 0], found[:, 1])
        print(f"  {case.name}: {np.median(found[:, 0]):.5g} a second; ratio {ratio.low:.3f} to {ratio.high:.3f}")
        text = f"{case.name}: speed of {ours.name} over {other.name}'s"
        yield claim(text, ratio.median, f"at least {case.least}", ratio.median >= case.least, f"{count} turns")


def mixed_gain(build: Build, count: int) -> Claim:
    """Return mixed precision's gain over float64, both of this build."""
    with ExitStack() as stack:
        runners = []
        for case in LIQUIDS:
            runners.append(Apart(build, case))
            stack.callback(runners[-1].close)
        found = turns(runners, SECONDS, count)
    ratio = ratio_of(found[:, 1], found[:, 0]).median
    text = f"lj-1000: speed of mixed precision over float64's, {build.name}"
    return claim(text, ratio, f"at least {MIXED_GAIN}", ratio >= MIXED_GAIN, f"{count} turns")


def main() -> int:
    """Measure and print. The exit status is 1 where a bound is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("commit", nargs="?", help="of the other build")
    parser.add_argument("--processor", choices=FEATURES, help="that this build's code is compiled for")
    parser.add_argument("--only", nargs="+", choices=[case.name for case in LOOPS], metavar="NAME")
    parser.add_argument("--turns", type=int, default=TURNS)
    given = parser.parse_args()
    if bool(given.commit) == bool(given.processor):
        parser.error("give a commit or --processor")
    print(where("numpy"), flush=True)
    here = Build("this build", checkout(), {})
    cases = tuple(case for case in LOOPS if not given.only or case.name in given.only)
    if given.processor:
        features = settings(given.processor)
        narrow = Build(f"code for {given.processor}", here.top, features)
        liquids = tuple(case._replace(least=NARROW) for case in LIQUIDS if case in cases)
        return show([*claims(liquids, (narrow, here), given.turns), mixed_gain(narrow, given.turns)])
    with tempfile.TemporaryDirectory() as folder:
        other = Build(given.commit, unpacked(given.commit, Path(folder)), {})
        return show(list(claims(cases, (here, other), given.turns)))


if __name__ == "__main__":
    sys.exit(main())
