"""GROMACS, the program ``gmx`` of a system's package or of an own build: files in a temporary folder, and its runs.

md-vv takes the velocities of an input for those of half a step earlier, so the input has such velocities. GROMACS
chooses the reach of its pair lists by a tolerance for the drift that missed pairs cause, in kJ/mol/ps a particle. The
default, 0.005, is large in reduced units: the energy of this liquid then changes by a hundredth in ten units of time,
which is a hundred times the error of the step. With 1e-5 GROMACS errs as little as the other programs.

In GROMACS' units 1 nm stands for sigma, 1 kJ/mol for epsilon and 1 ps for the unit of time. So the reduced numbers
stand in its files unchanged. Forces and coordinates of the usual builds are float32 ("mixed" precision). Every turn
begins at the same start. Its time is the time that GROMACS itself reports for its steps, without start-up.
"""

import os
import re
import shutil
import subprocess
import tempfile
import weakref
from pathlib import Path

import numpy as np

from kickdrift_validation.performance.liquids import CUTOFF, Liquid
from kickdrift_validation.performance.turns import Missing, Phase, Runner

INSTALL = "gmx is not on PATH; Debian and Ubuntu: apt install gromacs"
NATIVE = "KICKDRIFT_GMX"  # variable with the path of a gmx that was built for this processor
BUILD = f"{NATIVE} names no program gmx that was built for this processor; docs/speed.md shows how to build it"
LEAST = 1e6  # particle steps; in shorter runs its clock and its first steps matter
MDP = """integrator = md-vv
dt = {dt!r}
nsteps = -1
cutoff-scheme = Verlet
coulombtype = Cut-off
rcoulomb = {cutoff}
rvdw = {cutoff}
vdw-modifier = Potential-shift
DispCorr = no
tcoupl = no
pcoupl = no
comm-mode = None
constraints = none
continuation = yes
gen-vel = no
nstxout = {every}
nstvout = {every}
nstenergy = 0
nstcalcenergy = 1000000
nstlog = 0
verlet-buffer-tolerance = {tolerance!r}
nstlist = {interval}
"""
TOPOLOGY = """[ defaults ]
1 1 no 1.0 1.0
[ atomtypes ]
A 1 1.0 0.0 A 4.0 4.0
[ moleculetype ]
A 0
[ atoms ]
1 A 1 A A 1 0.0 1.0
[ system ]
melt
[ molecules ]
A {count}
"""


class Gromacs(Runner):
    """GROMACS' md-vv, velocity Verlet. Pair lists are made at the fastest ``interval`` of steps. With ``native`` the
    variable KICKDRIFT_GMX names the program."""

    def __init__(
        self, start: Liquid, threads: int = 1, tolerance: float = 1e-5, interval: int = 10, native: bool = False
    ) -> None:
        program = shutil.which(os.environ.get(NATIVE) or "." if native else "gmx")
        if program is None:
            raise Missing(BUILD if native else INSTALL)
        self.program, self.start, self.threads = program, start, threads
        self.least = max(20.0, LEAST / len(start.positions))
        self.lists = {"tolerance": tolerance, "interval": interval}
        self.folder = Path(tempfile.mkdtemp(prefix="kickdrift-gromacs-"))
        self.close = weakref.finalize(self, shutil.rmtree, self.folder, True)  # type: ignore[method-assign]
        said = self._gmx("--version")
        values = dict(line.split(":", 1) for line in said.splitlines() if ":" in line)
        build = values.get("SIMD instructions", "").strip()
        self.version = f"{values['GROMACS version'].strip()}, SIMD {build}"
        self.precision = values["Precision"].strip()
        (self.folder / "melt.top").write_text(TOPOLOGY.format(count=len(start.positions)))
        behind = start.velocities - 0.5 * start.dt * start.simulation().forces()
        (self.folder / "start.gro").write_text(gro(start._replace(velocities=behind)))
        self._prepare("turn", 0)
        self._last: Phase = start.positions, start.velocities

    def _gmx(self, *words: str, answer: str = "") -> str:
        """Run gmx and return its output. Raises RuntimeError with the last words of gmx if it fails."""
        environment = {**os.environ, "GMX_MAXBACKUP": "-1", "OMP_NUM_THREADS": str(self.threads)}
        done = subprocess.run(
            [self.program, *words], cwd=self.folder, input=answer, env=environment, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, check=False,
        )  # fmt: skip
        if done.returncode:
            lines = [line.strip() for line in done.stdout.splitlines() if line.strip()]
            raise RuntimeError(f"gmx {words[0]}: {' '.join(lines[-6:])}")
        return done.stdout

    def _prepare(self, name: str, every: int) -> None:
        """Write the input of a run with a frame every so many steps, or without frames for 0."""
        (self.folder / f"{name}.mdp").write_text(MDP.format(dt=self.start.dt, cutoff=CUTOFF, every=every, **self.lists))
        self._gmx(
            "grompp", "-f", f"{name}.mdp", "-c", "start.gro", "-p", "melt.top", "-o", f"{name}.tpr", "-po", "all.mdp",
            "-maxwarn", "9",
        )  # fmt: skip

    def _run(self, name: str, steps: int) -> str:
        self._gmx(
            "mdrun", "-s", f"{name}.tpr", "-nsteps", str(steps), "-ntmpi", "1", "-ntomp", str(self.threads), "-nb",
            "cpu", "-noconfout", "-g", "log", "-o", "frames.trr", "-e", "e.edr", "-cpo", "state.cpt",
        )  # fmt: skip
        log = (self.folder / "log.log").read_text(errors="replace")
        if found := re.search(r"updated every (\d+) steps, buffer ([\d.]+) nm", log):
            self.skin = f"{found[2]}, every {found[1]} steps"
        return log

    def timed(self, amount: float) -> float:
        steps = round(amount)
        log = self._run("turn", steps)
        wall = re.search(r"^\s*Time:\s+[\d.]+\s+([\d.]+)", log, re.M)
        if wall is None:
            raise RuntimeError("gmx mdrun: its log does not say how long it took")
        return steps / float(wall[1])

    def run(self, amount: float) -> float:
        self._last = self.looks(amount, 1)[-1]
        return round(amount)

    def phase(self) -> Phase:
        return self._last

    def looks(self, amount: float, count: int) -> list[Phase]:
        """Phases of a run from the start."""
        every = round(amount / count)
        self._prepare("look", every)
        self._run("look", count * every)
        self._gmx("trjconv", "-s", "look.tpr", "-f", "frames.trr", "-o", "frames.g96", "-vel", "-ndec", "9", answer="0")
        found = frames((self.folder / "frames.g96").read_text())
        if len(found) != count + 1:
            raise RuntimeError(f"gmx mdrun: {len(found)} frames, not {count + 1}")
        return found[1:]


def gro(start: Liquid) -> str:
    """Text of a .gro file with more digits than float32 has."""
    lines = ["melt", str(len(start.positions))]
    for k, (x, v) in enumerate(zip(start.positions, start.velocities, strict=True)):
        number = (k + 1) % 100_000
        places = "".join(f"{value:14.9f}" for value in x) + "".join(f"{value:14.10f}" for value in v)
        lines.append(f"{number:5d}{'A':<5}{'A':>5}{number:5d}{places}")
    return "\n".join([*lines, " ".join(f"{edge:.9f}" for edge in start.edges), ""])


def frames(text: str) -> list[Phase]:
    """Frames of a .g96 file with positions and velocities."""
    blocks = re.findall(r"^(POSITION|VELOCITY)(?:RED)?\n(.*?)^END", text, re.M | re.S)
    kinds: dict[str, list[np.ndarray]] = {"POSITION": [], "VELOCITY": []}
    for kind, lines in blocks:
        rows = [line.split()[-3:] for line in lines.splitlines() if not line.startswith("#")]
        kinds[kind].append(np.array(rows, dtype=float))
    return list(zip(kinds["POSITION"], kinds["VELOCITY"], strict=True))
